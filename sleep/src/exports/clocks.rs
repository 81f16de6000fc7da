//! Functions that read clocks.

use std::ffi::{c_int, c_void};

use libc::{clock_t, clockid_t, time_t, timespec, timeval, tms};

use crate::clock;
use crate::mode::{self, Mode, Own};
use crate::system::{real, timespec};

/// The time that a clock of the program shows, in nanoseconds. `None`: the clock stays real, or the calling thread
/// reads real clocks.
fn shown(clock: clockid_t) -> Option<u64> {
    let mode = mode::current();
    if mode == Mode::Real || mode::is_in_library() {
        return None;
    }
    let _own = Own::begin();
    let start = clock::start(clock)?;
    let passed = if mode == Mode::Program { clock::read() } else { clock::now() };
    Some(start.saturating_add(passed))
}

/// Replaces clock_gettime(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn clock_gettime(clock: clockid_t, to: *mut timespec) -> c_int {
    match shown(clock) {
        Some(shown) if !to.is_null() => {
            // SAFETY: the caller gives room for a time.
            unsafe { to.write(timespec(shown)) };
            0
        }
        _ => real!(clock_gettime(clock: clockid_t, to: *mut timespec) -> c_int),
    }
}

/// Replaces gettimeofday(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn gettimeofday(to: *mut timeval, zone: *mut c_void) -> c_int {
    match shown(libc::CLOCK_REALTIME) {
        Some(shown) if !to.is_null() => {
            let time = timespec(shown);
            // SAFETY: the caller gives room for a time.
            unsafe { to.write(timeval { tv_sec: time.tv_sec, tv_usec: time.tv_nsec / 1000 }) };
            0
        }
        _ => real!(gettimeofday(to: *mut timeval, zone: *mut c_void) -> c_int),
    }
}

/// Replaces time(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn time(to: *mut time_t) -> time_t {
    let Some(shown) = shown(libc::CLOCK_REALTIME) else { return real!(time(to: *mut time_t) -> time_t) };
    let seconds = timespec(shown).tv_sec;
    if !to.is_null() {
        // SAFETY: the caller gives NULL or room for a time.
        unsafe { to.write(seconds) };
    }
    seconds
}

/// Replaces timespec_get(3), of C11.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn timespec_get(to: *mut timespec, base: c_int) -> c_int {
    /// The value of TIME_UTC in time.h.
    const UTC: c_int = 1;
    match shown(libc::CLOCK_REALTIME) {
        Some(shown) if base == UTC && !to.is_null() => {
            // SAFETY: the caller gives room for a time.
            unsafe { to.write(timespec(shown)) };
            base
        }
        _ => real!(timespec_get(to: *mut timespec, base: c_int) -> c_int),
    }
}

/// Replaces times(2). The times of the processor are real.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn times(to: *mut tms) -> clock_t {
    let real = real!(times(to: *mut tms) -> clock_t);
    // SAFETY: the function reads a constant of the system.
    let ticks = u64::try_from(unsafe { libc::sysconf(libc::_SC_CLK_TCK) }).unwrap_or(0);
    let tick_ns = 1_000_000_000_u64.checked_div(ticks).unwrap_or(0);
    match shown(libc::CLOCK_MONOTONIC).and_then(|shown| shown.checked_div(tick_ns)) {
        // A result of -1 means that the C library's function failed.
        Some(shown) if real != -1 => shown as clock_t,
        _ => real,
    }
}
