//! What one client asks for, and what it gets. No sockets: any bytes can be tried.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::ServeOptions;
use super::client::Client;
use super::hub::{Board, Guest, Hub};
use crate::link::tcp::wire::{Counts, Failure, Hello, Message, Refusal, Role, WireError};
use crate::link::tcp::{Inbox, PROOF_LEN};
use crate::link::{Dir, Link, LinkError, Wait, check_pass};
use crate::sk::Frame;

/// A write that waits for the board looks this often whether its client has cancelled it. \[OURS]
const SLICE: Duration = Duration::from_millis(10);
/// The board's time that passes in one step of a request on virtual time. \[OURS]
const STEP_NS: u64 = 100_000_000;
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
    /// What was counted before it came.
    before: Counts,
    pending: Option<Pending>,
    /// The frame of the request under way.
    frame: Frame,
    text: String,
}

/// A request that is under way: it is done in steps, between which the client's other messages and its end are seen.
struct Pending {
    request: u64,
    what: What,
}

enum What {
    /// A write of the session's frame, which the board has not taken yet, and its limit; `None`: without.
    Write { until: Option<Instant> },
    /// Virtual time: a read, and how much time may pass; `None`: until there is a report.
    Read { left_ns: Option<u64> },
    /// Virtual time: how much of it has to pass.
    Pass { left_ns: u64 },
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
    pub(super) fn new(hub: &'a Hub, board: Arc<Board>, client: Arc<Client>) -> Self {
        let before = board.counts();
        Self { hub, board, client, before, pending: None, frame: Frame::new(), text: String::new() }
    }

    /// Whether a request is under way: it goes on with [`work`](Self::work).
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
                let counts = self.board.counts().since(&self.before);
                let reports_dropped = counts.reports_dropped + self.client.dropped();
                self.client.reply(&Message::Counted { request, counts: Counts { reports_dropped, ..counts } });
                return Ok(());
            }
            _ if self.client.role != Role::Writer => return Err(out_of_turn),
            _ => {}
        }
        match *message {
            Message::Write { request, wait, frame } => {
                let until = match wait {
                    Wait::Forever => None,
                    Wait::Now => Some(Instant::now()),
                    Wait::For(limit) => Instant::now().checked_add(limit),
                };
                self.frame = Frame::from_bytes(*frame);
                self.begin(request, What::Write { until });
            }
            Message::Read { request, wait } if self.board.info.virtual_time => {
                let left_ns = match wait {
                    Wait::Forever => None,
                    Wait::Now => Some(0),
                    Wait::For(limit) => Some(u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX)),
                };
                self.begin(request, What::Read { left_ns });
            }
            Message::Pass { request, ns } if self.board.info.virtual_time => match check_pass(Duration::from_nanos(ns))
            {
                Ok(()) => self.begin(request, What::Pass { left_ns: ns }),
                Err(error) => self.fail(request, &error),
            },
            _ => return Err(out_of_turn),
        }
        Ok(())
    }

    fn begin(&mut self, request: u64, what: What) {
        self.pending = Some(Pending { request, what });
        self.work();
    }

    /// Goes on with the request that is under way, for a short while.
    pub(super) fn work(&mut self) {
        let Some(pending) = self.pending.take() else { return };
        let request = pending.request;
        let left = match pending.what {
            What::Write { until } => self.write(request, until),
            What::Read { left_ns } => self.read(request, left_ns),
            What::Pass { left_ns } => self.pass(request, left_ns),
        };
        self.pending = left.map(|what| Pending { request, what });
    }

    /// Tries to hand over the frame; gives what is left to do, as the others below.
    fn write(&mut self, request: u64, until: Option<Instant>) -> Option<What> {
        let left = until.map_or(SLICE, |until| until.saturating_duration_since(Instant::now()).min(SLICE));
        let wait = if left.is_zero() { Wait::Now } else { Wait::For(left) };
        match self.board.write(&self.frame, wait) {
            Ok(at) => self.client.reply(&Message::Written { request, at, now: self.board.now() }),
            Err(LinkError::Timeout { .. }) if until.is_none_or(|until| Instant::now() < until) => {
                return Some(What::Write { until });
            }
            Err(error) => self.fail(request, &error),
        }
        None
    }

    fn read(&mut self, request: u64, left_ns: Option<u64>) -> Option<What> {
        // The last step is a long one: a short read costs more time than its limit.
        let step_ns = left_ns.map(|left| if left > 2 * STEP_NS { STEP_NS } else { left });
        let wait = match step_ns {
            None => Wait::Forever,
            Some(0) => Wait::Now,
            Some(step) => Wait::For(Duration::from_nanos(step)),
        };
        match self.board.link.read(&mut self.frame, wait) {
            Ok(meta) => {
                self.hub.publish(&self.board, &self.frame, meta);
                let (now, meta) = (self.board.now(), self.client.count(meta));
                self.client.reply(&Message::Got { request, now, meta, frame: self.frame.bytes() });
            }
            Err(LinkError::Timeout { .. }) if left_ns > step_ns => {
                return Some(What::Read { left_ns: left_ns.zip(step_ns).map(|(left, step)| left - step) });
            }
            Err(error) => self.fail(request, &error),
        }
        None
    }

    fn pass(&mut self, request: u64, left_ns: u64) -> Option<What> {
        let step_ns = left_ns.min(STEP_NS);
        match self.board.link.pass(Duration::from_nanos(step_ns)) {
            Ok(_) if left_ns > step_ns => return Some(What::Pass { left_ns: left_ns - step_ns }),
            Ok(_) => self.client.reply(&Message::Passed { request, now: self.board.now() }),
            Err(error) => self.fail(request, &error),
        }
        None
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
