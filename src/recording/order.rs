//! Frames in the order of their times.
//!
//! A recording has them in the order in which the host's calls returned: a report that was read late stands behind
//! commands that were sent after it was made.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Frames that are held back to be sorted: a report waits behind 31 others at most, each with a tight writer's commands
/// of its cycle before it. \[OURS]
const WINDOW: usize = 1024;

/// Sorts frames by their time, as far as they are out of order by less than 1024 frames; those of the same time stay in
/// the order in which they came.
#[derive(Debug)]
pub struct InOrder<T> {
    held: BinaryHeap<Reverse<Entry<T>>>,
    taken: u64,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { held: BinaryHeap::new(), taken: 0 }
    }
}

impl<T> InOrder<T> {
    /// Takes the next frame of the file and its time in nanoseconds; gives the earliest, once enough are held.
    pub fn push(&mut self, at_ns: i64, frame: T) -> Option<T> {
        self.held.push(Reverse(Entry { at_ns, number: self.taken, frame }));
        self.taken += 1;
        if self.held.len() > WINDOW { self.pop() } else { None }
    }

    /// The earliest of those held.
    pub fn pop(&mut self) -> Option<T> {
        self.held.pop().map(|Reverse(entry)| entry.frame)
    }
}

#[derive(Debug)]
struct Entry<T> {
    at_ns: i64,
    number: u64,
    frame: T,
}

impl<T> Entry<T> {
    const fn key(&self) -> (i64, u64) {
        (self.at_ns, self.number)
    }
}

impl<T> PartialEq for Entry<T> {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl<T> Eq for Entry<T> {}

impl<T> PartialOrd for Entry<T> {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for Entry<T> {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}
