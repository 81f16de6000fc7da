//! An open device: a queue of reports from it, one report at a time to it.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::bus::Handle;
use super::libusb::UsbError;
use super::reports::{GONE, Shared, State};
use super::transfer::{Outcome, Transfer};
use super::{Found, REPORT_LEN, Shape};
use crate::threads;

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
    /// The device refuses the report; its endpoint takes the next one again.
    #[error("it refuses the report (its endpoint stalls)")]
    Stalled,
    /// libusb refuses.
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
    inputs: Vec<Transfer>,
    /// One writer at a time.
    output: Mutex<Transfer>,
    /// The pipe's own thread, and the interface, until the pipe is closed.
    open: Mutex<Option<(JoinHandle<()>, Claim)>>,
    handle: Arc<Handle>,
    shape: Shape,
}

impl Pipe {
    /// Opens a device: takes it from the kernel's driver, which has it again when the pipe is closed.
    ///
    /// # Errors
    /// [`PipeError::Usb`]: [`UsbError::Access`] if this user may not, [`UsbError::Busy`] if another program has it.
    /// [`PipeError::Lost`] if it goes meanwhile.
    pub fn open(found: &Found, shape: Shape, limits: Limits) -> Result<Self, PipeError> {
        let handle = Arc::new(found.device.open()?);
        match handle.detach_driver_by_itself() {
            // Where the kernel has no driver there is nothing to detach.
            Ok(()) | Err(UsbError::NotSupported) => {}
            Err(error) => return Err(error.into()),
        }
        let claim = Claim::new(&handle, shape.interface)?;

        let shared = Arc::new(Shared::new(limits.queue));
        let transfer = |endpoint| Transfer::new(&handle, endpoint, shared.clone()).ok_or(UsbError::NoMemory);
        let inputs = (0..limits.transfers).map(|_| transfer(shape.input)).collect::<Result<Vec<_>, _>>()?;
        let output = Mutex::new(transfer(shape.output)?);
        let (its, bus) = (shared.clone(), found.device.bus().clone());
        let events = threads::spawn("usb-events", move || its.handle_events(&bus)).map_err(|_| UsbError::NoMemory)?;
        // From here on what was begun is ended by `close`, whatever happens.
        let pipe = Self { shared, inputs, output, open: Mutex::new(Some((events, claim))), handle, shape };
        for input in &pipe.inputs {
            let mut state = pipe.shared.state.lock();
            state.fit()?;
            input.hand_over().map_err(gone)?;
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
        if self.shared.queue == 1 && !state.closing {
            // Who keeps one report wants the newest.
            self.shared.take_what_came(&mut state, self.handle.bus());
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
            match self.wait(&self.shared.readable, &mut state, began, limit) {
                // What came is not late because nobody has looked.
                Err(_) if !looked => {
                    looked = true;
                    self.shared.take_what_came(&mut state, self.handle.bus());
                }
                done => done?,
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
        let output = match limit {
            None => self.output.lock(),
            Some(limit) => self.output.try_lock_for(limit).ok_or(PipeError::Timeout(limit))?,
        };
        let mut state = self.shared.state.lock();
        state.fit()?;
        // SAFETY: with the lock of `output` this thread is alone, and a write ends after its transfer has.
        unsafe { output.fill(report) };
        state.written = None;
        if let Err(error) = output.hand_over() {
            return Err(match gone(error) {
                PipeError::Lost(why) => {
                    self.shared.lose(&mut state, why);
                    PipeError::Lost(why)
                }
                other => other,
            });
        }
        state.pending += 1;
        let mut given_up = None;
        let (outcome, moved) = loop {
            if let Some(ended) = state.written {
                break ended;
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
                (Some(_), _) => self.shared.wait(&self.shared.writable, &mut state, self.handle.bus(), None),
                (None, Some(why)) => {
                    given_up = Some(why);
                    output.cancel();
                }
                (None, None) => {
                    if let Err(why) = self.wait(&self.shared.writable, &mut state, began, limit)
                        && state.written.is_none()
                    {
                        given_up = Some(why);
                        output.cancel();
                    }
                }
            }
        };
        drop(state);
        if outcome == Outcome::Stalled {
            // If it stalls for good the next report says so again.
            let _ = self.handle.clear_halt(self.shape.output);
        }
        result(outcome, moved, given_up)
    }

    /// Ends the reads under way.
    pub fn cancel_reads(&self) {
        let mut state = self.shared.state.lock();
        state.cancelled_reads += 1;
        self.shared.wake_all(&state, self.handle.bus());
    }

    /// Ends the writes under way.
    pub fn cancel_writes(&self) {
        let mut state = self.shared.state.lock();
        state.cancelled_writes += 1;
        self.shared.wake_all(&state, self.handle.bus());
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
            self.shared.wake_all(&state, self.handle.bus());
        }
        // From here on none is handed over again.
        let Some((events, claim)) = self.open.lock().take() else { return };
        self.inputs.iter().for_each(Transfer::cancel);
        self.handle.bus().interrupt();
        // It ends when libusb has no transfer any more; a panic in it would have no one to hear of it.
        let _ = events.join();
        if self.shared.state.lock().stalled {
            // Whoever opens it next begins with an endpoint that sends.
            let _ = self.handle.clear_halt(self.shape.input);
        }
        drop(claim);
    }

    /// Waits for a change, until the limit.
    fn wait(
        &self,
        changed: &Condvar,
        state: &mut MutexGuard<'_, State>,
        began: Instant,
        limit: Option<Duration>,
    ) -> Result<(), PipeError> {
        // A limit too far away to be a moment is none.
        let until = limit.and_then(|limit| Some((limit, began.checked_add(limit)?)));
        let left = match until {
            Some((limit, until)) => match until.checked_duration_since(Instant::now()) {
                Some(left) if !left.is_zero() => Some(left),
                _ => return Err(PipeError::Timeout(limit)),
            },
            None => None,
        };
        self.shared.wait(changed, state, self.handle.bus(), left);
        Ok(())
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.close();
    }
}

/// An interface that this process has.
struct Claim {
    handle: Arc<Handle>,
    interface: u8,
}

impl Claim {
    fn new(handle: &Arc<Handle>, interface: u8) -> Result<Self, UsbError> {
        handle.claim(interface)?;
        Ok(Self { handle: handle.clone(), interface })
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // A device that is gone has nothing to release.
        let _ = self.handle.release(self.interface);
    }
}

/// Why libusb did not take a transfer.
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

#[cfg(test)]
mod tests;
