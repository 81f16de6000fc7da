//! Accepts connections and serves them. One thread accepts them and receives their first message; each connection that
//! becomes a client gets a thread of its own.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::board::Board;
use super::client::Client;
use super::hub::{Hub, Joining};
use super::pending::{Look, PendingConnection};
use super::pending_pool::PendingPool;
use super::session::{Introduction, Left, Session};
use super::vanish;
use crate::port::log_limit::LogLimit;
use crate::span::Span;
use crate::tcp::wire::{End, Refusal, Role};
use crate::tcp::{Came, Channel, Inbox, ServerTls, Waker, patience};
use crate::threads;

/// How many connections the system may queue until they are accepted (the backlog of `listen`). The system may lower
/// this value. \[OURS]
const BACKLOG: i32 = 4096;
/// How many connections are accepted in a row before the server checks again whether pending connections have sent
/// their Hello. \[OURS]
const ACCEPTED_IN_A_ROW_MAX: usize = 16;
/// How long the server waits until a client has received why its connection ends. \[OURS]
const FAREWELL_MAX: Duration = Duration::from_millis(500);
/// The pause after an error of `accept`, for example because no file descriptor was left. \[OURS]
const ACCEPT_RETRY_PAUSE: Duration = Duration::from_millis(50);

/// The listening thread, and the data to stop it.
pub(super) struct Acceptor {
    shared: Arc<Shared>,
    waker: Arc<Waker>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    hub: Arc<Hub>,
    tls: Option<ServerTls>,
    stop: AtomicBool,
    log_limit: Mutex<LogLimit>,
}

impl Shared {
    /// Logs a line that clients can cause as often as they like. If there are too many lines of the same `kind`,
    /// further ones are only counted.
    fn log_limited(&self, kind: &str, line: &str) {
        let may_log = self.log_limit.lock().may_log(kind, Instant::now());
        if may_log {
            self.hub.tell(line);
        }
    }

    /// Logs how many lines were suppressed by the limit of each kind, when this is due.
    fn log_counted(&self, now: Instant) {
        let lines = self.log_limit.lock().due(now);
        lines.iter().for_each(|line| self.hub.tell(line));
    }
}

impl Acceptor {
    pub(super) fn start(listener: TcpListener, hub: &Arc<Hub>) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        // The standard library requests a shorter queue. With this one, many simultaneous connections wait instead of
        // being rejected.
        rustix::net::listen(&listener, BACKLOG)?;
        let waker = Arc::new(Waker::new()?);
        let shared = Arc::new(Shared {
            hub: Arc::clone(hub),
            tls: hub.options.secret.as_ref().map(|_| ServerTls::new()).transpose()?,
            stop: AtomicBool::new(false),
            log_limit: Mutex::default(),
        });
        let thread = threads::spawn("ecmsk-listen", {
            let (shared, waker) = (Arc::clone(&shared), Arc::clone(&waker));
            move || listen(&listener, &waker, &shared)
        })?;
        Ok(Self { shared, waker, thread: Some(thread) })
    }

    /// Notifies all clients, and ends their connections and the listening thread.
    pub(super) fn stop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.waker.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn listen(listener: &TcpListener, waker: &Waker, shared: &Arc<Shared>) {
    let mut pool = PendingPool::default();
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    let mut next_try = Instant::now();
    while !shared.stop.load(Ordering::Acquire) {
        let now = Instant::now();
        wait(listener, waker, &mut pool, now, next_try, shared);
        let now = Instant::now();
        // Pending connections come before new ones: their first message may have arrived.
        for (mut pending, look) in pool.look(now, &shared.hub.options) {
            match look {
                Look::Waits => {}
                Look::Introduced(hello) => {
                    threads.retain(|thread| !thread.is_finished());
                    match start_client(pending, hello, now, shared) {
                        Ok(thread) => threads.extend(thread),
                        Err(pending) => pool.put_back(pending),
                    }
                }
                Look::Refused(why, text) => {
                    log_refused(pending.from, why, &text, shared);
                    pending.refuse(why, &text, now);
                    pool.put_back(pending);
                }
                Look::Ended(reason) => {
                    if let Some(reason) = reason {
                        log_ended(pending.from, &reason, shared);
                    }
                }
            }
        }
        if !accept_pending(listener, &mut pool, shared) {
            next_try = Instant::now() + ACCEPT_RETRY_PAUSE;
        }
        shared.log_counted(now);
    }
    drop(pool);
    for thread in threads {
        let _ = thread.join();
    }
    let lines = shared.log_limit.lock().end();
    lines.iter().for_each(|line| shared.hub.tell(line));
}

