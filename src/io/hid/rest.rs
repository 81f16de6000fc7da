//! Rest: while a program writes and reads nothing, its reports are left to the system, which keeps the newest of them as the
//! pipe does. Each report that is taken takes its time from the writes: Windows is asked for every single one.
//!
//! What the system drops meanwhile nobody counts, so that a pipe rests only if its owner lets it.

use std::time::{Duration, Instant};

use parking_lot::MutexGuard;

use super::line::Line;
use super::pipe::Limits;
use super::reports::{GONE, Shared, State};

/// So long no call has read .. \[OURS]
const UNREAD_FOR: Duration = Duration::from_millis(250);
/// .. and so many have written: a program that does nothing is told at once that its board has gone. \[OURS]
const WRITES: u32 = 64;
/// A rest ends when none has written for so long. \[OURS]
pub(super) const UNWRITTEN_FOR: Duration = Duration::from_secs(1);
/// How long the first read waits at most until it has what the system kept. \[OURS]
const TAKEN_WITHIN: Duration = Duration::from_millis(50);

/// What a pipe knows of its rest.
pub(super) struct Rest {
    allowed: bool,
    /// When a read was under way for the last time.
    read_at: Instant,
    /// When the last write began.
    wrote_at: Instant,
    /// Reads under way.
    reads: usize,
    /// Writes since the last read.
    writes: u32,
    phase: Phase,
    /// Transfers to the host that are not handed over.
    parked: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Reports are taken as they come.
    Taking,
    Resting,
    /// So many reports may still lie with the system, which has until then.
    CatchingUp {
        missing: usize,
        until: Instant,
    },
}

/// A pipe that may not rest.
impl Default for Rest {
    fn default() -> Self {
        let now = Instant::now();
        Self {
            allowed: false,
            read_at: now,
            wrote_at: now,
            reads: 0,
            writes: 0,
            phase: Phase::Taking,
            parked: Vec::new(),
        }
    }
}

impl Rest {
    pub fn new(limits: Limits) -> Self {
        Self { allowed: limits.rests, parked: Vec::with_capacity(limits.transfers), ..Self::default() }
    }

    /// Whether a transfer that has ended is left with the pipe.
    pub fn parks(&mut self, number: usize) -> bool {
        let resting = self.phase == Phase::Resting;
        if resting {
            self.parked.push(number);
        }
        resting
    }

    /// Whether nothing comes from the host's transfers, of which there are so many.
    pub fn is_whole(&self, inputs: usize) -> bool {
        self.phase == Phase::Resting && self.parked.len() == inputs
    }

    pub fn wrote(&mut self) {
        self.writes = self.writes.saturating_add(1);
        if self.allowed {
            self.wrote_at = Instant::now();
        }
    }

    pub const fn begin_read(&mut self) {
        self.reads += 1;
    }

    pub fn end_read(&mut self) {
        self.reads -= 1;
        self.writes = 0;
        if self.allowed {
            self.read_at = Instant::now();
        }
    }

    /// A report came.
    pub const fn took_one(&mut self) {
        if let Phase::CatchingUp { missing, .. } = &mut self.phase {
            *missing = missing.saturating_sub(1);
        }
    }

    /// How long it may take yet until what the system kept is here. Then the system keeps as many as it can again.
    fn behind_for(&mut self, line: &dyn Line) -> Option<Duration> {
        let Phase::CatchingUp { missing, until } = self.phase else { return None };
        let left = until.saturating_duration_since(Instant::now());
        if missing > 0 && !left.is_zero() {
            return Some(left);
        }
        self.phase = Phase::Taking;
        line.keep(None);
        None
    }

    fn is_due(&self) -> bool {
        self.allowed
            && self.phase == Phase::Taking
            && self.reads == 0
            && self.writes >= WRITES
            && self.read_at.elapsed() >= UNREAD_FOR
    }
}

impl Shared {
    /// The pipe's thread: begins a rest when it is time, and ends it when nobody writes any more.
    pub fn look_at_rest(&self, state: &mut State, line: &dyn Line) {
        if state.closing || state.lost.is_some() {
            return;
        }
        if state.rest.is_due() {
            if line.keep(Some(self.queue)) {
                state.rest.phase = Phase::Resting;
            } else {
                state.rest.allowed = false;
            }
        } else if state.rest.phase == Phase::Resting && state.rest.wrote_at.elapsed() >= UNWRITTEN_FOR {
            self.end_rest(state, line);
        } else {
            state.rest.behind_for(line);
        }
    }

    /// Reports are taken again.
    pub fn end_rest(&self, state: &mut State, line: &dyn Line) {
        if state.rest.phase != Phase::Resting || state.closing || state.lost.is_some() {
            return;
        }
        state.rest.phase = Phase::CatchingUp { missing: self.queue, until: Instant::now() + TAKEN_WITHIN };
        state.rest.writes = 0;
        while let Some(number) = state.rest.parked.pop() {
            if line.begin_input(number).is_err() {
                return self.lose(state, GONE);
            }
            state.pending += 1;
        }
        // It looks as often as before from now on.
        self.look_around.notify_all();
    }

    /// A read: waits until the reports that are kept are the newest, or its limit is over.
    pub fn catch_up(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Option<Duration>) {
        let (began, cancelled) = (Instant::now(), state.cancelled_reads);
        while let Some(left) = state.rest.behind_for(line) {
            let left = limit.map_or(left, |limit| left.min(limit.saturating_sub(began.elapsed())));
            if left.is_zero() || state.closing || state.lost.is_some() || state.cancelled_reads != cancelled {
                return;
            }
            self.wait(&self.readable, state, line, Some(left));
        }
    }
}
