//! Frames in the order of their times.
//!
//! A recording has them in the order in which the host's calls returned: a report that was read late stands behind
//! commands that were sent after it was made.

use std::collections::BTreeMap;

/// Frames that are held back to be sorted: a report waits behind 31 others at most, each with a tight writer's commands
/// of its cycle before it. \[OURS]
const WINDOW: usize = 1024;

/// Sorts frames by their time, as far as they are out of order by less than 1024 frames; those of the same time stay in
/// the order in which they came.
#[derive(Debug)]
pub struct InOrder<T> {
    /// By their time and their number.
    held: BTreeMap<(i64, u64), T>,
    taken: u64,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { held: BTreeMap::new(), taken: 0 }
    }
}

impl<T> InOrder<T> {
    /// Takes the next frame of the file and its time in nanoseconds; gives the earliest, once enough are held.
    pub fn push(&mut self, at_ns: i64, frame: T) -> Option<T> {
        self.held.insert((at_ns, self.taken), frame);
        self.taken += 1;
        if self.held.len() > WINDOW { self.pop() } else { None }
    }

    /// The earliest of those held.
    pub fn pop(&mut self) -> Option<T> {
        self.held.pop_first().map(|(_, frame)| frame)
    }
}
