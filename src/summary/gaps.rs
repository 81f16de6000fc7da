//! Finds gaps in a motion: the FIFO ran empty while an axis was moving, and the board repeated the last target until
//! the program sent the next one (SK-5), so that the axis stopped or jerked.
//!
//! An empty FIFO at the end of a motion is no gap. It is a gap if the motion goes on: the steps between the targets before and
//! after it have the same direction, and each is at least 1/10 of the longest step.

/// \[OURS] A pause that is longer than this, in nanoseconds, is intended by the program and no gap.
const GAP_MAX_NS: i64 = 1_000_000_000;
/// \[OURS] A step between targets that is shorter than 1/10 of the longest step belongs to the beginning or the end of a
/// motion. No gap is counted there, because a program may pause there.
const SLOW_FRACTION: i64 = 10;

/// Finds the gaps in the motion of one axis, from its target positions as they are executed.
#[derive(Debug, Default)]
pub struct GapFinder {
    /// The last executed target, in counts; `None` before the first one.
    target: Option<i32>,
    /// The last two steps between targets, in counts.
    steps: [i64; 2],
    /// The longest step of the axis so far, in counts. Steps shorter than 1/10 of it belong to the beginning or the end of a
    /// motion. It is kept when a motion ends, so that the slow first steps of the next one are recognized.
    longest_step: i64,
    /// The time at which the FIFO was first found empty after the last target, ns.
    idle_since_ns: Option<i64>,
}

impl GapFinder {
    /// Notes that a cycle found the FIFO empty at `at_ns`.
    pub const fn idle(&mut self, at_ns: i64) {
        if self.idle_since_ns.is_none() {
            self.idle_since_ns = Some(at_ns);
        }
    }

    /// Notes a target that was executed at `at_ns`. If it ends a gap, returns the time at which the gap began, ns on the same
    /// clock.
    pub fn target(&mut self, at_ns: i64, target: i32) -> Option<i64> {
        let idle_since_ns = self.idle_since_ns.take();
        let before = self.target.replace(target)?;
        // On an axis that turns without end the position wraps around.
        let step = i64::from(target.wrapping_sub(before));
        let steps = [self.steps[0], self.steps[1], step];
        self.longest_step = self.longest_step.max(step.abs());
        let moves = |step: &i64| {
            step.signum() == steps[2].signum() && step.abs() * SLOW_FRACTION >= self.longest_step && *step != 0
        };
        let gap =
            idle_since_ns.filter(|since_ns| steps.iter().all(moves) && at_ns.saturating_sub(*since_ns) <= GAP_MAX_NS);
        self.steps = [steps[1], steps[2]];
        gap
    }

    /// Forgets the last target, because another command or a change of the AL state has ended the motion. The next
    /// target then begins a new motion.
    pub fn reset(&mut self) {
        *self = Self { longest_step: self.longest_step, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Executes one target per millisecond, and lets the FIFO be empty for `idle_ms` before target number `at`. Returns
    /// the gaps found.
    fn gaps(targets: &[i32], at: usize, idle_ms: i64) -> Vec<(i64, i64)> {
        let (mut gaps, mut now_ns, mut found) = (GapFinder::default(), 0, Vec::new());
        for (i, target) in targets.iter().enumerate() {
            if i == at {
                gaps.idle(now_ns);
                gaps.idle(now_ns + MS / 2);
                now_ns += idle_ms * MS;
            }
            found.extend(gaps.target(now_ns, *target).map(|since_ns| (since_ns, now_ns)));
            now_ns += MS;
        }
        found
    }

    /// A pause within a motion is a gap, in either direction of motion. It lasts from the first cycle with an empty
    /// FIFO to the next target.
    #[test]
    fn on_the_way() {
        let targets: Vec<i32> = (0..100).map(|i| 10 * i).collect();
        assert_eq!(gaps(&targets, 50, 7), [(50 * MS, 57 * MS)]);
        let back: Vec<i32> = targets.iter().rev().copied().collect();
        assert_eq!(gaps(&back, 50, 7), [(50 * MS, 57 * MS)]);
        assert_eq!(gaps(&targets, 100, 7), []);
    }

    /// A gap is also found where the 32-bit positions wrap around.
    #[test]
    fn past_the_largest_position() {
        let targets: Vec<i32> = (0..100).map(|i| (i32::MAX - 495).wrapping_add(10 * i)).collect();
        assert_eq!(gaps(&targets, 50, 7), [(50 * MS, 57 * MS)]);
        assert_eq!(gaps(&targets, 70, 7), [(70 * MS, 77 * MS)]);
    }

    /// An empty FIFO is no gap if the axis is at rest, reverses, is starting or has slowly reached its end. A long
    /// pause is no gap either.
    #[test]
    fn between_motions() {
        let turns: Vec<i32> = (0..50).map(|i| 10 * i).chain((0..50).map(|i| 490 - 10 * i)).collect();
        assert_eq!(gaps(&turns, 50, 7), []);
        let stands: Vec<i32> = (0..50).map(|i| 10 * i).chain([490; 3]).chain((50..90).map(|i| 10 * i)).collect();
        assert_eq!(gaps(&stands, 52, 7), []);
        let ramp = |from: i32| (0..=100).map(move |i: i32| from + i * i * (300 - 2 * i) / 1000);
        let ramps: Vec<i32> = ramp(0).chain(ramp(1000).skip(1)).collect();
        assert_eq!(gaps(&ramps, 101, 300), []);
        let targets: Vec<i32> = (0..100).map(|i| 10 * i).collect();
        assert_eq!(gaps(&targets, 50, 5000), []);
        assert_eq!(gaps(&[1000, 3000, 5000], 1, 200), [], "targets by the way, one at a time");
    }
}
