//! The end of a program that does not close its boards: they are closed for it, so that their threads stop and a
//! recording is complete. And its fork: a child has the boards without their threads, and so none.

#[cfg(unix)]
use std::process;
use std::sync::Once;
#[cfg(unix)]
use std::sync::atomic::AtomicU32;
use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(unix)]
use crate::board;

/// This process was forked while a board was open.
static FORKED: AtomicBool = AtomicBool::new(false);

/// Whether this process was forked while a board was open: the boards are its parent's.
pub fn is_forked() -> bool {
    FORKED.load(Ordering::Relaxed)
}

/// The process that opened boards; 0: none has.
#[cfg(unix)]
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Has all boards closed when this process exits, after everything the program itself does then: its global objects may
/// still send what brings the machine to rest. The first call counts.
pub fn close_at_exit() {
    static ONCE: Once = Once::new();
    ONCE.call_once(register);
}

/// The functions here run when exit handlers and the destructors of the program's global objects are done.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".fini_array")]
static AT_EXIT: extern "C" fn() = at_exit;

#[cfg(unix)]
extern "C" fn at_exit() {
    // A child of fork has the boards without their threads: they are the parent's to close.
    if process::id() == OWNER.load(Ordering::Relaxed) {
        let _ = std::panic::catch_unwind(crate::boards::close_all);
    }
}

#[cfg(unix)]
fn register() {
    extern "C" fn in_child() {
        FORKED.store(board::any_open(), Ordering::Relaxed);
    }

    OWNER.store(process::id(), Ordering::Relaxed);
    // SAFETY: the function takes and returns nothing, does no more than look at one atomic and set another, and the
    // library stays in memory (`nodelete`).
    if unsafe { libc::pthread_atfork(None, None, Some(in_child)) } != 0 {
        log::warn!("no room for a fork handler: do not use the library in a child of this process");
    }
}

/// Elsewhere (Windows) a library is told of the end when its threads are gone already, and nothing is left to close in
/// order.
#[cfg(not(unix))]
fn register() {}
