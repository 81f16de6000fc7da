//! Lets the program's threads wait for another thread. The threads wait in the kernel (futex, or an event of Windows).
//! Condition variables of Windows and of `parking_lot` are not used: they keep a list of waiting threads, and a thread
//! that is ended by force during its wait stays in that list forever.

use std::time::Duration;

/// Wakes threads that wait for a change of some state, such as an answer that another thread receives. The user of the queue
/// protects that state by a lock of its own.
#[derive(Debug, Default)]
pub struct WaitQueue(imp::WaitQueue);

/// A ticket for one wait: any notification after it was taken ends that wait.
pub struct WaitTicket(imp::WaitTicket);

impl WaitQueue {
    /// A queue without waiting threads.
    pub const fn new() -> Self {
        Self(imp::WaitQueue::new())
    }

    /// Takes a ticket. The caller holds the lock of the state that it waits for, and releases that lock after this
    /// call, so that no notification is missed.
    pub fn ticket(&self) -> WaitTicket {
        WaitTicket(self.0.ticket())
    }

    /// Waits for at most `limit` until there is a notification. A notification that came after the ticket was taken,
    /// but before this call, ends the wait at once. The wait may also end without a notification.
    pub fn wait(&self, ticket: WaitTicket, limit: Option<Duration>) {
        self.0.wait(ticket.0, limit);
    }

    /// Wakes all waiting threads.
    pub fn notify_all(&self) {
        self.0.notify_all();
    }
}

#[cfg(not(windows))]
mod imp {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
    use std::time::Duration;

    /// The condition variable of std, whose threads wait in the kernel (futex).
    #[derive(Debug, Default)]
    pub struct WaitQueue {
        notifications: Mutex<u64>,
        changed: Condvar,
        /// The number of tickets whose waits have not ended. A thread that was ended by force never returns its ticket;
        /// that only costs a needless system call for each notification.
        outstanding_tickets: AtomicUsize,
    }

    pub struct WaitTicket(u64);

    impl WaitQueue {
        pub const fn new() -> Self {
            Self { notifications: Mutex::new(0), changed: Condvar::new(), outstanding_tickets: AtomicUsize::new(0) }
        }

        fn lock(&self) -> MutexGuard<'_, u64> {
            self.notifications.lock().unwrap_or_else(PoisonError::into_inner)
        }

        pub fn ticket(&self) -> WaitTicket {
            self.outstanding_tickets.fetch_add(1, Ordering::SeqCst);
            WaitTicket(*self.lock())
        }

        pub fn wait(&self, WaitTicket(seen): WaitTicket, limit: Option<Duration>) {
            let notifications = self.lock();
            if *notifications == seen {
                match limit {
                    None => drop(self.changed.wait(notifications)),
                    Some(limit) => drop(self.changed.wait_timeout(notifications, limit)),
                }
            } else {
                drop(notifications);
            }
            self.outstanding_tickets.fetch_sub(1, Ordering::SeqCst);
        }

