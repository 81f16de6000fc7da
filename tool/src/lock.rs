//! Locks of the tool's threads.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Waits for a lock, even if another thread has panicked while it held the lock: the state under the tool's locks is
/// valid between any two statements.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
