//! An open device: a queue of reports from it, one report at a time to it.

use std::mem;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Mutex, MutexGuard};

use super::error::UsbError;
use super::line::{Line, Outcome};
use super::reports::{GONE, Shared, State};
use super::{Found, REPORT_LEN, Shape};
use crate::threads;

/// Sizes of a pipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Transfers to the host that are handed over at a time: 1 or more.
    pub transfers: usize,
    /// Reports kept while nobody reads, the newest ones: 1 or more.
    pub queue: usize,
    /// While a program only writes, reports may be left to a system that keeps the newest itself. Those that it drops are
    /// not counted.
    pub rests: bool,
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
    /// The device refuses the report; its endpoint takes the next one again.
    #[error("it refuses the report (its endpoint stalls)")]
    Stalled,
    /// libusb or Windows refuses.
    #[error(transparent)]
    Usb(#[from] UsbError),
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
    /// Transfers to the host that failed on the wire.
    pub failed: u64,
}

/// An open device. Reader, writer and closer may be three threads.
pub struct Pipe {
    shared: Arc<Shared>,
    /// One writer at a time.
    output: Mutex<()>,
    /// The pipe's own thread, until the pipe is closed.
    open: Mutex<Option<JoinHandle<()>>>,
    line: Arc<dyn Line>,
}

impl Pipe {
    /// Opens a device. By libusb it is taken from the kernel's driver, which has it again when the pipe is closed; on
    /// Windows the driver keeps it, and other programs may open it too.
    ///
    /// # Errors
    /// [`PipeError::Usb`]: [`UsbError::Access`] if this user may not, [`UsbError::Busy`] if another program has it.
    /// [`PipeError::Lost`] if it goes meanwhile.
    pub fn open(found: &Found, shape: Shape, limits: Limits) -> Result<Self, PipeError> {
        let shared = Arc::new(Shared::new(limits));
        let line = found.device.line(shape, limits.transfers, &shared)?;
        Self::over(line, shared)
    }

    /// A pipe over a line that tells `shared` what ends.
    pub(super) fn over(line: Arc<dyn Line>, shared: Arc<Shared>) -> Result<Self, PipeError> {
        let its = (shared.clone(), line.clone());
        let events =
            threads::spawn("usb-events", move || its.0.handle_events(&*its.1)).map_err(|_| UsbError::NoMemory)?;
        // From here on what was begun is ended by `close`, whatever happens.
        let pipe = Self { shared, output: Mutex::new(()), open: Mutex::new(Some(events)), line };
        for number in 0..pipe.line.inputs() {
            let mut state = pipe.shared.state.lock();
            state.fit()?;
            pipe.line.begin_input(number).map_err(gone)?;
            state.pending += 1;
        }
        Ok(pipe)
    }

    /// The oldest report not yet read, when this process took it from the system, and its number from 0. While a call
    /// waits, or none has for a moment, that is as soon as the system has it; between two calls up to a millisecond later,
    /// and never before. `limit`: `None` waits without end.
    ///
    /// # Errors
    /// [`PipeError`]; `report` is left alone then.
    pub fn read(&self, report: &mut [u8; REPORT_LEN], limit: Option<Duration>) -> Result<(Instant, u64), PipeError> {
        let mut state = self.shared.state.lock();
        state.rest.begin_read();
        let done = self.read_with(&mut state, report, limit);
        state.rest.end_read();
        done
    }

    fn read_with(
        &self,
        state: &mut MutexGuard<'_, State>,
        report: &mut [u8; REPORT_LEN],
        limit: Option<Duration>,
    ) -> Result<(Instant, u64), PipeError> {
        let began = Instant::now();
        let cancelled = state.cancelled_reads;
        self.shared.end_rest(state, &*self.line);
        self.shared.catch_up(state, &*self.line, limit);
        if self.shared.queue == 1 && !state.closing {
            // Who keeps one report wants the newest.
            self.shared.take_what_came(state, &*self.line);
        }
        let mut looked = false;
        loop {
            if state.closing {
                return Err(PipeError::Closed);
            }
            if let Some(next) = state.reports.pop_front() {
                report.copy_from_slice(&next.bytes);
                return Ok((next.at, next.number));
            }
            state.fit()?;
            if state.cancelled_reads != cancelled {
                return Err(PipeError::Cancelled);
            }
            match left(began, limit) {
                // What came is not late because nobody has looked.
                Err(_) if !looked => {
                    looked = true;
                    self.shared.take_what_came(state, &*self.line);
                }
                left => self.shared.wait(&self.shared.readable, state, &*self.line, left?),
            }
        }
    }

