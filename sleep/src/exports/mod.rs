//! The functions that replace those of the C library for the program. Each passes calls that are not the program's
//! ([`Mode`](crate::mode::Mode)) on to the C library unchanged.
//!
//! The C library cancels a thread by unwinding it in one of its functions. So no value with a destructor exists where a
//! function here calls such a function for the program, and where it calls [`test_cancel`].
//!
//! Not replaced, and so on the real clock: timers that send signals (alarm, setitimer, timer_create), how long
//! descriptors of timerfd_create run, limits of calls that receive (SO_RCVTIMEO, mq_timedreceive), sigtimedwait,
//! semtimedop, epoll_pwait2, pthread_timedjoin_np and pthread_clockjoin_np, and the times in sysinfo, clock and
//! `/proc/uptime`.

mod clocks;
mod conditions;
mod descriptors;
mod locks;
mod semaphores;
mod sleeps;
mod system_calls;
mod threads;
mod timers;

use std::ffi::c_int;

use libc::{clockid_t, timespec};

use crate::clock;
use crate::mode::{self, Mode};
use crate::system::nanoseconds;

unsafe extern "C-unwind" {
    fn pthread_testcancel();
}

/// Whether the calling function has to pass its call on to the C library.
fn is_passed_on() -> bool {
    mode::current() != Mode::Program
}

/// Ends the thread here if it was cancelled.
fn test_cancel() {
    // SAFETY: the function has no arguments. If it unwinds the thread, this function and its callers have nothing to drop.
    unsafe { pthread_testcancel() }
}

/// Sets errno and returns -1.
fn fail(errno: c_int) -> c_int {
    mode::set_errno(errno);
    -1
}

/// Converts a time of a clock to a deadline on the virtual clock; `None` if it is no valid time, or if the clock stays
/// real.
///
/// # Safety
/// The time is NULL or valid.
unsafe fn deadline(clock: clockid_t, until: *const timespec) -> Option<u64> {
    // SAFETY: the caller guarantees what the section Safety above requires.
    clock::deadline(clock, nanoseconds(unsafe { until.as_ref() }?)?)
}
