//! The client's side of the protocol: unread reports, the request in progress, and how the exchange ended. Without I/O:
//! bytes come from an [`Inbox`], so that tests can feed any bytes.

use std::collections::VecDeque;
use std::time::Instant;

use super::inbox::Inbox;
use super::wire::{Counts, End, Message, WireError};
use crate::link::{Dir, LinkError, ReadMeta, Stamp, Wait};
use crate::sk::Frame;
use crate::threads::CallingThread;

/// Why the exchange with the server has ended.
#[derive(Clone, Debug)]
pub(super) struct Ended {
    /// The error that all further calls of the link return.
    pub(super) error: LinkError,
    /// Whether the server may have executed the request in progress; a write then fails with [`LinkError::Unsure`].
    pub(super) unsure: bool,
}

/// A request to the server that is in progress.
pub(super) struct Request {
    pub(super) number: u64,
    /// The thread that waits for the answer.
    pub(super) caller: CallingThread,
    dir: Dir,
    wait: Wait,
    /// The server's answer: a result, or an error if it has refused the request.
    pub(super) answer: Option<Result<Answer, LinkError>>,
}

/// The server's answer to a request.
#[allow(clippy::large_enum_variant, reason = "there is one at a time, taken as soon as it is there")]
pub(super) enum Answer {
    Written(Stamp),
    /// The answer to a read request: time and sequence number of a report, whose bytes are in [`Exchange::got`].
    Got(ReadMeta),
    Passed(Option<Stamp>),
    Counted(Counts),
}

/// The state of a client's exchange of messages with its server.
pub(super) struct Exchange {
    name: String,
    /// The reports that the program has not read yet, oldest first.
    reports: VecDeque<(Frame, ReadMeta)>,
    /// How many reports that the program has not read yet are kept. If there is one more, the oldest is dropped.
    queue_max: usize,
    /// Reports dropped from `reports`, because the program did not read them in time.
    pub(super) dropped: u64,
    /// The server's sequence number of the first report of this link. Reports of the link are numbered from it, so the first
    /// one has the number 0.
    first_sequence: u64,
    /// The number of the next request. Requests are numbered from 1.
    pub(super) next_request: u64,
    pub(super) request: Option<Request>,
    /// The answered request of a thread that a signal handler has interrupted, while the handler makes a request of its own.
    pub(super) interrupted: Option<Request>,
    /// The bytes of the report that came with [`Answer::Got`].
    pub(super) got: Frame,
    /// The board's time as of the server's newest answer, on virtual time; `None`: unknown.
    pub(super) now: Option<Stamp>,
    pub(super) counts: Counts,
    /// When the newest message of the server was received.
    pub(super) heard: Instant,
    pub(super) ended: Option<Ended>,
}

impl Exchange {
    /// `first_sequence` is the server's sequence number of the next report; at most `queue_max` unread reports are
    /// kept.
    pub(super) fn new(name: String, first_sequence: u64, queue_max: usize, now: Option<Stamp>) -> Self {
        Self {
            name,
            reports: VecDeque::with_capacity(queue_max),
            queue_max,
            dropped: 0,
            first_sequence,
            next_request: 1,
            request: None,
            interrupted: None,
            got: Frame::new(),
            now,
            counts: Counts::default(),
            heard: Instant::now(),
            ended: None,
        }
    }

    /// Whether a request may begin: no other request is in progress. An answered request of the calling thread itself
    /// does not count: this call then comes from a signal handler that has interrupted it. That request is kept in
    /// `interrupted`, and the thread takes its answer when the handler has returned.
    pub(super) fn may_begin(&mut self) -> bool {
        if self.interrupted.is_none() {
            let is_own = |request: &mut Request| request.answer.is_some() && request.caller == CallingThread::current();
            self.interrupted = self.request.take_if(is_own);
        }
        self.request.is_none()
    }

    /// Begins a request and returns its number. No other request may be in progress.
    pub(super) fn begin(&mut self, dir: Dir, wait: Wait) -> u64 {
        let number = self.next_request;
        self.next_request += 1;
        self.request = Some(Request { number, caller: CallingThread::current(), dir, wait, answer: None });
        number
    }

    /// Takes the oldest unread report.
    pub(super) fn pop(&mut self, out: &mut Frame) -> Option<ReadMeta> {
        let (frame, meta) = self.reports.pop_front()?;
        out.clone_from(&frame);
        Some(ReadMeta { dropped: meta.dropped.saturating_add(self.dropped), ..meta })
    }

    /// Returns an error if the exchange with the server has ended.
    pub(super) fn check(&self) -> Result<(), LinkError> {
        self.ended.as_ref().map_or(Ok(()), |ended| Err(ended.error.clone()))
    }

    /// Ends the exchange. If it has ended already, the first reason stays.
    pub(super) fn end(&mut self, error: LinkError, unsure: bool) {
        self.ended.get_or_insert(Ended { error, unsure });
    }

    /// Ends the exchange because the connection has failed.
    pub(super) fn lose(&mut self, reason: impl Into<std::borrow::Cow<'static, str>>) {
        let error = LinkError::Lost { name: self.name.clone(), reason: reason.into() };
        self.end(error, true);
    }

