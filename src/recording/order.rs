//! Sorts frames by time.
//!
//! A recording has its frames in the order in which the host's calls returned. A report that was read late comes after
//! commands that were sent after the board made it.

use std::collections::BTreeMap;

/// The number of frames that are buffered to be sorted: up to 31 reports wait in the host, each with the commands that
/// a fast program writes in its cycle. \[OURS]
const WINDOW: usize = 1024;

/// Sorts frames by time if they are out of order by less than 1024 frames. Frames of the same time keep their order.
#[derive(Debug)]
pub struct InOrder<T> {
    /// The buffered frames by time and number.
    held: BTreeMap<(i64, u64), T>,
    taken: u64,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { held: BTreeMap::new(), taken: 0 }
    }
}

impl<T> InOrder<T> {
    /// Takes the next frame of the file and its time in nanoseconds. Returns the earliest buffered frame, once there
    /// are enough.
    pub fn push(&mut self, at_ns: i64, frame: T) -> Option<T> {
        self.held.insert((at_ns, self.taken), frame);
        self.taken += 1;
        if self.held.len() > WINDOW { self.pop() } else { None }
    }

    /// Removes the earliest buffered frame.
    pub fn pop(&mut self) -> Option<T> {
        self.held.pop_first().map(|(_, frame)| frame)
    }
}
