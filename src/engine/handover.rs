//! The queues between the threads of the host and the runner's thread: command frames in, reports out.
//!
//! Neither side holds a lock across a wait, or longer than it takes to copy a frame. All memory is allocated when the
//! hand-over is made. The lock types come from the parent module, so that a test can compile this file with a scheduler
//! that tries all interleavings.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::reports::{Report, ReportQueue};
use super::stepped::Stop;
use super::sync::{Condvar, Mutex, MutexGuard, lock, wait, wait_for};
use crate::fieldbus::Ns;
use crate::sk::Frame;

/// Whether the host interface is open; if not, the reason why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Open,
    Over(Stop),
}

struct Inbox {
    frames: VecDeque<(Frame, Ns)>,
    room: usize,
    phase: Phase,
    cancels: u64,
}

struct Outbox {
    reports: ReportQueue,
    phase: Phase,
    cancels: u64,
}

/// The two queues: the inbox has command frames from the host to the runner, the outbox reports from the runner to the
/// host.
pub(super) struct Handover {
    inbox: Mutex<Inbox>,
    space: Condvar,
    outbox: Mutex<Outbox>,
    news: Condvar,
}

impl Handover {
    /// Creates both queues: an inbox for `room` frames, and an outbox that keeps the newest `queue` unread reports. A
    /// writer waits while the inbox is full, as on a USB device that does not accept data.
    pub(super) fn new(room: usize, queue: usize) -> Self {
        Self {
            inbox: Mutex::new(Inbox { frames: VecDeque::with_capacity(room), room, phase: Phase::Open, cancels: 0 }),
            space: Condvar::new(),
            outbox: Mutex::new(Outbox { reports: ReportQueue::new(queue), phase: Phase::Open, cancels: 0 }),
            news: Condvar::new(),
        }
    }

    /// Called by the host: puts a frame that arrives at the board time `at` into the inbox. Waits first until `turn`, when the
    /// simulated wire is free, and then for room in the inbox. Returns [`Stop::Timeout`] if this is not possible by `end`.
    pub(super) fn send(&self, frame: &Frame, at: Ns, turn: Instant, end: Option<Instant>) -> Result<(), Stop> {
        let mut inbox = lock(&self.inbox);
        let cancels = inbox.cancels;
        loop {
            let to_turn = turn.saturating_duration_since(Instant::now());
            match inbox.phase {
                Phase::Over(stop) => return Err(stop),
                Phase::Open if inbox.cancels != cancels => return Err(Stop::Cancelled),
                Phase::Open if to_turn > Duration::ZERO => {
                    let to_end = time_left(end)?.unwrap_or(to_turn);
                    inbox = wait_for(&self.space, inbox, to_turn.min(to_end));
                }
                Phase::Open if inbox.frames.len() < inbox.room => break,
                Phase::Open => inbox = wait_until(&self.space, inbox, end)?,
            }
        }
        inbox.frames.push_back((frame.clone(), at));
        Ok(())
    }

    /// Called by the host: takes the oldest report. If there is none, waits for one until `end`.
    pub(super) fn receive(&self, out: &mut Frame, end: Option<Instant>) -> Result<Report, Stop> {
        self.receive_in_parts(out, end, None)
    }

    /// How often reads were cancelled so far, for [`Self::receive_in_parts`]: a higher number later means that a read was
    /// cancelled since.
    pub(super) fn reads_cancelled(&self) -> u64 {
        lock(&self.outbox).cancels
    }

    /// Like [`Self::receive`], for a caller that divides a long wait into several calls. `cancelled`: the value of
    /// [`Self::reads_cancelled`] when the whole wait began, so that a cancellation between two calls is noticed; `None`:
    /// the wait begins now.
    pub(super) fn receive_in_parts(
        &self,
        out: &mut Frame,
        end: Option<Instant>,
        cancelled: Option<u64>,
    ) -> Result<Report, Stop> {
        let mut outbox = lock(&self.outbox);
        let cancels = cancelled.unwrap_or(outbox.cancels);
        loop {
            match outbox.phase {
                Phase::Over(stop) => return Err(stop),
                Phase::Open if outbox.cancels != cancels => return Err(Stop::Cancelled),
                Phase::Open => {}
            }
            if let Some(report) = outbox.reports.pop(out) {
                return Ok(report);
            }
            outbox = wait_until(&self.news, outbox, end)?;
        }
    }

    /// Called by the runner: takes the oldest frame out of the inbox if it has arrived. `is_there` gets the arrival
    /// time of the frame and decides whether this time is reached. Returns the arrival time; `None`: no frame has
    /// arrived.
    pub(super) fn next_frame(&self, out: &mut Frame, is_there: impl FnOnce(Ns) -> bool) -> Option<Ns> {
        let mut inbox = lock(&self.inbox);
        if inbox.frames.front().is_none_or(|(_, at)| !is_there(*at)) {
            return None;
        }
        let was_full = inbox.frames.len() == inbox.room;
        let (frame, at) = inbox.frames.pop_front()?;
        drop(inbox);
        out.clone_from(&frame);
        if was_full {
            self.space.notify_all();
        }
        Some(at)
    }

    /// Called by the runner: puts a report that was made at `at` into the outbox.
    pub(super) fn publish(&self, frame: &Frame, at: Ns) {
        lock(&self.outbox).reports.push(frame, at);
        self.news.notify_one();
    }

    /// Ends all present waits and all later calls with the reason `why`. If it is called again, the first reason stays.
    pub(super) fn end(&self, why: Stop) {
        for phase in [&mut lock(&self.inbox).phase, &mut lock(&self.outbox).phase] {
            if *phase == Phase::Open {
                *phase = Phase::Over(why);
            }
        }
        self.space.notify_all();
        self.news.notify_all();
    }

    /// Cancels all writes that are waiting: they return [`Stop::Cancelled`].
    pub(super) fn cancel_writes(&self) {
        lock(&self.inbox).cancels += 1;
        self.space.notify_all();
    }

    /// Cancels all reads that are waiting: they return [`Stop::Cancelled`].
    pub(super) fn cancel_reads(&self) {
        lock(&self.outbox).cancels += 1;
        self.news.notify_all();
    }

    /// `Ok` while the host interface is open. Otherwise the reason why all calls of the host fail for good: the
    /// interface was closed, the board has rebooted, or the hardware of the bus is gone. Does not wait.
    pub(super) fn check(&self) -> Result<(), Stop> {
        match lock(&self.outbox).phase {
            Phase::Open => Ok(()),
            Phase::Over(stop) => Err(stop),
        }
    }

    /// The number of reports that were dropped because they were not read in time.
    pub(super) fn dropped(&self) -> u64 {
        lock(&self.outbox).reports.dropped()
    }
}

fn wait_until<'a, T>(
    condvar: &Condvar,
    guard: MutexGuard<'a, T>,
    end: Option<Instant>,
) -> Result<MutexGuard<'a, T>, Stop> {
    Ok(match time_left(end)? {
        None => wait(condvar, guard),
        Some(left) => wait_for(condvar, guard, left),
    })
}

/// The time left until `end`, or an error if it has passed; `None`: there is no limit.
fn time_left(end: Option<Instant>) -> Result<Option<Duration>, Stop> {
    let left = end.map(|end| end.saturating_duration_since(Instant::now()));
    if left == Some(Duration::ZERO) { Err(Stop::Timeout) } else { Ok(left) }
}
