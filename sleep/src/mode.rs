//! Who makes a call. The program, NEXTWUSBLib with its threads, and this library call the same functions.

use std::cell::Cell;
use std::ffi::c_int;
use std::sync::atomic::Ordering;

use crate::threads::Thread;

/// Who makes a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The program: clocks and waits are virtual.
    Program,
    /// NEXTWUSBLib, a thread that it has made, or a thread that is ending: clocks and waits are real.
    Real,
    /// This library, a signal handler that interrupts it, or the program's own malloc. Waits are real. Clocks are
    /// virtual and read without a lock; inside NEXTWUSBLib they are real.
    Own,
}

/// The state of a thread, in thread-local storage.
struct Local {
    own: Cell<u32>,
    library: Cell<u32>,
    real: Cell<bool>,
    thread: Cell<*const Thread>,
}

thread_local! {
    static LOCAL: Local = const {
        Local { own: Cell::new(0), library: Cell::new(0), real: Cell::new(false), thread: Cell::new(std::ptr::null()) }
    };
}

/// The mode of a call that this thread makes now.
pub fn current() -> Mode {
    LOCAL.with(|local| match (local.own.get(), local.library.get(), local.real.get()) {
        (0, 0, false) => Mode::Program,
        (0, ..) => Mode::Real,
        _ => Mode::Own,
    })
}

/// Whether this thread is in a call of NEXTWUSBLib.
pub fn is_in_library() -> bool {
    LOCAL.with(|local| local.library.get() > 0)
}

/// Marks this thread as no thread of the program, or as one no longer.
pub fn set_real() {
    LOCAL.with(|local| local.real.set(true));
}

/// Whether this thread is no thread of the program, or no longer one.
pub fn is_real() -> bool {
    LOCAL.with(|local| local.real.get())
}

/// The record of this thread; null: it has none yet.
pub fn thread() -> *const Thread {
    LOCAL.with(|local| local.thread.get())
}

/// Sets the record of this thread, which has to exist until it is set to null.
pub fn set_thread(thread: *const Thread) {
    LOCAL.with(|local| local.thread.set(thread));
    count_library(0);
}

/// Counts a call of NEXTWUSBLib that this thread enters (1) or leaves (-1). With 0 it only copies the count to the
/// thread's record.
pub fn count_library(step: i32) {
    LOCAL.with(|local| {
        let depth = local.library.get().saturating_add_signed(step);
        local.library.set(depth);
        // SAFETY: null or the record of this thread, which exists until it is set to null.
        if let Some(thread) = unsafe { local.thread.get().as_ref() } {
            thread.inside.store(depth, Ordering::Relaxed);
        }
    });
}

unsafe extern "C" {
    fn pthread_setcancelstate(state: c_int, before: *mut c_int) -> c_int;
}

/// The value of PTHREAD_CANCEL_DISABLE in the GNU C library.
const CANCEL_DISABLE: c_int = 1;

/// Marks that this library is at work in the thread, until this is dropped, which also restores `errno`. Until then the
/// thread is not cancelled.
pub struct Own {
    errno: c_int,
    cancel_state: c_int,
}

impl Own {
    pub fn begin() -> Self {
        LOCAL.with(|local| local.own.set(local.own.get() + 1));
        let mut cancel_state = CANCEL_DISABLE;
        // SAFETY: the state is a valid one; `cancel_state` receives the present one.
        unsafe { pthread_setcancelstate(CANCEL_DISABLE, &raw mut cancel_state) };
        Self { errno: errno(), cancel_state }
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        // SAFETY: the state came from this thread, which the guard does not leave.
        unsafe { pthread_setcancelstate(self.cancel_state, std::ptr::null_mut()) };
        LOCAL.with(|local| local.own.set(local.own.get() - 1));
        set_errno(self.errno);
    }
}

pub fn errno() -> c_int {
    // SAFETY: the function returns the address of this thread's errno.
    unsafe { *libc::__errno_location() }
}

pub fn set_errno(errno: c_int) {
    // SAFETY: as above.
    unsafe { *libc::__errno_location() = errno }
}
