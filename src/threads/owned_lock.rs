//! A lock that knows whose it is. `TerminateThread` ends a thread between any two instructions: the next one takes the lock over
//! whose owner is gone. Whoever waits is in no list, as in those of Windows and of `parking_lot`, which hand the lock on to a
//! thread that was ended while it waited.

use std::cell::UnsafeCell;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU64, Ordering};
use std::{hint, thread};

use super::Caller;

/// How often a thread tries before it lets others run: a lock is held for as long as it takes to copy a frame. \[OURS]
const SPINS: u32 = 64;
/// How often it lets others run before it sleeps. \[OURS]
const YIELDS: u32 = 64;
const SLEEP_MS: u32 = 1;
/// After how many such waits it looks whether the owner is gone: nobody who goes on has the lock for as long. \[OURS]
const CHECK_AFTER: u32 = 32;
/// In [`Mutex::owner`]: the lock is free.
const NOBODY: u64 = 0;

/// Waits without a handle: a thread that is ended while it closes one, as std's sleep does with its timer, keeps a lock of Wine
/// that every other thread needs to close its own.
pub fn sleep(limit_ms: u32) {
    // SAFETY: the function has no conditions.
    unsafe { Sleep(limit_ms) };
}

/// A lock that a thread which was ended by force does not keep.
#[derive(Debug, Default)]
pub struct Mutex<T> {
    /// [`Caller::packed`].
    owner: AtomicU64,
    value: UnsafeCell<T>,
}

// SAFETY: only the thread that has the lock reaches the value.
unsafe impl<T: Send> Sync for Mutex<T> {}

impl<T> Mutex<T> {
    /// A lock that nobody holds.
    pub const fn new(value: T) -> Self {
        Self { owner: AtomicU64::new(NOBODY), value: UnsafeCell::new(value) }
    }

    /// Waits for the lock.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        let caller = Caller::current().packed();
        let take_from = |owner| self.owner.compare_exchange(owner, caller, Ordering::Acquire, Ordering::Relaxed);
        let mut tries = 0_u32;
        while let Err(owner) = take_from(NOBODY) {
            if tries < SPINS {
                hint::spin_loop();
            } else if tries < SPINS + YIELDS {
                thread::yield_now();
            } else {
                sleep(SLEEP_MS);
                let check = (tries - SPINS - YIELDS) % CHECK_AFTER == CHECK_AFTER - 1;
                if check && owner != NOBODY && Caller::from_packed(owner).is_gone() && take_from(owner).is_ok() {
                    break;
                }
            }
            // In a count that came round, the spins come again.
            tries = tries.wrapping_add(1);
        }
        MutexGuard { mutex: self, of_thread: PhantomData }
    }
}

/// The lock is held as long as this lives.
#[derive(Debug)]
pub struct MutexGuard<'a, T> {
    pub mutex: &'a Mutex<T>,
    /// It stays with the thread that took the lock.
    of_thread: PhantomData<*const ()>,
}

impl<T> Deref for MutexGuard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: this thread has the lock.
        unsafe { &*self.mutex.value.get() }
    }
}

impl<T> DerefMut for MutexGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as above, and through this guard alone.
        unsafe { &mut *self.mutex.value.get() }
    }
}

impl<T> Drop for MutexGuard<'_, T> {
    fn drop(&mut self) {
        self.mutex.owner.store(NOBODY, Ordering::Release);
    }
}

#[link(name = "kernel32")]
unsafe extern "system" {
    fn Sleep(limit_ms: u32);
}
