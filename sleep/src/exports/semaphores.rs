//! Functions that wait for semaphores and post them.

use std::ffi::c_int;

use libc::{clockid_t, sem_t, timespec};

use super::{deadline, fail, is_passed_on, test_cancel};
use crate::mode::{self, Mode, Own};
use crate::system::real;
use crate::threads::{Outcome, What, outside, posted, wait};

/// Waits for a semaphore until a time of a clock; returns the result of sem_timedwait.
///
/// # Safety
/// The semaphore exists, and the time is NULL or valid.
unsafe fn wait_until(semaphore: *mut sem_t, clock: clockid_t, until: *const timespec) -> c_int {
    let attempt = || real!(sem_trywait(semaphore: *mut sem_t) -> c_int);
    test_cancel();
    if attempt() == 0 {
        return 0;
    }
    if mode::errno() != libc::EAGAIN {
        return -1;
    }
    // SAFETY: the caller guarantees what the section Safety above requires.
    let Some(deadline) = (unsafe { deadline(clock, until) }) else { return fail(libc::EINVAL) };
    let error = {
        let _own = Own::begin();
        let mut is_taken = false;
        loop {
            let outcome = wait(What::Semaphore(semaphore as usize), deadline, || {
                is_taken = attempt() == 0;
                is_taken
            });
            // Another thread may have taken the semaphore before the woken thread tries.
            if is_taken || attempt() == 0 {
                break 0;
            }
            match outcome {
                Outcome::Reached => break libc::ETIMEDOUT,
                Outcome::Interrupted => break libc::EINTR,
                Outcome::Woken => {}
            }
        }
    };
    if error == 0 {
        return 0;
    }
    test_cancel();
    fail(error)
}

/// Replaces sem_timedwait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn sem_timedwait(semaphore: *mut sem_t, until: *const timespec) -> c_int {
    if is_passed_on() {
        return real!(sem_timedwait(semaphore: *mut sem_t, until: *const timespec) -> c_int);
    }
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { wait_until(semaphore, libc::CLOCK_REALTIME, until) }
}

/// Replaces sem_clockwait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn sem_clockwait(semaphore: *mut sem_t, clock: clockid_t, until: *const timespec) -> c_int {
    if is_passed_on() {
        return real!(sem_clockwait(semaphore: *mut sem_t, clock: clockid_t, until: *const timespec) -> c_int);
    }
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { wait_until(semaphore, clock, until) }
}

/// Replaces sem_wait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn sem_wait(semaphore: *mut sem_t) -> c_int {
    let call = || real!(sem_wait(semaphore: *mut sem_t) -> c_int);
    if is_passed_on() { call() } else { outside(call) }
}

/// Replaces sem_post(3), which signal handlers may call, too.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn sem_post(semaphore: *mut sem_t) -> c_int {
    let result = real!(sem_post(semaphore: *mut sem_t) -> c_int);
    // In Own mode this thread itself may hold the lock of the table. The waiting threads then find the semaphore by
    // themselves.
    if mode::current() != Mode::Own {
        let _own = Own::begin();
        posted(semaphore as usize);
    }
    result
}
