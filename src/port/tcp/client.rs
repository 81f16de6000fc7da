//! A client as the server sees it: its connection and the messages that wait to be sent to it.

use std::collections::VecDeque;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::link::ReadMeta;
use crate::sk::Frame;
use crate::tcp::wire::{End, MESSAGE_MAX, Message, Role};
use crate::tcp::{Channel, Out};

/// How many reports are kept for a client whose socket is full; the oldest are dropped. \[OURS]
const REPORTS_KEPT: usize = 32;
/// How many bytes of other messages may wait for a client. A client that exceeds this sends requests without reading
/// the answers, and is disconnected. \[OURS]
const UNSENT_BYTES_MAX: usize = 16 * MESSAGE_MAX;

/// A connected client of the server.
pub(super) struct Client {
    pub(super) name: String,
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    pub(super) channel: Option<Channel>,
    /// The number of reports that the board's link had dropped before the client connected.
    dropped_before: u64,
    out: Mutex<Outgoing>,
    /// Whether bytes wait because the client's socket has no room.
    blocked: AtomicBool,
    /// Whether the connection is over for the server: a Bye was sent, or the connection has failed.
    finished: AtomicBool,
    /// Why this client's own thread has to end the connection.
    dismissal: OnceLock<Dismissal>,
    /// Whether a stop that this client has asked for is being carried out.
    is_stopping: AtomicBool,
}

/// Why a connection has to end. A thread other than the client's own sets this.
pub(super) struct Dismissal {
    pub(super) end: End,
    /// The text of the Bye: the reason, or the name of the client that has asked for a stop.
    pub(super) text: String,
    /// For a stop: whether the axes are switched off when they stand.
    pub(super) off: bool,
}

struct Outgoing {
    out: Out,
    reports: VecDeque<(Frame, ReadMeta)>,
    dropped: u64,
    last_sent: Instant,
}

impl Client {
    pub(super) fn new(name: String, role: Role, keepalive: Duration, channel: Option<Channel>, dropped: u64) -> Self {
        let reports = VecDeque::with_capacity(REPORTS_KEPT);
        Self {
            name,
            role,
            keepalive,
            channel,
            dropped_before: dropped,
            out: Mutex::new(Outgoing { out: Out::default(), reports, dropped: 0, last_sent: Instant::now() }),
            blocked: AtomicBool::new(false),
            finished: AtomicBool::new(false),
            dismissal: OnceLock::new(),
            is_stopping: AtomicBool::new(false),
        }
    }

    /// Makes this client's own thread end the connection. If the board has executed a request, its answer is sent
    /// before. A second call has no effect.
    pub(super) fn dismiss(&self, end: End, text: &str) {
        self.dismiss_for(Dismissal { end, text: text.to_owned(), off: false });
    }

    /// Dismisses this client because another one, `by`, has asked for a stop.
    pub(super) fn overrule(&self, by: &str, off: bool) {
        self.dismiss_for(Dismissal { end: End::Overruled, text: by.to_owned(), off });
    }

    fn dismiss_for(&self, dismissal: Dismissal) {
        if self.dismissal.set(dismissal).is_ok()
            && let Some(channel) = &self.channel
        {
            channel.wake();
        }
    }

    /// Notes whether a stop that this client has asked for is being carried out.
    pub(super) fn set_stopping(&self, is_stopping: bool) {
        self.is_stopping.store(is_stopping, Ordering::Release);
    }

    /// Whether a stop that this client has asked for is being carried out.
    pub(super) fn is_stopping(&self) -> bool {
        self.is_stopping.load(Ordering::Acquire)
    }

    /// Why this client's thread has to end the connection; `None`: it need not.
    pub(super) fn dismissal(&self) -> Option<&Dismissal> {
        self.dismissal.get()
    }

    /// The stop by which another client ends this connection; `None`: there is none.
    pub(super) fn overruled(&self) -> Option<&Dismissal> {
        self.dismissal().filter(|dismissal| dismissal.end == End::Overruled)
    }

    /// Whether nothing more is sent to the client: a Bye was sent, or the connection has failed.
    pub(super) fn is_over(&self) -> bool {
        self.finished.load(Ordering::Acquire)
    }

