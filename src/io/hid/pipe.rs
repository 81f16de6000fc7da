//! An open device: a queue of received reports, and one report at a time to the device.

use std::mem;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::backend::{Backend, Outcome};
use super::error::UsbError;
use super::events::CALLER_CHECK_INTERVAL;
use super::reports::{GONE, Shared, State};
use super::{FoundDevice, REPORT_LEN, ReportInterface};
use crate::threads::sync::unlockable::{Mutex, MutexGuard};
use crate::threads::{self, CallingThread};

/// Options for [`Pipe::open`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PipeOptions {
    /// Number of transfers to the host that are submitted at the same time, 1 or more. With more transfers the process
    /// may be late for longer without losing a report.
    pub transfers: usize,
    /// Capacity of the queue of unread reports, 1 or more; the queue keeps the newest reports.
    pub queue: usize,
    /// Whether reports may stay in the system's queue while the program does not read, which saves processor time. This
    /// happens only on Windows, whose queue keeps the newest reports. Reports that Windows drops are not counted.
    pub may_pause_input: bool,
}

/// Why a call of a pipe has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PipeError {
    /// The call was not complete at its time limit.
    #[error("nothing within {0:?}")]
    Timeout(Duration),
    /// The call was cancelled by [`Pipe::cancel_reads`] or [`Pipe::cancel_writes`].
    #[error("the call was cancelled")]
    Cancelled,
    /// The pipe was closed by [`Pipe::close`].
    #[error("it is closed")]
    Closed,
    /// The device was unplugged or no longer answers. The value is the reason, as a text for the user.
    #[error("{0}")]
    Lost(&'static str),
    /// Only a part of the report was transferred.
    #[error("{moved} of {REPORT_LEN} bytes were moved")]
    Partial {
        /// Number of bytes transferred.
        moved: usize,
    },
    /// The device refused the report. The halt is cleared, so the next report can be accepted.
    #[error("it refuses the report (its endpoint stalls)")]
    Stalled,
    /// libusb or Windows refused the call.
    #[error(transparent)]
    Usb(#[from] UsbError),
}

/// Counters of a pipe since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PipeStats {
    /// Number of reports received.
    pub reports: u64,
    /// Number of reports dropped because they were not read in time, or not before the device was lost.
    pub dropped: u64,
    /// Number of transfers to the host that were empty or short.
    pub short: u64,
    /// Number of transfers to the host that failed on the wire.
    pub failed: u64,
}

/// An open device. Different threads may read, write and close it at the same time.
pub struct Pipe {
    shared: Arc<Shared>,
    /// The pipe's own thread; `None` once the pipe is closed.
    event_thread: Mutex<Option<JoinHandle<()>>>,
    backend: Arc<dyn Backend>,
}

impl Pipe {
    /// Opens a device. With libusb its interface is detached from the kernel's driver until the pipe is closed. On
    /// Windows the HID driver keeps the interface, and other programs may open the device too.
    ///
    /// # Errors
    /// [`PipeError::Usb`] with [`UsbError::Access`] if the user has no permission, with [`UsbError::Busy`] if another
    /// program uses the device. [`PipeError::Lost`] if the device was just unplugged.
    pub fn open(found: &FoundDevice, interface: ReportInterface, options: PipeOptions) -> Result<Self, PipeError> {
        let shared = Arc::new(Shared::new(options));
        let backend = found.device.open_backend(interface, options.transfers, &shared)?;
        Self::with_backend(backend, shared)
    }

    /// Creates a pipe over a backend whose listener is `shared`.
    pub(super) fn with_backend(backend: Arc<dyn Backend>, shared: Arc<Shared>) -> Result<Self, PipeError> {
        let (thread_shared, thread_backend) = (shared.clone(), backend.clone());
        let events = threads::spawn("usb-events", move || {
            thread_shared.handle_events(&*thread_backend);
            end_of_transfers(&thread_shared, &thread_backend);
        });
        let events = events.map_err(|_| UsbError::NoMemory)?;
        // The pipe exists from here on, so that an error below drops it, which ends its thread and transfers.
        let pipe = Self { shared, event_thread: Mutex::new(Some(events)), backend };
        for number in 0..pipe.backend.inputs() {
            let mut state = pipe.shared.state.lock();
            state.check()?;
            pipe.backend.submit_input(number).map_err(submit_error)?;
            state.inputs_submitted += 1;
        }
        // The pipe's thread sleeps while no transfer is submitted, so it has to be woken after the first one.
        pipe.shared.thread_wakeup.notify_all();
        Ok(pipe)
    }

