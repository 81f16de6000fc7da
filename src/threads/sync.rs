//! Locks and condition variables for the program's threads, which may be ended by force. They keep no list of waiting
//! threads on the stacks of these threads (on Windows the list is on the heap): the stack of an ended thread is freed,
//! and a list with an entry there would keep other threads from getting the lock.

pub(crate) use imp::{Condvar, Mutex, MutexGuard, lock, wait, wait_for};

/// The types of std. Poisoning is ignored, because the state under these locks is valid between any two statements.
#[cfg(not(windows))]
mod imp {
    use std::sync::PoisonError;
    pub use std::sync::{Condvar, Mutex, MutexGuard};
    use std::time::Duration;

    pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
        mutex.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn wait<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
        condvar.wait(guard).unwrap_or_else(PoisonError::into_inner)
    }

    pub fn wait_for<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>, limit: Duration) -> MutexGuard<'a, T> {
        condvar.wait_timeout(guard, limit).unwrap_or_else(PoisonError::into_inner).0
    }
}

/// On Windows the locks and condition variables of std are those of the system, which link waiting threads in a list on
/// their stacks. So this crate has its own.
#[cfg(windows)]
mod imp {
    use std::time::Duration;

    use crate::threads::WaitQueue;
    pub use crate::threads::owned_lock::{Mutex, MutexGuard};

    pub struct Condvar(WaitQueue);

    impl Condvar {
        pub const fn new() -> Self {
            Self(WaitQueue::new())
        }

        pub fn notify_one(&self) {
            self.0.notify_all();
        }

        pub fn notify_all(&self) {
            self.0.notify_all();
        }
    }

    pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
        mutex.lock()
    }

    pub fn wait<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
        wait_at_most(condvar, guard, None)
    }

    pub fn wait_for<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>, limit: Duration) -> MutexGuard<'a, T> {
        wait_at_most(condvar, guard, Some(limit))
    }

    fn wait_at_most<'a, T>(
        Condvar(queue): &Condvar,
        guard: MutexGuard<'a, T>,
        limit: Option<Duration>,
    ) -> MutexGuard<'a, T> {
        let ticket = queue.ticket();
        let mutex = guard.mutex;
        drop(guard);
        queue.wait(ticket, limit);
        mutex.lock()
    }
}
