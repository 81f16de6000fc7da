//! The frames and reports that the program's threads and the link's thread pass to each other. All memory is allocated
//! when the queues are created, and their lock is never held during a wait or an exchange.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::pacer::{WaitingFrames, has_motion};
use crate::ethercat::Ns;
use crate::link::{Dir, LinkError, ReadMeta, Stamp};
use crate::sk::{FIFO_ENTRIES, Frame, MasterCommand, SlotSize};
use crate::threads::WaitQueue;

/// How many frames of a program may wait in the link: as many as the board's FIFO holds. \[OURS]
const FRAMES_MAX: usize = FIFO_ENTRIES as usize;

/// The state that the lock of the queues protects.
pub(super) struct QueueState {
    /// Frames of the program that are waiting to be sent, oldest first.
    held: VecDeque<Frame>,
    /// Unread reports, oldest first, each with the time at which its exchange began, and its report number.
    reports: VecDeque<(Frame, Ns, u64)>,
    /// How many unread reports are kept at most.
    queue: usize,
    next_report: u64,
    dropped: u64,
    /// Number of the program's frames that were discarded, as the board's FIFO discards its entries: by SET_FIFO clear,
    /// by leaving OP, or by a reset.
    cleared: u64,
    /// Number of the program's frames that could not be sent because the link ended before.
    unsent: u64,
    /// The error of all further calls, once the board is lost or the link is closed.
    over: Option<LinkError>,
    /// The time until which waiting frames are still sent after the program has closed the link; `None`: the program
    /// has not closed it.
    closing: Option<Instant>,
    /// How often waiting calls were cancelled so far, one count for each direction, indexed by `Dir as usize`.
    cancels: [u64; 2],
    op: bool,
}

/// Counters of the frames and reports that have passed through a link's queues.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct QueueCounts {
    pub dropped: u64,
    pub cleared: u64,
    pub unsent: u64,
    pub held: usize,
}

/// The queues between the program's threads and the link's thread.
pub(super) struct FrameQueues {
    state: Mutex<QueueState>,
    /// Wakes the link's thread: the program has written a frame, or the link ends.
    work: Condvar,
    /// Wakes the program's readers: a report has come, or reading has ended.
    readable: WaitQueue,
    /// Wakes the program's writers: there is room for a frame, or writing has ended.
    room: WaitQueue,
}

impl FrameQueues {
    /// Creates queues that keep up to `queue` unread reports.
    pub fn new(queue: usize) -> Self {
        let queue = queue.max(1);
        let state = QueueState {
            held: VecDeque::with_capacity(FRAMES_MAX),
            reports: VecDeque::with_capacity(queue),
            queue,
            next_report: 0,
            dropped: 0,
            cleared: 0,
            unsent: 0,
            over: None,
            closing: None,
            cancels: [0; 2],
            op: false,
        };
        Self { state: Mutex::new(state), work: Condvar::new(), readable: WaitQueue::new(), room: WaitQueue::new() }
    }

