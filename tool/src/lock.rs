//! Locks of the tool's threads.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Waits for a lock. That another thread has panicked with it is ignored: the state under the tool's locks is valid between any
/// two statements.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
