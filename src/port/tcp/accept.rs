//! Connections: one thread takes them and hears what they want; those that become clients have a thread each.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::client::Client;
use super::hub::{Board, Guest, Hub};
use super::pool::Pool;
use super::repeats::Repeats;
use super::session::{Introduction, Left, Session};
use super::stranger::{Look, Stranger};
use super::vanish;
use crate::link::tcp::wire::{End, Refusal, Role};
use crate::link::tcp::{Came, Channel, DEAD_AFTER, Inbox, ServerTls, Waker};
use crate::span::Span;
use crate::threads;

/// Connections that the system keeps until they are taken: as many as it likes. \[OURS]
const BACKLOG: i32 = 4096;
/// Connections that are taken at once before those there are looked after. \[OURS]
const AT_ONCE: usize = 16;
/// What a client that is told why it ends gets for that. \[OURS]
const FAREWELL: Duration = Duration::from_millis(500);
/// After the system has given no connection. \[OURS]
const PAUSE: Duration = Duration::from_millis(50);

/// The thread that listens.
pub(super) struct Acceptor {
    shared: Arc<Shared>,
    waker: Arc<Waker>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    hub: Arc<Hub>,
    tls: Option<ServerTls>,
    stop: AtomicBool,
    repeats: Mutex<Repeats>,
}

impl Shared {
    /// Notes a line of which there may be many, the more so if somebody wants it. Lines of the same `kind` are counted.
    fn tell_of(&self, kind: &str, line: &str) {
        let is_told = self.repeats.lock().is_told(kind, Instant::now());
        if is_told {
            self.hub.tell(line);
        }
    }

    /// Notes what was counted.
    fn tell_counted(&self, now: Instant) {
        let lines = self.repeats.lock().due(now);
        lines.iter().for_each(|line| self.hub.tell(line));
    }
}

impl Acceptor {
    pub(super) fn start(listener: TcpListener, hub: &Arc<Hub>) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        // More than the standard library asks for: who comes in a crowd waits in the system instead of being turned away.
        rustix::net::listen(&listener, BACKLOG)?;
        let waker = Arc::new(Waker::new()?);
        let shared = Arc::new(Shared {
            hub: Arc::clone(hub),
            tls: hub.options.secret.as_ref().map(|_| ServerTls::new()).transpose()?,
            stop: AtomicBool::new(false),
            repeats: Mutex::default(),
        });
        let thread = threads::spawn("ecmsk-listen", {
            let (shared, waker) = (Arc::clone(&shared), Arc::clone(&waker));
            move || listen(&listener, &waker, &shared)
        })?;
        Ok(Self { shared, waker, thread: Some(thread) })
    }

    /// Ends it and every connection; clients have been told before.
    pub(super) fn stop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.waker.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn listen(listener: &TcpListener, waker: &Waker, shared: &Arc<Shared>) {
    let mut pool = Pool::default();
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    let mut next_try = Instant::now();
    while !shared.stop.load(Ordering::Acquire) {
        let now = Instant::now();
        wait(listener, waker, &mut pool, now, next_try, shared);
        let now = Instant::now();
        // Who is there first: it may be about to say what it wants.
        for (mut stranger, look) in pool.look(now, &shared.hub.options) {
            match look {
                Look::Waits => {}
                Look::Introduced(said) => {
                    threads.retain(|thread| !thread.is_finished());
                    match let_in(stranger, said, now, shared) {
                        Ok(thread) => threads.extend(thread),
                        Err(stranger) => pool.put_back(stranger),
                    }
                }
                Look::Refused(why, text) => {
                    tell_refused(stranger.from, why, &text, shared);
                    stranger.refuse(why, &text, now);
                    pool.put_back(stranger);
                }
                Look::Ended(reason) => {
                    if let Some(reason) = reason {
                        tell_ended(stranger.from, &reason, shared);
                    }
                }
            }
        }
        if !take(listener, &mut pool, shared) {
            next_try = Instant::now() + PAUSE;
        }
        shared.tell_counted(now);
    }
    drop(pool);
    for thread in threads {
        let _ = thread.join();
    }
    let lines = shared.repeats.lock().end();
    lines.iter().for_each(|line| shared.hub.tell(line));
}

