//! Who handles a line's events: the call that waits for one, so that no other thread stands between it and the system; and
//! the pipe's own thread as long as none does, so that reports are taken whatever the program does. One at a time.
//!
//! A call that leaves hands nothing over, which would cost every report a change of threads: the pipe's thread looks from
//! time to time whether calls still come. While one and the same call waits it sleeps, and that call wakes it.

use std::mem;
use std::thread;
use std::time::Duration;

use parking_lot::{Condvar, MutexGuard};

use super::error::UsbError;
use super::line::Line;
use super::reports::{DEAF, Shared, State};
use super::rest::UNWRITTEN_FOR;

/// For how long a thread handles events before it looks around, should nothing wake it. \[OURS]
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// As long as calls come and go the pipe's thread looks whether they have left something after half of what the transfers
/// that wait last, at the shortest cycle (250 us) .. \[OURS]
const LOOK_AFTER_EACH: Duration = Duration::from_micros(125);
/// .. and at least so often. \[OURS]
const LOOK_AFTER_AT_MOST: Duration = Duration::from_millis(1);
/// After an error of a line's event handling it is tried again .. \[OURS]
const AFTER_AN_ERROR: Duration = Duration::from_millis(10);
/// .. so often in a row, a second in all: then the device counts as lost. \[OURS]
const ERRORS: u32 = 100;

/// When the pipe's thread looks again, with so many transfers to the host.
fn look_after(transfers: usize) -> Duration {
    u32::try_from(transfers)
        .map_or(LOOK_AFTER_AT_MOST, |transfers| LOOK_AFTER_EACH.saturating_mul(transfers).min(LOOK_AFTER_AT_MOST))
}

impl Shared {
    /// The pipe's thread: until the pipe is closed and the system has none of its transfers, or says nothing of them any
    /// more.
    pub fn handle_events(&self, line: &dyn Line) {
        let look_after = look_after(line.inputs());
        let mut state = self.state.lock();
        let mut seen = state.turns;
        while !state.deaf && (!state.closing || state.pending > 0) {
            let calls_come = state.turns != seen;
            seen = state.turns;
            self.look_at_rest(&mut state, line);
            if state.handled {
                if calls_come || state.closing {
                    self.look_around.wait_for(&mut state, look_after);
                } else {
                    state.asleep = true;
                    self.look_around.wait(&mut state);
                    state.asleep = false;
                }
            } else if !state.closing && state.rest.is_whole(line.inputs()) {
                // Nothing comes but the ends of writes, and who writes waits for them.
                self.look_around.wait_for(&mut state, UNWRITTEN_FOR);
            } else if calls_come && !state.closing {
                self.handle(&mut state, line, Duration::ZERO);
                self.look_around.wait_for(&mut state, look_after);
            } else {
                self.handle(&mut state, line, LOOK_EVERY);
            }
        }
    }

    /// A call: waits for a change, for that long or up to a millisecond more, as systems count; it may be less.
    pub fn wait(&self, changed: &Condvar, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Option<Duration>) {
        state.turns += 1;
        if !state.handled {
            return self.handle_for_a_call(state, line, limit.unwrap_or(LOOK_EVERY).min(LOOK_EVERY));
        }
        state.waiting += 1;
        match limit {
            Some(limit) => {
                changed.wait_for(state, limit);
            }
            None => changed.wait(state),
        }
        state.waiting -= 1;
    }

    /// The call that writes: as [`Shared::wait`], for the end of its transfer.
    pub fn wait_written(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Option<Duration>) {
        if !line.has_output_apart() {
            return self.wait(&self.writable, state, line, limit);
        }
        state.turns += 1;
        self.attend(state, || line.await_output(limit.unwrap_or(LOOK_EVERY).min(LOOK_EVERY)));
        if state.closing && state.written.is_some() {
            // The pipe's thread ends after this transfer, which it is told nothing of.
            self.wake_all(state, line);
        }
    }

    /// Takes what has come and was not handled yet, without waiting.
    pub fn take_what_came(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line) {
        if !state.handled && !state.deaf {
            self.handle_for_a_call(state, line, Duration::ZERO);
        }
    }

    /// Ends the waits under way, whoever handles events.
    pub fn wake_all(&self, state: &State, line: &dyn Line) {
        self.readable.notify_all();
        self.writable.notify_all();
        self.look_around.notify_all();
        line.interrupt_output();
        if state.handled {
            line.interrupt();
        }
    }

    fn handle_for_a_call(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Duration) {
        self.handle(state, line, limit);
        state.turns += 1;
        if mem::take(&mut state.asleep) {
            self.look_around.notify_all();
        }
    }

    fn handle(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Duration) {
        state.handled = true;
        self.attend(state, || line.handle_events(limit));
        state.handled = false;
        // One of them goes on with it.
        if state.waiting > 0 {
            self.readable.notify_all();
            self.writable.notify_all();
        }
    }

    /// Lets the line work, without the lock; a line that fails for good has lost the device.
    fn attend(&self, state: &mut MutexGuard<'_, State>, work: impl FnOnce() -> Result<(), UsbError>) {
        let done = MutexGuard::unlocked(state, || {
            work().inspect_err(|error| {
                log::debug!("the events of USB: {error}");
                thread::sleep(AFTER_AN_ERROR);
            })
        });
        state.event_errors = if done.is_ok() { 0 } else { state.event_errors + 1 };
        if state.event_errors >= ERRORS {
            state.deaf = true;
            self.lose(state, DEAF);
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
            assert!(look_after(transfers) * 2 <= cycle * transfers as u32, "{transfers}");
        }
        assert_eq!((look_after(8), look_after(usize::MAX)), (Duration::from_millis(1), Duration::from_millis(1)));
    }
}
