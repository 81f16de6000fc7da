//! Functions that sleep.

use std::ffi::{c_int, c_uint};

use libc::{clockid_t, timespec, useconds_t};

use super::{fail, is_passed_on, test_cancel};
use crate::clock;
use crate::mode::Own;
use crate::system::{nanoseconds, real, timespec};
use crate::threads::{Outcome, What, wait};

/// Sleeps until a deadline. Returns the time that is left, in nanoseconds; 0 unless a signal handler has run.
fn sleep_until(deadline: u64) -> u64 {
    test_cancel();
    let outcome = {
        let _own = Own::begin();
        wait(What::Time, deadline, || false)
    };
    test_cancel();
    if outcome == Outcome::Interrupted { deadline.saturating_sub(clock::now()) } else { 0 }
}

/// Sleeps for `ns` nanoseconds. Returns the time that is left, like [`sleep_until`].
fn sleep_for(ns: u64) -> u64 {
    sleep_until(clock::in_ns(ns)).min(ns)
}

/// Returns the result of a sleep, an error number or 0, and writes the time that is left to `left`.
///
/// # Safety
/// `left` is NULL or points to room for a time.
unsafe fn slept(left_ns: u64, left: *mut timespec) -> c_int {
    if left_ns == 0 {
        return 0;
    }
    if !left.is_null() {
        // SAFETY: the caller guarantees what the section Safety above requires.
        unsafe { left.write(timespec(left_ns)) };
    }
    libc::EINTR
}

/// Replaces nanosleep(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn nanosleep(time: *const timespec, left: *mut timespec) -> c_int {
    // SAFETY: the caller gives a time; NULL is left to the C library.
    let Some(given) = (unsafe { time.as_ref() }).filter(|_| !is_passed_on()) else {
        return real!(nanosleep(time: *const timespec, left: *mut timespec) -> c_int);
    };
    let Some(ns) = nanoseconds(given) else { return fail(libc::EINVAL) };
    // SAFETY: the caller gives NULL or room for a time.
    match unsafe { slept(sleep_for(ns), left) } {
        0 => 0,
        error => fail(error),
    }
}

/// Replaces clock_nanosleep(2), which returns the error number.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn clock_nanosleep(
    clock: clockid_t,
    flags: c_int,
    time: *const timespec,
    left: *mut timespec,
) -> c_int {
    // SAFETY: the caller gives a time; NULL is left to the C library.
    let given = unsafe { time.as_ref() }.filter(|_| !is_passed_on() && clock::start(clock).is_some());
    let Some(given) = given else {
        return real!(
            clock_nanosleep(clock: clockid_t, flags: c_int, time: *const timespec, left: *mut timespec) -> c_int
        );
    };
    let Some(ns) = nanoseconds(given) else { return libc::EINVAL };
    if flags & libc::TIMER_ABSTIME == 0 {
        // SAFETY: the caller gives NULL or room for a time.
        return unsafe { slept(sleep_for(ns), left) };
    }
    let deadline = clock::deadline(clock, ns).unwrap_or(0);
    if sleep_until(deadline) == 0 { 0 } else { libc::EINTR }
}

/// Replaces usleep(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn usleep(micros: useconds_t) -> c_int {
    if is_passed_on() {
        return real!(usleep(micros: useconds_t) -> c_int);
    }
    if sleep_for(u64::from(micros) * 1_000) == 0 { 0 } else { fail(libc::EINTR) }
}

/// Replaces sleep(3), which returns the seconds that are left.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn sleep(seconds: c_uint) -> c_uint {
    if is_passed_on() {
        return real!(sleep(seconds: c_uint) -> c_uint);
    }
    let left = sleep_for(u64::from(seconds) * 1_000_000_000);
    c_uint::try_from(left.div_ceil(1_000_000_000)).unwrap_or(seconds)
}

/// Replaces thrd_sleep(3), of C11, which returns -1 after a signal and another negative number for an error.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn thrd_sleep(time: *const timespec, left: *mut timespec) -> c_int {
    // SAFETY: the caller gives a time; NULL is left to the C library.
    let Some(given) = (unsafe { time.as_ref() }).filter(|_| !is_passed_on()) else {
        return real!(thrd_sleep(time: *const timespec, left: *mut timespec) -> c_int);
    };
    let Some(ns) = nanoseconds(given) else { return -2 };
    // SAFETY: the caller gives NULL or room for a time.
    if unsafe { slept(sleep_for(ns), left) } == 0 { 0 } else { -1 }
}
