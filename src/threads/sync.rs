//! Locks and condition variables for the program's threads, which may be ended by force. They keep no list of waiting
//! threads on the stacks of these threads (on Windows the list is on the heap): the stack of an ended thread is freed,
//! and a list with an entry there would keep other threads from getting the lock.

pub use imp::{Condvar, Mutex, MutexGuard, lock, wait, wait_for};

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

        pub fn wait<T>(&self, guard: &mut MutexGuard<'_, T>) {
            self.wait_at_most(guard, None);
        }

        pub fn wait_for<T>(&self, guard: &mut MutexGuard<'_, T>, limit: Duration) {
            self.wait_at_most(guard, Some(limit));
        }

        fn wait_at_most<T>(&self, guard: &mut MutexGuard<'_, T>, limit: Option<Duration>) {
            let ticket = self.0.ticket();
            MutexGuard::unlocked(guard, || self.0.wait(ticket, limit));
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

    pub fn wait<'a, T>(condvar: &Condvar, mut guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
        condvar.wait(&mut guard);
        guard
    }

    pub fn wait_for<'a, T>(condvar: &Condvar, mut guard: MutexGuard<'a, T>, limit: Duration) -> MutexGuard<'a, T> {
        condvar.wait_for(&mut guard, limit);
        guard
    }
}

/// The same locks with the interface of `parking_lot`: a guard can be unlocked for a while by a function that has borrowed it.
/// Elsewhere than on Windows they are those of `parking_lot`; there only a signal handler ends a thread that waits for one.
pub(crate) mod unlockable {
    #[cfg(all(windows, feature = "usb"))]
    pub use super::imp::Condvar;
    #[cfg(windows)]
    pub use super::imp::{Mutex, MutexGuard};
    #[cfg(all(not(windows), feature = "usb"))]
    pub use parking_lot::Condvar;
    #[cfg(not(windows))]
    pub use parking_lot::{Mutex, MutexGuard};
}
