//! A lock that stores its owner. `TerminateThread` may end the owner between any two instructions; then the next thread
//! takes the lock over. The lock has no list of waiting threads. The locks of Windows and of `parking_lot` have such a
//! list, and would pass the lock on to a thread that was ended while it waited, so that no other thread would ever get
//! it.

use std::cell::UnsafeCell;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU64, Ordering};
use std::{hint, thread};

use super::CallingThread;

/// How many times a thread spins before it yields: a lock is held only for as long as copying a frame takes. \[OURS]
const SPINS: u32 = 64;
/// How many times a thread yields before it sleeps. \[OURS]
const YIELDS: u32 = 64;
const SLEEP_MS: u32 = 1;
/// The number of sleeps, together about 32 ms, after which a waiting thread asks the system whether the owner has
/// ended. An owner that still runs would normally have released the lock by then. \[OURS]
const CHECK_AFTER: u32 = 32;
/// Value of [`Mutex::owner`] while the lock is free.
const NOBODY: u64 = 0;

/// Sleeps without using a handle. The sleep of std closes the handle of a timer. If a program ends the thread at that
/// moment, a lock of Wine stays taken that all other threads need to close their handles.
pub fn sleep(limit_ms: u32) {
    // SAFETY: the function has no safety conditions.
    unsafe { Sleep(limit_ms) };
}

/// A lock that the next thread takes over if its owner was ended by force.
#[derive(Debug, Default)]
pub struct Mutex<T> {
    /// The owner as [`CallingThread::packed`], or [`NOBODY`].
    owner: AtomicU64,
    value: UnsafeCell<T>,
}

// SAFETY: only the thread that has the lock reaches the value.
unsafe impl<T: Send> Sync for Mutex<T> {}

impl<T> Mutex<T> {
    /// A free lock.
    pub const fn new(value: T) -> Self {
        Self { owner: AtomicU64::new(NOBODY), value: UnsafeCell::new(value) }
    }

    /// Waits until this thread holds the lock.
    pub fn lock(&self) -> MutexGuard<'_, T> {
        let caller = CallingThread::current().packed();
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
                if check && owner != NOBODY && CallingThread::from_packed(owner).is_gone() && take_from(owner).is_ok() {
                    break;
                }
            }
            // When the counter wraps around, the thread spins again, which does no harm.
            tries = tries.wrapping_add(1);
        }
        MutexGuard { mutex: self, of_thread: PhantomData }
    }
}

/// Holds the lock while it lives, and releases it when dropped.
#[derive(Debug)]
pub struct MutexGuard<'a, T> {
    pub mutex: &'a Mutex<T>,
    /// Makes the guard not `Send`: it stays with the thread that took the lock.
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
        // SAFETY: this thread has the lock, and reaches the value through this guard alone.
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
