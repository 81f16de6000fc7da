//! The end of a process that has not closed its boards, and fork.
//!
//! When the process ends, the boards' threads are stopped and recordings completed. A server of a board is informed
//! that the program has vanished, whatever the exit code. A child of fork closes its copies of the connections and USB
//! devices of open boards, so that a server notices the end of the parent, and another program can then open the USB
//! board.

#[cfg(unix)]
use std::process;
#[cfg(unix)]
use std::sync::atomic::{AtomicU32, Ordering};

#[cfg(unix)]
use crate::forked;
#[cfg(target_os = "linux")]
use crate::program_clock::{self, InLibrary};
#[cfg(target_os = "linux")]
use crate::{logger, open_boards};

/// The id of the process that opened boards; 0 if none has.
#[cfg(unix)]
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Arranges that boards still open are released when this process exits, after the exit handlers of the program, whose
/// global objects may still stop the machine and close the board. Called before each board is opened.
pub fn end_at_exit() {
    #[cfg(unix)]
    OWNER.store(process::id(), Ordering::Relaxed);
    #[cfg(all(unix, not(target_os = "linux")))]
    {
        static ONCE: std::sync::Once = std::sync::Once::new();
        ONCE.call_once(|| watch_forks());
    }
}

/// The loader calls the functions in the section `.init_array` before main, or when it loads the library: forks are noticed
/// from then on.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".init_array")]
static AT_START: extern "C" fn() = at_start;

#[cfg(target_os = "linux")]
extern "C" fn at_start() {
    program_clock::find();
    watch_forks();
}

/// The functions in the section `.fini_array` run after the exit handlers and the destructors of the program's global
/// objects. These may still close the boards; the boards that they leave open are released here.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".fini_array")]
static AT_EXIT: extern "C" fn() = at_exit;

#[cfg(target_os = "linux")]
extern "C" fn at_exit() {
    let _in_library = InLibrary::begin();
    // A child of fork must not release the boards, which belong to its parent.
    if process::id() == OWNER.load(Ordering::Relaxed) && !forked::is_forked() {
        let _ = std::panic::catch_unwind(open_boards::vanish_all);
    }
    if !forked::is_forked() {
        let _ = std::panic::catch_unwind(logger::finish);
    }
}

#[cfg(unix)]
extern "C" fn watch_forks() {
    extern "C" fn in_child() {
        if forked::note_fork() {
            // SAFETY: this is a child that was just forked, and no call of it reaches a board of its parent from here on.
            unsafe { ecmsk::threads::close_in_child() };
        }
    }

    // SAFETY: the function only reads and sets atomics and closes descriptors, and the library stays in memory (`nodelete`). If
    // the system has no memory for the registration forks are not noticed.
    unsafe { libc::pthread_atfork(None, None, Some(in_child)) };
}
