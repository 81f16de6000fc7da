//! Decides which thread handles the backend's events; only one does at a time. A call that waits for an event handles
//! events itself, where the backend allows it, which saves a context switch for each report. While no call waits, the
//! pipe's own thread handles events, so that reports are received whatever the program does.
//!
//! A call that returns does not wake the pipe's thread, since that would cost a context switch again. Instead the
//! pipe's thread checks at an interval whether the program still calls the pipe. During a long wait of a single call
//! the pipe's thread sleeps, and that call wakes it when it returns. The pipe's thread takes over if the thread of that
//! call was ended by force, or if a signal handler that has interrupted the call closes the pipe. If the handler reads
//! or writes instead, the call of the handler handles events, since the interrupted call cannot continue.

use std::mem;
use std::time::{Duration, Instant};

use super::backend::Backend;
use super::error::UsbError;
use super::reports::{ABANDONED, EVENTS_FAILED, Shared, State};
use crate::threads::sync::unlockable::MutexGuard;
use crate::threads::{self, CallingThread, WaitQueue};

/// The maximum time for which a thread waits for events before it checks the pipe's state again. \[OURS]
const EVENT_WAIT_MAX: Duration = Duration::from_secs(1);
/// While a program makes calls, but no call waits at the moment, the pipe's thread handles the events that these calls
/// have left over. It checks for events at this interval times the number of transfers to the host. The interval is
/// half of the shortest cycle (250 us), in which one report comes, so that transfers are resubmitted while others are
/// still pending. \[OURS]
const CHECK_INTERVAL_PER_TRANSFER: Duration = Duration::from_micros(125);
/// The longest interval at which the pipe's thread checks for events, for any number of transfers. \[OURS]
const CHECK_INTERVAL_MAX: Duration = Duration::from_millis(1);
/// The interval at which a thread of the pipe that waits for a thread of the program checks whether that thread still
/// exists. \[OURS]
pub(super) const CALLER_CHECK_INTERVAL: Duration = Duration::from_millis(100);
/// While the pipe is being closed: how long the pipe's thread waits for the call that handles events, which was woken,
/// before it handles events itself. A signal handler that does not return may have interrupted that call. \[OURS]
const HANDLER_LIMIT: Duration = Duration::from_millis(200);
/// How long to wait for the end of a transfer whose thread was ended by force. \[OURS]
const ABANDONED_LIMIT: Duration = Duration::from_secs(1);
/// Pause between an error of the backend's event handling and the next attempt. \[OURS]
const RETRY_AFTER: Duration = Duration::from_millis(10);
/// After this many errors of the event handling in a row, one second in all, the device counts as lost. \[OURS]
const EVENT_ERRORS_MAX: u32 = 100;

/// The interval at which the pipe's thread checks for events while a program makes calls, for a number of transfers to
/// the host.
fn check_interval(transfers: usize) -> Duration {
    u32::try_from(transfers).map_or(CHECK_INTERVAL_MAX, |transfers| {
        CHECK_INTERVAL_PER_TRANSFER.saturating_mul(transfers).min(CHECK_INTERVAL_MAX)
    })
}

impl Shared {
    /// The body of the pipe's thread. It runs until the pipe is closed and all transfers have ended, or until event
    /// handling has failed, so that the end of transfers can no longer be reported.
    pub fn handle_events(&self, backend: &dyn Backend) {
        let check_interval = check_interval(backend.inputs());
        let mut state = self.state.lock();
        let mut seen = state.call_count;
        let mut cancelled_at = None;
        while !state.events_failed && (!state.closing || state.is_any_in_flight()) {
            if state.closing {
                let Some(cancelled_at) = cancelled_at else {
                    // Cancels the transfers to the host once. No transfer is submitted again afterwards, because
                    // `closing` is set.
                    cancelled_at = Some(Instant::now());
                    MutexGuard::unlocked(&mut state, || backend.cancel_inputs());
                    continue;
                };
                if state.event_handler.is_some_and(|caller| caller.is_gone()) || cancelled_at.elapsed() > HANDLER_LIMIT
                {
                    state.event_handler = None;
                }
            }
            if state.closing && state.is_write_abandoned() {
                self.end_abandoned_write(&mut state, backend);
                continue;
            }
            let calls_come = state.call_count != seen;
            seen = state.call_count;
            self.look_at_pause(&mut state, backend);
            if state.event_handler.is_some() {
                if calls_come || state.closing {
                    self.thread_wakeup.wait_for(&mut state, check_interval);
                } else {
                    self.sleep(&mut state);
                }
            } else if !state.closing && (!state.is_any_in_flight() || state.input_pause.is_complete(backend.inputs())) {
                // No transfer to the host is submitted: the pipe is being opened, the device is lost, or the input is
                // paused. The only possible event is the end of a write, for which the writing thread itself waits.
                self.thread_wakeup.wait(&mut state);
            } else if calls_come && !state.closing && backend.lets_calls_handle_events() {
                self.handle(&mut state, backend, Duration::ZERO);
                self.thread_wakeup.wait_for(&mut state, check_interval);
            } else {
                self.handle(&mut state, backend, EVENT_WAIT_MAX);
            }
        }
    }

