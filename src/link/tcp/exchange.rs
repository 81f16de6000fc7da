//! What a client knows of its exchange with the server: reports, the request under way, how it ended. No I/O: bytes come
//! from [`Inbox`], so that any can be tried.

use std::collections::VecDeque;
use std::time::Instant;

use super::inbox::Inbox;
use super::wire::{Counts, End, Message, WireError};
use crate::link::{Dir, LinkError, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// How an exchange ended.
#[derive(Clone, Debug)]
pub(super) struct Ended {
    /// What calls say from now on.
    pub(super) error: LinkError,
    /// Whether the request under way may have been done all the same.
    pub(super) unsure: bool,
}

/// The request under way.
pub(super) struct Request {
    pub(super) number: u64,
    dir: Dir,
    wait: Wait,
    pub(super) answer: Option<Answer>,
}

/// What the server said.
pub(super) enum Answer {
    Written(Stamp),
    /// The frame is in [`Exchange::got`].
    Got(ReadMeta),
    Passed(Option<Stamp>),
    Counted(Counts),
    Failed(LinkError),
}

pub(super) struct Exchange {
    name: String,
    /// Reports nobody has read, oldest first.
    reports: VecDeque<(Frame, ReadMeta)>,
    keep: usize,
    /// Reports of `reports` that were dropped.
    dropped: u64,
    /// Sequence number of the first report of this link.
    first: u64,
    next_request: u64,
    pub(super) request: Option<Request>,
    pub(super) got: Frame,
    /// Time of the board on virtual time, if it is known.
    pub(super) now: Option<Stamp>,
    pub(super) counts: Counts,
    pub(super) heard: Instant,
    pub(super) ended: Option<Ended>,
}

impl Exchange {
    /// `first` is the number of the first report to come, and `keep` as many as are kept while nobody reads.
    pub(super) fn new(name: String, first: u64, keep: usize, now: Option<Stamp>) -> Self {
        Self {
            name,
            reports: VecDeque::with_capacity(keep),
            keep,
            dropped: 0,
            first,
            next_request: 1,
            request: None,
            got: Frame::new(),
            now,
            counts: Counts::default(),
            heard: Instant::now(),
            ended: None,
        }
    }

    /// Begins a request; there is none under way. Gives its number.
    pub(super) fn begin(&mut self, dir: Dir, wait: Wait) -> u64 {
        let number = self.next_request;
        self.next_request += 1;
        self.request = Some(Request { number, dir, wait, answer: None });
        number
    }

    /// Requests that were begun so far.
    pub(super) const fn requests(&self) -> u64 {
        self.next_request
    }

    /// The oldest report.
    pub(super) fn pop(&mut self, out: &mut Frame) -> Option<ReadMeta> {
        let (frame, meta) = self.reports.pop_front()?;
        out.clone_from(&frame);
        Some(ReadMeta { dropped: meta.dropped.saturating_add(self.dropped), ..meta })
    }

    /// Reports dropped here.
    pub(super) const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// It is over; the first reason stays.
    pub(super) fn end(&mut self, error: LinkError, unsure: bool) {
        if self.ended.is_none() {
            self.ended = Some(Ended { error, unsure });
        }
    }

    /// The connection broke.
    pub(super) fn lose(&mut self, reason: impl Into<std::borrow::Cow<'static, str>>) {
        let error = LinkError::Lost { name: self.name.clone(), reason: reason.into() };
        self.end(error, true);
    }

    /// Takes every message that came; says how many reports there were.
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
                if self.reports.len() == self.keep {
                    self.reports.pop_front();
                    self.dropped += 1;
                }
                self.reports.push_back((Frame::from_bytes(*frame), self.ours(meta)));
            }
            Message::Written { request, at, now } => {
                self.answer(message, request, Answer::Written(at))?;
                self.now = now;
            }
            Message::Got { request, now, meta, frame } => {
                self.got = Frame::from_bytes(*frame);
                let meta = self.ours(meta);
                self.answer(message, request, Answer::Got(meta))?;
                self.now = now;
            }
            Message::Passed { request, now } => {
                self.answer(message, request, Answer::Passed(now))?;
                self.now = now;
            }
            Message::Counted { request, counts } => {
                self.counts = counts;
                self.answer(message, request, Answer::Counted(counts))?;
            }
            Message::Failed { request, now, failure } => {
                let under_way = self.request.as_ref().ok_or(WireError::OutOfTurn { kind: message.kind() })?;
                let error = failure.error(&self.name, under_way.dir, under_way.wait);
                // The good-bye that says it too is on its way.
                let lost = matches!(error, LinkError::Lost { .. }).then(|| error.clone());
                self.answer(message, request, Answer::Failed(error))?;
                self.now = now;
                if let Some(lost) = lost {
                    self.end(lost, false);
                }
            }
            Message::Bye { end, text } => {
                let reason = match end {
                    End::Stopped => "its server was stopped".to_owned(),
                    End::Lost => text.to_owned(),
                    End::Closed | End::Broken => format!("its server has ended the connection: {text}"),
                };
                // The server answers in order: what it has not answered by now it has not done.
                self.end(LinkError::Lost { name: self.name.clone(), reason: reason.into() }, false);
            }
            _ => return Err(WireError::OutOfTurn { kind: message.kind() }),
        }
        Ok(())
    }

    fn answer(&mut self, message: &Message<'_>, number: u64, answer: Answer) -> Result<(), WireError> {
        match &mut self.request {
            Some(request) if request.number == number && request.answer.is_none() => {
                request.answer = Some(answer);
                Ok(())
            }
            _ => Err(WireError::OutOfTurn { kind: message.kind() }),
        }
    }

    /// Numbers as this link counts them.
    const fn ours(&self, meta: ReadMeta) -> ReadMeta {
        ReadMeta { sequence: meta.sequence.saturating_sub(self.first), ..meta }
    }
}

