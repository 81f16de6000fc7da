//! Pauses the input of a pipe while a program does not read: the board's reports then stay in the system's queue. That
//! queue drops the oldest reports when it is full, as the pipe's own queue does. Without a pause the pipe would call
//! Windows for each report, which takes processor time from the program's writes.
//!
//! The system does not count the reports that it drops meanwhile, so a pipe pauses its input only if its owner allows
//! pauses ([`PipeOptions::may_pause_input`]). If the device is lost during a pause, the next call notices the loss.

use std::time::{Duration, Instant};

use super::backend::Backend;
use super::pipe::PipeOptions;
use super::reports::{GONE, Shared, State, THREADS_CAPACITY};
use crate::threads::CallingThread;
use crate::threads::sync::unlockable::MutexGuard;

/// A pause of the input begins when no call has read for this long. \[OURS]
const PAUSE_AFTER_UNREAD: Duration = Duration::from_millis(250);
/// The maximum time for which the first read after a pause waits until the pipe has received the reports in the
/// system's queue. \[OURS]
const CATCH_UP_WITHIN: Duration = Duration::from_millis(50);

/// Whether a pipe's input is paused, and what is needed to begin and end a pause.
pub(super) struct InputPause {
    allowed: bool,
    /// When the last read of the program ended.
    read_at: Instant,
    /// The threads of the program that are in a read at present.
    readers: Vec<CallingThread>,
    phase: Phase,
    /// The numbers of the transfers to the host that have ended in the pause and were not submitted again.
    held_back: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// There is no pause: all transfers to the host are submitted.
    Receiving,
    /// The input is paused: no transfer to the host is submitted, so reports stay in the system's queue.
    Paused,
    /// A call needs the input again: the pipe's thread will submit the transfers.
    Ending {
        /// How long this call waits for the reports in the system's queue.
        until: Instant,
    },
    /// The pause has ended: transfers are submitted again, and the reports in the system's queue are received first.
    CatchingUp {
        /// How many of the reports in the system's queue may not have been received yet.
        missing: usize,
        /// From this time on the system's queue counts as empty, whatever `missing` is.
        until: Instant,
    },
}

/// The state of a pipe whose owner has not allowed it to pause the input.
impl Default for InputPause {
    fn default() -> Self {
        let held_back = Vec::new();
        let readers = Vec::new();
        Self { allowed: false, read_at: Instant::now(), readers, phase: Phase::Receiving, held_back }
    }
}

impl InputPause {
    pub fn new(options: PipeOptions) -> Self {
        Self {
            allowed: options.may_pause_input,
            readers: Vec::with_capacity(THREADS_CAPACITY),
            held_back: Vec::with_capacity(options.transfers),
            ..Self::default()
        }
    }

    /// Whether the transfer `number`, which has ended, must not be submitted again because of the pause.
    pub fn keeps_back(&mut self, number: usize) -> bool {
        let paused = self.phase == Phase::Paused;
        if paused {
            self.held_back.push(number);
        }
        paused
    }

    /// Whether the input is paused, so that the loss of the device is noticed only when a call checks for it.
    pub fn is_paused(&self) -> bool {
        self.phase == Phase::Paused
    }

    /// Whether the input is paused and all `inputs` transfers to the host have ended, so that the pipe's thread has no
    /// events to wait for.
    pub fn is_complete(&self, inputs: usize) -> bool {
        self.phase == Phase::Paused && self.held_back.len() == inputs
    }

    pub fn begin_read(&mut self) {
        if self.allowed {
            if self.readers.len() == self.readers.capacity() {
                self.readers.retain(|reader| !reader.is_gone());
            }
            self.readers.push(CallingThread::current());
        }
    }

    pub fn end_read(&mut self) {
        if self.allowed {
            self.read_at = Instant::now();
            let own = CallingThread::current();
            if let Some(own) = self.readers.iter().position(|reader| *reader == own) {
                self.readers.swap_remove(own);
            }
        }
    }

    /// Records that a report was received, while the system's queue is being emptied.
    pub const fn note_report(&mut self) {
        if let Phase::CatchingUp { missing, .. } = &mut self.phase {
            *missing = missing.saturating_sub(1);
        }
    }

    /// How much longer to wait for the remaining reports in the system's queue, which the pause has shortened to the
    /// length of the pipe's queue. `None` once all of these reports are received or the time is over. This function
    /// then sets the system's queue to its maximum length again.
    fn catch_up_time_left(&mut self, backend: &dyn Backend) -> Option<Duration> {
        let (missing, until) = match self.phase {
            Phase::CatchingUp { missing, until } => (missing, until),
            Phase::Ending { until } => {
                return Some(until.saturating_duration_since(Instant::now())).filter(|left| !left.is_zero());
            }
            Phase::Receiving | Phase::Paused => return None,
        };
        let left = until.saturating_duration_since(Instant::now());
        if missing > 0 && !left.is_zero() {
            return Some(left);
        }
        self.phase = Phase::Receiving;
        backend.set_system_queue(None);
        None
    }

    fn is_due(&mut self) -> bool {
        if !self.allowed || self.phase != Phase::Receiving || self.read_at.elapsed() < PAUSE_AFTER_UNREAD {
            return false;
        }
        // The end of a read is recorded by its thread. A thread that was ended by force records nothing, so its read is
        // removed here.
        self.readers.retain(|reader| !reader.is_gone());
        self.readers.is_empty()
    }
}

impl Shared {
    /// Called by the pipe's thread: begins a pause if no call has read for [`PAUSE_AFTER_UNREAD`], and submits the transfers
    /// again if a call needs them. Otherwise ends the catch-up phase ([`Phase::CatchingUp`]) if it is over.
    pub fn look_at_pause(&self, state: &mut State, backend: &dyn Backend) {
        if state.closing || state.lost.is_some() {
            return;
        }
        if let Phase::Ending { until } = state.input_pause.phase {
            state.input_pause.phase = Phase::CatchingUp { missing: self.queue, until };
            while let Some(number) = state.input_pause.held_back.pop() {
                if backend.submit_input(number).is_err() {
                    return self.lose(state, GONE);
                }
                state.inputs_submitted += 1;
            }
        } else if !state.input_pause.is_due() {
            state.input_pause.catch_up_time_left(backend);
        } else if backend.set_system_queue(Some(self.queue)) {
            state.input_pause.phase = Phase::Paused;
        } else {
            state.input_pause.allowed = false;
        }
    }

    /// Ends a pause: the pipe's thread submits the transfers to the host again. It does so and not the thread of the program,
    /// which may be ended between two of them.
    pub fn end_pause(&self, state: &mut State, backend: &dyn Backend) {
        if state.input_pause.phase != Phase::Paused || state.closing || state.lost.is_some() {
            return;
        }
        state.input_pause.phase = Phase::Ending { until: Instant::now() + CATCH_UP_WITHIN };
        self.thread_wakeup.notify_all();
        if state.event_handler.is_some() {
            backend.interrupt();
        }
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
