//! The functions of the C library that the program calls. Each passes calls on unchanged that are not the program's
//! ([`Mode`](crate::mode::Mode)).
//!
//! A thread may be cancelled in the C library's functions, which unwinds it. So no value with a destructor exists where one of
//! these calls such a function for the program, and where it calls [`test_cancel`].
//!
//! Not here, and so on the real clock: timers that send signals (alarm, setitimer, timer_create), how long descriptors of
//! timerfd_create run, limits of calls that receive (SO_RCVTIMEO, mq_timedreceive), sigtimedwait, semtimedop, epoll_pwait2,
//! pthread_timedjoin_np and pthread_clockjoin_np, and what sysinfo, clock and `/proc/uptime` say.

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

/// Whether the calling function has to pass its call on.
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

/// The deadline of a wait until a time of a clock; `None`: it is no time, or the clock has none.
///
/// # Safety
/// The time is NULL or valid.
unsafe fn deadline(clock: clockid_t, until: *const timespec) -> Option<u64> {
    // SAFETY: the caller's promise.
    clock::deadline(clock, nanoseconds(unsafe { until.as_ref() }?)?)
}
