//! Counters of injected faults.

use std::sync::atomic::{AtomicU64, Ordering};

/// The numbers of injected faults in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultCounts {
    /// Number of frames that the link has dropped.
    pub dropped: u64,
    /// Number of frames in which the link has flipped one bit.
    pub corrupted: u64,
    /// Number of frames that the link has passed on twice.
    pub duplicated: u64,
    /// Number of frames that the link has delayed.
    pub delayed: u64,
}

/// The faults that a link has injected since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultStats {
    /// The faults injected into command frames.
    pub write: FaultCounts,
    /// The faults injected into reports.
    pub read: FaultCounts,
    /// Whether a fault has disconnected the board.
    pub disconnected: bool,
}

/// Counters of the calls and faults in one direction.
#[derive(Debug, Default)]
pub(super) struct Counters {
    /// The number of calls in this direction that succeeded.
    pub(super) done: AtomicU64,
    /// The number of calls in this direction that ended with an error.
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
