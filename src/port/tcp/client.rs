//! What a server keeps for one client: its connection, and what has to go there.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::link::ReadMeta;
use crate::link::tcp::wire::{End, MESSAGE_MAX, Message, Role};
use crate::link::tcp::{Channel, Out};
use crate::sk::Frame;

/// Reports kept for a client whose socket takes none, the newest. \[OURS]
const REPORTS: usize = 32;
/// Bytes of other messages that wait for such a client: more is a client that asks and does not listen. \[OURS]
const BACKLOG: usize = 16 * MESSAGE_MAX;

pub(super) struct Client {
    pub(super) who: String,
    pub(super) role: Role,
    pub(super) keepalive: Duration,
    pub(super) channel: Option<Channel>,
    /// Reports dropped before the server, when it came.
    dropped_before: u64,
    out: Mutex<Outgoing>,
    /// Something waits until the socket takes it.
    blocked: AtomicBool,
    /// It was said good-bye to, or its connection does not work.
    over: AtomicBool,
}

struct Outgoing {
    out: Out,
    reports: VecDeque<(Frame, ReadMeta)>,
    dropped: u64,
    said: Instant,
}

impl Client {
    pub(super) fn new(who: String, role: Role, keepalive: Duration, channel: Option<Channel>, dropped: u64) -> Self {
        let reports = VecDeque::with_capacity(REPORTS);
        Self {
            who,
            role,
            keepalive,
            channel,
            dropped_before: dropped,
            out: Mutex::new(Outgoing { out: Out::default(), reports, dropped: 0, said: Instant::now() }),
            blocked: AtomicBool::new(false),
            over: AtomicBool::new(false),
        }
    }

    /// Whether nothing more will be sent.
    pub(super) fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// Whether something waits for the socket.
    pub(super) fn is_blocked(&self) -> bool {
        self.blocked.load(Ordering::Acquire)
    }

    /// Sends a message before any report that still waits.
    pub(super) fn reply(&self, message: &Message<'_>) {
        let mut outgoing = self.out.lock();
        self.stage(&mut outgoing, message);
        self.push(&mut outgoing);
    }

    /// Sends a report, or keeps it until the socket takes it.
    pub(super) fn report(&self, frame: &Frame, meta: ReadMeta) {
        let mut outgoing = self.out.lock();
        if outgoing.reports.len() == REPORTS {
            outgoing.reports.pop_front();
            outgoing.dropped += 1;
        }
        outgoing.reports.push_back((frame.clone(), meta));
        self.push(&mut outgoing);
    }

    /// Reports dropped for it so far, of `meta` those dropped before the server too.
    pub(super) fn count(&self, meta: ReadMeta) -> ReadMeta {
        ReadMeta { dropped: meta.dropped.saturating_sub(self.dropped_before), ..meta }
    }

    /// Reports that were dropped here.
    pub(super) fn dropped(&self) -> u64 {
        self.out.lock().dropped
    }

    /// Says good-bye, once.
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

    /// Sends what waits, as far as the socket takes it now.
    pub(super) fn flush(&self) {
        self.push(&mut self.out.lock());
    }

    /// Says that the server is there, if it has said nothing for a while.
    pub(super) fn ping(&self) {
        let mut outgoing = self.out.lock();
        if outgoing.said.elapsed() >= self.keepalive / 2 && outgoing.out.is_empty() {
            self.stage(&mut outgoing, &Message::Ping);
            self.push(&mut outgoing);
        }
    }

    /// What was sent, if it is kept in memory.
    pub(super) fn take_sent(&self) -> Vec<u8> {
        self.out.lock().out.take()
    }

    fn give_up(&self) {
        self.over.store(true, Ordering::Release);
        if let Some(channel) = &self.channel {
            channel.wake();
        }
    }

    fn stage(&self, outgoing: &mut Outgoing, message: &Message<'_>) {
        outgoing.said = Instant::now();
        let staged = match &self.channel {
            Some(channel) => channel.stage(message, &mut outgoing.out).is_ok(),
            None => {
                outgoing.out.keep(message);
                true
            }
        };
        if !staged || (self.channel.is_some() && outgoing.out.waiting() > BACKLOG) {
            self.give_up();
        }
    }

    fn push(&self, outgoing: &mut Outgoing) {
        let Some(channel) = &self.channel else { return };
        let all = loop {
            match channel.push(&mut outgoing.out) {
                Ok(true) => {}
                Ok(false) => break false,
                // The thread of the connection sees it, too.
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
            // Its thread has to wait for room, too.
            channel.wake();
        }
    }
}
