//! Locks with a time limit.

use std::ffi::c_int;

use libc::{clockid_t, pthread_mutex_t, pthread_rwlock_t, timespec};

use super::conditions::of_c11;
use super::{deadline, is_passed_on};
use crate::mode::Own;
use crate::system::real;
use crate::threads::{Outcome, What, wait};

/// Waits for a lock until a time of a clock; returns an error number, or 0. `attempt` tries the lock by the C library
/// without a wait.
///
/// # Safety
/// The time is NULL or valid.
unsafe fn lock_until(clock: clockid_t, until: *const timespec, attempt: impl Fn() -> c_int) -> c_int {
    let _own = Own::begin();
    let mut error = attempt();
    if error != libc::EBUSY {
        return error;
    }
    // SAFETY: the caller guarantees what the section Safety above requires.
    let Some(deadline) = (unsafe { deadline(clock, until) }) else { return libc::EINVAL };
    loop {
        let outcome = wait(What::Lock, deadline, || {
            error = attempt();
            error != libc::EBUSY
        });
        if error == libc::EBUSY {
            error = attempt();
        }
        match (error, outcome) {
            (libc::EBUSY, Outcome::Reached) => return libc::ETIMEDOUT,
            // A signal does not end a wait for a lock.
            (libc::EBUSY, _) => {}
            _ => return error,
        }
    }
}

/// Defines a function that waits for a lock until a time of the real-time clock. The arguments are its name, the type
/// of the lock, and the C library's function that tries the lock without a wait.
macro_rules! timed {
    ($name:ident, $lock:ty, $attempt:path) => {
        #[doc = concat!(stringify!($name), "(3).")]
        #[unsafe(no_mangle)]
        unsafe extern "C-unwind" fn $name(lock: *mut $lock, until: *const timespec) -> c_int {
            if is_passed_on() {
                return real!($name(lock: *mut $lock, until: *const timespec) -> c_int);
            }
            // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
            unsafe { lock_until(libc::CLOCK_REALTIME, until, || $attempt(lock)) }
        }
    };
}

/// Like `timed`, but for a function whose caller chooses the clock.
macro_rules! clocked {
    ($name:ident, $lock:ty, $attempt:path) => {
        #[doc = concat!(stringify!($name), "(3).")]
        #[unsafe(no_mangle)]
        unsafe extern "C-unwind" fn $name(lock: *mut $lock, clock: clockid_t, until: *const timespec) -> c_int {
            if is_passed_on() {
                return real!($name(lock: *mut $lock, clock: clockid_t, until: *const timespec) -> c_int);
            }
            // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
            unsafe { lock_until(clock, until, || $attempt(lock)) }
        }
    };
}

timed!(pthread_mutex_timedlock, pthread_mutex_t, libc::pthread_mutex_trylock);
clocked!(pthread_mutex_clocklock, pthread_mutex_t, libc::pthread_mutex_trylock);
timed!(pthread_rwlock_timedrdlock, pthread_rwlock_t, libc::pthread_rwlock_tryrdlock);
clocked!(pthread_rwlock_clockrdlock, pthread_rwlock_t, libc::pthread_rwlock_tryrdlock);
timed!(pthread_rwlock_timedwrlock, pthread_rwlock_t, libc::pthread_rwlock_trywrlock);
clocked!(pthread_rwlock_clockwrlock, pthread_rwlock_t, libc::pthread_rwlock_trywrlock);

/// Replaces mtx_timedlock(3), of C11, whose mutex is a POSIX mutex.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn mtx_timedlock(mutex: *mut pthread_mutex_t, until: *const timespec) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    of_c11(unsafe { pthread_mutex_timedlock(mutex, until) })
}
