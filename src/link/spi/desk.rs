//! What the host's threads and the link's own hand to each other: frames out, reports in. Everything is allocated when
//! the desk is made, and nobody holds its lock across a wait or an exchange.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::pacer::{Held, Ns, has_motion};
use crate::link::{Dir, LinkError};
use crate::sk::{FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, SlotSize};

/// Frames that a program may be ahead by: as many as the board's FIFO has entries. \[OURS]
const HELD: usize = FIFO_ENTRIES as usize;

pub(super) struct State {
    held: VecDeque<Frame>,
    reports: VecDeque<(Frame, Ns, u64)>,
    queue: usize,
    next_report: u64,
    dropped: u64,
    /// Frames of the host that were dropped, as the board's FIFO drops its entries: SET_FIFO clear, leaving OP, reset.
    cleared: u64,
    /// Frames of the host that did not go out any more.
    unsent: u64,
    /// Why no call works any more.
    over: Option<LinkError>,
    /// The host has closed the link, and this is when what it has written must be out.
    closing: Option<Instant>,
    cancelled_reads: u64,
    cancelled_writes: u64,
    op: bool,
}

/// Counts of a desk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct DeskCounts {
    pub dropped: u64,
    pub cleared: u64,
    pub unsent: u64,
    pub held: usize,
}

pub(super) struct Desk {
    state: Mutex<State>,
    /// For the link's thread.
    work: Condvar,
    readable: Condvar,
    room: Condvar,
}

impl Desk {
    /// With room for so many reports.
    pub fn new(queue: usize) -> Self {
        let queue = queue.max(1);
        let state = State {
            held: VecDeque::with_capacity(HELD),
            reports: VecDeque::with_capacity(queue),
            queue,
            next_report: 0,
            dropped: 0,
            cleared: 0,
            unsent: 0,
            over: None,
            closing: None,
            cancelled_reads: 0,
            cancelled_writes: 0,
            op: false,
        };
        Self { state: Mutex::new(state), work: Condvar::new(), readable: Condvar::new(), room: Condvar::new() }
    }

    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// Host: hands a frame over.
    pub fn write(&self, frame: &Frame, size: SlotSize, limit: Option<Duration>) -> Result<(), Refused> {
        let began = Instant::now();
        let mut state = self.state.lock();
        let cancelled = state.cancelled_writes;
        loop {
            state.fit()?;
            if state.op && drops_what_is_ahead(frame, size) {
                state.cleared += state.held.len() as u64;
                state.held.clear();
                self.room.notify_all();
            }
            if state.held.len() < HELD {
                break;
            }
            if state.cancelled_writes != cancelled {
                return Err(LinkError::Cancelled { dir: Dir::Write }.into());
            }
            wait(&self.room, &mut state, began, limit)?;
        }
        state.held.push_back(frame.clone());
        self.work.notify_one();
        Ok(())
    }

    /// Host: takes the oldest report.
    pub fn read(&self, out: &mut Frame, limit: Option<Duration>) -> Result<(Ns, u64, u64), Refused> {
        let began = Instant::now();
        let mut state = self.state.lock();
        let cancelled = state.cancelled_reads;
        loop {
            // What came before the board was lost can still be read; after closing nothing is.
            if state.closing.is_some() {
                state.fit()?;
            }
            if let Some((frame, at, number)) = state.reports.pop_front() {
                out.clone_from(&frame);
                return Ok((at, number, state.dropped));
            }
            state.fit()?;
            if state.cancelled_reads != cancelled {
                return Err(LinkError::Cancelled { dir: Dir::Read }.into());
            }
            wait(&self.readable, &mut state, began, limit)?;
        }
    }

    /// Host: ends the calls of one direction that wait.
    pub fn cancel(&self, dir: Dir) {
        let mut state = self.state.lock();
        match dir {
            Dir::Write => state.cancelled_writes += 1,
            Dir::Read => state.cancelled_reads += 1,
        }
        self.room.notify_all();
        self.readable.notify_all();
    }

