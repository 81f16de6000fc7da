//! Sorts frames by time.
//!
//! A recording has its frames in the order in which the host's calls returned. A report that was read late comes after
//! commands that were sent after the board made it.

use std::collections::VecDeque;

/// The number of frames that are buffered to be sorted: up to 31 reports wait in the host, each with the commands that
/// a fast program writes in its cycle. \[OURS]
const WINDOW: usize = 1024;

/// Sorts frames by time if they are out of order by less than 1024 frames. Frames of the same time keep their order.
#[derive(Debug)]
pub struct InOrder<T> {
    /// The times of the buffered frames, sorted, and the index of each in `held`. Nearly all frames arrive in order, so
    /// inserting is cheap.
    order: VecDeque<(i64, usize)>,
    held: Vec<Option<T>>,
    free: Vec<usize>,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { order: VecDeque::new(), held: Vec::new(), free: Vec::new() }
    }
}

impl<T> InOrder<T> {
    /// Takes the next frame of the file and its time in nanoseconds. Returns the earliest buffered frame, once there
    /// are enough.
    pub fn push(&mut self, at_ns: i64, frame: T) -> Option<T> {
        let place = self.free.pop().unwrap_or(self.held.len());
        match self.held.get_mut(place) {
            Some(free) => *free = Some(frame),
            None => self.held.push(Some(frame)),
        }
        let is_last = self.order.back().is_none_or(|(last_ns, _)| *last_ns <= at_ns);
        let behind = if is_last { self.order.len() } else { self.order.partition_point(|(ns, _)| *ns <= at_ns) };
        self.order.insert(behind, (at_ns, place));
        if self.order.len() > WINDOW { self.pop() } else { None }
    }

    /// Removes the earliest buffered frame.
    pub fn pop(&mut self) -> Option<T> {
        let (_, place) = self.order.pop_front()?;
        self.free.push(place);
        self.held.get_mut(place)?.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames are sorted as far as they are out of order by less than 1024; those of the same time keep their order.
    #[test]
    fn frames_are_sorted_by_time_and_then_as_they_came() {
        let mut order = InOrder::default();
        let mut sorted = Vec::new();
        // Each block of 16 times comes backwards, and each time twice.
        let times = (0..5000_i64).map(|n| n / 32 * 16 + 15 - n / 2 % 16);
        for (number, at_ns) in times.enumerate() {
            sorted.extend(order.push(at_ns, (at_ns, number)));
        }
        assert_eq!(sorted.len(), 5000 - WINDOW);
        sorted.extend(std::iter::from_fn(|| order.pop()));
        assert_eq!(sorted.len(), 5000);
        assert!(sorted.is_sorted() && order.held.len() <= WINDOW + 1);
    }
}
