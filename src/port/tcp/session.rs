//! What one client asks for, and what it gets. No sockets: any bytes can be tried.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::ServeOptions;
use super::client::Client;
use super::hub::{Board, Guest, Hub};
use crate::link::tcp::wire::{Counts, Failure, Hello, Message, Refusal, Role, WireError};
use crate::link::tcp::{Inbox, PROOF_LEN};
use crate::link::{Dir, Link, LinkError, Wait};
use crate::sk::Frame;

/// A write that waits for the board looks this often whether its client has cancelled it. \[OURS]
const SLICE: Duration = Duration::from_millis(10);
/// The longest keep-alive time a client may have: an hour, as its key allows.
const KEEPALIVE_MS: std::ops::RangeInclusive<u32> = 50..=3_600_000;

/// Why a client is no client any more.
#[derive(Debug)]
pub(super) enum Left {
    /// It has closed its link.
    Closed,
    /// It is not there any more; why.
    Gone(String),
    /// It does not keep to the protocol.
    Broken(WireError),
    /// The server has said good-bye to it.
    Dismissed,
}

impl From<WireError> for Left {
    fn from(error: WireError) -> Self {
        Self::Broken(error)
    }
}

/// A client's session.
pub(super) struct Session<'a> {
    hub: &'a Hub,
    board: Arc<Board>,
    client: Arc<Client>,
    pending: Option<Pending>,
    frame: Frame,
    text: String,
}

/// A write that the board has not taken yet.
struct Pending {
    request: u64,
    frame: Frame,
    /// `None`: without limit.
    until: Option<Instant>,
}

/// What a hello says.
pub(super) struct Introduction {
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    pub(super) name: String,
    pub(super) proof: [u8; PROOF_LEN],
}

impl Introduction {
    /// Reads a client's first message; the refusal if it is no hello.
    pub(super) fn of(message: &Message<'_>) -> Result<Self, (Refusal, String)> {
        let Message::Hello(Hello { role, keepalive_ms, pid, program, proof }) = *message else {
            return Err((Refusal::NoHello, WireError::OutOfTurn { kind: message.kind() }.to_string()));
        };
        if !KEEPALIVE_MS.contains(&keepalive_ms) {
            return Err((Refusal::NoHello, format!("a keep-alive time of {keepalive_ms} ms")));
        }
        // What a client calls itself is shown to people.
        let program: String = program.chars().filter(|letter| !letter.is_control()).collect();
        let keepalive = Duration::from_millis(keepalive_ms.into());
        Ok(Self { role, keepalive, name: format!("{program} (PID {pid})"), proof: *proof })
    }
}

impl<'a> Session<'a> {
    pub(super) const fn new(hub: &'a Hub, board: Arc<Board>, client: Arc<Client>) -> Self {
        Self { hub, board, client, pending: None, frame: Frame::new(), text: String::new() }
    }

    /// Whether a write waits for the board.
    pub(super) const fn is_busy(&self) -> bool {
        self.pending.is_some()
    }

    /// Takes a message.
    pub(super) fn take(&mut self, message: &Message<'_>) -> Result<(), Left> {
        let out_of_turn = Left::Broken(WireError::OutOfTurn { kind: message.kind() });
        match *message {
            Message::Ping => return Ok(()),
            Message::Bye { .. } => return Err(Left::Closed),
            Message::Cancel { request } => {
                // It may have been done by now; then the answer is on its way.
                if self.pending.as_ref().is_some_and(|pending| pending.request == request) {
                    self.pending = None;
                    self.fail(request, &LinkError::Cancelled { dir: Dir::Write });
                }
                return Ok(());
            }
            // One at a time.
            _ if self.is_busy() => return Err(out_of_turn),
            Message::Count { request } => {
                let counts = self.board.counts();
                let reports_dropped = counts.reports_dropped + self.client.dropped();
                self.client.reply(&Message::Counted { request, counts: Counts { reports_dropped, ..counts } });
                return Ok(());
            }
            _ if self.client.role != Role::Writer => return Err(out_of_turn),
            _ => {}
        }
        match *message {
            Message::Write { request, wait, frame } => self.write(request, wait, frame),
            Message::Read { request, wait } if self.board.info.virtual_time => self.read(request, wait),
            Message::Pass { request, ns } if self.board.info.virtual_time => self.pass(request, ns),
            _ => return Err(out_of_turn),
        }
        Ok(())
    }

