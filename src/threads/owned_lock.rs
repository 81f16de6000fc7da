//! A lock that knows whose it is. `TerminateThread` ends a thread between any two instructions: the next one takes the lock over
//! whose owner is gone.

use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::Caller;

/// How long a thread waits before it looks whether the lock's owner is gone. \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(20);
/// In [`Mutex::owner`]: the lock is free, or is just being taken or released.
const NOBODY: u64 = 0;

/// A lock that a thread which was ended by force does not keep.
#[derive(Debug, Default)]
pub struct Mutex<T> {
    /// [`Caller::packed`].
    owner: AtomicU64,
    inner: parking_lot::Mutex<T>,
}

impl<T> Mutex<T> {
    /// A lock that nobody holds.
    pub const fn new(value: T) -> Self {
        Self { owner: AtomicU64::new(NOBODY), inner: parking_lot::Mutex::new(value) }
    }

    /// Waits for the lock.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        let caller = Caller::current().packed();
        loop {
            if let Some(guard) = self.inner.try_lock_for(LOOK_INTERVAL) {
                self.owner.store(caller, Ordering::Relaxed);
                return MutexGuard { mutex: self, guard };
            }
            let owner = self.owner.load(Ordering::Relaxed);
            if owner != NOBODY
                && Caller::from_packed(owner).is_gone()
                // Another thread that waits has found the same.
                && self.owner.compare_exchange(owner, NOBODY, Ordering::Relaxed, Ordering::Relaxed).is_ok()
            {
                // SAFETY: the lock is held by a thread that does not exist any more, and only one thread gets here for it.
                unsafe { self.inner.force_unlock() };
            }
        }
    }
}

/// The lock is held as long as this lives.
pub struct MutexGuard<'a, T> {
    pub mutex: &'a Mutex<T>,
    guard: parking_lot::MutexGuard<'a, T>,
}

impl<T> Deref for MutexGuard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.guard
    }
}

impl<T> DerefMut for MutexGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.guard
    }
}

impl<T> Drop for MutexGuard<'_, T> {
    fn drop(&mut self) {
        self.mutex.owner.store(NOBODY, Ordering::Relaxed);
    }
}
