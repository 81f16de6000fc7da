//! The end of a process that has not closed its boards, and fork.
//!
//! When the process ends the boards' threads are stopped and recordings completed, and a server of a board is told that the
//! program has vanished, whatever the exit code. A child of fork has no threads of its parent, so it cannot use the boards
//! that were open; it lets go of their connections, so that a server notices the end of its parent.

#[cfg(unix)]
use std::process;
#[cfg(unix)]
use std::sync::atomic::AtomicU32;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

#[cfg(unix)]
use crate::board;

/// Set in a child that was forked while a board was open or a call was under way.
static FORKED: AtomicBool = AtomicBool::new(false);

/// Whether this process was forked while a board was open or a call was under way, so that boards and locks belong to its
/// parent.
pub fn is_forked() -> bool {
    FORKED.load(Ordering::Relaxed)
}

/// How many calls are under way that may hold a lock of this library while no board is open.
static CALLS_THAT_MAY_HOLD_LOCK: AtomicUsize = AtomicUsize::new(0);

/// Marks a call that may hold a lock of this library while no board is open. In a child that is forked meanwhile the lock is
/// held and the thread that would release it does not exist, so that child must not use this library.
pub struct MayHoldLock;

impl MayHoldLock {
    /// To be called before the first lock is taken.
    pub fn begin() -> Self {
        CALLS_THAT_MAY_HOLD_LOCK.fetch_add(1, Ordering::SeqCst);
        Self
    }
}

impl Drop for MayHoldLock {
    fn drop(&mut self) {
        CALLS_THAT_MAY_HOLD_LOCK.fetch_sub(1, Ordering::SeqCst);
    }
}

/// The id of the process that opened boards; 0 if none has.
#[cfg(unix)]
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Has all boards released when this process exits, after the exit handlers of the program, whose global objects may still
/// stop the machine and close the board. Called before each board is opened.
pub fn end_at_exit() {
    #[cfg(unix)]
    OWNER.store(process::id(), Ordering::Relaxed);
    #[cfg(all(unix, not(target_os = "linux")))]
    {
        static ONCE: std::sync::Once = std::sync::Once::new();
        ONCE.call_once(|| watch_forks());
    }
}

/// Functions in this section run before main, or when the library is loaded.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".init_array")]
static AT_START: extern "C" fn() = watch_forks;

/// Functions in this section run after the exit handlers and the destructors of the program's global objects.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".fini_array")]
static AT_EXIT: extern "C" fn() = at_exit;

#[cfg(target_os = "linux")]
extern "C" fn at_exit() {
    // A child of fork must not release the boards, which belong to its parent.
    if process::id() == OWNER.load(Ordering::Relaxed) && !is_forked() {
        let _ = std::panic::catch_unwind(crate::exported::boards::vanish_all);
    }
    if !is_forked() {
        let _ = std::panic::catch_unwind(crate::logger::finish);
    }
}

#[cfg(unix)]
extern "C" fn watch_forks() {
    extern "C" fn in_child() {
        // FORKED is never cleared, so that it holds in children of the child too.
        if board::any_open() || CALLS_THAT_MAY_HOLD_LOCK.load(Ordering::SeqCst) > 0 {
            FORKED.store(true, Ordering::Relaxed);
            // SAFETY: this is a child that was just forked, and no call of it reaches a board of its parent from here on.
            unsafe { ecmsk::link::tcp::close_in_child() };
        }
    }

    // SAFETY: the function only reads and sets atomics and closes descriptors, and the library stays in memory (`nodelete`). If the
    // system has no memory for the registration forks are not noticed.
    unsafe { libc::pthread_atfork(None, None, Some(in_child)) };
}
