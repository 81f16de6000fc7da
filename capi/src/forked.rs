//! What a child of fork must not use: whether boards are open, and whether calls are under way. Such a child has no threads of its
//! parent, so it cannot use the boards that were open, and locks that were held then stay held.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// How many boards are open in this process.
static OPEN: AtomicUsize = AtomicUsize::new(0);

/// Whether any board is open.
pub fn any_open() -> bool {
    OPEN.load(Ordering::Relaxed) > 0
}

/// To be called when a board was opened.
pub fn note_opened() {
    OPEN.fetch_add(1, Ordering::Relaxed);
}

/// To be called when a board was closed.
pub fn note_closed() {
    OPEN.fetch_sub(1, Ordering::Relaxed);
}

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

/// For a child that was just forked: notes whether boards and locks belong to its parent, and returns that. It is never
/// forgotten, so that it holds in children of the child too.
#[cfg(unix)]
pub fn note_fork() -> bool {
    let is_parents = any_open() || CALLS_THAT_MAY_HOLD_LOCK.load(Ordering::SeqCst) > 0;
    if is_parents {
        FORKED.store(true, Ordering::Relaxed);
    }
    is_parents
}