    pub fn lock(&self) -> MutexGuard<'_, QueueState> {
        self.state.lock()
    }

    /// For the program: queues a frame, waiting for room for up to `limit`. Fails if the limit has passed, the call was
    /// cancelled, the board is lost, or the link is closed.
    pub fn write(&self, frame: &Frame, size: SlotSize, limit: Option<Duration>) -> Result<(), LinkError> {
        let began = Instant::now();
        let mut state = self.state.lock();
        let cancels = state.cancels;
        loop {
            state.check_open()?;
            if state.op && discards_fifo(frame, size) {
                state.cleared += state.held.len() as u64;
                state.held.clear();
                self.room.notify_all();
            }
            if state.held.len() < FRAMES_MAX {
                break;
            }
            state.check_cancelled(Dir::Write, cancels)?;
            if let Err(waited) = wait(&self.room, &mut state, began, limit) {
                return Err(LinkError::Timeout { dir: Dir::Write, waited, what: "the board takes no more frames" });
            }
        }
        state.held.push_back(frame.clone());
        self.work.notify_one();
        Ok(())
    }

    /// For the program: takes the oldest report, waiting for one for up to `limit`. Fails as [`Self::write`] does.
    pub fn read(&self, out: &mut Frame, limit: Option<Duration>) -> Result<ReadMeta, LinkError> {
        let began = Instant::now();
        let mut state = self.state.lock();
        let cancels = state.cancels;
        loop {
            // After the loss of the board, the reports from before can still be read, because they may show the cause
            // of the loss. After closing, nothing can be read.
            if state.closing.is_some() {
                state.check_open()?;
            }
            if let Some((frame, at, number)) = state.reports.pop_front() {
                out.clone_from(&frame);
                return Ok(ReadMeta { at: Stamp(at), sequence: number, dropped: state.dropped });
            }
            state.check_open()?;
            state.check_cancelled(Dir::Read, cancels)?;
            if let Err(waited) = wait(&self.readable, &mut state, began, limit) {
                return Err(LinkError::Timeout { dir: Dir::Read, waited, what: "the board sent no report" });
            }
        }
    }

    /// For the program: cancels the waiting calls of one direction.
    pub fn cancel(&self, dir: Dir) {
        self.state.lock().cancels[dir as usize] += 1;
        self.room.notify_all();
        self.readable.notify_all();
    }

    /// For the program: ends all calls. Frames written before are still sent until the time `until`.
    pub fn close(&self, until: Instant) {
        let mut state = self.state.lock();
        state.closing.get_or_insert(until);
        state.over = Some(LinkError::Closed);
        self.wake_all();
    }

    /// For the link's thread: records that the board is lost. Has no effect if the program has closed the link.
    pub fn lose(&self, why: LinkError) {
        let mut state = self.state.lock();
        state.over.get_or_insert(why);
        self.wake_all();
    }

    /// For the link's thread: records that the thread ends, so that the frames still queued count as not sent.
    pub fn end(&self) {
        let mut state = self.state.lock();
        state.unsent += state.held.len() as u64;
        state.held.clear();
        state.over.get_or_insert(LinkError::Closed);
        self.wake_all();
    }

    /// For the link's thread: queues a report. `op` says whether the board was in OP.
    pub fn report(&self, report: &Frame, at: Ns, op: bool) {
        let mut state = self.state.lock();
        state.op = op;
        if state.reports.len() >= state.queue {
            state.reports.pop_front();
            state.dropped += 1;
        }
        let number = state.next_report;
        state.reports.push_back((report.clone(), at, number));
        state.next_report += 1;
        self.readable.notify_all();
    }

    /// For the link's thread: records an invalid answer. Its report number stays unused, so that readers see a gap in
    /// [`ReadMeta::sequence`].
    pub fn no_report(&self) {
        self.state.lock().next_report += 1;
    }

    /// For the link's thread: copies the oldest frame of the program into `out` and removes it; returns whether there
    /// was one.
    pub fn take(&self, out: &mut Frame) -> bool {
        let mut state = self.state.lock();
        let Some(frame) = state.held.pop_front() else { return false };
        out.clone_from(&frame);
        self.room.notify_all();
        true
    }

    /// For the link's thread: waits until there may be work, at most until `until`.
    pub fn wait_for_work(&self, state: &mut MutexGuard<'_, QueueState>, until: Instant) {
        self.work.wait_until(state, until);
    }

    /// Returns the error of all calls once the board is lost or the link is closed.
    pub fn check(&self) -> Result<(), LinkError> {
        self.state.lock().check_open()
    }

    pub fn counts(&self) -> QueueCounts {
        let state = self.state.lock();
        QueueCounts { dropped: state.dropped, cleared: state.cleared, unsent: state.unsent, held: state.held.len() }
    }

    /// How many frames of the program are waiting to be sent.
    pub fn held(&self) -> usize {
        self.state.lock().held.len()
    }

    fn wake_all(&self) {
        self.work.notify_all();
        self.readable.notify_all();
        self.room.notify_all();
    }
}

impl QueueState {
    fn check_open(&self) -> Result<(), LinkError> {
        self.over.clone().map_or(Ok(()), Err)
    }

    /// Fails if calls in this direction were cancelled since a call began. `before`: [`Self::cancels`] when the call
    /// began.
    fn check_cancelled(&self, dir: Dir, before: [u64; 2]) -> Result<(), LinkError> {
        if self.cancels[dir as usize] == before[dir as usize] { Ok(()) } else { Err(LinkError::Cancelled { dir }) }
    }

    /// Counts the program's waiting frames for the pacer.
    pub fn held(&self, size: SlotSize) -> WaitingFrames {
        WaitingFrames {
            frames: self.held.len(),
            motion: self.held.front().is_some_and(|frame| has_motion(frame, size)),
            last: self.closing.is_some(),
        }
    }

    /// The time until which frames are still sent; `None` unless the program has closed the link.
    pub const fn closing(&self) -> Option<Instant> {
        self.closing
    }
}

/// Whether the frame discards the entries of the board's FIFO. The frames that the link has not sent yet are then
/// discarded too. \[OURS]
fn discards_fifo(frame: &Frame, size: SlotSize) -> bool {
    MasterCommand::decode(&frame.slot(size, 0), size).is_ok_and(|command| command.discards_fifo())
}

/// Waits for a change of the state; fails with a timeout once `limit` has passed.
fn wait(
    queue: &WaitQueue,
    state: &mut MutexGuard<'_, QueueState>,
    began: Instant,
    limit: Option<Duration>,
) -> Result<(), Duration> {
    let left = match limit {
        None => None,
        Some(limit) => match limit.checked_sub(began.elapsed()) {
            Some(left) if !left.is_zero() => Some(left),
            _ => return Err(limit),
        },
    };
    let ticket = queue.ticket();
    MutexGuard::unlocked(state, || queue.wait(ticket, left));
    Ok(())
}
