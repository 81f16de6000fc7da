//! Functions that begin threads, cancel them, and wait for their end.

use std::ffi::{c_int, c_void};
use std::sync::Arc;

use libc::{pthread_attr_t, pthread_t};

use super::conditions::of_c11;
use super::is_passed_on;
use crate::mode::{self, Mode, Own};
use crate::system::real;
use crate::threads::{self, Thread, outside};

type PosixWork = unsafe extern "C-unwind" fn(*mut c_void) -> *mut c_void;
type C11Work = unsafe extern "C-unwind" fn(*mut c_void) -> c_int;

/// The first function of the program in a new thread.
#[derive(Clone, Copy)]
enum Work {
    Posix(PosixWork),
    C11(C11Work),
}

/// The argument of [`begin`], the first function of a new thread.
struct Start {
    work: Work,
    argument: *mut c_void,
    /// The record of the thread; `None`: it is no thread of the program.
    thread: Option<Arc<Thread>>,
}

/// The first function of every new thread. It takes `start` apart before it calls the program, so that it has nothing
/// to drop if the thread is unwound.
unsafe extern "C-unwind" fn begin(start: *mut c_void) -> *mut c_void {
    let (work, argument) = {
        let _own = Own::begin();
        // SAFETY: made by `create` below for this thread alone.
        let start = unsafe { Box::from_raw(start.cast::<Start>()) };
        match &start.thread {
            Some(thread) => threads::begin(thread),
            None => mode::set_real(),
        }
        (start.work, start.argument)
    };
    // SAFETY: the function and its argument come from the caller of pthread_create or thrd_create.
    unsafe {
        match work {
            Work::Posix(work) => work(argument),
            // thrd_join converts the pointer back to the integer.
            Work::C11(work) => work(argument) as isize as *mut c_void,
        }
    }
}

/// Makes a thread; returns an error number, or 0. A thread that a thread of the program makes belongs to the program,
/// and counts as running from here on.
///
/// # Safety
/// As pthread_create(3).
unsafe fn create(
    handle: *mut pthread_t,
    attributes: *const pthread_attr_t,
    work: Work,
    argument: *mut c_void,
) -> c_int {
    let mode = mode::current();
    let _own = Own::begin();
    let thread = (mode == Mode::Program).then(|| {
        threads::current();
        threads::add()
    });
    let record = thread.clone();
    let begin: PosixWork = begin;
    let start = Box::into_raw(Box::new(Start { work, argument, thread })).cast::<c_void>();
    let error = real!(
        pthread_create(
            handle: *mut pthread_t, attributes: *const pthread_attr_t, begin: PosixWork, start: *mut c_void
        ) -> c_int
    );
    if error != 0 {
        // SAFETY: made above, and no thread has it.
        drop(unsafe { Box::from_raw(start.cast::<Start>()) });
        if let Some(record) = record {
            threads::remove(&record);
        }
    }
    error
}

/// Replaces pthread_create(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_create(
    handle: *mut pthread_t,
    attributes: *const pthread_attr_t,
    work: PosixWork,
    argument: *mut c_void,
) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { create(handle, attributes, Work::Posix(work), argument) }
}

/// Replaces thrd_create(3), of C11, whose threads are POSIX threads. The C library's function makes them without a call
/// of pthread_create, so it is replaced as well.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn thrd_create(handle: *mut pthread_t, work: C11Work, argument: *mut c_void) -> c_int {
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    of_c11(unsafe { create(handle, std::ptr::null(), Work::C11(work), argument) })
}

/// Replaces pthread_join(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_join(thread: pthread_t, result: *mut *mut c_void) -> c_int {
    let call = || real!(pthread_join(thread: pthread_t, result: *mut *mut c_void) -> c_int);
    if is_passed_on() { call() } else { outside(call) }
}

/// Replaces thrd_join(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn thrd_join(thread: pthread_t, result: *mut c_int) -> c_int {
    let mut value = std::ptr::null_mut();
    // SAFETY: the caller's thread, and room for its value.
    let error = unsafe { pthread_join(thread, &raw mut value) };
    if error == 0 && !result.is_null() {
        // SAFETY: the caller gives NULL or room for a number.
        unsafe { result.write(value as isize as c_int) };
    }
    of_c11(error)
}

/// Replaces pthread_cancel(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cancel(thread: pthread_t) -> c_int {
    let error = real!(pthread_cancel(thread: pthread_t) -> c_int);
    if mode::current() != Mode::Own {
        let _own = Own::begin();
        threads::cancelled(thread);
    }
    error
}