    /// Reads the oldest unread report. Returns the time at which this process received it, and its number, counted from
    /// 0. Without a `limit` the call waits until a report comes.
    ///
    /// A report that comes while a call waits has the time of the system's event. A report that comes between two calls
    /// may have a time that is up to 1 ms late, since the pipe's thread then checks for events at an interval.
    ///
    /// # Errors
    /// [`PipeError::Timeout`], [`PipeError::Cancelled`] by [`Self::cancel_reads`], [`PipeError::Closed`], or
    /// [`PipeError::Lost`]. `report` is then unchanged.
    pub fn read(&self, report: &mut [u8; REPORT_LEN], limit: Option<Duration>) -> Result<(Instant, u64), PipeError> {
        let mut state = self.shared.state.lock();
        state.input_pause.begin_read();
        let done = self.read_with(&mut state, report, limit);
        state.input_pause.end_read();
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
        self.shared.end_pause(state, &*self.backend);
        self.shared.catch_up(state, &*self.backend, limit);
        if self.shared.queue == 1 && !state.closing {
            // With a queue of one report the program wants the newest one, so pending events are handled first.
            self.shared.poll_events(state, &*self.backend);
        }
        let mut polled = false;
        loop {
            if state.closing {
                return Err(PipeError::Closed);
            }
            if let Some(next) = state.reports.pop_front() {
                report.copy_from_slice(&next.bytes);
                return Ok((next.at, next.number));
            }
            state.check()?;
            if state.cancelled_reads != cancelled {
                return Err(PipeError::Cancelled);
            }
            match time_left(began, limit) {
                // The limit has passed. A report may have arrived whose event was not handled yet, so events are
                // handled once more.
                Err(_) if !polled => {
                    polled = true;
                    self.shared.poll_events(state, &*self.backend);
                }
                left => self.shared.wait(&self.shared.readable, state, &*self.backend, left?),
            }
        }
    }

    /// Sends one report to the device. Without a `limit` the call waits until the device accepts it.
    ///
    /// # Errors
    /// [`PipeError::Timeout`], [`PipeError::Cancelled`] by [`Self::cancel_writes`], [`PipeError::Closed`],
    /// [`PipeError::Stalled`], [`PipeError::Usb`]: no byte was transferred. [`PipeError::Partial`]: a part of the
    /// report was transferred before the write had to end. [`PipeError::Lost`]: the device is gone.
    pub fn write(&self, report: &[u8; REPORT_LEN], limit: Option<Duration>) -> Result<(), PipeError> {
        let began = Instant::now();
        let turn = self.turn_to_write(began, limit)?;
        if !turn.interrupts_a_write {
            return self.write_in_turn(report, began, limit);
        }
        let interrupted = self.end_of_interrupted_write(began, limit)?;
        let written = self.write_in_turn(report, began, limit);
        self.shared.state.lock().output_result = interrupted;
        written
    }

    /// Called in a signal handler that has interrupted a write: waits until the transfer of the interrupted write has
    /// ended. Returns the result of that transfer, which the interrupted write needs when the handler has returned;
    /// `None`: the interrupted write has submitted no transfer yet.
    fn end_of_interrupted_write(
        &self,
        began: Instant,
        limit: Option<Duration>,
    ) -> Result<Option<(Outcome, usize)>, PipeError> {
        let mut state = self.shared.state.lock();
        let cancelled = state.cancelled_writes;
        while state.output_submitted {
            state.check()?;
            if state.cancelled_writes != cancelled {
                return Err(PipeError::Cancelled);
            }
            let left = time_left(began, limit)?;
            self.shared.wait_written(&mut state, &*self.backend, left);
        }
        Ok(state.output_result)
    }

