//! Beginning threads, and waiting for their end.

use std::ffi::{c_int, c_void};
use std::sync::Arc;

use libc::{pthread_attr_t, pthread_t};

use super::is_passed_on;
use crate::mode::{self, Mode, Own};
use crate::system::real;
use crate::threads::{self, Thread, outside};

type Work = unsafe extern "C-unwind" fn(*mut c_void) -> *mut c_void;

/// What a new thread begins with.
struct Start {
    work: Work,
    argument: *mut c_void,
    /// Its record; `None`: it is no thread of the program.
    thread: Option<Arc<Thread>>,
}

/// The first function of a thread. It takes its start apart before it calls the program, so that it has nothing to drop
/// if the thread is unwound.
unsafe extern "C-unwind" fn begin(start: *mut c_void) -> *mut c_void {
    let (work, argument) = {
        let _own = Own::begin();
        // SAFETY: made by pthread_create below for this thread alone.
        let start = unsafe { Box::from_raw(start.cast::<Start>()) };
        match &start.thread {
            Some(thread) => threads::begin(thread),
            None => mode::set_real(),
        }
        (start.work, start.argument)
    };
    // SAFETY: the function and its argument come from the caller of pthread_create.
    unsafe { work(argument) }
}

/// pthread_create(3). A thread that a thread of the program makes is one of the program and runs from here on.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_create(
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
    let begin: Work = begin;
    let start = Box::into_raw(Box::new(Start { work, argument, thread })).cast::<c_void>();
    let error = real!(
        pthread_create(
            handle: *mut pthread_t, attributes: *const pthread_attr_t, begin: Work, start: *mut c_void
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

/// pthread_join(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_join(thread: pthread_t, result: *mut *mut c_void) -> c_int {
    let call = || real!(pthread_join(thread: pthread_t, result: *mut *mut c_void) -> c_int);
    if is_passed_on() { call() } else { outside(call) }
}

/// pthread_cancel(3).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pthread_cancel(thread: pthread_t) -> c_int {
    let error = real!(pthread_cancel(thread: pthread_t) -> c_int);
    if mode::current() != Mode::Own {
        let _own = Own::begin();
        threads::cancelled(thread);
    }
    error
}
