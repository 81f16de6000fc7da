//! Determines the velocity from positions.

use std::collections::VecDeque;

/// \[OURS] The velocity is the mean over this time in nanoseconds, because in one cycle a slow axis moves one count
/// or none.
const MEAN_OVER_NS: i64 = 5_000_000;

/// The positions of the last [`MEAN_OVER_NS`].
#[derive(Debug, Default)]
pub struct Speed {
    last: VecDeque<(i64, f64)>,
}

impl Speed {
    /// Adds a position; returns the middle of the time considered and the velocity there, per second.
    pub fn position(&mut self, at_ns: i64, position: f64) -> Option<(i64, f64)> {
        self.last.push_back((at_ns, position));
        // The oldest kept position is at least this old, so that there is a velocity even with slow reports.
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
