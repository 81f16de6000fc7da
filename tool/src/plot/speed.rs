//! How fast a position goes, from the positions alone.

use std::collections::VecDeque;

/// \[OURS] The velocity shown is the mean over this time, nanoseconds: from cycle to cycle a slow axis goes one count or none.
const OVER_NS: i64 = 5_000_000;

/// The positions of the last [`OVER_NS`].
#[derive(Debug, Default)]
pub struct Speed {
    last: VecDeque<(i64, f64)>,
}

impl Speed {
    /// The next position; gives the middle of the time looked at and the velocity there, per second.
    pub fn position(&mut self, at_ns: i64, position: f64) -> Option<(i64, f64)> {
        self.last.push_back((at_ns, position));
        // The first that is kept is at least that old, so that slow reports have a velocity, too.
        while self.last.get(1).is_some_and(|(then_ns, _)| at_ns.saturating_sub(*then_ns) >= OVER_NS) {
            self.last.pop_front();
        }
        let (then_ns, then) = self.last.front().copied()?;
        let passed_ns = at_ns.saturating_sub(then_ns);
        (passed_ns >= OVER_NS).then(|| (then_ns + passed_ns / 2, (position - then) * 1e9 / passed_ns as f64))
    }

    /// The next position has nothing to do with those before.
    pub fn reset(&mut self) {
        self.last.clear();
    }
}
