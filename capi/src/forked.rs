//! Counts the open boards and the calls under way, to decide in a child of fork whether it may use this library. Such a
//! child has no threads of its parent, so it cannot use boards that were open, and locks that were held are never
//! released in it.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// How many boards are open in this process.
static OPEN: AtomicUsize = AtomicUsize::new(0);

/// Whether any board is open.
pub fn any_open() -> bool {
    OPEN.load(Ordering::Relaxed) > 0
}

/// Counts a board as open. [`OpenBoard`](crate::board::OpenBoard) calls this when it is made.
pub fn note_opened() {
    OPEN.fetch_add(1, Ordering::Relaxed);
}

/// Counts a board as closed. [`OpenBoard`](crate::board::OpenBoard) calls this when it is closed for the first time.
pub fn note_closed() {
    OPEN.fetch_sub(1, Ordering::Relaxed);
}

/// Set in a child that was forked while a board was open or a call was under way: such a child must not use this library.
static FORKED: AtomicBool = AtomicBool::new(false);

/// Whether this process was forked while a board was open or a call was under way, so that boards and locks belong to its
/// parent.
pub fn is_forked() -> bool {
    FORKED.load(Ordering::Relaxed)
}

/// How many calls are under way that may hold a lock of this library. Most calls are counted only while no board is open:
/// an open board alone already forbids a child of fork the use of this library.
static CALLS_THAT_MAY_HOLD_LOCK: AtomicUsize = AtomicUsize::new(0);

/// Marks a call that may hold a lock of this library while no board is open. In a child that is forked meanwhile the lock is
/// held and the thread that would release it does not exist, so that child must not use this library.
pub struct MayHoldLock;

impl MayHoldLock {
    /// Counts the call. It must be counted before it takes its first lock: a child that is forked while the lock is held would
    /// otherwise use this library and wait for the lock forever.
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

/// To be called in a child that was just forked. Returns whether boards and locks belong to its parent. If so,
/// [`is_forked`] returns true from now on, in this process and in its own children.
#[cfg(unix)]
pub fn note_fork() -> bool {
    let is_parents = any_open() || CALLS_THAT_MAY_HOLD_LOCK.load(Ordering::SeqCst) > 0;
    if is_parents {
        FORKED.store(true, Ordering::Relaxed);
    }
    is_parents
}