    /// Waits until it is this thread's turn to write, since only one thread writes at a time.
    fn turn_to_write(&self, began: Instant, limit: Option<Duration>) -> Result<WriterTurn<'_>, PipeError> {
        let caller = CallingThread::current();
        let mut state = self.shared.state.lock();
        let cancelled = state.cancelled_writes;
        let interrupts_a_write = state.writers.contains(&caller);
        if state.writers.len() == state.writers.capacity() {
            state.writers.retain(|writer| !writer.is_gone());
        }
        state.writers.push_back(caller);
        let turn = WriterTurn { shared: &self.shared, caller, interrupts_a_write };
        loop {
            let waits = match state.writers.front() {
                Some(first) if *first == caller => return Ok(turn),
                Some(first) if first.is_gone() => {
                    state.writers.pop_front();
                    continue;
                }
                _ if state.cancelled_writes != cancelled => Err(PipeError::Cancelled),
                _ => state.check().and_then(|()| time_left(began, limit)),
            };
            match waits {
                Ok(left) => {
                    let left = left.map_or(CALLER_CHECK_INTERVAL, |left| left.min(CALLER_CHECK_INTERVAL));
                    Shared::wait_at(&self.shared.writable, &mut state, Some(left));
                }
                Err(error) => {
                    drop(state);
                    return Err(error);
                }
            }
        }
    }

    fn write_in_turn(
        &self,
        report: &[u8; REPORT_LEN],
        began: Instant,
        limit: Option<Duration>,
    ) -> Result<(), PipeError> {
        let mut state = self.shared.state.lock();
        let cancelled = state.cancelled_writes;
        if state.output_submitted {
            self.shared.end_abandoned_write(&mut state, &*self.backend);
        }
        state.check()?;
        state.output_result = None;
        state.output_submitted = true;
        drop(state);
        // The lock is released, because on some systems the call returns only when the device has the report.
        // SAFETY: it is this thread's turn to write, and the transfer of the previous write has ended.
        let submitted = unsafe { self.backend.submit_output(report) };
        let mut state = self.shared.state.lock();
        if let Err(error) = submitted {
            state.output_submitted = false;
            let error = submit_error(error);
            if let PipeError::Lost(why) = error {
                self.shared.lose(&mut state, why);
            }
            // Wakes the thread that closes the pipe, which may be waiting for this transfer to end.
            self.shared.wake_all(&state, &*self.backend);
            return Err(error);
        }
        let mut given_up = None;
        let (outcome, moved) = loop {
            if let Some(ended) = state.output_result {
                break ended;
            }
            if state.events_failed {
                return state.check();
            }
            let stop = if state.closing {
                Some(PipeError::Closed)
            } else if state.cancelled_writes != cancelled {
                Some(PipeError::Cancelled)
            } else {
                None
            };
            match (given_up, stop) {
                // The transfer was cancelled. The write waits for the end of the transfer, which comes soon.
                (Some(_), _) => self.shared.wait_written(&mut state, &*self.backend, None),
                (None, Some(why)) => {
                    given_up = Some(why);
                    self.backend.cancel_output();
                }
                (None, None) => {
                    let waited = time_left(began, limit).map(|left| {
                        self.shared.wait_written(&mut state, &*self.backend, left);
                    });
                    if let Err(why) = waited
                        && state.output_result.is_none()
                    {
                        given_up = Some(why);
                        self.backend.cancel_output();
                    }
                }
            }
        };
        drop(state);
        if outcome == Outcome::Stalled {
            self.backend.clear_output_halt();
        }
        write_result(outcome, moved, given_up)
    }

    /// Cancels the running reads, which return [`PipeError::Cancelled`].
    pub fn cancel_reads(&self) {
        let mut state = self.shared.state.lock();
        state.cancelled_reads += 1;
        self.shared.wake_all(&state, &*self.backend);
    }

    /// Cancels the running writes, which return [`PipeError::Cancelled`].
    pub fn cancel_writes(&self) {
        let mut state = self.shared.state.lock();
        state.cancelled_writes += 1;
        self.shared.wake_all(&state, &*self.backend);
    }

    /// Checks that the pipe is open and the device is connected.
    ///
    /// # Errors
    /// [`PipeError::Closed`] after [`Self::close`], [`PipeError::Lost`] once the device is gone.
    pub fn check(&self) -> Result<(), PipeError> {
        let mut state = self.shared.state.lock();
        if state.input_pause.is_paused() && state.check().is_ok() && !self.backend.is_there() {
            self.shared.lose(&mut state, GONE);
        }
        state.check()
    }

    /// The counters of received, dropped, short and failed reports since the pipe was opened.
    pub fn stats(&self) -> PipeStats {
        self.shared.state.lock().stats
    }

    /// Ends all calls and releases the device. Further calls of this function have no effect.
    pub fn close(&self) {
        {
            let mut state = self.shared.state.lock();
            state.closing = true;
            if !state.is_handled_by_another() {
                // If this thread is recorded as the event handler, a signal handler that has interrupted it closes the
                // pipe. The interrupted call cannot continue before this call returns, so the pipe's thread takes over.
                state.event_handler = None;
            }
            self.shared.wake_all(&state, &*self.backend);
        }
        // The pipe's thread ends the transfers and releases the device, so that this happens even if the calling thread
        // ends here.
        let Some(events) = self.event_thread.lock().take() else { return };
        // The result is ignored: a panic of the pipe's thread cannot be reported from here.
        let _ = events.join();
    }
}

