//! An open device: a queue of reports from it, one report at a time to it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};
use rusb::{Context, DeviceHandle, UsbContext};

use super::transfer::{Ended, Outcome, Transfer};
use super::{Found, REPORT_LEN, Shape};
use crate::threads;

/// How often the thread for libusb's events looks whether it is to end, should nothing wake it. \[OURS]
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Transfers in a row that may fail on the wire before the device counts as gone. \[OURS]
const FAILURES: u32 = 8;

/// Sizes of a pipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Transfers to the host that are handed over at a time: 1 or more.
    pub transfers: usize,
    /// Reports kept while nobody reads, the newest ones: 1 or more.
    pub queue: usize,
}

/// Why a call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PipeError {
    /// Nothing happened within the limit.
    #[error("nothing within {0:?}")]
    Timeout(Duration),
    /// The call was ended by [`Pipe::cancel_reads`] or [`Pipe::cancel_writes`].
    #[error("the call was cancelled")]
    Cancelled,
    /// The pipe is closed.
    #[error("it is closed")]
    Closed,
    /// The device is gone.
    #[error("{0}")]
    Lost(&'static str),
    /// Part of a report was moved.
    #[error("{moved} of {REPORT_LEN} bytes were moved")]
    Torn {
        /// Bytes.
        moved: usize,
    },
    /// libusb refuses.
    #[error(transparent)]
    Usb(#[from] rusb::Error),
}

/// Counts of a pipe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PipeStats {
    /// Reports that came.
    pub reports: u64,
    /// Reports that were dropped because nobody read them.
    pub dropped: u64,
    /// Transfers to the host that were empty or short.
    pub short: u64,
    /// Transfers that failed on the wire.
    pub failed: u64,
}

/// A report from the device.
#[derive(Clone)]
struct Report {
    bytes: [u8; REPORT_LEN],
    at: Instant,
    number: u64,
}

#[derive(Default)]
struct State {
    reports: VecDeque<Report>,
    /// Transfers that libusb has.
    pending: usize,
    /// How the transfer to the device ended, once it has.
    written: Option<(Outcome, usize)>,
    lost: Option<&'static str>,
    closing: bool,
    cancelled_reads: u64,
    cancelled_writes: u64,
    failures: u32,
    stats: PipeStats,
}

struct Shared {
    queue: usize,
    state: Mutex<State>,
    readable: Condvar,
    writable: Condvar,
}

/// An open device. Reader, writer and closer may be three threads.
pub struct Pipe {
    shared: Arc<Shared>,
    inputs: Vec<Transfer>,
    /// One writer at a time.
    output: Mutex<Transfer>,
    /// The thread for libusb's events.
    events: Mutex<Option<JoinHandle<()>>>,
    handle: Arc<DeviceHandle<Context>>,
    context: Context,
    interface: u8,
}

const GONE: &str = "it was pulled or has reset itself (SW_RESET)";
const STALLED: &str = "its endpoint stalls; pull it and plug it in again";
const FAILING: &str = "its transfers fail; look at the cable and the hub";

impl Pipe {
    /// Opens a device: takes it from the kernel's driver, which has it again when the pipe is closed.
    ///
    /// # Errors
    /// [`PipeError::Usb`]: `Access` if this user may not, `Busy` if another program has it.
    pub fn open(found: &Found, shape: Shape, limits: Limits) -> Result<Self, PipeError> {
        let context = found.device.context().clone();
        let handle = Arc::new(found.device.open()?);
        match handle.set_auto_detach_kernel_driver(true) {
            // Where the kernel has no driver there is nothing to detach.
            Ok(()) | Err(rusb::Error::NotSupported) => {}
            Err(error) => return Err(error.into()),
        }
        handle.claim_interface(shape.interface)?;

        let shared = Arc::new(Shared {
            queue: limits.queue,
            state: Mutex::default(),
            readable: Condvar::new(),
            writable: Condvar::new(),
        });
        let transfer = |endpoint| Transfer::new(&handle, endpoint, shared.clone()).ok_or(rusb::Error::NoMem);
        let inputs = (0..limits.transfers).map(|_| transfer(shape.input)).collect::<Result<Vec<_>, _>>()?;
        let output = Mutex::new(transfer(shape.output)?);
        let (its, bus) = (shared.clone(), context.clone());
        let events = threads::spawn("usb-events", move || its.handle_events(&bus)).map_err(|_| rusb::Error::NoMem)?;
        let interface = shape.interface;
        let pipe = Self { shared, inputs, output, events: Mutex::new(Some(events)), handle, context, interface };
        for input in &pipe.inputs {
            let mut state = pipe.shared.state.lock();
            input.hand_over().map_err(|_| PipeError::Lost(GONE))?;
            state.pending += 1;
        }
        Ok(pipe)
    }

