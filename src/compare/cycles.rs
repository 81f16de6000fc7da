//! Counts the cycles of a run by its reports: the board makes one in each.

/// A report that comes later than this part of a cycle behind a whole number of cycles is one of the next cycle: a report
/// may be late, and a host may have missed some. \[OURS]
const EARLY_FRACTION: i64 = 4;

/// The cycles of a stretch of OP.
#[derive(Clone, Debug, Default)]
pub(super) struct Cycles {
    /// Cycles so far.
    passed: i64,
    before_ns: Option<i64>,
    /// By how much the report before came later than the cycles that were counted, in nanoseconds; half of it is forgotten with
    /// each report, so that a clock that runs otherwise than the board's adds nothing.
    late_ns: i64,
}

impl Cycles {
    /// Cycles so far.
    pub(super) const fn passed(&self) -> i64 {
        self.passed
    }

    /// A report goes by. Reports that the host has missed are counted with it.
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

    /// Each report is a cycle, however early or late it comes; where some are missing their cycles count.
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
