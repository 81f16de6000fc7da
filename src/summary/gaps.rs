//! Gaps in a motion: the FIFO ran empty while an axis was moving, and the board repeated the last target until the program's
//! next one came (SK-5). The axis stood still on the way, or jerked.
//!
//! That a FIFO is empty after a motion is no gap. It is one if the target went on afterwards as it had gone before.

/// \[OURS] A longer pause is the program's own, nanoseconds.
const LONGEST_NS: i64 = 1_000_000_000;
/// \[OURS] Steps from cycle to cycle below this part of the longest are the beginning or the end of a motion, which may wait.
const SLOW: i64 = 10;

/// Follows the target positions of one axis, as they are executed.
#[derive(Debug, Default)]
pub struct Gaps {
    /// The target in force, and the last two steps to it, in counts.
    target: Option<i32>,
    steps: [i64; 2],
    longest: i64,
    /// The first cycle that found the FIFO empty since the last target.
    idle_since_ns: Option<i64>,
}

impl Gaps {
    /// A cycle finds the FIFO empty.
    pub const fn idle(&mut self, at_ns: i64) {
        if self.idle_since_ns.is_none() {
            self.idle_since_ns = Some(at_ns);
        }
    }

    /// A target is executed. Gives the beginning of the gap that ends with it, if there is one.
    pub fn target(&mut self, at_ns: i64, target: i32) -> Option<i64> {
        let idle_since_ns = self.idle_since_ns.take();
        let before = self.target.replace(target)?;
        let step = i64::from(target) - i64::from(before);
        let steps = [self.steps[0], self.steps[1], step];
        self.longest = self.longest.max(step.abs());
        let moves = |step: &i64| step.signum() == steps[2].signum() && step.abs() * SLOW >= self.longest && *step != 0;
        let gap =
            idle_since_ns.filter(|since_ns| steps.iter().all(moves) && at_ns.saturating_sub(*since_ns) <= LONGEST_NS);
        self.steps = [steps[1], steps[2]];
        gap
    }

    /// The targets before are not in force any more.
    pub fn reset(&mut self) {
        *self = Self { longest: self.longest, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Targets one a millisecond, and an empty FIFO of so many milliseconds before the number `at`; gives the gaps found.
    fn gaps(targets: &[i32], at: usize, idle_ms: i64) -> Vec<(i64, i64)> {
        let (mut gaps, mut now_ns, mut found) = (Gaps::default(), 0, Vec::new());
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

    /// A pause on the way is a gap, forwards and backwards, from its first cycle to the next target.
    #[test]
    fn on_the_way() {
        let targets: Vec<i32> = (0..100).map(|i| 10 * i).collect();
        assert_eq!(gaps(&targets, 50, 7), [(50 * MS, 57 * MS)]);
        let back: Vec<i32> = targets.iter().rev().copied().collect();
        assert_eq!(gaps(&back, 50, 7), [(50 * MS, 57 * MS)]);
        assert_eq!(gaps(&targets, 100, 7), []);
    }

    /// A pause where the axis stands, turns, begins, or has come slowly to its end is none; nor is a long one.
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
