//! Counts the cycles of a run by the reports of the board, which sends one in each cycle.

/// How early a report may come, as a fraction of a cycle (1/4). A report that comes up to this much before the end of
/// the nth cycle since the previous report counts as the report of the nth cycle: the host missed the reports between.
/// A report that comes earlier counts as a late report of the cycle before. \[OURS]
const EARLY_FRACTION: i64 = 4;

/// Counts the cycles of the board from the moment the network reaches OP until it leaves OP.
#[derive(Clone, Debug, Default)]
pub(super) struct Cycles {
    /// The number of the board's cycles in OP so far.
    passed: i64,
    before_ns: Option<i64>,
    /// How much later the previous report came than the counted cycles say, in nanoseconds. Each report halves the value,
    /// so that the drift between the clocks of host and board does not accumulate.
    late_ns: i64,
}

impl Cycles {
    /// The number of the board's cycles in OP so far.
    pub(super) const fn passed(&self) -> i64 {
        self.passed
    }

    /// Processes a report that was received at `at_ns`: counts the cycles since the previous report, including those whose
    /// reports the host missed.
    pub(super) fn report(&mut self, at_ns: i64, cycle_ns: i64) {
        let cycle_ns = cycle_ns.max(1);
        let Some(before_ns) = self.before_ns.replace(at_ns) else {
            self.passed += 1;
            return;
        };
        let since_ns = at_ns.saturating_sub(before_ns).max(0).saturating_add(self.late_ns);
        let counted = (since_ns.saturating_add(cycle_ns / EARLY_FRACTION) / cycle_ns).max(1);
        self.passed = self.passed.saturating_add(counted);
        self.late_ns = since_ns.saturating_sub(counted.saturating_mul(cycle_ns)).clamp(-cycle_ns, cycle_ns) / 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_NS: i64 = 1_000_000;

    fn passed(times_us: &[i64]) -> i64 {
        let mut cycles = Cycles::default();
        times_us.iter().for_each(|us| cycles.report(us * 1000, CYCLE_NS));
        cycles.passed()
    }

    /// A report counts as one cycle even if it comes up to 0.7 cycles early or late. The cycles of missing reports are
    /// counted as well.
    #[test]
    fn a_report_is_a_cycle_and_missing_ones_count() {
        assert_eq!(passed(&[0, 1000, 2000, 3000]), 4);
        assert_eq!(passed(&[0, 1000, 1300, 3000, 4000]), 5, "one comes early");
        assert_eq!(passed(&[0, 1000, 2650, 3000, 4000]), 5, "one comes late");
        assert_eq!(passed(&[0, 1000, 1320, 2320, 3320]), 5, "the board's clock is set");
        assert_eq!(passed(&[0, 1000, 5000, 6000]), 7, "three are missing");
        let slow: Vec<i64> = (0..10_000).map(|n| n * 1001).collect();
        assert_eq!(passed(&slow), 10_000, "the other clock is another one");
    }
}