    /// The oldest report not yet read, when it came, and its number from 0. `limit`: `None` waits without end.
    ///
    /// # Errors
    /// [`PipeError`]; `report` is left alone then.
    pub fn read(&self, report: &mut [u8; REPORT_LEN], limit: Option<Duration>) -> Result<(Instant, u64), PipeError> {
        let began = Instant::now();
        let mut state = self.shared.state.lock();
        let cancelled = state.cancelled_reads;
        loop {
            if state.closing {
                return Err(PipeError::Closed);
            }
            if let Some(next) = state.reports.pop_front() {
                report.copy_from_slice(&next.bytes);
                return Ok((next.at, next.number));
            }
            if let Some(why) = state.lost {
                return Err(PipeError::Lost(why));
            }
            if state.cancelled_reads != cancelled {
                return Err(PipeError::Cancelled);
            }
            wait(&self.shared.readable, &mut state, began, limit)?;
        }
    }

    /// Moves one report to the device. `limit`: `None` waits without end.
    ///
    /// # Errors
    /// [`PipeError`]; but for [`PipeError::Torn`] no byte was moved.
    pub fn write(&self, report: &[u8; REPORT_LEN], limit: Option<Duration>) -> Result<(), PipeError> {
        let began = Instant::now();
        let before = self.shared.state.lock().cancelled_writes;
        let output = match limit {
            None => self.output.lock(),
            Some(limit) => self.output.try_lock_for(limit).ok_or(PipeError::Timeout(limit))?,
        };
        let mut state = self.shared.state.lock();
        state.fit()?;
        // SAFETY: with the lock of `output` this thread is alone, and a write ends after its transfer has.
        unsafe { output.fill(report) };
        state.written = None;
        output.hand_over().map_err(|_| PipeError::Lost(state.lost.unwrap_or(GONE)))?;
        state.pending += 1;
        let mut given_up = None;
        loop {
            if let Some((outcome, moved)) = state.written {
                return result(outcome, moved, given_up);
            }
            let stop = if state.closing {
                Some(PipeError::Closed)
            } else if state.cancelled_writes != before {
                Some(PipeError::Cancelled)
            } else {
                None
            };
            match (given_up, stop) {
                // libusb gives it back soon.
                (Some(_), _) => self.shared.writable.wait(&mut state),
                (None, Some(why)) => {
                    given_up = Some(why);
                    output.cancel();
                }
                (None, None) => {
                    if let Err(why) = wait(&self.shared.writable, &mut state, began, limit)
                        && state.written.is_none()
                    {
                        given_up = Some(why);
                        output.cancel();
                    }
                }
            }
        }
    }

    /// Ends the reads under way.
    pub fn cancel_reads(&self) {
        self.shared.state.lock().cancelled_reads += 1;
        self.shared.readable.notify_all();
    }

    /// Ends the writes under way.
    pub fn cancel_writes(&self) {
        self.shared.state.lock().cancelled_writes += 1;
        self.shared.writable.notify_all();
    }

    /// Whether the device is there.
    ///
    /// # Errors
    /// [`PipeError::Closed`], [`PipeError::Lost`].
    pub fn check(&self) -> Result<(), PipeError> {
        self.shared.state.lock().fit()
    }

    /// Counts since it was opened.
    pub fn stats(&self) -> PipeStats {
        self.shared.state.lock().stats
    }

