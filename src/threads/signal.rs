//! What a thread of a program waits at while it waits for another thread. Whoever waits here is known to the system alone: a
//! condition variable of Windows, and one of `parking_lot`, keep a list of those that wait, in their stacks or beside them, and
//! a thread that is ended by force in its wait stays in that list for ever.

use std::time::Duration;

/// Wakes the threads that wait for something to change. What changes stands under a lock of its owner.
#[derive(Debug, Default)]
pub struct Signal(imp::Signal);

/// What is told from here on ends the wait with this.
pub struct Ticket(imp::Ticket);

impl Signal {
    /// A signal for which nobody waits.
    pub const fn new() -> Self {
        Self(imp::Signal::new())
    }

    /// To be taken under the lock, before it is released for the wait.
    pub fn ticket(&self) -> Ticket {
        Ticket(self.0.ticket())
    }

    /// Waits until something was told since the ticket was taken, for at most `limit`. It may end early.
    pub fn wait(&self, ticket: Ticket, limit: Option<Duration>) {
        self.0.wait(ticket.0, limit);
    }

    /// Ends all waits.
    pub fn notify_all(&self) {
        self.0.notify_all();
    }
}

#[cfg(not(windows))]
mod imp {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
    use std::time::Duration;

    /// std's condition variable, whose waits are the kernel's (futex).
    #[derive(Debug, Default)]
    pub struct Signal {
        told: Mutex<u64>,
        changed: Condvar,
        /// How many tickets there are. Those of threads that were ended by force stay, which costs a call of the system.
        tickets: AtomicUsize,
    }

    pub struct Ticket(u64);

    impl Signal {
        pub const fn new() -> Self {
            Self { told: Mutex::new(0), changed: Condvar::new(), tickets: AtomicUsize::new(0) }
        }

        fn lock(&self) -> MutexGuard<'_, u64> {
            self.told.lock().unwrap_or_else(PoisonError::into_inner)
        }

        pub fn ticket(&self) -> Ticket {
            self.tickets.fetch_add(1, Ordering::SeqCst);
            Ticket(*self.lock())
        }

        pub fn wait(&self, Ticket(seen): Ticket, limit: Option<Duration>) {
            let told = self.lock();
            if *told == seen {
                match limit {
                    None => drop(self.changed.wait(told)),
                    Some(limit) => drop(self.changed.wait_timeout(told, limit)),
                }
            } else {
                drop(told);
            }
            self.tickets.fetch_sub(1, Ordering::SeqCst);
        }

        pub fn notify_all(&self) {
            if self.tickets.load(Ordering::SeqCst) == 0 {
                return;
            }
            *self.lock() += 1;
            self.changed.notify_all();
        }
    }
}

#[cfg(windows)]
mod imp {
    use std::ffi::c_void;
    use std::ptr;
    use std::time::Duration;

    use crate::threads::owned_lock::{self, Mutex, MutexGuard};

    type Handle = *mut c_void;

    const FOREVER: u32 = u32::MAX;
    /// How many events are set in one go.
    const AT_ONCE: usize = 8;
    /// How long a wait is for which Windows has no event.
    const WITHOUT_EVENT_MS: u32 = 1;

    /// An event of Windows for each thread that waits, which the next one to wait uses again. That of a thread that was ended
    /// by force stays its own.
    #[derive(Debug, Default)]
    pub struct Signal(Mutex<Vec<Waiter>>);

    #[derive(Debug)]
    struct Waiter {
        event: Handle,
        /// A thread has it.
        taken: bool,
        /// That thread is to be woken.
        waits: bool,
    }

    // SAFETY: handles of events may be used by any thread.
    unsafe impl Send for Waiter {}

    pub struct Ticket(Option<(usize, Handle)>);

    impl Signal {
        pub const fn new() -> Self {
            Self(Mutex::new(Vec::new()))
        }

        fn lock(&self) -> MutexGuard<'_, Vec<Waiter>> {
            self.0.lock()
        }

        pub fn ticket(&self) -> Ticket {
            let mut waiters = self.lock();
            let free = waiters.iter().position(|waiter| !waiter.taken).or_else(|| {
                // SAFETY: an event without attributes and name, which resets itself and is not set.
                let event = unsafe { CreateEventW(ptr::null(), 0, 0, ptr::null()) };
                if event.is_null() || waiters.try_reserve(1).is_err() {
                    return None;
                }
                waiters.push(Waiter { event, taken: false, waits: false });
                Some(waiters.len() - 1)
            });
            Ticket(free.map(|number| {
                let waiter = &mut waiters[number];
                (waiter.taken, waiter.waits) = (true, true);
                (number, waiter.event)
            }))
        }

        pub fn wait(&self, Ticket(ticket): Ticket, limit: Option<Duration>) {
            let Some((number, event)) = ticket else { return owned_lock::sleep(WITHOUT_EVENT_MS) };
            let limit_ms = limit.map_or(FOREVER, |limit| {
                u32::try_from(limit.as_micros().div_ceil(1000)).unwrap_or(FOREVER).min(FOREVER - 1)
            });
            // SAFETY: the event is open until `drop`.
            unsafe { WaitForSingleObject(event, limit_ms) };
            let waiter = &mut self.lock()[number];
            (waiter.taken, waiter.waits) = (false, false);
        }

        pub fn notify_all(&self) {
            loop {
                // Outside the lock, so that nobody waits for it for the time of a call of the system.
                let (mut events, mut count) = ([ptr::null_mut(); AT_ONCE], 0);
                for waiter in self.lock().iter_mut().filter(|waiter| waiter.waits).take(AT_ONCE) {
                    waiter.waits = false;
                    (events[count], count) = (waiter.event, count + 1);
                }
                for event in &events[..count] {
                    // SAFETY: as above.
                    unsafe { SetEvent(*event) };
                }
                if count < AT_ONCE {
                    return;
                }
            }
        }
    }

    impl Drop for Signal {
        fn drop(&mut self) {
            for waiter in self.lock().drain(..) {
                // SAFETY: the event is closed here only.
                unsafe { CloseHandle(waiter.event) };
            }
        }
    }

    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn CreateEventW(attributes: *const c_void, manual: i32, set: i32, name: *const u16) -> Handle;
        fn SetEvent(event: Handle) -> i32;
        fn WaitForSingleObject(handle: Handle, limit_ms: u32) -> u32;
        fn CloseHandle(handle: Handle) -> i32;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::thread;

    use super::*;

    /// LIB-70 Whoever waits is woken by what is told after the ticket was taken, also before the wait has begun.
    #[test]
    fn what_is_told_is_heard() {
        let (signal, state) = (Signal::new(), Mutex::new(0));
        let wait_for = |wanted: u32| {
            let mut now = state.lock().expect("no panic");
            while *now < wanted {
                let ticket = signal.ticket();
                drop(now);
                signal.wait(ticket, None);
                now = state.lock().expect("no panic");
            }
        };
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| (1..=500).for_each(wait_for));
            }
            scope.spawn(|| {
                for _ in 0..500 {
                    *state.lock().expect("no panic") += 1;
                    signal.notify_all();
                    thread::yield_now();
                }
            });
        });
        let ticket = signal.ticket();
        signal.notify_all();
        signal.wait(ticket, None);
        let ticket = signal.ticket();
        signal.wait(ticket, Some(Duration::from_millis(5)));
    }
}
