//! Timer descriptors. They run on the real clock: only times that the program has read from its clocks are converted.

use std::ffi::c_int;

use libc::{clockid_t, itimerspec};

use super::is_passed_on;
use crate::clock;
use crate::mode::Own;
use crate::system::{nanoseconds, real, real_ns, timespec};

/// The real time at which a clock of the program shows `shown_ns`, if virtual time advances with the real clock.
fn real_time(clock: clockid_t, shown_ns: u64) -> Option<u64> {
    let left = shown_ns.saturating_sub(clock::start(clock)?).saturating_sub(clock::now());
    Some(real_ns(clock).saturating_add(left))
}

/// The clock of a timer descriptor, from `/proc`.
fn clock_of(timer: c_int) -> Option<clockid_t> {
    let facts = std::fs::read_to_string(format!("/proc/self/fdinfo/{timer}")).ok()?;
    facts.lines().find_map(|line| line.strip_prefix("clockid:")?.trim().parse().ok())
}

/// Replaces timerfd_settime(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn timerfd_settime(
    timer: c_int,
    flags: c_int,
    time: *const itimerspec,
    before: *mut itimerspec,
) -> c_int {
    let call = |time: *const itimerspec| {
        real!(
            timerfd_settime(timer: c_int, flags: c_int, time: *const itimerspec, before: *mut itimerspec) -> c_int
        )
    };
    if is_passed_on() || flags & libc::TFD_TIMER_ABSTIME == 0 {
        return call(time);
    }
    let _own = Own::begin();
    // SAFETY: the caller gives a time; NULL is left to the C library.
    let Some(given) = (unsafe { time.as_ref() }) else { return call(time) };
    // A time of 0 stops the timer.
    let ns = nanoseconds(&given.it_value).filter(|ns| *ns != 0);
    match ns.and_then(|ns| real_time(clock_of(timer)?, ns)) {
        Some(ns) => call(&itimerspec { it_value: timespec(ns), ..*given }),
        None => call(time),
    }
}
