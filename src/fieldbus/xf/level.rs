//! An estimate of the number of sets of outputs in the chip.
//!
//! The [`Ledger`](super::ledger::Ledger) shows which sets were sent, but some cycles late: too late to decide how many
//! sets to write next. If the bus kept eight sets in the chip by the count of the ledger, nearly all eight could
//! already be sent. So the estimate keeps the time at which the RxFIFO runs empty, at one set per cycle. Each header
//! corrects this time, because the clocks of the chip and of the wires differ.

use crate::ethercat::Ns;

/// The maximum age of the fill level in an answer header, in cycles: the time of three exchanges of two packets each is
/// not longer. \[OURS]
const OLD: u64 = 4;

/// An estimate of the fill level of the chip's RxFIFO.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FillLevel {
    /// The estimated time at which the RxFIFO runs empty, on the clock of the wires to the chip.
    empty_at: Ns,
}

impl FillLevel {
    /// Called when the RxFIFO is empty: sets the estimate to 0.
    pub(super) const fn clear(&mut self) {
        self.empty_at = 0;
    }

    /// Records that `sets` sets of outputs were written into the RxFIFO.
    pub(super) fn wrote(&mut self, now: Ns, sets: u64, cycle_ns: Ns) {
        self.empty_at = self.empty_at.max(now).saturating_add(sets * cycle_ns);
    }

    /// Corrects the estimate by the fill level in a header, in which the newest `unseen` sets of outputs may be
    /// missing. The estimate changes only if it is below the lowest possible level or above the highest one.
    pub(super) fn header(&mut self, now: Ns, level: u8, unseen: u64, cycle_ns: Ns) {
        let level = u64::from(level);
        let least = now.saturating_add(level.saturating_sub(OLD) * cycle_ns);
        let most = now.saturating_add((level + unseen) * cycle_ns);
        self.empty_at = self.empty_at.clamp(least, most);
    }

    /// The estimated number of sets of outputs in the RxFIFO at the time `now`.
    pub(super) const fn sets(&self, now: Ns, cycle_ns: Ns) -> u64 {
        self.empty_at.saturating_sub(now).div_ceil(cycle_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE: Ns = 1_000_000;

    /// XF-19.6 Without a header a set of outputs leaves in each cycle; an empty RxFIFO stays empty.
    #[test]
    fn a_set_leaves_in_each_cycle() {
        let mut level = FillLevel::default();
        level.wrote(10 * CYCLE, 3, CYCLE);
        assert_eq!([10, 11, 12, 13, 50].map(|at| level.sets(at * CYCLE, CYCLE)), [3, 2, 1, 0, 0]);
        level.wrote(50 * CYCLE, 1, CYCLE);
        assert_eq!(level.sets(50 * CYCLE, CYCLE), 1);
    }

    /// XF-19.6 Headers keep the estimate near the chip's own count, whichever clock is faster.
    #[test]
    fn headers_set_it_right() {
        let mut level = FillLevel::default();
        level.wrote(0, 8, CYCLE);
        level.header(20 * CYCLE, 8, 0, CYCLE);
        assert_eq!(level.sets(20 * CYCLE, CYCLE), 4, "the chip is slow: at least what the oldest header leaves");
        level.wrote(20 * CYCLE, 30, CYCLE);
        level.header(21 * CYCLE, 2, 1, CYCLE);
        assert_eq!(level.sets(21 * CYCLE, CYCLE), 3, "the chip is fast: at most what it has and may have got since");
    }
}
