//! The end of a program that does not close its boards: their threads are stopped, a recording is complete, and a board
//! that is served is left as by a program that has vanished, whatever the exit code. And its fork: a child has the boards
//! without their threads, and so none.

#[cfg(unix)]
use std::process;
#[cfg(unix)]
use std::sync::atomic::AtomicU32;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

#[cfg(unix)]
use crate::board;

/// This process was forked while a board was open, or while one was being opened or closed.
static FORKED: AtomicBool = AtomicBool::new(false);

/// Whether this process was forked while a board was open, or while a call was under way: boards and locks are its
/// parent's.
pub fn is_forked() -> bool {
    FORKED.load(Ordering::Relaxed)
}

/// Calls that may hold a lock of this library while no board is open.
static BUSY: AtomicUsize = AtomicUsize::new(0);

/// A call that may hold a lock of this library while no board is open. A child that is forked meanwhile has that lock
/// without the thread that would release it: it has no board.
pub struct Busy;

impl Busy {
    /// Before the first lock is taken.
    pub fn begin() -> Self {
        BUSY.fetch_add(1, Ordering::SeqCst);
        Self
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        BUSY.fetch_sub(1, Ordering::SeqCst);
    }
}

/// The process that opened boards; 0: none has.
#[cfg(unix)]
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Has all boards given back when this process exits, after everything the program itself does then: its global objects
/// may still send what brings the machine to rest, and close. Called before each board is opened.
pub fn end_at_exit() {
    #[cfg(unix)]
    OWNER.store(process::id(), Ordering::Relaxed);
    #[cfg(all(unix, not(target_os = "linux")))]
    {
        static ONCE: std::sync::Once = std::sync::Once::new();
        ONCE.call_once(|| watch_forks());
    }
}

/// The functions here run before main, or when the library is loaded.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".init_array")]
static AT_START: extern "C" fn() = watch_forks;

/// The functions here run when exit handlers and the destructors of the program's global objects are done.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".fini_array")]
static AT_EXIT: extern "C" fn() = at_exit;

#[cfg(target_os = "linux")]
extern "C" fn at_exit() {
    // A child of fork has the boards without their threads: they are the parent's to give back.
    if process::id() == OWNER.load(Ordering::Relaxed) && !is_forked() {
        let _ = std::panic::catch_unwind(crate::boards::vanish_all);
    }
}

#[cfg(unix)]
extern "C" fn watch_forks() {
    extern "C" fn in_child() {
        // What was so in the parent stays so in the child's own children.
        if board::any_open() || BUSY.load(Ordering::SeqCst) > 0 {
            FORKED.store(true, Ordering::Relaxed);
        }
    }

    // SAFETY: the function takes and returns nothing, does no more than look at two atomics and set another, and the
    // library stays in memory (`nodelete`). Without room for it nothing is watched.
    unsafe { libc::pthread_atfork(None, None, Some(in_child)) };
}
