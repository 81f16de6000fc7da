//! Sorts frames by time.
//!
//! The frames of a recording are in the order in which the calls of the host returned. If a report was read late, it
//! comes after commands that were sent after the board had made it.

use std::collections::VecDeque;

/// The number of frames that are buffered to be sorted. While up to 31 reports wait in the host, it goes on writing
/// commands. So there is room for the commands of 31 cycles, some 32 per cycle. \[OURS]
const WINDOW: usize = 1024;

/// Sorts frames by time if they are out of order by less than 1024 frames. Frames of the same time keep their order.
#[derive(Debug)]
pub struct InOrder<T> {
    /// The buffered frames with their times, sorted.
    held: VecDeque<(i64, T)>,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { held: VecDeque::new() }
    }
}

impl<T> InOrder<T> {
    /// Adds the next frame of the file and its time in nanoseconds. Returns the earliest buffered frame once more than
    /// 1024 are buffered. Otherwise returns `None`.
    pub fn push(&mut self, at_ns: i64, frame: T) -> Option<T> {
        // Nearly all frames are in order.
        let place = match self.held.back() {
            Some((latest_ns, _)) if *latest_ns > at_ns => self.held.partition_point(|(held_ns, _)| *held_ns <= at_ns),
            _ => self.held.len(),
        };
        self.held.insert(place, (at_ns, frame));
        if self.held.len() > WINDOW { self.pop() } else { None }
    }

    /// Removes the earliest buffered frame. Call this at the end of the file until the result is `None`.
    pub fn pop(&mut self) -> Option<T> {
        self.held.pop_front().map(|(_, frame)| frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames are sorted if they are out of order by less than 1024 frames. Frames of the same time keep their order.
    #[test]
    fn frames_are_sorted_by_time_and_then_as_they_came() {
        let mut order = InOrder::default();
        let mut sorted = Vec::new();
        // The test data: the times are in reverse order within each block of 16 times, and each time occurs twice.
        let times = (0..5000_i64).map(|n| n / 32 * 16 + 15 - n / 2 % 16);
        for (number, at_ns) in times.enumerate() {
            sorted.extend(order.push(at_ns, (at_ns, number)));
            assert!(order.held.len() <= WINDOW);
        }
        assert_eq!(sorted.len(), 5000 - WINDOW);
        sorted.extend(std::iter::from_fn(|| order.pop()));
        assert_eq!(sorted.len(), 5000);
        assert!(sorted.is_sorted());
    }
}