/// What a client makes of a server's bytes: how many reports there were, and the error that ended it.
#[doc(hidden)]
pub fn replay(bytes: &[u8]) -> (usize, Option<LinkError>) {
    let mut exchange = Exchange::new("tcp:".to_owned(), 0, 4, None);
    let mut reports = 0;
    exchange.begin(Dir::Write, Wait::Forever);
    feed(bytes, |inbox| {
        reports += exchange.take_all(inbox);
        exchange.ended.is_none()
    });
    assert!(exchange.reports.len() <= exchange.keep && reports as u64 >= exchange.dropped);
    (reports, exchange.ended.map(|ended| ended.error))
}

/// How many messages these bytes are, half a one at the end aside.
///
/// # Errors
/// The first that is none.
#[doc(hidden)]
pub fn messages(bytes: &[u8]) -> Result<usize, WireError> {
    let mut count = 0;
    each_message(bytes, |_| count += 1).map(|()| count)
}

/// Gives `take` the messages that these bytes are, half a one at the end aside.
///
/// # Errors
/// The first that is none.
pub(crate) fn each_message(bytes: &[u8], mut take: impl FnMut(&Message<'_>)) -> Result<(), WireError> {
    let mut wrong = None;
    feed(bytes, |inbox| {
        loop {
            match inbox.next() {
                Ok(Some(message)) => take(&message),
                Ok(None) => return true,
                Err(error) => {
                    wrong = Some(error);
                    return false;
                }
            }
        }
    });
    wrong.map_or(Ok(()), Err)
}

/// Puts bytes into an inbox as they fit, until `take` has enough.
fn feed(mut bytes: &[u8], mut take: impl FnMut(&mut Inbox) -> bool) {
    let mut inbox = Inbox::default();
    while !bytes.is_empty() {
        let room = inbox.room();
        let count = room.len().min(bytes.len());
        room[..count].copy_from_slice(&bytes[..count]);
        bytes = &bytes[count..];
        inbox.came(count);
        if !take(&mut inbox) {
            return;
        }
    }
}
