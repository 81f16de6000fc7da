//! Locks with a time limit.

use std::ffi::c_int;

use libc::{clockid_t, pthread_mutex_t, pthread_rwlock_t, timespec};

use super::conditions::of_c11;
use super::is_passed_on;
use crate::clock;
use crate::mode::Own;
use crate::system::{nanoseconds, real};
use crate::threads::{Outcome, What, wait};

/// Waits for a lock until a time of a clock; an error number, or 0. `attempt` is the C library's function without a wait.
///
/// # Safety
/// The time is NULL or valid.
unsafe fn lock_until(clock: clockid_t, until: *const timespec, attempt: impl Fn() -> c_int) -> c_int {
    let _own = Own::begin();
    let mut error = attempt();
    if error != libc::EBUSY {
        return error;
    }
    // SAFETY: the caller's promise.
    let until = unsafe { until.as_ref() }.and_then(nanoseconds).and_then(|ns| clock::deadline(clock, ns));
    let Some(deadline) = until else { return libc::EINVAL };
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

/// pthread_mutex_timedlock(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_mutex_timedlock(mutex: *mut pthread_mutex_t, until: *const timespec) -> c_int {
    if is_passed_on() {
        return real!(pthread_mutex_timedlock(mutex: *mut pthread_mutex_t, until: *const timespec) -> c_int);
    }
    // SAFETY: the caller's arguments.
    unsafe { lock_until(libc::CLOCK_REALTIME, until, || libc::pthread_mutex_trylock(mutex)) }
}

/// pthread_mutex_clocklock(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_mutex_clocklock(
    mutex: *mut pthread_mutex_t,
    clock: clockid_t,
    until: *const timespec,
) -> c_int {
    if is_passed_on() {
        return real!(
            pthread_mutex_clocklock(mutex: *mut pthread_mutex_t, clock: clockid_t, until: *const timespec) -> c_int
        );
    }
    // SAFETY: the caller's arguments.
    unsafe { lock_until(clock, until, || libc::pthread_mutex_trylock(mutex)) }
}

/// mtx_timedlock(3), of C11, whose mutex is that of POSIX.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn mtx_timedlock(mutex: *mut pthread_mutex_t, until: *const timespec) -> c_int {
    // SAFETY: the caller's arguments.
    of_c11(unsafe { pthread_mutex_timedlock(mutex, until) })
}

/// pthread_rwlock_timedrdlock(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_rwlock_timedrdlock(lock: *mut pthread_rwlock_t, until: *const timespec) -> c_int {
    if is_passed_on() {
        return real!(pthread_rwlock_timedrdlock(lock: *mut pthread_rwlock_t, until: *const timespec) -> c_int);
    }
    // SAFETY: the caller's arguments.
    unsafe { lock_until(libc::CLOCK_REALTIME, until, || libc::pthread_rwlock_tryrdlock(lock)) }
}

/// pthread_rwlock_timedwrlock(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_rwlock_timedwrlock(lock: *mut pthread_rwlock_t, until: *const timespec) -> c_int {
    if is_passed_on() {
        return real!(pthread_rwlock_timedwrlock(lock: *mut pthread_rwlock_t, until: *const timespec) -> c_int);
    }
    // SAFETY: the caller's arguments.
    unsafe { lock_until(libc::CLOCK_REALTIME, until, || libc::pthread_rwlock_trywrlock(lock)) }
}

/// pthread_rwlock_clockrdlock(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_rwlock_clockrdlock(
    lock: *mut pthread_rwlock_t,
    clock: clockid_t,
    until: *const timespec,
) -> c_int {
    if is_passed_on() {
        return real!(
            pthread_rwlock_clockrdlock(lock: *mut pthread_rwlock_t, clock: clockid_t, until: *const timespec) -> c_int
        );
    }
    // SAFETY: the caller's arguments.
    unsafe { lock_until(clock, until, || libc::pthread_rwlock_tryrdlock(lock)) }
}

/// pthread_rwlock_clockwrlock(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_rwlock_clockwrlock(
    lock: *mut pthread_rwlock_t,
    clock: clockid_t,
    until: *const timespec,
) -> c_int {
    if is_passed_on() {
        return real!(
            pthread_rwlock_clockwrlock(lock: *mut pthread_rwlock_t, clock: clockid_t, until: *const timespec) -> c_int
        );
    }
    // SAFETY: the caller's arguments.
    unsafe { lock_until(clock, until, || libc::pthread_rwlock_trywrlock(lock)) }
}
