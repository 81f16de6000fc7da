//! System calls that the program makes directly. Of those with a time limit, only futex(2) is common: std::future and
//! std::semaphore of C++ use it, and the locks, channels and parked threads of Rust.

use std::ffi::{c_int, c_long};

use libc::timespec;

use super::{fail, is_passed_on};
use crate::clock;
use crate::mode::Own;
use crate::system::{nanoseconds, real, word_at};
use crate::threads::{Outcome, What, outside, wait, woken};

/// Replaces syscall(2). It takes any number of arguments, of which the kernel uses at most six numbers. They are in the
/// same registers, whether a function has six arguments or any number of them.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn syscall(
    number: c_long,
    first: c_long,
    second: c_long,
    third: c_long,
    fourth: c_long,
    fifth: c_long,
    sixth: c_long,
) -> c_long {
    let call = || {
        real!(
            syscall(
                number: c_long,
                first: c_long,
                second: c_long,
                third: c_long,
                fourth: c_long,
                fifth: c_long,
                sixth: c_long
            ) -> c_long
        )
    };
    if number != libc::SYS_futex || is_passed_on() {
        return call();
    }
    let (address, operation, value) = (first as usize, second as c_int, third as u32);
    let is_of_realtime = operation & libc::FUTEX_CLOCK_REALTIME != 0;
    let command = operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME);
    if !matches!(command, libc::FUTEX_WAIT | libc::FUTEX_WAIT_BITSET) {
        let woken_really = call();
        if matches!(command, libc::FUTEX_WAKE | libc::FUTEX_WAKE_BITSET) && woken_really >= 0 {
            let _own = Own::begin();
            let left = i64::from(value.cast_signed()).max(1).saturating_sub(woken_really);
            return woken_really + woken(address, usize::try_from(left).unwrap_or(0)) as c_long;
        }
        return woken_really;
    }
    // SAFETY: the caller gives NULL or a time.
    let Some(limit) = (unsafe { (fourth as *const timespec).as_ref() }) else { return outside(call) };
    // An invalid address or time is left to the kernel, which returns an error without a wait.
    let Some(ns) = nanoseconds(limit).filter(|_| address != 0 && address.is_multiple_of(4)) else { return call() };
    let deadline = match command {
        libc::FUTEX_WAIT => Some(clock::in_ns(ns)),
        _ => clock::deadline(if is_of_realtime { libc::CLOCK_REALTIME } else { libc::CLOCK_MONOTONIC }, ns),
    };
    let Some(deadline) = deadline else { return call() };
    match wait_for_word(address, value, deadline) {
        0 => 0,
        error => fail(error).into(),
    }
}

/// Waits until a word is no longer `seen`, until another thread ends the wait, or until `deadline`. Returns an error
/// number, or 0.
fn wait_for_word(address: usize, seen: u32, deadline: u64) -> c_int {
    let _own = Own::begin();
    if word_at(address) != seen {
        return libc::EAGAIN;
    }
    let outcome = wait(What::Word { address, seen }, deadline, || word_at(address) != seen);
    match outcome {
        Outcome::Reached => libc::ETIMEDOUT,
        Outcome::Interrupted => libc::EINTR,
        Outcome::Woken => 0,
    }
}