/// Cleans up at the end of the pipe's thread: clears a halt of the input endpoint and releases the device. At this time
/// all transfers have ended, or their ends can no longer be reported.
fn end_of_transfers(shared: &Shared, backend: &Arc<dyn Backend>) {
    let (stalled, leaked) = {
        let state = shared.state.lock();
        (state.stalled, state.events_failed && state.is_any_in_flight())
    };
    if leaked {
        // The system may still write into transfers whose end was not reported, so their memory is never freed.
        mem::forget(backend.clone());
    }
    if stalled {
        // If the endpoint has stalled, the halt is cleared, so that the next program that opens the device finds a
        // working endpoint.
        backend.clear_input_halt();
    }
    backend.release();
}

/// A thread's turn to write. It ends when this value is dropped.
struct WriterTurn<'a> {
    shared: &'a Shared,
    caller: CallingThread,
    /// Whether this write is made in a signal handler that has interrupted another write of the same thread.
    interrupts_a_write: bool,
}

impl Drop for WriterTurn<'_> {
    fn drop(&mut self) {
        {
            let writers = &mut self.shared.state.lock().writers;
            // Removes only the last entry of this thread. An earlier entry belongs to the write that this write has
            // interrupted.
            if let Some(last) = writers.iter().rposition(|other| *other == self.caller) {
                writers.remove(last);
            }
        }
        self.shared.writable.notify_all();
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.close();
    }
}

/// The time left until a call's limit; `None` without a limit, or if the limit is beyond the range of the clock.
fn time_left(began: Instant, limit: Option<Duration>) -> Result<Option<Duration>, PipeError> {
    let Some((limit, until)) = limit.and_then(|limit| Some((limit, began.checked_add(limit)?))) else {
        return Ok(None);
    };
    match until.checked_duration_since(Instant::now()) {
        Some(left) if !left.is_zero() => Ok(Some(left)),
        _ => Err(PipeError::Timeout(limit)),
    }
}

/// The error of a call whose transfer the system did not accept.
const fn submit_error(error: UsbError) -> PipeError {
    match error {
        // The interface is no longer claimed, because the device has reset itself.
        UsbError::NoDevice | UsbError::NotFound => PipeError::Lost(GONE),
        other => PipeError::Usb(other),
    }
}

fn write_result(outcome: Outcome, moved: usize, given_up: Option<PipeError>) -> Result<(), PipeError> {
    match (outcome, moved) {
        // A cancelled transfer may have completed just before it was cancelled.
        (Outcome::Done | Outcome::Cancelled, REPORT_LEN) => Ok(()),
        (Outcome::Gone, _) => Err(PipeError::Lost(GONE)),
        (_, 1..) => Err(PipeError::Partial { moved }),
        (Outcome::Stalled, 0) => Err(PipeError::Stalled),
        (_, 0) => Err(given_up.unwrap_or(PipeError::Usb(UsbError::Io))),
    }
}

#[cfg(all(test, unix))]
mod tests;
