//! Connections: they are taken or refused, come to a client or not, and each has its thread.

use std::io::{self, ErrorKind};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use rustix::event::{PollFd, PollFlags, poll};

use super::client::Client;
use super::hub::{Guest, Hub, Joined};
use super::session::{Introduction, Left, Session};
use super::vanish;
use crate::link::tcp::wire::{End, Greeting, Message, Refusal};
use crate::link::tcp::{Came, Channel, DEAD_AFTER, Inbox, Out, PROOF_LEN, ServerTls, Side, Waker, first_message};
use crate::span::Span;
use crate::threads;

/// Connections that have not said what they want yet, at the same time. \[OURS]
const STRANGERS: usize = 16;
/// What a connection that is told why it ends gets for that. \[OURS]
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
    /// Connections that have not said what they want, by number.
    strangers: Mutex<Vec<(u64, TcpStream)>>,
}

impl Shared {
    /// A connection is no stranger any more.
    fn introduced(&self, number: u64) {
        self.strangers.lock().retain(|(other, _)| *other != number);
    }
}

impl Acceptor {
    pub(super) fn start(listener: TcpListener, hub: &Arc<Hub>) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        let waker = Arc::new(Waker::new()?);
        let shared = Arc::new(Shared {
            hub: Arc::clone(hub),
            tls: hub.options.secret.as_ref().map(|_| ServerTls::new()).transpose()?,
            stop: AtomicBool::new(false),
            strangers: Mutex::default(),
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
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    let mut number = 0;
    while !shared.stop.load(Ordering::Acquire) {
        let mut ready = [PollFd::new(listener, PollFlags::IN), PollFd::new(waker.waited(), PollFlags::IN)];
        // A failing wait shows in what comes next.
        let _ = poll(&mut ready, None);
        match listener.accept() {
            Ok((socket, _)) => {
                threads.retain(|thread| !thread.is_finished());
                number += 1;
                match take(socket, number, shared) {
                    Ok(thread) => threads.extend(thread),
                    Err(error) => shared.hub.tell(&format!("a connection is lost: {error}")),
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(error) => {
                shared.hub.tell(&format!("no connection can be taken: {error}"));
                std::thread::sleep(PAUSE);
            }
        }
    }
    for (_, socket) in shared.strangers.lock().iter() {
        let _ = socket.shutdown(std::net::Shutdown::Both);
    }
    for thread in threads {
        let _ = thread.join();
    }
}

/// Greets a connection and gives it a thread, or refuses it.
fn take(socket: TcpStream, number: u64, shared: &Arc<Shared>) -> io::Result<Option<JoinHandle<()>>> {
    let has_room = {
        let mut strangers = shared.strangers.lock();
        let has_room = strangers.len() < STRANGERS;
        if has_room {
            strangers.push((number, socket.try_clone()?));
        }
        has_room
    };
    let taken = greet(socket, has_room, number, shared);
    if has_room && taken.is_err() {
        shared.introduced(number);
    }
    taken
}

fn greet(socket: TcpStream, has_room: bool, number: u64, shared: &Arc<Shared>) -> io::Result<Option<JoinHandle<()>>> {
    let channel = Channel::new(socket)?;
    let mut out = Out::default();
    channel.stage_plain(&Greeting { tls: shared.tls.is_some(), has_room }.encode(), &mut out);
    // A new connection takes so few bytes at once.
    channel.push(&mut out)?;
    if !has_room {
        return Ok(None);
    }
    let shared = Arc::clone(shared);
    threads::spawn("ecmsk-client", move || connection(channel, number, &shared)).map(Some)
}

/// One connection, from its greeting to its end.
fn connection(channel: Channel, number: u64, shared: &Shared) {
    let hub = &shared.hub;
    let from = channel.peer().map(|address| address.to_string()).unwrap_or_default();
    let mut inbox = Inbox::default();
    let joined = introduce(channel, &from, &mut inbox, shared);
    shared.introduced(number);
    let (client, board) = match joined {
        Ok(joined) => joined,
        Err(reason) => return hub.tell(&format!("{from}: {reason}")),
    };
    let Some(channel) = &client.channel else { return };
    hub.tell(&format!("{} is a {}", client.who, role_name(&client)));
    let mut session = Session::new(hub, Arc::clone(&board), Arc::clone(&client));
    let left = converse(channel, &mut inbox, &client, &mut session);
    let is_trusted = matches!(left, Left::Closed) || !hub.has(&board);
    match &left {
        Left::Closed => hub.tell(&format!("{} has closed its link", client.who)),
        Left::Gone(why) => hub.tell(&format!("{} is gone: {why}", client.who)),
        Left::Broken(error) => {
            client.finish(End::Broken, &error.to_string());
            hub.tell(&format!("{} does not keep to the protocol: {error}", client.who));
        }
        Left::Dismissed if hub.has(&board) && !hub.is_stopping() => {
            hub.tell(&format!("{} is gone: it does not take what is sent to it", client.who));
        }
        Left::Dismissed => {}
    }
    // Axes first. And with its place free before it sees the end: a client that closes its link may be back at once.
    if let Some(queue) = hub.leave(&client, is_trusted) {
        vanish::settle(hub, &board, queue, &client.who);
        hub.leave_seat();
    }
    farewell(channel, &client, &mut inbox, matches!(left, Left::Gone(_)));
}

fn role_name(client: &Client) -> &'static str {
    match client.role {
        crate::link::tcp::wire::Role::Writer => "writer",
        crate::link::tcp::wire::Role::Reader => "reader",
    }
}

/// TLS session, hello, proof; or why it is no client.
fn introduce(mut channel: Channel, from: &str, inbox: &mut Inbox, shared: &Shared) -> Result<Joined, String> {
    let options = &shared.hub.options;
    let deadline = Instant::now() + options.hello_limit;
    let silent = |error: io::Error| match error.kind() {
        ErrorKind::TimedOut => format!("it said nothing for {}", Span(options.hello_limit)),
        ErrorKind::UnexpectedEof => "it went before it said what it wants".to_owned(),
        _ => error.to_string(),
    };
    let material = match &shared.tls {
        Some(tls) => {
            let session = tls.accept().map_err(|error| error.to_string())?;
            Some(channel.secure(session, deadline).map_err(silent)?)
        }
        None => None,
    };
    let first = first_message(&channel, inbox, deadline, |message| Introduction::of(&message));
    let said = match first {
        Err(error) if error.kind() == ErrorKind::InvalidData => Err((Refusal::NoHello, error.to_string())),
        first => first.map_err(silent)?,
    };
    let key = options.secret.as_ref().zip(material);
    let proof = key.as_ref().map_or([0; PROOF_LEN], |(secret, material)| secret.prove(Side::Server, material));
    let said = said.and_then(|said| {
        let known = key.as_ref().is_none_or(|(secret, material)| secret.is_proof(Side::Client, material, &said.proof));
        if known { Ok(said) } else { Err((Refusal::WrongSecret, String::new())) }
    });
    let (channel, why, text) = match said {
        Ok(Introduction { role, keepalive, name, .. }) => {
            let who = format!("{name} at {from}");
            let mut guest = Guest { who, role, keepalive, proof: &proof, channel: Some(channel) };
            match shared.hub.join(&mut guest) {
                Ok(joined) => return Ok(joined),
                Err((why, text)) => (guest.channel, why, text),
            }
        }
        Err((why, text)) => (Some(channel), why, text),
    };
    if let Some(channel) = channel {
        let mut out = Out::default();
        let until = Instant::now() + FAREWELL;
        // Whether it hears why is its affair.
        let _ = channel.stage(&Message::Refused { why, text: &text }, &mut out);
        let _ = channel.flush(&mut out, until);
        channel.end(false);
        drain(&channel, inbox, until);
    }
    Err(match why {
        Refusal::HasWriter => format!("refused as a second writer, {text} is the writer"),
        Refusal::NoBoard => format!("refused, there is no board: {text}"),
        Refusal::Full => "refused, there are as many clients as allowed".to_owned(),
        Refusal::WrongSecret => "refused, it does not know the secret".to_owned(),
        Refusal::NoHello => format!("refused, what it said is no hello: {text}"),
    })
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
        *inbox = Inbox::default();
        let left = until.saturating_duration_since(Instant::now());
        match channel.receive(inbox) {
            _ if left.is_zero() => return,
            Ok(Came::Bytes | Came::All) => {}
            Ok(Came::Nothing) if channel.wait(false, Some(left)).is_ok() => {}
            _ => return,
        }
    }
}
