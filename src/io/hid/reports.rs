//! The state that a pipe and its backend share, and how the end of a transfer changes it: a report is queued, a write
//! is done, the device is lost.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::REPORT_LEN;
use super::backend::{Outcome, TransferListener};
use super::error::UsbError;
use super::input_pause::InputPause;
use super::pipe::{PipeError, PipeOptions, PipeStats};
use crate::threads::sync::unlockable::{Condvar, Mutex, MutexGuard};
use crate::threads::{CallingThread, WaitQueue};

/// How many transfers in a row may fail on the wire before the device counts as lost. \[OURS]
const FAILURES_MAX: u32 = 8;

/// Number of reports for which the queue has memory when the pipe is opened; a queue with a larger capacity grows as it
/// fills. \[OURS]
const QUEUE_CAPACITY_INITIAL: usize = 1024;

/// Number of threads of each kind, that read or that wait for their turn to write, for which memory is allocated when the
/// pipe is opened. \[OURS]
pub(super) const THREADS_CAPACITY: usize = 16;

// The reasons for the loss of a device, as texts for the user.
pub(super) const GONE: &str = "it was pulled or has reset itself (SW_RESET)";
const STALLED: &str = "it refuses to send (its endpoint stalls); if it does so again, switch it off and on";
const FAILING: &str = "its transfers fail: it was pulled, or the cable or the hub is bad";
const DEFECT: &str = "a defect of this library has ended its transfers; open it again, and please report it with the \
                      output of ECMSK_LOG=trace";
/// Why the device is lost if a thread was ended by force during a write, so that the end of its transfer is never
/// reported. [`State::events_failed`] is then set too.
pub(super) const ABANDONED: &str = "a thread of the program was ended in a write to it; open it again";
/// Why the device is lost if the backend's event handling has failed for good. [`State::events_failed`] is then set
/// too.
pub(super) const EVENTS_FAILED: &str = "this system does not say any more what becomes of its transfers; pull it and plug it in \
                               again, and look at the system's log";

/// A report from the device, in the queue of the pipe.
pub(super) struct Report {
    pub bytes: [u8; REPORT_LEN],
    /// The time at which this process received the report from the system.
    pub at: Instant,
    /// The report's number since the pipe was opened, from 0.
    pub number: u64,
}

#[derive(Default)]
pub(super) struct State {
    pub reports: VecDeque<Report>,
    /// How many transfers to the host are submitted and have not ended. Only the pipe's thread changes this number, once the
    /// pipe is open: a thread of the program may be ended between a transfer and its count.
    pub inputs_submitted: usize,
    /// The thread that writes, followed by the threads that wait for their turn.
    pub writers: VecDeque<CallingThread>,
    /// Whether the transfer to the device is submitted and has not ended.
    pub output_submitted: bool,
    /// How the transfer to the device has ended, with the number of bytes transferred; `None` until it has ended.
    pub output_result: Option<(Outcome, usize)>,
    /// Why the device is lost, as a text for the user; `None` while it is connected.
    pub lost: Option<&'static str>,
    /// Whether the endpoint to the host has stalled. Its halt is then cleared when the pipe is closed.
    pub stalled: bool,
    pub closing: bool,
    /// Number of cancellations of reads. A read ends when this number has changed since the read began.
    pub cancelled_reads: u64,
    /// Number of cancellations of writes. A write ends when this number has changed since the write began.
    pub cancelled_writes: u64,
    /// The thread that is in [`Backend::handle_events`](super::backend::Backend::handle_events); `None`: no thread is.
    pub event_handler: Option<CallingThread>,
    /// Counts how often a call has begun to wait or has stopped handling events. While the count changes, the program
    /// makes calls, which handle events themselves; the pipe's thread then only checks for events at an interval.
    pub call_count: u64,
    /// Whether the pipe's thread sleeps until the call that handles events returns.
    pub thread_asleep: bool,
    /// How many calls of the backend's event handling have failed in a row.
    pub event_errors: u32,
    /// Whether the backend's event handling has failed for good. The ends of transfers are then no longer reported, so
    /// the system may still use the memory of some transfers, and the device is lost.
    pub events_failed: bool,
    failures: u32,
    pub input_pause: InputPause,
    pub stats: PipeStats,
}

impl State {
    fn new(options: PipeOptions) -> Self {
        let reports = VecDeque::with_capacity(options.queue.min(QUEUE_CAPACITY_INITIAL));
        let writers = VecDeque::with_capacity(THREADS_CAPACITY);
        Self { reports, writers, input_pause: InputPause::new(options), ..Self::default() }
    }

    /// Whether a transfer is in flight, in either direction.
    pub const fn is_any_in_flight(&self) -> bool {
        self.inputs_submitted > 0 || self.output_submitted
    }