    /// Ends every call and gives the device back. Closing twice is harmless.
    pub fn close(&self) {
        {
            let mut state = self.shared.state.lock();
            state.closing = true;
            self.shared.readable.notify_all();
            self.shared.writable.notify_all();
        }
        // From here on none is handed over again.
        let Some(events) = self.events.lock().take() else { return };
        self.inputs.iter().for_each(Transfer::cancel);
        self.context.interrupt_handle_events();
        // It ends when libusb has no transfer any more; a panic in it would have no one to hear of it.
        let _ = events.join();
        // A device that is gone has nothing to release.
        let _ = self.handle.release_interface(self.interface);
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.close();
    }
}

impl State {
    fn fit(&self) -> Result<(), PipeError> {
        if self.closing {
            return Err(PipeError::Closed);
        }
        self.lost.map_or(Ok(()), |why| Err(PipeError::Lost(why)))
    }
}

impl Shared {
    fn handle_events(&self, context: &Context) {
        loop {
            {
                let state = self.state.lock();
                if state.closing && state.pending == 0 {
                    return;
                }
            }
            if let Err(error) = context.handle_events(Some(LOOK_EVERY)) {
                log::debug!("libusb's events: {error}");
            }
        }
    }

    fn lose(&self, state: &mut State, why: &'static str) {
        state.lost.get_or_insert(why);
        self.readable.notify_all();
        self.writable.notify_all();
    }
}

impl Ended for Shared {
    fn input(&self, outcome: Outcome, bytes: &[u8]) -> bool {
        let mut state = self.state.lock();
        match outcome {
            Outcome::Done => {
                state.failures = 0;
                self.keep(&mut state, bytes);
            }
            Outcome::Gone => self.lose(&mut state, GONE),
            Outcome::Stalled => self.lose(&mut state, STALLED),
            Outcome::Cancelled | Outcome::Failed => {
                state.failures += 1;
                state.stats.failed += u64::from(outcome == Outcome::Failed);
                if state.failures > FAILURES {
                    self.lose(&mut state, FAILING);
                }
            }
        }
        let again = !state.closing && state.lost.is_none();
        state.pending -= usize::from(!again);
        again
    }

    fn not_resubmitted(&self) {
        let mut state = self.state.lock();
        state.pending -= 1;
        self.lose(&mut state, GONE);
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
}

impl Shared {
    fn keep(&self, state: &mut State, bytes: &[u8]) {
        // Devices that end a report by an empty packet, and nonsense, are counted.
        let Ok(bytes) = <[u8; REPORT_LEN]>::try_from(bytes) else {
            state.stats.short += 1;
            return;
        };
        if state.reports.len() >= self.queue {
            state.reports.pop_front();
            state.stats.dropped += 1;
        }
        let number = state.stats.reports;
        state.reports.push_back(Report { bytes, at: Instant::now(), number });
        state.stats.reports += 1;
        self.readable.notify_one();
    }
}

fn result(outcome: Outcome, moved: usize, given_up: Option<PipeError>) -> Result<(), PipeError> {
    match (outcome, moved) {
        // It may have gone through just as it was given up.
        (Outcome::Done | Outcome::Cancelled, REPORT_LEN) => Ok(()),
        (Outcome::Gone, _) => Err(PipeError::Lost(GONE)),
        (_, 1..) => Err(PipeError::Torn { moved }),
        (Outcome::Stalled, 0) => Err(PipeError::Usb(rusb::Error::Pipe)),
        (_, 0) => Err(given_up.unwrap_or(PipeError::Usb(rusb::Error::Io))),
    }
}

/// Waits for a change, until the limit.
fn wait(
    changed: &Condvar,
    state: &mut MutexGuard<'_, State>,
    began: Instant,
    limit: Option<Duration>,
) -> Result<(), PipeError> {
    let Some(limit) = limit else {
        changed.wait(state);
        return Ok(());
    };
    // A limit too far away to be a moment is none.
    match began.checked_add(limit) {
        Some(until) if Instant::now() >= until => Err(PipeError::Timeout(limit)),
        Some(until) => {
            changed.wait_until(state, until);
            Ok(())
        }
        None => {
            changed.wait(state);
            Ok(())
        }
    }
}
