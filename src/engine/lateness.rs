//! How late the cycles of a board on the real clock began.

use std::sync::atomic::{AtomicU64, Ordering};

/// The upper bounds, in nanoseconds of machine time, of all but the last of the ranges that [`Lateness::within`] counts. \[OURS]
pub const LATENESS_BOUNDS_NS: [u64; 12] = [
    10_000,
    25_000,
    50_000,
    100_000,
    250_000,
    500_000,
    1_000_000,
    2_500_000,
    5_000_000,
    10_000_000,
    100_000_000,
    1_000_000_000,
];
const RANGES: usize = LATENESS_BOUNDS_NS.len() + 1;

/// The delays with which a runner has begun its cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lateness {
    /// The number of cycles that the runner has run.
    pub cycles: u64,
    /// The longest delay of a cycle after its deadline, nanoseconds of machine time.
    pub worst_ns: u64,
    /// How much board time was skipped because the runner was late, nanoseconds.
    pub skipped_ns: u64,
    /// How often the runner woke up for a cycle with a delay in each range: up to the first of [`LATENESS_BOUNDS_NS`],
    /// from there up to the second, and so on. The last number counts longer delays. Cycles that are caught up on at
    /// once after a late one are not counted.
    pub within: [u64; RANGES],
    /// The sum of the delays that `within` counts, nanoseconds of machine time.
    pub sum_ns: u64,
}

/// The counts of a runner, which other threads read while it runs.
#[derive(Default)]
pub(super) struct LateCounts {
    cycles: AtomicU64,
    worst_ns: AtomicU64,
    within: [AtomicU64; RANGES],
    sum_ns: AtomicU64,
}

impl LateCounts {
    /// Counts the delay of a cycle, nanoseconds of machine time.
    pub(super) fn note(&self, late_ns: u64) {
        self.worst_ns.fetch_max(late_ns, Ordering::Relaxed);
        self.sum_ns.fetch_add(late_ns, Ordering::Relaxed);
        self.within[LATENESS_BOUNDS_NS.partition_point(|bound| *bound < late_ns)].fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn set_cycles(&self, cycles: u64) {
        self.cycles.store(cycles, Ordering::Relaxed);
    }

    /// The counts so far. `skipped_ns`: how much board time was skipped, nanoseconds.
    pub(super) fn read(&self, skipped_ns: u64) -> Lateness {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        Lateness {
            cycles: read(&self.cycles),
            worst_ns: read(&self.worst_ns),
            skipped_ns,
            within: self.within.each_ref().map(read),
            sum_ns: read(&self.sum_ns),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A delay that equals a bound is counted in the range below it, the longest ones are counted in the last range.
    #[test]
    fn delays_are_counted_in_ranges() {
        let counts = LateCounts::default();
        let mut expected = Lateness { worst_ns: 1_000_000_001, sum_ns: 2_000_020_002, ..Lateness::default() };
        for (late_ns, range) in [(0, 0), (10_000, 0), (10_001, 1), (1_000_000_000, 11), (1_000_000_001, 12)] {
            counts.note(late_ns);
            expected.within[range] += 1;
        }
        assert_eq!(counts.read(0), expected);
    }
}
