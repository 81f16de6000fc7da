//! Frames in the order of their times.
//!
//! A recording has them in the order in which the host's calls returned: a report that was read late stands behind
//! commands that were sent after it was made.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::cli::recording::Framed;

/// Frames that are held back to be sorted: a report waits behind 31 others at most, each with a tight writer's commands
/// of its cycle before it. \[OURS]
const WINDOW: usize = 1024;

/// Sorts frames by their time, as far as they are out of order by less than [`WINDOW`] frames.
#[derive(Default)]
pub struct InOrder {
    held: BinaryHeap<Reverse<Entry>>,
}

impl InOrder {
    /// Takes the next frame of the file; gives the earliest, once enough are held.
    pub fn push(&mut self, framed: Framed) -> Option<Framed> {
        self.held.push(Reverse(Entry(framed)));
        if self.held.len() > WINDOW { self.pop() } else { None }
    }

    /// The earliest of those held.
    pub fn pop(&mut self) -> Option<Framed> {
        self.held.pop().map(|Reverse(Entry(framed))| framed)
    }
}

struct Entry(Framed);

impl Entry {
    /// Frames of the same time stay in the order of the file.
    const fn key(&self) -> (i64, u64) {
        (self.0.time_ns, self.0.number)
    }
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}