    /// Lets the pipe's thread sleep until the call that handles events returns, for at most [`CALLER_CHECK_INTERVAL`].
    /// The caller then checks the state again, whether this thread was woken or not: a call that returns at the end of
    /// the interval wakes nobody. If the thread of the call has ended, its event handling ends here.
    fn sleep(&self, state: &mut MutexGuard<'_, State>) {
        state.thread_asleep = true;
        self.thread_wakeup.wait_for(state, CALLER_CHECK_INTERVAL);
        state.thread_asleep = false;
        if state.event_handler.is_some_and(|caller| caller.is_gone()) {
            log::debug!("a thread of the program is gone that was waiting for the board");
            state.event_handler = None;
            self.readable.notify_all();
            self.writable.notify_all();
        }
    }

    /// Called by a read or write: waits for a change of the state. The wait may end without a change, so the caller
    /// checks the state and waits again. It may also end up to 1 ms after `limit`, since operating systems count waits
    /// in milliseconds.
    pub fn wait(
        &self,
        changed: &WaitQueue,
        state: &mut MutexGuard<'_, State>,
        backend: &dyn Backend,
        limit: Option<Duration>,
    ) {
        state.call_count += 1;
        if !state.is_handled_by_another() && backend.lets_calls_handle_events() {
            return self.handle_for_a_call(state, backend, limit.unwrap_or(EVENT_WAIT_MAX).min(EVENT_WAIT_MAX));
        }
        Self::wait_at(changed, state, limit);
    }

    /// Called by a write: waits for the end of its transfer, as [`Shared::wait`] does. If the backend reports this end
    /// only in [`Backend::await_output`], waits there.
    pub fn wait_written(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend, limit: Option<Duration>) {
        if !backend.waits_for_output_apart() {
            return self.wait(&self.writable, state, backend, limit);
        }
        state.call_count += 1;
        self.call_unlocked(state, || backend.await_output(limit.unwrap_or(EVENT_WAIT_MAX).min(EVENT_WAIT_MAX)));
        if state.closing && state.output_result.is_some() {
            // The pipe's thread may be waiting for the end of this transfer. The backend does not report the end to
            // that thread, so it is woken here.
            self.wake_all(state, backend);
        }
    }

    /// Cancels a transfer to the device whose writing thread was ended by force, and waits until the transfer has
    /// ended.
    pub fn end_abandoned_write(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend) {
        let began = Instant::now();
        backend.cancel_output();
        while state.output_submitted && !state.events_failed {
            if began.elapsed() > ABANDONED_LIMIT {
                state.events_failed = true;
                return self.lose(state, ABANDONED);
            }
            self.wait_written(state, backend, Some(CHECK_INTERVAL_MAX));
        }
    }

    /// Handles the backend's pending events without waiting for further ones.
    pub fn poll_events(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend) {
        if !backend.lets_calls_handle_events() {
            if state.reports.is_empty() {
                // This call may not handle events itself. It waits for up to 1 ms, in which the pipe's thread handles
                // the pending ones.
                Self::wait_at(&self.readable, state, Some(CHECK_INTERVAL_MAX));
            }
        } else if !state.is_handled_by_another() && !state.events_failed {
            self.handle_for_a_call(state, backend, Duration::ZERO);
        }
    }

    /// Wakes all threads that wait for a change of the state, including the thread that handles events.
    pub fn wake_all(&self, state: &State, backend: &dyn Backend) {
        self.readable.notify_all();
        self.writable.notify_all();
        self.thread_wakeup.notify_all();
        backend.interrupt_output();
        if state.event_handler.is_some() {
            backend.interrupt();
        }
    }

    fn handle_for_a_call(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend, limit: Duration) {
        self.handle(state, backend, limit);
        state.call_count += 1;
        if mem::take(&mut state.thread_asleep) {
            self.thread_wakeup.notify_all();
        }
    }

    fn handle(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend, limit: Duration) {
        let own = CallingThread::current();
        state.event_handler = Some(own);
        self.call_unlocked(state, || backend.handle_events(limit));
        if state.event_handler == Some(own) {
            state.event_handler = None;
        }
        // No thread handles events now. Waiting reads and writes are woken, so that one of them takes over.
        self.readable.notify_all();
        self.writable.notify_all();
    }

    /// Calls the backend without holding the lock. After [`EVENT_ERRORS_MAX`] failures in a row the device counts as
    /// lost.
    fn call_unlocked(&self, state: &mut MutexGuard<'_, State>, work: impl FnOnce() -> Result<(), UsbError>) {
        let done = MutexGuard::unlocked(state, || {
            work().inspect_err(|error| {
                log::debug!("the events of USB: {error}");
                threads::pause(RETRY_AFTER);
            })
        });
        state.event_errors = if done.is_ok() { 0 } else { state.event_errors + 1 };
        if state.event_errors >= EVENT_ERRORS_MAX {
            state.events_failed = true;
            self.lose(state, EVENTS_FAILED);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With any number of transfers, the check interval is at most half the time in which reports at the shortest cycle
    /// use up all transfers, so that transfers are resubmitted in time.
    #[test]
    fn transfers_are_looked_after_in_time() {
        let cycle = Duration::from_micros(250);
        for transfers in 1..=64 {
            assert!(check_interval(transfers) * 2 <= cycle * transfers as u32, "{transfers}");
        }
        assert_eq!(
            (check_interval(8), check_interval(usize::MAX)),
            (Duration::from_millis(1), Duration::from_millis(1))
        );
    }
}