    /// Handles all complete messages in the inbox; returns how many of them were reports.
    pub(super) fn take_all(&mut self, inbox: &mut Inbox) -> usize {
        let mut reports = 0;
        while self.ended.is_none() {
            let taken = match inbox.next() {
                Ok(None) => break,
                Ok(Some(message)) => {
                    reports += usize::from(matches!(message, Message::Report { .. }));
                    self.take(&message)
                }
                Err(error) => Err(error),
            };
            if let Err(error) = taken {
                self.lose(format!("its server does not keep to the protocol: {error}"));
            }
        }
        reports
    }

    fn take(&mut self, message: &Message<'_>) -> Result<(), WireError> {
        match *message {
            Message::Ping => {}
            Message::Report { meta, frame } => {
                if self.reports.len() == self.queue_max {
                    self.reports.pop_front();
                    self.dropped += 1;
                }
                self.reports.push_back((Frame::from_bytes(*frame), self.renumbered(meta)));
            }
            Message::Written { request, at, now } => {
                self.answer(message, request, Ok(Answer::Written(at)))?;
                self.now = now;
            }
            Message::Got { request, now, meta, frame } => {
                self.got = Frame::from_bytes(*frame);
                let meta = self.renumbered(meta);
                self.answer(message, request, Ok(Answer::Got(meta)))?;
                self.now = now;
            }
            Message::Passed { request, now } => {
                self.answer(message, request, Ok(Answer::Passed(now)))?;
                self.now = now;
            }
            Message::Counted { request, counts } => {
                self.counts = counts;
                self.answer(message, request, Ok(Answer::Counted(counts)))?;
            }
            Message::Failed { request, now, failure } => {
                let under_way = self.request.as_ref().ok_or(WireError::OutOfTurn { kind: message.kind() })?;
                let error = failure.error(&self.name, under_way.dir, under_way.wait);
                // The server's board is lost: the exchange ends at once, without waiting for the server's Bye with the same
                // reason.
                let lost = matches!(error, LinkError::Lost { .. }).then(|| error.clone());
                self.answer(message, request, Err(error))?;
                self.now = now;
                if let Some(lost) = lost {
                    self.end(lost, false);
                }
            }
            Message::Bye { end, text } => {
                let reason = match end {
                    End::Stopped if text.is_empty() => "its server was stopped".to_owned(),
                    End::Stopped => format!("its server is stopped, and {text}"),
                    End::Lost => text.to_owned(),
                    End::Overruled => {
                        format!("stopped by another client, {text}, and its server brings the axes to a standstill")
                    }
                    End::Closed | End::Broken => format!("its server has ended the connection: {text}"),
                };
                // The server answers requests in the order in which it executes them, and Bye is its last message. So it has
                // not executed the request in progress.
                self.end(LinkError::Lost { name: self.name.clone(), reason: reason.into() }, false);
            }
            _ => return Err(WireError::OutOfTurn { kind: message.kind() }),
        }
        Ok(())
    }

    fn answer(
        &mut self,
        message: &Message<'_>,
        number: u64,
        answer: Result<Answer, LinkError>,
    ) -> Result<(), WireError> {
        match &mut self.request {
            Some(request) if request.number == number && request.answer.is_none() => {
                request.answer = Some(answer);
                Ok(())
            }
            _ => Err(WireError::OutOfTurn { kind: message.kind() }),
        }
    }

    /// Time, sequence number and drops of a report, with the sequence number counted from the first report of this link.
    const fn renumbered(&self, meta: ReadMeta) -> ReadMeta {
        ReadMeta { sequence: meta.sequence.saturating_sub(self.first_sequence), ..meta }
    }
}

/// Feeds bytes, as a server would send them, to a client without a connection. Returns the number of reports, and the
/// error that has ended the exchange.
#[doc(hidden)]
pub fn replay(bytes: &[u8]) -> (usize, Option<LinkError>) {
    let mut exchange = Exchange::new("tcp:".to_owned(), 0, 4, None);
    let mut reports = 0;
    exchange.begin(Dir::Write, Wait::Forever);
    let done = feed(bytes, |inbox| {
        reports += exchange.take_all(inbox);
        exchange.check()
    });
    assert!(exchange.reports.len() <= exchange.queue_max && reports as u64 >= exchange.dropped);
    (reports, done.err())
}

/// The number of complete messages in these bytes.
///
/// # Errors
/// The first invalid message.
#[doc(hidden)]
pub fn messages(bytes: &[u8]) -> Result<usize, WireError> {
    let mut count = 0;
    each_message(bytes, |_| count += 1).map(|()| count)
}

/// Calls `take` with each message that these bytes contain, except an incomplete one at the end.
///
/// # Errors
/// The first invalid message.
pub(crate) fn each_message(bytes: &[u8], mut take: impl FnMut(&Message<'_>)) -> Result<(), WireError> {
    feed(bytes, |inbox| {
        while let Some(message) = inbox.next()? {
            take(&message);
        }
        Ok(())
    })
}

/// Appends bytes to an inbox in portions that fit, and calls `take` after each portion, until all are consumed or
/// `take` fails.
fn feed<E>(mut bytes: &[u8], mut take: impl FnMut(&mut Inbox) -> Result<(), E>) -> Result<(), E> {
    let mut inbox = Inbox::default();
    while !bytes.is_empty() {
        bytes = inbox.fill(bytes);
        take(&mut inbox)?;
    }
    Ok(())
}