/// Waits until a connection or bytes arrive, until a deadline has passed, or until the server ends.
fn wait(
    listener: &TcpListener,
    waker: &Waker,
    pool: &mut PendingPool,
    now: Instant,
    next_try: Instant,
    shared: &Shared,
) {
    // The listener is polled only if `takes` is true. If it is false, the wait has to end when there is room again, so
    // that time is among the deadlines. Both are calculated with the same `now`, so that they agree.
    let takes = pool.has_room(now) && now >= next_try;
    let times = [
        pool.next_time(now, &shared.hub.options),
        shared.log_limit.lock().next_due(),
        (next_try > now).then_some(next_try),
    ];
    let limit = times.into_iter().flatten().min().map(|until| until.saturating_duration_since(now));
    let limit = limit.and_then(|limit| Timespec::try_from(limit).ok());
    let mut fds = vec![PollFd::new(waker.waited(), PollFlags::IN)];
    if takes {
        fds.push(PollFd::new(listener, PollFlags::IN));
    }
    let first = fds.len();
    fds.extend(pool.waits_for());
    // If the wait fails, the following calls on the sockets report the error.
    let _ = poll(&mut fds, limit.as_ref());
    if !fds[0].revents().is_empty() {
        waker.seen();
    }
    let ready: Vec<bool> = fds[first..].iter().map(|fd| !fd.revents().is_empty()).collect();
    drop(fds);
    pool.note_ready(&ready);
}

/// Accepts connections as far as there is room; returns false if the system could not provide one.
fn accept_pending(listener: &TcpListener, pool: &mut PendingPool, shared: &Shared) -> bool {
    for _ in 0..ACCEPTED_IN_A_ROW_MAX {
        let now = Instant::now();
        if !pool.has_room(now) {
            return true;
        }
        match listener.accept() {
            Ok((socket, from)) => {
                let secured = shared.tls.as_ref().zip(shared.hub.secret());
                match PendingConnection::greet(socket, from, now, secured) {
                    Ok(pending) => {
                        if let Some(evicted) = pool.add(pending, now) {
                            log_ended(evicted.from, "it had not said what it wants, and made room for others", shared);
                        }
                    }
                    Err(error) => shared.log_limited(
                        &format!("a connection from {} is lost: {error}", from.ip()),
                        &format!("a connection from {from} is lost: {error}"),
                    ),
                }
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => return true,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => {
                let line = format!("no connection can be taken: {error}");
                shared.log_limited(&line, &line);
                // The process may have run out of file descriptors. Closing a pending connection frees one; the oldest
                // has had the most time for its Hello.
                pool.drop_oldest();
                return false;
            }
        }
    }
    true
}

/// Makes a pending connection a client with a thread, or returns the connection if it was refused. `Ok(None)`: the
/// client is lost, because the system provides no thread or file handle for it.
fn start_client(
    pending: Box<PendingConnection>,
    hello: Introduction,
    now: Instant,
    shared: &Arc<Shared>,
) -> Result<Option<JoinHandle<()>>, Box<PendingConnection>> {
    let Introduction { role, keepalive, name, .. } = hello;
    let from = pending.from;
    let kind = format!("{} at {} is a {}", program(&name), from.ip(), role_name(role));
    let proof = pending.proof();
    let (mut channel, inbox) = pending.into_parts();
    if let Err(error) = channel.make_wakeable() {
        shared.log_limited(&kind, &format!("{name} at {from} is lost: {error}"));
        return Ok(None);
    }
    let mut joining =
        Joining { who: format!("{name} at {from}"), role, keepalive, proof: &proof, channel: Some(channel) };
    let (client, board) = match shared.hub.join(&mut joining) {
        Ok(joined) => joined,
        Err((why, text)) => {
            log_refused(from, why, &text, shared);
            let Some(channel) = joining.channel else { return Ok(None) };
            let mut pending = PendingConnection::from_client(channel, inbox, from, now);
            pending.refuse(why, &text, now);
            return Err(pending);
        }
    };
    shared.log_limited(&kind, &format!("{} is a {}", client.name, role_name(role)));
    let thread = threads::spawn("ecmsk-client", {
        let (client, shared) = (Arc::clone(&client), Arc::clone(shared));
        move || connection(client, &board, inbox, &shared)
    });
    match thread {
        Ok(thread) => Ok(Some(thread)),
        Err(error) => {
            shared.hub.leave(&client, true);
            shared.hub.tell(&format!("{} is lost, there is no thread for it: {error}", client.name));
            Ok(None)
        }
    }
}

/// The body of a client's thread, from the Welcome until the connection ends.
fn connection(client: Arc<Client>, board: &Arc<Board>, mut inbox: Inbox, shared: &Shared) {
    let hub = &shared.hub;
    let Some(channel) = &client.channel else { return };
    let mut session = Session::new(hub, Arc::clone(board), Arc::clone(&client));
    let left = serve_client(channel, &mut inbox, &client, &mut session);
    session.finish_stop();
    // The axes are stopped and the client's place is freed before `farewell` ends the connection, because a program may
    // open its link again as soon as it sees this end.
    vanish::client_left(hub, board, &client, &left);
    match &left {
        Left::Closed => {
            let at = channel.peer().map(|from| from.ip().to_string()).unwrap_or_default();
            shared.log_limited(
                &format!("{} at {at} has closed its link", program(&client.name)),
                &format!("{} has closed its link", client.name),
            );
        }
        Left::Gone(why) => hub.tell(&format!("{} is gone: {why}", client.name)),
        Left::Broken(error) => {
            client.finish(End::Broken, &error.to_string());
            hub.tell(&format!("{} does not keep to the protocol: {error}", client.name));
        }
        Left::Displaced => {
            let at = channel.peer().map(|from| from.ip().to_string()).unwrap_or_default();
            let what = "asked for nothing, and made room for another";
            shared
                .log_limited(&format!("{} at {at} {what}", program(&client.name)), &format!("{} {what}", client.name));
        }
        Left::Overruled(by) => hub.tell(&format!("{} was stopped by {by}", client.name)),
        Left::Dismissed if hub.has(board) && !hub.is_stopping() => {
            hub.tell(&format!("{} is gone: it does not take what is sent to it", client.name));
        }
        Left::Dismissed => {}
    }
    farewell(channel, &client, &mut inbox, matches!(left, Left::Gone(_)));
}

const fn role_name(role: Role) -> &'static str {
    match role {
        Role::Writer => "writer",
        Role::Reader => "reader",
        Role::Stopper => "client that asks for a stop",
        Role::Asker => "client that asks for the machine file",
    }
}

