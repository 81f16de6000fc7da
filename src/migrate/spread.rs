//! A distribution of many durations, with median, 99th percentile and maximum, in little memory.

use std::collections::BTreeMap;

use super::Place;

/// The width of the histogram's bins for durations up to [`FINE_MAX_NS`], ns. \[OURS]
const FINE_NS: i64 = 10_000;
/// The longest duration in a bin of the width [`FINE_NS`], ns. Longer durations have bins of the width [`COARSE_NS`].
/// \[OURS]
const FINE_MAX_NS: i64 = 1_000_000_000;
const COARSE_NS: i64 = 100_000_000;

/// A histogram of durations, with the longest duration and the frame at its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Spread {
    counts: BTreeMap<i64, u64>,
    total: u64,
    longest: Option<(i64, Place)>,
}

impl Spread {
    /// Adds a duration in nanoseconds. `ended` is the frame at its end.
    pub fn add(&mut self, ns: i64, ended: Place) {
        let step = if ns <= FINE_MAX_NS { FINE_NS } else { COARSE_NS };
        *self.counts.entry(ns / step * step).or_default() += 1;
        self.total += 1;
        if self.longest.is_none_or(|(longest, _)| ns > longest) {
            self.longest = Some((ns, ended));
        }
    }

    /// The number of durations that were added.
    pub const fn count(&self) -> u64 {
        self.total
    }

    /// The percentile of the durations, in nanoseconds, rounded down: to a multiple of 10 us, or of 100 ms for more
    /// than a second. `None` if there are no durations. `per_cent` is 0 to 100.
    pub fn percentile(&self, per_cent: u64) -> Option<i64> {
        let wanted = (self.total.saturating_mul(per_cent.min(100))).div_ceil(100).max(1);
        let mut passed = 0;
        self.counts.iter().find_map(|(ns, count)| {
            passed += count;
            (passed >= wanted).then_some(*ns)
        })
    }

    /// The longest duration, in nanoseconds; `None` if there are none.
    pub fn longest_ns(&self) -> Option<i64> {
        self.longest.map(|(ns, _)| ns)
    }

    /// The frame at which the longest duration ended; `None` if there are no durations.
    pub fn longest_at(&self) -> Option<Place> {
        self.longest.map(|(_, place)| place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Place = Place { frame: 1, at_ns: 0 };

    /// The percentiles equal those of the sorted list, and the longest duration keeps its frame.
    #[test]
    fn percentiles() {
        let mut spread = Spread::default();
        assert_eq!((spread.percentile(50), spread.longest_ns(), spread.count()), (None, None, 0));
        for n in (1..=100).rev() {
            spread.add(n * 1_000_000, Place { frame: n as u64, at_ns: n });
        }
        assert_eq!(spread.percentile(50), Some(50_000_000));
        assert_eq!(spread.percentile(99), Some(99_000_000));
        assert_eq!(spread.percentile(100), Some(100_000_000));
        assert_eq!(spread.longest_at(), Some(Place { frame: 100, at_ns: 100 }));
        spread.add(5_123_456_789, PLACE);
        assert_eq!((spread.percentile(100), spread.longest_ns()), (Some(5_100_000_000), Some(5_123_456_789)));
    }
}
