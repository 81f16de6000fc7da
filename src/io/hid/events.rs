//! Who handles a line's events: the call that waits for one, so that no other thread stands between it and the system; and
//! the pipe's own thread as long as none does, so that reports are taken whatever the program does. One at a time.

use std::thread;
use std::time::Duration;

use parking_lot::{Condvar, MutexGuard};

use super::line::Line;
use super::reports::{Shared, State};

/// For how long a thread handles events before it looks around, should nothing wake it. \[OURS]
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// As long as calls handle events the pipe's thread looks this often whether they have left something: half of what the
/// transfers that wait (8) last at a cycle of 250 us. \[OURS]
const LOOK_AFTER_CALLS: Duration = Duration::from_millis(1);
/// After an error of a line's event handling it is tried again. \[OURS]
const AFTER_AN_ERROR: Duration = Duration::from_millis(10);

impl Shared {
    /// The pipe's thread: until the pipe is closed and the system has none of its transfers.
    pub fn handle_events(&self, line: &dyn Line) {
        let mut state = self.state.lock();
        let mut seen = state.waits;
        while !state.closing || state.pending > 0 {
            let calls_wait = state.waits != seen && !state.closing;
            seen = state.waits;
            if !state.handled {
                self.handle(&mut state, line, if calls_wait { Duration::ZERO } else { LOOK_EVERY });
            }
            if calls_wait || state.handled {
                self.look_around.wait_for(&mut state, LOOK_AFTER_CALLS);
            }
        }
    }

    /// A call: waits for a change, for that long or up to a millisecond more, as systems count; it may be less.
    pub fn wait(&self, changed: &Condvar, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Option<Duration>) {
        state.waits += 1;
        if !state.handled {
            return self.handle(state, line, limit.unwrap_or(LOOK_EVERY).min(LOOK_EVERY));
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

    /// Takes what has come and was not handled yet, without waiting.
    pub fn take_what_came(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line) {
        if !state.handled {
            self.handle(state, line, Duration::ZERO);
        }
    }

    /// Ends the waits under way, whoever handles events.
    pub fn wake_all(&self, state: &State, line: &dyn Line) {
        self.readable.notify_all();
        self.writable.notify_all();
        self.look_around.notify_all();
        if state.handled {
            line.interrupt();
        }
    }

    fn handle(&self, state: &mut MutexGuard<'_, State>, line: &dyn Line, limit: Duration) {
        state.handled = true;
        MutexGuard::unlocked(state, || {
            if let Err(error) = line.handle_events(limit) {
                log::debug!("the events of USB: {error}");
                thread::sleep(AFTER_AN_ERROR);
            }
        });
        state.handled = false;
        // One of them goes on with it.
        if state.waiting > 0 {
            self.readable.notify_all();
            self.writable.notify_all();
        }
    }
}