    /// Whether another thread than the calling thread handles events. If the calling thread itself is recorded as the
    /// event handler, this call comes from a signal handler that has interrupted the event handling.
    pub fn is_handled_by_another(&self) -> bool {
        self.event_handler.is_some_and(|handler| handler != CallingThread::current())
    }

    /// Whether the thread that submitted the transfer to the device was ended by force.
    pub fn is_write_abandoned(&self) -> bool {
        self.output_submitted && self.writers.front().is_none_or(CallingThread::is_gone)
    }

    /// Returns an error if the pipe is closed or the device is lost.
    pub fn check(&self) -> Result<(), PipeError> {
        if self.closing {
            return Err(PipeError::Closed);
        }
        self.lost.map_or(Ok(()), |why| Err(PipeError::Lost(why)))
    }
}

/// State that the threads that read, write and close share with the pipe's own thread.
pub(super) struct Shared {
    pub queue: usize,
    pub state: Mutex<State>,
    pub readable: WaitQueue,
    pub writable: WaitQueue,
    /// Wakes the pipe's own thread from its sleep.
    pub thread_wakeup: Condvar,
}

impl Shared {
    /// Creates the state. The queue keeps the newest [`PipeOptions::queue`] reports.
    pub fn new(options: PipeOptions) -> Self {
        Self {
            queue: options.queue,
            state: Mutex::new(State::new(options)),
            readable: WaitQueue::new(),
            writable: WaitQueue::new(),
            thread_wakeup: Condvar::new(),
        }
    }

    /// Waits until `queue` is notified, or for at most `limit`; without a limit as long as it takes. The state is
    /// unlocked during the wait.
    pub fn wait_at(queue: &WaitQueue, state: &mut MutexGuard<'_, State>, limit: Option<Duration>) {
        let ticket = queue.ticket();
        MutexGuard::unlocked(state, || queue.wait(ticket, limit));
    }

    /// Marks the device as lost and ends every wait. Unread reports are dropped and counted, because a program must not
    /// take an old state of the machine for the present one.
    pub fn lose(&self, state: &mut State, why: &'static str) {
        state.lost.get_or_insert(why);
        state.stats.dropped += state.reports.len() as u64;
        state.reports.clear();
        self.readable.notify_all();
        self.writable.notify_all();
    }

    /// Puts a report into the queue. The caller then wakes the waiting reads.
    fn keep(&self, state: &mut State, bytes: &[u8]) {
        // Some devices end a report with an empty packet. These and other short transfers are counted.
        let Ok(bytes) = <[u8; REPORT_LEN]>::try_from(bytes) else {
            state.stats.short += 1;
            return;
        };
        let number = state.stats.reports;
        state.stats.reports += 1;
        state.input_pause.note_report();
        if state.lost.is_some() {
            // This report was received before the device was lost, but is handled only now.
            state.stats.dropped += 1;
            return;
        }
        if state.reports.len() >= self.queue {
            state.reports.pop_front();
            state.stats.dropped += 1;
        }
        state.reports.push_back(Report { bytes, at: Instant::now(), number });
    }
}

impl TransferListener for Shared {
    fn input_ended(&self, number: usize, outcome: Outcome, bytes: &[u8], resubmit: &dyn Fn() -> Result<(), UsbError>) {
        let mut state = self.state.lock();
        match outcome {
            Outcome::Done => {
                state.failures = 0;
                self.keep(&mut state, bytes);
            }
            Outcome::Gone => self.lose(&mut state, GONE),
            Outcome::Stalled => {
                state.stalled = true;
                self.lose(&mut state, STALLED);
            }
            Outcome::Cancelled | Outcome::Failed => {
                state.failures += 1;
                state.stats.failed += u64::from(outcome == Outcome::Failed);
                if state.failures > FAILURES_MAX {
                    self.lose(&mut state, FAILING);
                }
            }
        }
        // The transfer is resubmitted while the lock is held. After `closing` is set, the pipe's thread cancels the
        // submitted transfers once, so no transfer may be submitted after that.
        let wanted = !state.closing && state.lost.is_none();
        let held_back = wanted && state.input_pause.keeps_back(number);
        if !wanted || held_back || resubmit().is_err() {
            state.inputs_submitted -= 1;
            if wanted && !held_back {
                self.lose(&mut state, GONE);
            }
        }
        drop(state);
        // Reads are woken only after the lock is released: otherwise a woken thread would wait for the lock at once.
        if outcome == Outcome::Done {
            self.readable.notify_all();
        }
    }

    fn output_ended(&self, outcome: Outcome, moved: usize) {
        let mut state = self.state.lock();
        state.output_submitted = false;
        state.output_result = Some((outcome, moved));
        if outcome == Outcome::Gone {
            self.lose(&mut state, GONE);
        }
        self.writable.notify_all();
    }

    fn panicked(&self) {
        let mut state = self.state.lock();
        // It is unknown whether the transfer was counted as ended, so no thread may wait for its end.
        state.events_failed = true;
        self.lose(&mut state, DEFECT);
    }
}
