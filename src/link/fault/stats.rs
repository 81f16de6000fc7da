//! How many faults there were.

use std::sync::atomic::{AtomicU64, Ordering};

/// Faults in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultCounts {
    /// Frames lost on the way.
    pub dropped: u64,
    /// Frames with a bit turned over.
    pub corrupted: u64,
    /// Frames that arrived twice.
    pub duplicated: u64,
    /// Frames that were held up.
    pub delayed: u64,
}

/// Faults of a link since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultStats {
    /// Of command frames.
    pub write: FaultCounts,
    /// Of reports.
    pub read: FaultCounts,
    /// Whether the board was taken away.
    pub disconnected: bool,
}

/// The counters of one direction.
#[derive(Debug, Default)]
pub(super) struct Counters {
    /// Calls that succeeded.
    pub(super) done: AtomicU64,
    /// Calls that ended with an error.
    pub(super) failed: AtomicU64,
    pub(super) dropped: AtomicU64,
    pub(super) corrupted: AtomicU64,
    pub(super) duplicated: AtomicU64,
    pub(super) delayed: AtomicU64,
}

impl Counters {
    pub(super) fn faults(&self) -> FaultCounts {
        FaultCounts {
            dropped: read(&self.dropped),
            corrupted: read(&self.corrupted),
            duplicated: read(&self.duplicated),
            delayed: read(&self.delayed),
        }
    }
}

pub(super) fn read(counter: &AtomicU64) -> u64 {
    counter.load(Ordering::Relaxed)
}

pub(super) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}
