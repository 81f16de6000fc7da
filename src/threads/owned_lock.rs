//! A lock that stores its owner. `TerminateThread` may end the owner between any two instructions; then the next thread
//! takes the lock over. The lock has no list of waiting threads. The locks of Windows and of `parking_lot` have such a
//! list, and would pass the lock on to a thread that was ended while it waited, so that no other thread would ever get
//! it.

use std::ffi::c_void;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};
use std::{hint, ptr};

use parking_lot::lock_api;

use super::CallingThread;

/// How many times a thread spins before it waits in the kernel: a lock is held only for as long as copying a frame takes.
/// \[OURS]
const SPINS: u32 = 64;
/// The longest wait, ms, before a thread checks the lock again. Each release wakes one thread. If that thread is ended before it
/// takes the lock, the others go on after this time. \[OURS]
const WAIT_MS: u32 = 8;
/// The number of waits of this length in a row, together about 32 ms, after which a waiting thread asks the system whether the
/// owner has ended. An owner that still runs would normally have released the lock by then. \[OURS]
const CHECK_AFTER: u32 = 4;
/// `WAIT_TIMEOUT`: the wait has ended at its limit.
const TIMED_OUT: u32 = 0x102;
/// Value of [`RawMutex::owner`] while the lock is free.
const NOBODY: u64 = 0;
/// Set in [`RawMutex::owner`] while threads may wait for the lock. Windows' thread ids are multiples of 4, so this bit of
/// [`CallingThread::packed`] is free.
const AWAITED: u64 = 1 << 32;

/// A lock that the next thread takes over if its owner was ended by force.
pub type Mutex<T> = lock_api::Mutex<RawMutex, T>;
/// Holds the lock while it lives, and releases it when dropped.
pub type MutexGuard<'a, T> = lock_api::MutexGuard<'a, RawMutex, T>;

/// Sleeps without using a handle. The sleep of std closes the handle of a timer. If a program ends the thread at that
/// moment, a lock of Wine stays taken that all other threads need to close their handles.
pub fn sleep(limit_ms: u32) {
    // SAFETY: the function has no safety conditions.
    unsafe { Sleep(limit_ms) };
}

/// The lock without its value.
pub struct RawMutex {
    /// The owner as [`CallingThread::packed`], with [`AWAITED`], or [`NOBODY`].
    owner: AtomicU64,
    /// The event at which threads wait, made by the first one that has to; null before.
    released: AtomicPtr<c_void>,
}

impl RawMutex {
    fn take_from(&self, owner: u64, caller: u64) -> Result<u64, u64> {
        self.owner.compare_exchange(owner, caller, Ordering::Acquire, Ordering::Relaxed)
    }

    /// Waits for a short time, or until the owner releases the lock. Returns whether the time has passed.
    fn wait(&self) -> bool {
        let mut event = self.released.load(Ordering::Acquire);
        if event.is_null() {
            // SAFETY: an event without attributes and name, which resets itself and is not set.
            let made = unsafe { CreateEventW(ptr::null(), 0, 0, ptr::null()) };
            event = match self.released.compare_exchange(event, made, Ordering::AcqRel, Ordering::Acquire) {
                Ok(_) => made,
                Err(other) => {
                    // SAFETY: no other thread has seen this event.
                    unsafe { CloseHandle(made) };
                    other
                }
            };
        }
        // Without memory for an event there is none; the next wait tries again.
        if event.is_null() {
            sleep(WAIT_MS);
            return true;
        }
        // SAFETY: the event is open until `drop`.
        unsafe { WaitForSingleObject(event, WAIT_MS) == TIMED_OUT }
    }

    #[cold]
    fn lock_later(&self, caller: u64) {
        let mut waits = 0_u32;
        loop {
            for _ in 0..SPINS {
                // Other threads may wait, too; so the lock stays marked.
                if self.take_from(NOBODY, caller | AWAITED).is_ok() {
                    return;
                }
                hint::spin_loop();
            }
            let owner = self.owner.load(Ordering::Relaxed);
            if owner == NOBODY || (owner & AWAITED == 0 && self.take_from(owner, owner | AWAITED).is_err()) {
                continue;
            }
            waits = if self.wait() { waits + 1 } else { 0 };
            if waits < CHECK_AFTER {
                continue;
            }
            waits = 0;
            let owner = self.owner.load(Ordering::Relaxed);
            if owner != NOBODY
                && CallingThread::from_packed(owner & !AWAITED).is_gone()
                && self.take_from(owner, caller | AWAITED).is_ok()
            {
                return;
            }
        }
    }
}

// SAFETY: a thread has the lock from the moment at which it writes itself into `owner`, which it does only if nobody is there,
// or a thread that has ended, until it writes nobody there.
unsafe impl lock_api::RawMutex for RawMutex {
    #[expect(clippy::declare_interior_mutable_const, reason = "the trait asks for it: each lock begins as a copy")]
    const INIT: Self = Self { owner: AtomicU64::new(NOBODY), released: AtomicPtr::new(ptr::null_mut()) };

    /// The guard is not `Send`: it stays with the thread that took the lock.
    type GuardMarker = lock_api::GuardNoSend;

    fn lock(&self) {
        let caller = CallingThread::current().packed();
        if self.take_from(NOBODY, caller).is_err() {
            self.lock_later(caller);
        }
    }

    fn try_lock(&self) -> bool {
        self.take_from(NOBODY, CallingThread::current().packed()).is_ok()
    }

    unsafe fn unlock(&self) {
        if self.owner.swap(NOBODY, Ordering::Release) & AWAITED != 0 {
            // A thread marks the lock before it makes the event, so it may not be there yet.
            let event = self.released.load(Ordering::Acquire);
            if !event.is_null() {
                // SAFETY: the event is open until `drop`.
                unsafe { SetEvent(event) };
            }
        }
    }
}

impl Drop for RawMutex {
    fn drop(&mut self) {
        let event = *self.released.get_mut();
        if !event.is_null() {
            // SAFETY: the event is closed here only.
            unsafe { CloseHandle(event) };
        }
    }
}

#[link(name = "kernel32")]
unsafe extern "system" {
    fn Sleep(limit_ms: u32);
    fn CreateEventW(attributes: *const c_void, manual: i32, set: i32, name: *const u16) -> *mut c_void;
    fn SetEvent(event: *mut c_void) -> i32;
    fn WaitForSingleObject(handle: *mut c_void, limit_ms: u32) -> u32;
    fn CloseHandle(handle: *mut c_void) -> i32;
}
