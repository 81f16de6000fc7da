//! Which thread handles the backend's events. A call that waits for one does it itself, which saves a change of threads for
//! each report. While no call waits the pipe's own thread does it, so that reports are received whatever the program does.
//! Only one thread handles events at a time.
//!
//! A call that returns does not wake the pipe's thread, since that would cost a change of threads again; the pipe's thread
//! checks at an interval whether calls still come. While a single call waits for long the pipe's thread sleeps, and that
//! call wakes it.

use std::mem;
use std::thread;
use std::time::Duration;

use parking_lot::{Condvar, MutexGuard};

use super::backend::Backend;
use super::error::UsbError;
use super::input_pause::PAUSE_ENDS_AFTER_UNWRITTEN;
use super::reports::{EVENTS_FAILED, Shared, State};

/// The longest time that a thread waits for events before it checks the pipe's state. \[OURS]
const EVENT_WAIT_MAX: Duration = Duration::from_secs(1);
/// While calls come and go, the pipe's thread checks for events that they have left at this interval per transfer to the
/// host. It is half of the shortest cycle (250 us), so that the transfers are resubmitted before the last of them is used. \[OURS]
const CHECK_INTERVAL_PER_TRANSFER: Duration = Duration::from_micros(125);
/// The longest of these intervals, however many transfers there are. \[OURS]
const CHECK_INTERVAL_MAX: Duration = Duration::from_millis(1);
/// After an error of the backend's event handling it is tried again after this time .. \[OURS]
const RETRY_AFTER: Duration = Duration::from_millis(10);
/// .. and after this many errors in a row, a second in all, the device counts as lost. \[OURS]
const EVENT_ERRORS_MAX: u32 = 100;

/// The interval at which the pipe's thread checks for events, with this many transfers to the host.
fn check_interval(transfers: usize) -> Duration {
    u32::try_from(transfers).map_or(CHECK_INTERVAL_MAX, |transfers| {
        CHECK_INTERVAL_PER_TRANSFER.saturating_mul(transfers).min(CHECK_INTERVAL_MAX)
    })
}

impl Shared {
    /// The body of the pipe's thread. It runs until the pipe is closed and all transfers have ended, or their end is not
    /// reported any more.
    pub fn handle_events(&self, backend: &dyn Backend) {
        let check_interval = check_interval(backend.inputs());
        let mut state = self.state.lock();
        let mut seen = state.call_count;
        while !state.events_failed && (!state.closing || state.submitted > 0) {
            let calls_come = state.call_count != seen;
            seen = state.call_count;
            self.begin_or_end_pause(&mut state, backend);
            if state.handling_events {
                if calls_come || state.closing {
                    self.thread_wakeup.wait_for(&mut state, check_interval);
                } else {
                    state.thread_asleep = true;
                    self.thread_wakeup.wait(&mut state);
                    state.thread_asleep = false;
                }
            } else if !state.closing && state.input_pause.is_complete(backend.inputs()) {
                // No event can come but the end of a write, for which the thread that writes waits itself.
                self.thread_wakeup.wait_for(&mut state, PAUSE_ENDS_AFTER_UNWRITTEN);
            } else if calls_come && !state.closing {
                self.handle(&mut state, backend, Duration::ZERO);
                self.thread_wakeup.wait_for(&mut state, check_interval);
            } else {
                self.handle(&mut state, backend, EVENT_WAIT_MAX);
            }
        }
    }

    /// Called by a read or write: waits for a change of the state. It may return early, and up to a millisecond late, because
    /// systems count in milliseconds.
    pub fn wait(
        &self,
        changed: &Condvar,
        state: &mut MutexGuard<'_, State>,
        backend: &dyn Backend,
        limit: Option<Duration>,
    ) {
        state.call_count += 1;
        if !state.handling_events {
            return self.handle_for_a_call(state, backend, limit.unwrap_or(EVENT_WAIT_MAX).min(EVENT_WAIT_MAX));
        }
        state.calls_waiting += 1;
        match limit {
            Some(limit) => {
                changed.wait_for(state, limit);
            }
            None => changed.wait(state),
        }
        state.calls_waiting -= 1;
    }

    /// Called by a write: waits like [`Shared::wait`], for the end of its transfer.
    pub fn wait_written(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend, limit: Option<Duration>) {
        if !backend.waits_for_output_apart() {
            return self.wait(&self.writable, state, backend, limit);
        }
        state.call_count += 1;
        self.call_unlocked(state, || backend.await_output(limit.unwrap_or(EVENT_WAIT_MAX).min(EVENT_WAIT_MAX)));
        if state.closing && state.output_result.is_some() {
            // The pipe's thread waits for the end of this transfer and is not informed of it otherwise.
            self.wake_all(state, backend);
        }
    }

    /// Handles events that are pending, without waiting.
    pub fn poll_events(&self, state: &mut MutexGuard<'_, State>, backend: &dyn Backend) {
        if !state.handling_events && !state.events_failed {
            self.handle_for_a_call(state, backend, Duration::ZERO);
        }
    }

    /// Ends all waits, whichever thread handles events.
    pub fn wake_all(&self, state: &State, backend: &dyn Backend) {
        self.readable.notify_all();
        self.writable.notify_all();
        self.thread_wakeup.notify_all();
        backend.interrupt_output();
        if state.handling_events {
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
        state.handling_events = true;
        self.call_unlocked(state, || backend.handle_events(limit));
        state.handling_events = false;
        // One of the waiting calls goes on handling events.
        if state.calls_waiting > 0 {
            self.readable.notify_all();
            self.writable.notify_all();
        }
    }

    /// Calls the backend without holding the lock. If it fails [`EVENT_ERRORS_MAX`] times in a row the device is lost.
    fn call_unlocked(&self, state: &mut MutexGuard<'_, State>, work: impl FnOnce() -> Result<(), UsbError>) {
        let done = MutexGuard::unlocked(state, || {
            work().inspect_err(|error| {
                log::debug!("the events of USB: {error}");
                thread::sleep(RETRY_AFTER);
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

    /// WIRE-19 However few transfers wait for reports, they are looked after before they are used up at the shortest cycle.
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