    /// Moves one report to the device. `limit`: `None` waits without end.
    ///
    /// # Errors
    /// [`PipeError`]; but for [`PipeError::Torn`] no byte was moved.
    pub fn write(&self, report: &[u8; REPORT_LEN], limit: Option<Duration>) -> Result<(), PipeError> {
        let began = Instant::now();
        let before = self.shared.state.lock().cancelled_writes;
        let _alone = match limit {
            None => self.output.lock(),
            Some(limit) => self.output.try_lock_for(limit).ok_or(PipeError::Timeout(limit))?,
        };
        let mut state = self.shared.state.lock();
        state.fit()?;
        state.rest.wrote();
        state.written = None;
        state.pending += 1;
        drop(state);
        // Without the lock: there are systems that do not come back from it before the device has the report.
        // SAFETY: with the lock of `output` this thread is alone, and a write ends after its transfer has.
        let begun = unsafe { self.line.begin_output(report) };
        let mut state = self.shared.state.lock();
        if let Err(error) = begun {
            state.pending -= 1;
            let error = gone(error);
            if let PipeError::Lost(why) = error {
                self.shared.lose(&mut state, why);
            }
            // Whoever closes it may wait for this transfer.
            self.shared.wake_all(&state, &*self.line);
            return Err(error);
        }
        let mut given_up = None;
        let (outcome, moved) = loop {
            if let Some(ended) = state.written {
                break ended;
            }
            if state.deaf {
                return state.fit();
            }
            let stop = if state.closing {
                Some(PipeError::Closed)
            } else if state.cancelled_writes != before {
                Some(PipeError::Cancelled)
            } else {
                None
            };
            match (given_up, stop) {
                // The system gives it back soon.
                (Some(_), _) => self.shared.wait_written(&mut state, &*self.line, None),
                (None, Some(why)) => {
                    given_up = Some(why);
                    self.line.cancel_output();
                }
                (None, None) => {
                    let waited = left(began, limit).map(|left| {
                        self.shared.wait_written(&mut state, &*self.line, left);
                    });
                    if let Err(why) = waited
                        && state.written.is_none()
                    {
                        given_up = Some(why);
                        self.line.cancel_output();
                    }
                }
            }
        };
        drop(state);
        if outcome == Outcome::Stalled {
            self.line.unstall_output();
        }
        result(outcome, moved, given_up)
    }

    /// Ends the reads under way.
    pub fn cancel_reads(&self) {
        let mut state = self.shared.state.lock();
        state.cancelled_reads += 1;
        self.shared.wake_all(&state, &*self.line);
    }

    /// Ends the writes under way.
    pub fn cancel_writes(&self) {
        let mut state = self.shared.state.lock();
        state.cancelled_writes += 1;
        self.shared.wake_all(&state, &*self.line);
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
            self.shared.wake_all(&state, &*self.line);
        }
        // From here on none is handed over again.
        let Some(events) = self.open.lock().take() else { return };
        self.line.cancel_inputs();
        self.line.interrupt();
        // It ends when no transfer is under way any more; a panic in it would have no one to hear of it.
        let _ = events.join();
        let state = self.shared.state.lock();
        let (stalled, kept) = (state.stalled, state.deaf && state.pending > 0);
        drop(state);
        if kept {
            // The system has transfers whose end it will not tell: their memory is its own from here on.
            mem::forget(self.line.clone());
        }
        if stalled {
            // Whoever opens it next begins with an endpoint that sends.
            self.line.unstall_input();
        }
        self.line.release();
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.close();
    }
}

/// What is left of a call's limit. One that is too far away to be a moment is none.
fn left(began: Instant, limit: Option<Duration>) -> Result<Option<Duration>, PipeError> {
    let Some((limit, until)) = limit.and_then(|limit| Some((limit, began.checked_add(limit)?))) else {
        return Ok(None);
    };
    match until.checked_duration_since(Instant::now()) {
        Some(left) if !left.is_zero() => Ok(Some(left)),
        _ => Err(PipeError::Timeout(limit)),
    }
}

/// Why the system did not take a transfer.
const fn gone(error: UsbError) -> PipeError {
    match error {
        // An interface that is not ours any more: the device was reset under us.
        UsbError::NoDevice | UsbError::NotFound => PipeError::Lost(GONE),
        other => PipeError::Usb(other),
    }
}

fn result(outcome: Outcome, moved: usize, given_up: Option<PipeError>) -> Result<(), PipeError> {
    match (outcome, moved) {
        // It may have gone through just as it was given up.
        (Outcome::Done | Outcome::Cancelled, REPORT_LEN) => Ok(()),
        (Outcome::Gone, _) => Err(PipeError::Lost(GONE)),
        (_, 1..) => Err(PipeError::Torn { moved }),
        (Outcome::Stalled, 0) => Err(PipeError::Stalled),
        (_, 0) => Err(given_up.unwrap_or(PipeError::Usb(UsbError::Io))),
    }
}

#[cfg(all(test, unix))]
mod tests;