/// Waits until somebody comes or says something, until a time is over, or for the end.
fn wait(listener: &TcpListener, waker: &Waker, pool: &mut Pool, now: Instant, next_try: Instant, shared: &Shared) {
    // Of one moment: whoever does not wait for the listener has to wait for the time at which there is room.
    let takes = pool.has_room(now) && now >= next_try;
    let times = [
        pool.next_time(now, &shared.hub.options),
        shared.repeats.lock().next_due(),
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
    // A failing wait shows in what comes next.
    let _ = poll(&mut fds, limit.as_ref());
    if !fds[0].revents().is_empty() {
        waker.seen();
    }
    let ready: Vec<bool> = fds[first..].iter().map(|fd| !fd.revents().is_empty()).collect();
    drop(fds);
    pool.note_ready(&ready);
}

/// Takes those who have come, as far as there is room; says whether the system gave what was needed.
fn take(listener: &TcpListener, pool: &mut Pool, shared: &Shared) -> bool {
    for _ in 0..AT_ONCE {
        let now = Instant::now();
        if !pool.has_room(now) {
            return true;
        }
        match listener.accept() {
            Ok((socket, from)) => match Stranger::greet(socket, from, now, shared.tls.as_ref()) {
                Ok(stranger) => {
                    if let Some(evicted) = pool.add(stranger, now) {
                        tell_ended(evicted.from, "it had not said what it wants, and made room for others", shared);
                    }
                }
                Err(error) => shared.tell_of(
                    &format!("a connection from {} is lost: {error}", from.ip()),
                    &format!("a connection from {from} is lost: {error}"),
                ),
            },
            Err(error) if error.kind() == ErrorKind::WouldBlock => return true,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => {
                let line = format!("no connection can be taken: {error}");
                shared.tell_of(&line, &line);
                // It may be files that are missing: strangers have some.
                pool.drop_oldest();
                return false;
            }
        }
    }
    true
}

/// Makes a client of a stranger, with a thread; or gives it back, refused.
fn let_in(
    stranger: Box<Stranger>,
    said: Introduction,
    now: Instant,
    shared: &Arc<Shared>,
) -> Result<Option<JoinHandle<()>>, Box<Stranger>> {
    let Introduction { role, keepalive, name, .. } = said;
    let from = stranger.from;
    let kind = format!("{} at {} is a {}", program(&name), from.ip(), role_name(role));
    let proof = stranger.proof(&shared.hub.options);
    let (mut channel, inbox) = stranger.into_parts();
    if let Err(error) = channel.make_wakeable() {
        shared.tell_of(&kind, &format!("{name} at {from} is lost: {error}"));
        return Ok(None);
    }
    let mut guest = Guest { who: format!("{name} at {from}"), role, keepalive, proof: &proof, channel: Some(channel) };
    let (client, board) = match shared.hub.join(&mut guest) {
        Ok(joined) => joined,
        Err((why, text)) => {
            tell_refused(from, why, &text, shared);
            let Some(channel) = guest.channel else { return Ok(None) };
            let mut stranger = Stranger::again(channel, inbox, from, now);
            stranger.refuse(why, &text, now);
            return Err(stranger);
        }
    };
    shared.tell_of(&kind, &format!("{} is a {}", client.who, role_name(role)));
    let thread = threads::spawn("ecmsk-client", {
        let (client, shared) = (Arc::clone(&client), Arc::clone(shared));
        move || connection(client, &board, inbox, &shared)
    });
    match thread {
        Ok(thread) => Ok(Some(thread)),
        Err(error) => {
            shared.hub.leave(&client, true);
            shared.hub.tell(&format!("{} is lost, there is no thread for it: {error}", client.who));
            Ok(None)
        }
    }
}

/// A client, from its welcome to its end.
fn connection(client: Arc<Client>, board: &Arc<Board>, mut inbox: Inbox, shared: &Shared) {
    let hub = &shared.hub;
    let Some(channel) = &client.channel else { return };
    let mut session = Session::new(hub, Arc::clone(board), Arc::clone(&client));
    let left = converse(channel, &mut inbox, &client, &mut session);
    // Axes first. And with its place free before it sees the end: a client that closes its link may be back at once.
    vanish::part(hub, board, &client, &left);
    match &left {
        Left::Closed => {
            let at = channel.peer().map(|from| from.ip().to_string()).unwrap_or_default();
            shared.tell_of(
                &format!("{} at {at} has closed its link", program(&client.who)),
                &format!("{} has closed its link", client.who),
            );
        }
        Left::Gone(why) => hub.tell(&format!("{} is gone: {why}", client.who)),
        Left::Broken(error) => {
            client.finish(End::Broken, &error.to_string());
            hub.tell(&format!("{} does not keep to the protocol: {error}", client.who));
        }
        Left::Dismissed if hub.has(board) && !hub.is_stopping() => {
            hub.tell(&format!("{} is gone: it does not take what is sent to it", client.who));
        }
        Left::Dismissed => {}
    }
    farewell(channel, &client, &mut inbox, matches!(left, Left::Gone(_)));
}

const fn role_name(role: Role) -> &'static str {
    match role {
        Role::Writer => "writer",
        Role::Reader => "reader",
    }
}

/// The program in the name of a client, without its process.
fn program(name: &str) -> &str {
    name.split(" (PID ").next().unwrap_or(name)
}

fn tell_ended(from: SocketAddr, reason: &str, shared: &Shared) {
    shared.tell_of(&format!("{}: {reason}", from.ip()), &format!("{from}: {reason}"));
}

fn tell_refused(from: SocketAddr, why: Refusal, text: &str, shared: &Shared) {
    let reason = match why {
        Refusal::HasWriter => format!("refused as a second writer, {text} is the writer"),
        Refusal::NoBoard => format!("refused, there is no board: {text}"),
        Refusal::Full => "refused, there are as many clients as allowed".to_owned(),
        Refusal::WrongSecret => "refused, it does not know the secret".to_owned(),
        Refusal::NoHello => format!("refused, what it said is no hello: {text}"),
    };
    tell_ended(from, &reason, shared);
}

/// Takes what a client says until it is none any more.
fn converse(channel: &Channel, inbox: &mut Inbox, client: &Client, session: &mut Session<'_>) -> Left {
    let mut heard = Instant::now();
    let patience = client.keepalive * DEAD_AFTER;
    let mut is_drained = false;
    loop {
        // What came with the hello is in the inbox already.
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
        // All that had come is done: what comes now ends the wait.
        let came = if std::mem::take(&mut is_drained) { Ok(Came::Nothing) } else { channel.receive(inbox) };
        match came {
            Ok(came @ (Came::Bytes | Came::All)) => {
                heard = Instant::now();
                is_drained = came == Came::All;
                continue;
            }
            Ok(Came::Nothing) => {}
            Ok(Came::End) => return Left::Gone("it has ended without closing its link".to_owned()),
            Err(error) => return Left::Gone(error.to_string()),
        }
        let silent = heard.elapsed();
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

/// Sends what is left, and lets the client see the end before the connection is torn down.
fn farewell(channel: &Channel, client: &Client, inbox: &mut Inbox, is_gone: bool) {
    let until = Instant::now() + FAREWELL;
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

/// Throws away what comes: closing a connection with unread bytes in it would take away what was sent.
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