        pub fn notify_all(&self) {
            if self.outstanding_tickets.load(Ordering::SeqCst) == 0 {
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

    use crate::threads::CallingThread;
    use crate::threads::owned_lock::{self, Mutex, MutexGuard};

    type Handle = *mut c_void;

    /// The longest wait, ms. The thread that changes the state may be ended before it has set all events; then the waiting
    /// threads look again. \[OURS]
    const LIMIT_MS: u32 = 500;
    /// The maximum number of events that `notify_all` collects at once while it holds the lock, before it sets them
    /// without the lock: the length of its array, so that it need not allocate.
    const AT_ONCE: usize = 8;
    /// The number of threads for which the first one that waits allocates memory. \[OURS]
    const WAITERS_CAPACITY: usize = 16;
    /// The duration, ms, of a wait for which Windows could not create an event. The wait then ends without a
    /// notification, and the caller checks its condition and waits again.
    const WITHOUT_EVENT_MS: u32 = 1;

    /// One Windows event per waiting thread, reused by the next thread that waits, also if its thread was ended by force.
    #[derive(Debug, Default)]
    pub struct WaitQueue(Mutex<Vec<Waiter>>);

    #[derive(Debug)]
    struct Waiter {
        event: Handle,
        /// The thread that has a ticket for this event.
        of: Option<CallingThread>,
    }

    // SAFETY: handles of events may be used by any thread.
    unsafe impl Send for Waiter {}

    pub struct WaitTicket(Option<(usize, Handle)>);

    impl WaitQueue {
        pub const fn new() -> Self {
            Self(Mutex::new(Vec::new()))
        }

        fn lock(&self) -> MutexGuard<'_, Vec<Waiter>> {
            self.0.lock()
        }

        pub fn ticket(&self) -> WaitTicket {
            let mut waiters = self.lock();
            let is_free = |waiter: &Waiter| waiter.of.is_none();
            let is_left = |waiter: &Waiter| waiter.of.is_some_and(|thread| thread.is_gone());
            let free = waiters.iter().position(is_free).or_else(|| waiters.iter().position(is_left)).or_else(|| {
                let more = if waiters.is_empty() { WAITERS_CAPACITY } else { 1 };
                waiters.try_reserve(more).ok()?;
                // SAFETY: an event without attributes and name, which resets itself and is not set.
                let event = unsafe { CreateEventW(ptr::null(), 0, 0, ptr::null()) };
                if event.is_null() {
                    return None;
                }
                waiters.push(Waiter { event, of: None });
                Some(waiters.len() - 1)
            });
            WaitTicket(free.map(|number| {
                let waiter = &mut waiters[number];
                waiter.of = Some(CallingThread::current());
                (number, waiter.event)
            }))
        }

        pub fn wait(&self, WaitTicket(ticket): WaitTicket, limit: Option<Duration>) {
            let Some((number, event)) = ticket else { return owned_lock::sleep(WITHOUT_EVENT_MS) };
            let limit_ms = limit.map_or(LIMIT_MS, |limit| {
                u32::try_from(limit.as_micros().div_ceil(1000)).unwrap_or(LIMIT_MS).min(LIMIT_MS)
            });
            // SAFETY: the event is open until `drop`.
            unsafe { WaitForSingleObject(event, limit_ms) };
            self.lock()[number].of = None;
        }

        pub fn notify_all(&self) {
            let mut told = 0;
            loop {
                // The events are set outside the lock, so that no thread waits for the lock during a system call. Who waits is
                // noted by the waiting thread alone: if this one is ended here, the next notification sets all events. An event
                // that is set twice ends a later wait early.
                let (mut events, mut count) = ([ptr::null_mut(); AT_ONCE], 0);
                for waiter in self.lock().iter().filter(|waiter| waiter.of.is_some()).skip(told).take(AT_ONCE) {
                    (events[count], count) = (waiter.event, count + 1);
                }
                for event in &events[..count] {
                    // SAFETY: the event is open until `drop`.
                    unsafe { SetEvent(*event) };
                }
                told += count;
                if count < AT_ONCE {
                    return;
                }
            }
        }
    }

    impl Drop for WaitQueue {
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

    /// LIB-70 A notification after a ticket was taken ends the wait with that ticket, even if it comes before the wait
    /// begins.
    #[test]
    fn what_is_told_is_heard() {
        let (queue, state) = (WaitQueue::new(), Mutex::new(0));
        let wait_for = |wanted: u32| {
            let mut now = state.lock().expect("no panic");
            while *now < wanted {
                let ticket = queue.ticket();
                drop(now);
                queue.wait(ticket, None);
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
                    queue.notify_all();
                    thread::yield_now();
                }
            });
        });
        let ticket = queue.ticket();
        queue.notify_all();
        queue.wait(ticket, None);
        let ticket = queue.ticket();
        queue.wait(ticket, Some(Duration::from_millis(5)));
    }
}
