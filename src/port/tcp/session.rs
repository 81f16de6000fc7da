//! The requests of one client and their answers. Without sockets, so that tests can feed any bytes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::ServeOptions;
use super::board::Board;
use super::client::Client;
use super::hub::{Hub, Joining, StopProgress, StopStep};
use super::vanish;
use crate::link::{Dir, Link, LinkError, Wait, check_pass};
use crate::sk::Frame;
use crate::tcp::wire::{Counts, End, Failure, Hello, Message, PART_MAX, Refusal, Role, WireError};
use crate::tcp::{Inbox, PROOF_LEN};

/// How often a write that waits for the board checks whether its client has cancelled it. \[OURS]
const WRITE_SLICE: Duration = Duration::from_millis(10);
/// How long a stop waits for the thread that brings the axes to a standstill, before its client's messages are handled
/// again. \[OURS]
const STOP_SLICE: Duration = Duration::from_millis(10);
/// How far the board's time advances in one step of a request on virtual time, ns: 100 ms. Between two steps the server
/// can notice that the client has gone. \[OURS]
const TIME_STEP_NS: u64 = 100_000_000;
/// The keep-alive times that a client may ask for, ms: the range of the key `keepalive_ms` of its link.
const KEEPALIVE_RANGE_MS: std::ops::RangeInclusive<u32> = 50..=3_600_000;

/// The reason why a client's session has ended.
#[derive(Debug)]
pub(super) enum Left {
    /// The client has closed its link.
    Closed,
    /// The connection has ended without a Bye; the reason as text.
    Gone(String),
    /// The client has violated the protocol.
    Broken(WireError),
    /// Another client, which the text names, has asked for a stop.
    Overruled(String),
    /// The client has asked for nothing, and has made room for another one.
    Displaced,
    /// The server has ended the connection.
    Dismissed,
}

impl From<WireError> for Left {
    fn from(error: WireError) -> Self {
        Self::Broken(error)
    }
}

/// The session of one client: its requests and the state that they need.
pub(super) struct Session<'a> {
    hub: &'a Arc<Hub>,
    board: Arc<Board>,
    client: Arc<Client>,
    /// The counters of the board's link when the session began. Answers about counters give the increase since then.
    before: Counts,
    pending: Option<Pending>,
    /// The command frame of the write in progress.
    frame: Frame,
    text: String,
}

/// A request in progress. It is executed in steps, between which further messages of the client and the end of its
/// connection are handled.
struct Pending {
    request: u64,
    work: Work,
}

/// The part of a request that is still to be done.
enum Work {
    /// A write: the board has not accepted the session's frame yet; `until` is the time limit, `None` is no limit.
    Write { until: Option<Instant> },
    /// On virtual time: a read. `left_ns`: how far the time may still advance; `None`: until there is a report.
    Read { left_ns: Option<u64> },
    /// On virtual time: advances the time by `left_ns` more.
    Pass { left_ns: u64 },
    /// A stop of the axes; `off`: the axes are switched off at standstill.
    Stop { off: bool, progress: StopProgress },
}

/// What a client's first message, the Hello, says about it.
pub(super) struct Introduction {
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    pub(super) name: String,
    pub(super) proof: [u8; PROOF_LEN],
}

impl Introduction {
    /// Decodes a client's first message. The error is the reason to refuse the client, if the message is not a valid
    /// Hello.
    pub(super) fn of(message: &Message<'_>) -> Result<Self, (Refusal, String)> {
        let Message::Hello(Hello { role, keepalive_ms, pid, program, proof }) = *message else {
            return Err((Refusal::NoHello, WireError::OutOfTurn { kind: message.kind() }.to_string()));
        };
        if !KEEPALIVE_RANGE_MS.contains(&keepalive_ms) {
            return Err((Refusal::NoHello, format!("a keep-alive time of {keepalive_ms} ms")));
        }
        // The name is shown in logs, so control characters are removed.
        let program: String = program.chars().filter(|letter| !letter.is_control()).collect();
        let keepalive = Duration::from_millis(keepalive_ms.into());
        Ok(Self { role, keepalive, name: format!("{program} (PID {pid})"), proof: *proof })
    }
}

impl<'a> Session<'a> {
    pub(super) fn new(hub: &'a Arc<Hub>, board: Arc<Board>, client: Arc<Client>) -> Self {
        let before = board.counts();
        Self { hub, board, client, before, pending: None, frame: Frame::new(), text: String::new() }
    }

