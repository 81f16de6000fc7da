//! What happens on a pipe while nobody looks: reports come in and are kept, transfers end, the device goes.

use std::collections::VecDeque;
use std::time::Instant;

use parking_lot::{Condvar, Mutex};

use super::REPORT_LEN;
use super::error::UsbError;
use super::line::{Ended, Outcome};
use super::pipe::{Limits, PipeError, PipeStats};
use super::rest::Rest;

/// Transfers in a row that may fail on the wire before the device counts as gone. \[OURS]
const FAILURES: u32 = 8;

/// Reports that room is made for beforehand; a longer queue grows as it fills. \[OURS]
const PREPARED: usize = 1024;

pub(super) const GONE: &str = "it was pulled or has reset itself (SW_RESET)";
const STALLED: &str = "it refuses to send (its endpoint stalls); if it does so again, switch it off and on";
const FAILING: &str = "its transfers fail: it was pulled, or the cable or the hub is bad";
const DEFECT: &str = "a defect of this library has ended its transfers; open it again, and please report it with the \
                      output of ECMSK_LOG=trace";
/// See [`State::deaf`].
pub(super) const DEAF: &str = "this system does not say any more what becomes of its transfers; pull it and plug it in \
                               again, and look at the system's log";

/// A report from the device.
pub(super) struct Report {
    pub bytes: [u8; REPORT_LEN],
    pub at: Instant,
    pub number: u64,
}

#[derive(Default)]
pub(super) struct State {
    pub reports: VecDeque<Report>,
    /// Transfers that the system has.
    pub pending: usize,
    /// How the transfer to the device ended, once it has.
    pub written: Option<(Outcome, usize)>,
    pub lost: Option<&'static str>,
    /// The endpoint to the host stalled.
    pub stalled: bool,
    pub closing: bool,
    pub cancelled_reads: u64,
    pub cancelled_writes: u64,
    /// A thread handles the line's events.
    pub handled: bool,
    /// Times that a call has begun to wait, or has left the line's events.
    pub turns: u64,
    /// Calls that wait while another thread handles events.
    pub waiting: usize,
    /// The pipe's thread sleeps until a call leaves the line's events.
    pub asleep: bool,
    /// Errors of the line's event handling in a row.
    pub event_errors: u32,
    /// The line's events fail for good: the end of no transfer is told any more, and the system may have some. The device
    /// is lost.
    pub deaf: bool,
    failures: u32,
    pub rest: Rest,
    pub stats: PipeStats,
}

impl State {
    fn new(limits: Limits) -> Self {
        let reports = VecDeque::with_capacity(limits.queue.min(PREPARED));
        Self { reports, rest: Rest::new(limits), ..Self::default() }
    }

    /// Whether the device is there.
    pub fn fit(&self) -> Result<(), PipeError> {
        if self.closing {
            return Err(PipeError::Closed);
        }
        self.lost.map_or(Ok(()), |why| Err(PipeError::Lost(why)))
    }
}

/// What the threads that read, write and close share with the pipe's own.
pub(super) struct Shared {
    pub queue: usize,
    pub state: Mutex<State>,
    pub readable: Condvar,
    pub writable: Condvar,
    /// For the pipe's own thread.
    pub look_around: Condvar,
}

impl Shared {
    /// Keeps the newest reports, as many as `limits` say.
    pub fn new(limits: Limits) -> Self {
        let [readable, writable, look_around] = [const { Condvar::new() }; 3];
        Self { queue: limits.queue, state: Mutex::new(State::new(limits)), readable, writable, look_around }
    }

    /// Ends every wait: the device is gone. Reports that nobody has read are gone with it, and counted: a program that
    /// looks at a machine's state must not be told an old one as if the board were still there.
    pub fn lose(&self, state: &mut State, why: &'static str) {
        state.lost.get_or_insert(why);
        state.stats.dropped += state.reports.len() as u64;
        state.reports.clear();
        self.readable.notify_all();
        self.writable.notify_all();
    }

    fn keep(&self, state: &mut State, bytes: &[u8]) {
        // Devices that end a report by an empty packet, and nonsense, are counted.
        let Ok(bytes) = <[u8; REPORT_LEN]>::try_from(bytes) else {
            state.stats.short += 1;
            return;
        };
        let number = state.stats.reports;
        state.stats.reports += 1;
        state.rest.took_one();
        if state.lost.is_some() {
            // It came before the device went, and is looked at afterwards.
            state.stats.dropped += 1;
            return;
        }
        if state.reports.len() >= self.queue {
            state.reports.pop_front();
            state.stats.dropped += 1;
        }
        state.reports.push_back(Report { bytes, at: Instant::now(), number });
        self.readable.notify_one();
    }
}

impl Ended for Shared {
    fn input(&self, number: usize, outcome: Outcome, bytes: &[u8], again: &dyn Fn() -> Result<(), UsbError>) {
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
                if state.failures > FAILURES {
                    self.lose(&mut state, FAILING);
                }
            }
        }
        // With the lock still: whoever closes the pipe cancels what was handed over before, and nothing is afterwards.
        let wanted = !state.closing && state.lost.is_none();
        let parked = wanted && state.rest.parks(number);
        if wanted && !parked && again().is_ok() {
            return;
        }
        state.pending -= 1;
        if wanted && !parked {
            self.lose(&mut state, GONE);
        }
    }

    fn output(&self, outcome: Outcome, moved: usize) {
        let mut state = self.state.lock();
        state.pending -= 1;
        state.written = Some((outcome, moved));
        if outcome == Outcome::Gone {
            self.lose(&mut state, GONE);
        }
        self.writable.notify_all();
    }

    fn defective(&self) {
        let mut state = self.state.lock();
        // Nobody waits for the end of a transfer that may have been counted already, or may not.
        state.deaf = true;
        self.lose(&mut state, DEFECT);
    }
}