    /// Whether bytes wait because the client's socket has no room.
    pub(super) fn is_blocked(&self) -> bool {
        self.blocked.load(Ordering::Acquire)
    }

    /// Stages a message other than a report and sends it before the reports that are waiting.
    pub(super) fn reply(&self, message: &Message<'_>) {
        let mut outgoing = self.out.lock();
        self.stage(&mut outgoing, message);
        self.push(&mut outgoing);
    }

    /// Sends a report, or keeps it until the socket has room.
    pub(super) fn report(&self, frame: &Frame, meta: ReadMeta) {
        let mut outgoing = self.out.lock();
        if outgoing.reports.len() == REPORTS_KEPT {
            outgoing.reports.pop_front();
            outgoing.dropped += 1;
        }
        outgoing.reports.push_back((frame.clone(), meta));
        self.push(&mut outgoing);
    }

    /// Time and sequence number of a report, with `dropped` counted since the client connected.
    pub(super) fn count(&self, meta: ReadMeta) -> ReadMeta {
        ReadMeta { dropped: meta.dropped.saturating_sub(self.dropped_before), ..meta }
    }

    /// How many reports the server has dropped for this client.
    pub(super) fn dropped(&self) -> u64 {
        self.out.lock().dropped
    }

    /// Sends a Bye, which is the last message to the client. A second call has no effect.
    pub(super) fn finish(&self, end: End, text: &str) {
        if self.is_over() {
            return;
        }
        let mut outgoing = self.out.lock();
        outgoing.reports.clear();
        self.stage(&mut outgoing, &Message::Bye { end, text });
        self.push(&mut outgoing);
        drop(outgoing);
        self.give_up();
    }

    /// Sends the bytes that are waiting, as far as the socket has room.
    pub(super) fn flush(&self) {
        self.push(&mut self.out.lock());
    }

    /// Sends a keep-alive message if nothing was sent for half of the client's keep-alive time.
    pub(super) fn ping(&self) {
        let mut outgoing = self.out.lock();
        if outgoing.last_sent.elapsed() >= self.keepalive / 2 && outgoing.out.is_empty() {
            self.stage(&mut outgoing, &Message::Ping);
            self.push(&mut outgoing);
        }
    }

    /// Takes the messages that were sent since the last call. Only for the clients of tests, which have no connection
    /// and keep messages in memory.
    pub(super) fn take_sent(&self) -> Vec<u8> {
        self.out.lock().out.take()
    }

    fn give_up(&self) {
        self.finished.store(true, Ordering::Release);
        if let Some(channel) = &self.channel {
            channel.wake();
        }
    }

    fn stage(&self, outgoing: &mut Outgoing, message: &Message<'_>) {
        outgoing.last_sent = Instant::now();
        let staged = match &self.channel {
            Some(channel) => channel.stage(message, &mut outgoing.out).is_ok(),
            None => {
                outgoing.out.keep(message);
                true
            }
        };
        if !staged || (self.channel.is_some() && outgoing.out.waiting() > UNSENT_BYTES_MAX) {
            self.give_up();
        }
    }

    fn push(&self, outgoing: &mut Outgoing) {
        let Some(channel) = &self.channel else { return };
        let all = loop {
            match channel.push(&mut outgoing.out) {
                Ok(true) => {}
                Ok(false) => break false,
                // The connection is broken, so nothing more is sent. The thread of the connection gets an error too
                // when it receives next, and ends the session.
                Err(_) => return self.give_up(),
            }
            if self.is_over() {
                break true;
            }
            let Some((frame, meta)) = outgoing.reports.pop_front() else { break true };
            let dropped = self.count(meta).dropped.saturating_add(outgoing.dropped);
            let meta = ReadMeta { dropped, ..meta };
            self.stage(outgoing, &Message::Report { meta, frame: frame.bytes() });
        };
        if self.blocked.swap(!all, Ordering::AcqRel) == all && !all {
            // Wakes the client's thread: from now on it has to poll the socket for room as well.
            channel.wake();
        }
    }
}