/// The name of a client's program: the client's name without its process id.
fn program(name: &str) -> &str {
    name.split(" (PID ").next().unwrap_or(name)
}

fn log_ended(from: SocketAddr, reason: &str, shared: &Shared) {
    shared.log_limited(&format!("{}: {reason}", from.ip()), &format!("{from}: {reason}"));
}

fn log_refused(from: SocketAddr, why: Refusal, text: &str, shared: &Shared) {
    let reason = match why {
        Refusal::HasWriter => format!("refused as a second writer, {text} is the writer"),
        Refusal::NoBoard => format!("refused, there is no board: {text}"),
        Refusal::Full => "refused, there are as many clients as allowed".to_owned(),
        Refusal::WrongSecret => "refused, it does not know the secret".to_owned(),
        Refusal::NoHello => format!("refused, what it said is no hello: {text}"),
    };
    log_ended(from, &reason, shared);
}

/// Handles a client's messages until the connection ends. Returns the reason of the end.
fn serve_client(channel: &Channel, inbox: &mut Inbox, client: &Client, session: &mut Session<'_>) -> Left {
    let mut last_message = Instant::now();
    let patience = patience(client.keepalive);
    let mut is_drained = false;
    loop {
        if let Err(left) = session.check_dismissed() {
            return left;
        }
        // The inbox may already contain messages that arrived together with the Hello.
        loop {
            match inbox.next() {
                Ok(None) => break,
                Ok(Some(message)) => {
                    if let Err(left) = session.take(&message) {
                        return left;
                    }
                }
                Err(error) => return error.into(),
            }
        }
        if client.is_over() {
            return Left::Dismissed;
        }
        session.work();
        // After `Came::All` the socket is empty, so a second system call to receive is avoided: bytes that arrive later
        // end the wait below.
        let came = if std::mem::take(&mut is_drained) { Ok(Came::Nothing) } else { channel.receive(inbox) };
        match came {
            Ok(came @ (Came::Bytes | Came::All)) => {
                last_message = Instant::now();
                is_drained = came == Came::All;
                continue;
            }
            Ok(Came::Nothing) => {}
            Ok(Came::End) => return Left::Gone("it has ended without closing its link".to_owned()),
            Err(error) => return Left::Gone(error.to_string()),
        }
        let silent = last_message.elapsed();
        if silent > patience {
            return Left::Gone(format!("no word for {}", Span(silent)));
        }
        client.ping();
        if session.is_busy() {
            continue;
        }
        let limit = (client.keepalive / 4).min(patience - silent);
        if let Err(error) = channel.wait(client.is_blocked(), Some(limit)) {
            return Left::Gone(error.to_string());
        }
        if client.is_blocked() {
            client.flush();
        }
    }
}

/// Sends the remaining bytes to a client, and waits at most [`FAREWELL_MAX`] for the client to receive them before the
/// connection is closed.
fn farewell(channel: &Channel, client: &Client, inbox: &mut Inbox, is_gone: bool) {
    let until = Instant::now() + FAREWELL_MAX;
    while !is_gone && client.is_blocked() && Instant::now() < until {
        let left = until.saturating_duration_since(Instant::now());
        if channel.wait(true, Some(left)).is_err() {
            break;
        }
        client.flush();
    }
    channel.end(is_gone);
    if !is_gone {
        drain(channel, inbox, until);
    }
}

/// Reads and discards bytes from the client until it closes its end: the system would discard sent bytes too if a
/// connection were closed with unread ones.
fn drain(channel: &Channel, inbox: &mut Inbox, until: Instant) {
    loop {
        inbox.clear();
        let left = until.saturating_duration_since(Instant::now());
        match channel.receive(inbox) {
            _ if left.is_zero() => return,
            Ok(Came::Bytes | Came::All) => {}
            Ok(Came::Nothing) if channel.wait(false, Some(left)).is_ok() => {}
            _ => return,
        }
    }
}