    fn write(&mut self, request: u64, wait: Wait, frame: &[u8; crate::sk::FRAME_LEN]) {
        let frame = Frame::from_bytes(*frame);
        let until = match wait {
            Wait::Forever => None,
            Wait::Now => Some(Instant::now()),
            Wait::For(limit) => Instant::now().checked_add(limit),
        };
        self.pending = Some(Pending { request, frame, until });
        self.work();
    }

    /// Tries to hand over the frame that waits, for a short while.
    pub(super) fn work(&mut self) {
        let Some(pending) = &self.pending else { return };
        let request = pending.request;
        let left = pending.until.map_or(SLICE, |until| until.saturating_duration_since(Instant::now()).min(SLICE));
        let wait = if left.is_zero() { Wait::Now } else { Wait::For(left) };
        match self.board.write(&pending.frame, wait) {
            Ok(at) => {
                self.pending = None;
                self.client.reply(&Message::Written { request, at, now: self.board.now() });
            }
            Err(LinkError::Timeout { .. }) if pending.until.is_none_or(|until| Instant::now() < until) => {}
            Err(error) => {
                self.pending = None;
                self.fail(request, &error);
            }
        }
    }

    fn read(&mut self, request: u64, wait: Wait) {
        match self.board.link.read(&mut self.frame, wait) {
            Ok(meta) => {
                self.hub.publish(&self.board, &self.frame, meta);
                let (now, meta) = (self.board.now(), self.client.count(meta));
                self.client.reply(&Message::Got { request, now, meta, frame: self.frame.bytes() });
            }
            Err(error) => self.fail(request, &error),
        }
    }

    fn pass(&mut self, request: u64, ns: u64) {
        match self.board.link.pass(Duration::from_nanos(ns)) {
            Ok(now) => self.client.reply(&Message::Passed { request, now }),
            Err(error) => self.fail(request, &error),
        }
    }

    fn fail(&mut self, request: u64, error: &LinkError) {
        let now = self.board.now();
        let failure = Failure::of(error, &mut self.text);
        self.client.reply(&Message::Failed { request, now, failure });
        if matches!(error, LinkError::Lost { .. } | LinkError::Closed) {
            self.hub.lose(&self.board, error);
        }
    }
}

/// What a server of `link` says to a client that sends these bytes and does not listen meanwhile.
#[doc(hidden)]
pub fn answer(link: Arc<dyn Link>, bytes: &[u8]) -> Vec<u8> {
    let hub = Hub::new(ServeOptions::default());
    let board = hub.attach(link);
    let mut inbox = Inbox::default();
    let mut left = bytes;
    let mut session = None;
    loop {
        loop {
            let message = match inbox.next() {
                Ok(Some(message)) => message,
                Ok(None) => break,
                Err(_) => return said(&session),
            };
            match &mut session {
                None => {
                    let Ok(hello) = Introduction::of(&message) else { return Vec::new() };
                    let Introduction { role, keepalive, name, .. } = hello;
                    let mut guest = Guest { who: name, role, keepalive, proof: &[0; PROOF_LEN], channel: None };
                    let Ok((client, board)) = hub.join(&mut guest) else { return Vec::new() };
                    session = Some((Session::new(&hub, board, Arc::clone(&client)), client));
                }
                Some((session, client)) => {
                    if session.take(&message).is_err() || client.is_over() || !hub.has(&board) {
                        return said(&Some((session, Arc::clone(client))));
                    }
                    // Nobody else has the board, so what it does not take now it never takes.
                    session.pending = None;
                }
            }
        }
        if left.is_empty() {
            return said(&session);
        }
        let room = inbox.room();
        let count = room.len().min(left.len());
        room[..count].copy_from_slice(&left[..count]);
        left = &left[count..];
        inbox.came(count);
    }
}

fn said<T>(session: &Option<(T, Arc<Client>)>) -> Vec<u8> {
    session.as_ref().map(|(_, client)| client.take_sent()).unwrap_or_default()
}