    /// Host: every call ends; what was written is to be out by then.
    pub fn close(&self, until: Instant) {
        let mut state = self.state.lock();
        state.closing.get_or_insert(until);
        state.over = Some(LinkError::Closed);
        self.wake_all();
    }

    /// The link's thread: the board is lost, unless the host has closed the link.
    pub fn lose(&self, why: LinkError) {
        let mut state = self.state.lock();
        state.over.get_or_insert(why);
        self.wake_all();
    }

    /// The link's thread: it ends, and what it holds does not go out.
    pub fn end(&self) {
        let mut state = self.state.lock();
        state.unsent += state.held.len() as u64;
        state.held.clear();
        state.over.get_or_insert(LinkError::Closed);
        self.wake_all();
    }

    /// The link's thread: a report came.
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
        self.readable.notify_one();
    }

    /// The link's thread: an answer came that is none; its number is left out.
    pub fn no_report(&self) {
        self.state.lock().next_report += 1;
    }

    /// The link's thread: the oldest frame of the host.
    pub fn take(&self, out: &mut Frame) -> bool {
        let mut state = self.state.lock();
        let Some(frame) = state.held.pop_front() else { return false };
        out.clone_from(&frame);
        self.room.notify_one();
        true
    }

    /// The link's thread: waits for work until then.
    pub fn wait_for_work(&self, state: &mut MutexGuard<'_, State>, until: Instant) {
        self.work.wait_until(state, until);
    }

    /// Whether calls work.
    pub fn check(&self) -> Result<(), LinkError> {
        self.state.lock().fit()
    }

    pub fn counts(&self) -> DeskCounts {
        let state = self.state.lock();
        DeskCounts { dropped: state.dropped, cleared: state.cleared, unsent: state.unsent, held: state.held.len() }
    }

    /// How many frames of the host are held.
    pub fn held(&self) -> usize {
        self.state.lock().held.len()
    }

    fn wake_all(&self) {
        self.work.notify_all();
        self.readable.notify_all();
        self.room.notify_all();
    }
}

impl State {
    fn fit(&self) -> Result<(), LinkError> {
        self.over.clone().map_or(Ok(()), Err)
    }

    pub fn held(&self, size: SlotSize) -> Held {
        Held {
            frames: self.held.len(),
            motion: self.held.front().is_some_and(|frame| has_motion(frame, size)),
            last: self.closing.is_some(),
        }
    }

    /// Until when what was written must be out, once the link is being closed.
    pub const fn closing(&self) -> Option<Instant> {
        self.closing
    }
}

/// Why a call of the host did not do its work.
pub(super) enum Refused {
    /// The limit has passed.
    Timeout(Duration),
    /// For this reason.
    Error(LinkError),
}

impl From<LinkError> for Refused {
    fn from(error: LinkError) -> Self {
        Self::Error(error)
    }
}

/// What acts on a board's arrival before what is ahead of it in the FIFO (SK-5), and drops it: the link's part of what is
/// ahead goes as well. \[OURS]
fn drops_what_is_ahead(frame: &Frame, size: SlotSize) -> bool {
    match MasterCommand::decode(&frame.slot(size, 0), size) {
        Ok(MasterCommand::SetFifo(FifoAction::Clear) | MasterCommand::SoftReset) => true,
        Ok(MasterCommand::SetState(state)) => state != MasterState::Op,
        _ => false,
    }
}

fn wait(
    changed: &Condvar,
    state: &mut MutexGuard<'_, State>,
    began: Instant,
    limit: Option<Duration>,
) -> Result<(), Refused> {
    // A limit too far away to be a moment is none.
    match limit.and_then(|limit| Some((limit, began.checked_add(limit)?))) {
        Some((limit, until)) if Instant::now() >= until => Err(Refused::Timeout(limit)),
        Some((_, until)) => {
            changed.wait_until(state, until);
            Ok(())
        }
        None => {
            changed.wait(state);
            Ok(())
        }
    }
}
