//! Condition variables. Waits of the program's threads are kept in this library's table, because the virtual clock
//! cannot end a wait in the C library.

use std::ffi::c_int;

use libc::{clockid_t, pthread_cond_t, pthread_condattr_t, pthread_mutex_t, timespec};

use super::{deadline, is_passed_on, test_cancel};
use crate::clock::NEVER;
use crate::mode::{self, Mode, Own};
use crate::system::real;
use crate::threads::{Outcome, What, lock, signal, wait_and};

/// Waits for a condition variable until a deadline; returns an error number, or 0.
///
/// # Safety
/// Condition variable and mutex exist, and the thread has locked the mutex.
unsafe fn wait_until(condition: *mut pthread_cond_t, mutex: *mut pthread_mutex_t, deadline: u64) -> c_int {
    test_cancel();
    let error = {
        let _own = Own::begin();
        // The mutex is released only when other threads can end the wait, so that no signal is lost.
        let release = || {
            // SAFETY: the caller guarantees what the section Safety above requires.
            unsafe { libc::pthread_mutex_unlock(mutex) };
        };
        let outcome = wait_and(What::Condition(condition as usize), deadline, release, || false);
        // SAFETY: the caller guarantees what the section Safety above requires.
        let error = unsafe { libc::pthread_mutex_lock(mutex) };
        if error == 0 && outcome == Outcome::Reached { libc::ETIMEDOUT } else { error }
    };
    test_cancel();
    error
}

/// The clock of a condition variable; `None` if other processes use the variable too, so that its waits stay real.
fn clock_of(condition: *const pthread_cond_t) -> Option<clockid_t> {
    let _own = Own::begin();
    lock().condition_clocks.get(&(condition as usize)).copied().unwrap_or(Some(libc::CLOCK_REALTIME))
}

/// Replaces pthread_cond_wait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_wait(condition: *mut pthread_cond_t, mutex: *mut pthread_mutex_t) -> c_int {
    if is_passed_on() || clock_of(condition).is_none() {
        return real!(pthread_cond_wait(condition: *mut pthread_cond_t, mutex: *mut pthread_mutex_t) -> c_int);
    }
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { wait_until(condition, mutex, NEVER) }
}

/// Replaces pthread_cond_timedwait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_timedwait(
    condition: *mut pthread_cond_t,
    mutex: *mut pthread_mutex_t,
    until: *const timespec,
) -> c_int {
    let clock = if is_passed_on() { None } else { clock_of(condition) };
    let Some(clock) = clock else {
        return real!(
            pthread_cond_timedwait(
                condition: *mut pthread_cond_t, mutex: *mut pthread_mutex_t, until: *const timespec
            ) -> c_int
        );
    };
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    let Some(deadline) = (unsafe { deadline(clock, until) }) else { return libc::EINVAL };
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { wait_until(condition, mutex, deadline) }
}

/// Replaces pthread_cond_clockwait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_clockwait(
    condition: *mut pthread_cond_t,
    mutex: *mut pthread_mutex_t,
    clock: clockid_t,
    until: *const timespec,
) -> c_int {
    if is_passed_on() || clock_of(condition).is_none() {
        return real!(
            pthread_cond_clockwait(
                condition: *mut pthread_cond_t, mutex: *mut pthread_mutex_t, clock: clockid_t, until: *const timespec
            ) -> c_int
        );
    }
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    let Some(deadline) = (unsafe { deadline(clock, until) }) else { return libc::EINVAL };
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { wait_until(condition, mutex, deadline) }
}

/// Wakes threads of the program that wait in this library's table. Returns whether the C library's function has to be
/// called too, for threads that wait there.
fn is_left_to_system(condition: *const pthread_cond_t, is_all: bool) -> bool {
    // In this mode the calling thread itself may hold the lock of the table.
    if mode::current() == Mode::Own {
        return true;
    }
    let _own = Own::begin();
    signal(condition as usize, is_all) == 0 || is_all
}

/// Replaces pthread_cond_signal(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_signal(condition: *mut pthread_cond_t) -> c_int {
    if is_left_to_system(condition, false) {
        return real!(pthread_cond_signal(condition: *mut pthread_cond_t) -> c_int);
    }
    0
}

/// Replaces pthread_cond_broadcast(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_broadcast(condition: *mut pthread_cond_t) -> c_int {
    if is_left_to_system(condition, true) {
        return real!(pthread_cond_broadcast(condition: *mut pthread_cond_t) -> c_int);
    }
    0
}

/// Replaces pthread_cond_init(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_init(
    condition: *mut pthread_cond_t,
    attributes: *const pthread_condattr_t,
) -> c_int {
    if mode::current() != Mode::Own {
        let _own = Own::begin();
        let mut clock = Some(libc::CLOCK_REALTIME);
        if !attributes.is_null() {
            let (mut shared, mut number) = (libc::PTHREAD_PROCESS_PRIVATE, libc::CLOCK_REALTIME);
            // SAFETY: the caller gives attributes; both values exist.
            unsafe {
                libc::pthread_condattr_getpshared(attributes, &raw mut shared);
                libc::pthread_condattr_getclock(attributes, &raw mut number);
            }
            clock = (shared == libc::PTHREAD_PROCESS_PRIVATE).then_some(number);
        }
        let mut threads = lock();
        if clock == Some(libc::CLOCK_REALTIME) {
            threads.condition_clocks.remove(&(condition as usize));
        } else {
            threads.condition_clocks.insert(condition as usize, clock);
        }
    }
    real!(pthread_cond_init(condition: *mut pthread_cond_t, attributes: *const pthread_condattr_t) -> c_int)
}

/// Replaces pthread_cond_destroy(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cond_destroy(condition: *mut pthread_cond_t) -> c_int {
    if mode::current() != Mode::Own {
        let _own = Own::begin();
        lock().condition_clocks.remove(&(condition as usize));
    }
    real!(pthread_cond_destroy(condition: *mut pthread_cond_t) -> c_int)
}

/// Converts an error number to the result of a C11 function, as threads.h defines it.
pub fn of_c11(error: c_int) -> c_int {
    match error {
        0 => 0,
        libc::ETIMEDOUT => 4,
        _ => 2,
    }
}

// In the GNU C library the types of C11 are the POSIX types.

/// Replaces cnd_wait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn cnd_wait(condition: *mut pthread_cond_t, mutex: *mut pthread_mutex_t) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    of_c11(unsafe { pthread_cond_wait(condition, mutex) })
}

/// Replaces cnd_timedwait(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn cnd_timedwait(
    condition: *mut pthread_cond_t,
    mutex: *mut pthread_mutex_t,
    until: *const timespec,
) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    of_c11(unsafe { pthread_cond_timedwait(condition, mutex, until) })
}

/// Replaces cnd_signal(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn cnd_signal(condition: *mut pthread_cond_t) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    of_c11(unsafe { pthread_cond_signal(condition) })
}

/// Replaces cnd_broadcast(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn cnd_broadcast(condition: *mut pthread_cond_t) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    of_c11(unsafe { pthread_cond_broadcast(condition) })
}
