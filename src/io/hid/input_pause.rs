//! While a program writes and reads nothing, its reports may stay in the system's queue, which keeps the newest of them as the
//! pipe's queue does. Receiving each report costs time that the writes lack, since Windows has to be asked for every single
//! one.
//!
//! Reports that the system drops meanwhile are not counted, so a pipe pauses its input only if its owner allows it
//! ([`PipeOptions::may_pause_input`]).

use std::time::{Duration, Instant};

use parking_lot::MutexGuard;

use super::backend::Backend;
use super::pipe::PipeOptions;
use super::reports::{GONE, Shared, State};

/// A pause begins when no call has read for this long .. \[OURS]
const PAUSE_AFTER_UNREAD: Duration = Duration::from_millis(250);
/// .. and this many have written since: without writes the loss of the board would not be noticed. \[OURS]
const PAUSE_AFTER_WRITES: u32 = 64;
/// A pause ends when no call has written for this long. \[OURS]
pub(super) const PAUSE_ENDS_AFTER_UNWRITTEN: Duration = Duration::from_secs(1);
/// How long the first read after a pause waits at most until the reports of the system's queue are received. \[OURS]
const CATCH_UP_WITHIN: Duration = Duration::from_millis(50);

/// The state of a pipe's input.
pub(super) struct InputPause {
    allowed: bool,
    /// When the last read ended.
    read_at: Instant,
    /// When the last write began.
    wrote_at: Instant,
    /// How many reads are under way.
    reads: usize,
    /// How many writes began since the last read.
    writes: u32,
    phase: Phase,
    /// Transfers to the host that are not submitted because of the pause.
    held_back: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Transfers to the host are submitted at all times.
    Receiving,
    /// Reports stay in the system's queue.
    Paused,
    /// Transfers are submitted again, and the system's queue is emptied.
    CatchingUp {
        /// How many reports that queue may still hold.
        missing: usize,
        /// When it counts as empty in any case.
        until: Instant,
    },
}

/// A pipe that may not pause its input.
impl Default for InputPause {
    fn default() -> Self {
        let now = Instant::now();
        Self {
            allowed: false,
            read_at: now,
            wrote_at: now,
            reads: 0,
            writes: 0,
            phase: Phase::Receiving,
            held_back: Vec::new(),
        }
    }
}

impl InputPause {
    pub fn new(options: PipeOptions) -> Self {
        Self { allowed: options.may_pause_input, held_back: Vec::with_capacity(options.transfers), ..Self::default() }
    }

    /// Whether transfer `number`, which has ended, is not to be submitted again because of the pause.
    pub fn keeps_back(&mut self, number: usize) -> bool {
        let paused = self.phase == Phase::Paused;
        if paused {
            self.held_back.push(number);
        }
        paused
    }

    /// Whether the input is paused and all `inputs` transfers to the host have ended.
    pub fn is_complete(&self, inputs: usize) -> bool {
        self.phase == Phase::Paused && self.held_back.len() == inputs
    }

    pub fn note_write(&mut self) {
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

    /// A report was received.
    pub const fn note_report(&mut self) {
        if let Phase::CatchingUp { missing, .. } = &mut self.phase {
            *missing = missing.saturating_sub(1);
        }
    }

    /// How long the reports of the system's queue may still take; `None` once they are received. Then the system's queue is
    /// set to its greatest length again.
    fn catch_up_time_left(&mut self, backend: &dyn Backend) -> Option<Duration> {
        let Phase::CatchingUp { missing, until } = self.phase else { return None };
        let left = until.saturating_duration_since(Instant::now());
        if missing > 0 && !left.is_zero() {
            return Some(left);
        }
        self.phase = Phase::Receiving;
        backend.set_system_queue(None);
        None
    }

    fn is_due(&self) -> bool {
        self.allowed
            && self.phase == Phase::Receiving
            && self.reads == 0
            && self.writes >= PAUSE_AFTER_WRITES
            && self.read_at.elapsed() >= PAUSE_AFTER_UNREAD
    }
}

impl Shared {
    /// Called by the pipe's thread: begins a pause when it is due, and ends one when no call writes any more.
    pub fn begin_or_end_pause(&self, state: &mut State, backend: &dyn Backend) {
        if state.closing || state.lost.is_some() {
            return;
        }
        if state.input_pause.is_due() {
            if backend.set_system_queue(Some(self.queue)) {
                state.input_pause.phase = Phase::Paused;
            } else {
                state.input_pause.allowed = false;
            }
        } else if state.input_pause.phase == Phase::Paused
            && state.input_pause.wrote_at.elapsed() >= PAUSE_ENDS_AFTER_UNWRITTEN
        {
            self.end_pause(state, backend);
        } else {
            state.input_pause.catch_up_time_left(backend);
        }
    }

    /// Ends a pause: submits the transfers to the host again.
    pub fn end_pause(&self, state: &mut State, backend: &dyn Backend) {
        if state.input_pause.phase != Phase::Paused || state.closing || state.lost.is_some() {
            return;
        }
        state.input_pause.phase = Phase::CatchingUp { missing: self.queue, until: Instant::now() + CATCH_UP_WITHIN };
        state.input_pause.writes = 0;
        while let Some(number) = state.input_pause.held_back.pop() {
            if backend.submit_input(number).is_err() {
                return self.lose(state, GONE);
            }
            state.submitted += 1;
        }
        // The pipe's thread checks for events at the usual interval again.
        self.thread_wakeup.notify_all();
    }

    /// Called by a read after a pause: waits until the pipe's queue holds the newest reports, or for at most `limit`.
    pub fn catch_up(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend, limit: Option<Duration>) {
        let (began, cancelled) = (Instant::now(), state.cancelled_reads);
        while let Some(left) = state.input_pause.catch_up_time_left(backend) {
            let left = limit.map_or(left, |limit| left.min(limit.saturating_sub(began.elapsed())));
            if left.is_zero() || state.closing || state.lost.is_some() || state.cancelled_reads != cancelled {
                return;
            }
            self.wait(&self.readable, state, backend, Some(left));
        }
    }
}
