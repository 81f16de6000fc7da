//! Computes a velocity from positions.

use std::collections::VecDeque;

/// \[OURS] The time over which a velocity is averaged, in nanoseconds. In a single cycle a slow axis moves one count or none,
/// which would make its velocity jump.
const MEAN_OVER_NS: i64 = 5_000_000;

/// The positions of the last [`MEAN_OVER_NS`] with their times, and one older position, from which a mean velocity is computed.
#[derive(Debug, Default)]
pub struct Speed {
    last: VecDeque<(i64, f64)>,
}

impl Speed {
    /// Adds a position. Returns the mean velocity per second, and the middle of the time that it is averaged over.
    pub fn position(&mut self, at_ns: i64, position: f64) -> Option<(i64, f64)> {
        self.last.push_back((at_ns, position));
        // One position older than the averaging time is kept, so that there is a velocity even with slow reports.
        while self.last.get(1).is_some_and(|(then_ns, _)| at_ns.saturating_sub(*then_ns) >= MEAN_OVER_NS) {
            self.last.pop_front();
        }
        let (then_ns, then) = self.last.front().copied()?;
        let passed_ns = at_ns.saturating_sub(then_ns);
        (passed_ns >= MEAN_OVER_NS).then(|| (then_ns + passed_ns / 2, (position - then) * 1e9 / passed_ns as f64))
    }

    /// Forgets all positions, because the next one is unrelated to them.
    pub fn reset(&mut self) {
        self.last.clear();
    }
}