    /// Whether a request is in progress, which [`work`](Self::work) continues.
    pub(super) const fn is_busy(&self) -> bool {
        self.pending.is_some()
    }

    /// Ends the session if the client was dismissed. A request in progress is dropped: the board has not executed it. The
    /// Bye is sent here, in the thread of the client, so that it comes after the answer to each request that was executed.
    pub(super) fn check_dismissed(&self) -> Result<(), Left> {
        let Some(dismissal) = self.client.dismissal() else { return Ok(()) };
        self.client.finish(dismissal.end, &dismissal.text);
        Err(match dismissal.end {
            End::Overruled => Left::Overruled(dismissal.text.clone()),
            End::Broken => Left::Displaced,
            _ => Left::Dismissed,
        })
    }

    /// Handles a message of the client. The error ends the session.
    pub(super) fn take(&mut self, message: &Message<'_>) -> Result<(), Left> {
        let out_of_turn = Left::Broken(WireError::OutOfTurn { kind: message.kind() });
        match *message {
            Message::Ping => return Ok(()),
            Message::Bye { .. } => return Err(Left::Closed),
            Message::Cancel { request } => {
                // If the request has been executed meanwhile, its answer has been sent already.
                if self.pending.as_ref().is_some_and(|pending| pending.request == request) {
                    self.pending = None;
                    self.fail(request, &LinkError::Cancelled { dir: Dir::Write });
                }
                return Ok(());
            }
            // The protocol allows a client only one request in progress, so a second one ends its session.
            _ if self.is_busy() => return Err(out_of_turn),
            Message::Count { request } => {
                let counts = self.board.counts().since(&self.before);
                let reports_dropped = counts.reports_dropped + self.client.dropped();
                self.client.reply(&Message::Counted { request, counts: Counts { reports_dropped, ..counts } });
                return Ok(());
            }
            Message::Stop { request, off } if self.client.role == Role::Stopper => {
                self.begin(request, Work::Stop { off, progress: self.hub.begin_stop(&self.client) });
                return Ok(());
            }
            Message::Ask { request, from } if self.client.role == Role::Asker => {
                let file = self.hub.options.machine.as_deref();
                let (name, text) = file.map_or(("", ""), |file| (file.name(), file.text()));
                let part = text.as_bytes().get(from as usize..).unwrap_or_default();
                let part = &part[..part.len().min(PART_MAX)];
                let length = u32::try_from(text.len()).unwrap_or(u32::MAX);
                self.client.reply(&Message::Machine { request, length, name, part });
                return Ok(());
            }
            _ if self.client.role != Role::Writer => return Err(out_of_turn),
            _ => {}
        }
        match *message {
            Message::Write { request, wait, frame } => {
                self.frame = Frame::from_bytes(*frame);
                self.begin(request, Work::Write { until: wait.deadline() });
            }
            Message::Read { request, wait } if self.board.info.virtual_time => {
                let left_ns = wait.limit().map(|limit| u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX));
                self.begin(request, Work::Read { left_ns });
            }
            Message::Pass { request, ns } if self.board.info.virtual_time => match check_pass(Duration::from_nanos(ns))
            {
                Ok(()) => self.begin(request, Work::Pass { left_ns: ns }),
                Err(error) => self.fail(request, &error),
            },
            _ => return Err(out_of_turn),
        }
        Ok(())
    }

    fn begin(&mut self, request: u64, work: Work) {
        self.pending = Some(Pending { request, work });
        self.work();
    }

    /// Carries out a stop that the client has asked for, although its connection has ended, so that axes are stopped
    /// and switched off as requested. Does nothing if the server ends or has lost its board.
    pub(super) fn finish_stop(&mut self) {
        while matches!(&self.pending, Some(Pending { work: Work::Stop { .. }, .. }))
            && self.hub.has(&self.board)
            && !self.hub.is_stopping()
        {
            self.work();
        }
    }

    /// Executes the next step of the request in progress, if there is one. Between two steps the caller handles further
    /// messages of the client.
    pub(super) fn work(&mut self) {
        let Some(pending) = self.pending.take() else { return };
        let request = pending.request;
        let left = match pending.work {
            Work::Write { until } => self.write(request, until),
            Work::Read { left_ns } => self.read(request, left_ns),
            Work::Pass { left_ns } => self.pass(request, left_ns),
            Work::Stop { off, progress } => self.stop(request, off, progress),
        };
        self.pending = left.map(|work| Pending { request, work });
    }

    /// Tries to write the frame to the board. Returns the rest of the request that is still to be done; `None`: the
    /// request is answered.
    fn write(&mut self, request: u64, until: Option<Instant>) -> Option<Work> {
        let left = until.map_or(WRITE_SLICE, |until| until.saturating_duration_since(Instant::now()).min(WRITE_SLICE));
        match self.board.write(&self.frame, Wait::at_most(left)) {
            Ok(at) => self.client.reply(&Message::Written { request, at, now: self.board.now() }),
            Err(LinkError::Timeout { .. }) if until.is_none_or(|until| Instant::now() < until) => {
                return Some(Work::Write { until });
            }
            Err(error) => self.fail(request, &error),
        }
        None
    }

    fn read(&mut self, request: u64, left_ns: Option<u64>) -> Option<Work> {
        // A read is divided into steps of `TIME_STEP_NS`. A rest of up to two steps is one read. Otherwise the last
        // read could have a very short limit, and any read advances the virtual time by at least 125 us.
        let step_ns = left_ns.map(|left| if left > 2 * TIME_STEP_NS { TIME_STEP_NS } else { left });
        let wait = step_ns.map_or(Wait::Forever, |step| Wait::at_most(Duration::from_nanos(step)));
        match self.board.link.read(&mut self.frame, wait) {
            Ok(meta) => {
                self.hub.publish(&self.board, &self.frame, meta);
                let (now, meta) = (self.board.now(), self.client.count(meta));
                self.client.reply(&Message::Got { request, now, meta, frame: self.frame.bytes() });
            }
            Err(LinkError::Timeout { .. }) if left_ns > step_ns => {
                return Some(Work::Read { left_ns: left_ns.zip(step_ns).map(|(left, step)| left - step) });
            }
            Err(error) => self.fail(request, &error),
        }
        None
    }

    fn pass(&mut self, request: u64, left_ns: u64) -> Option<Work> {
        let step_ns = left_ns.min(TIME_STEP_NS);
        match self.board.link.pass(Duration::from_nanos(step_ns)) {
            Ok(_) if left_ns > step_ns => return Some(Work::Pass { left_ns: left_ns - step_ns }),
            Ok(_) => self.client.reply(&Message::Passed { request, now: self.board.now() }),
            Err(error) => self.fail(request, &error),
        }
        None
    }

    fn stop(&self, request: u64, off: bool, mut progress: StopProgress) -> Option<Work> {
        let by = &self.client.name;
        match self.hub.step_stop(by, off, &mut progress) {
            StopStep::Wait => self.hub.wait(STOP_SLICE),
            StopStep::Brake(queue) => vanish::stop_for(self.hub, &self.board, queue, by, off),
            StopStep::Done(ended) => {
                let (end, writer, text) = (ended.end, &*progress.writer, &*ended.text);
                self.client.reply(&Message::Stopped { request, end, writer, text });
                return None;
            }
        }
        Some(Work::Stop { off, progress })
    }

    fn fail(&mut self, request: u64, error: &LinkError) {
        let now = self.board.now();
        let failure = Failure::of(error, &mut self.text);
        self.client.reply(&Message::Failed { request, now, failure });
        if matches!(error, LinkError::Lost { .. } | LinkError::Closed) {
            self.hub.lose(&self.board, error);
            // Sends the Bye. The caller sees that the client is over.
            let _ = self.check_dismissed();
        }
    }
}

/// The bytes with which a server answers a client that sends `bytes` in one piece. `link` is the link of the served
/// board. For tests that feed any bytes.
#[doc(hidden)]
pub fn answer(link: Arc<dyn Link>, bytes: &[u8]) -> Vec<u8> {
    let hub = Arc::new(Hub::new(ServeOptions::default()));
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
                    let mut joining = Joining { who: name, role, keepalive, proof: &[0; PROOF_LEN], channel: None };
                    let Ok((client, board)) = hub.join(&mut joining) else { return Vec::new() };
                    session = Some((Session::new(&hub, board, Arc::clone(&client)), client));
                }
                Some((session, client)) => {
                    if session.take(&message).is_err() || client.is_over() || !hub.has(&board) {
                        return said(&Some((session, Arc::clone(client))));
                    }
                    // The board is used by this client only, so a request that the board does not carry out at once
                    // would wait for ever. It is dropped.
                    session.pending = None;
                }
            }
        }
        if left.is_empty() {
            return said(&session);
        }
        left = inbox.fill(left);
    }
}

fn said<T>(session: &Option<(T, Arc<Client>)>) -> Vec<u8> {
    session.as_ref().map(|(_, client)| client.take_sent()).unwrap_or_default()
}
