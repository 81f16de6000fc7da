//! The clock by which calls wait. It leaves out the time for which this process stood still: stopped by SIGSTOP, swapped out, on
//! a machine that was suspended. Judged by any other clock a board that answers every cycle has been silent for all that time, and
//! every limit has passed, before a single report could be read.
//!
//! Before a call waits it says for how long at most ([`Patience::expect`]). When much more than that has passed until somebody looks
//! at the clock again, the process stood still, and the clock goes on by half of that wait only: so no single wait makes a board
//! silent that could not be heard, and waits end all the same if the process stands still in each of them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// \[OURS] The longest part of a wait for a report.
pub const WAIT_MAX: Duration = Duration::from_millis(100);
/// \[OURS] By how much a wait may take longer on a busy machine before the process counts as having stood still.
const LATENESS_MAX: Duration = Duration::from_millis(100);
/// \[OURS] By how much the clock goes on at least, however long the process stood still.
const STEP_MIN: Duration = Duration::from_millis(1);

/// The clock. Threads may share it.
pub struct Patience {
    started: Instant,
    /// The clock that is given to [`Patience::at`], when that was called last, ns.
    last_ns: AtomicU64,
    /// How long the next wait may take, ns.
    expected_ns: AtomicU64,
    /// For how long the process stood still, ns.
    stood_ns: AtomicU64,
}

impl Patience {
    pub fn new() -> Self {
        let [last_ns, expected_ns, stood_ns] = [0; 3].map(AtomicU64::new);
        Self { started: Instant::now(), last_ns, expected_ns, stood_ns }
    }

    /// The real time since it was made.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// The next wait may take that long.
    pub fn expect(&self, wait: Duration) {
        let wait_ns = u64::try_from(wait.as_nanos()).unwrap_or(u64::MAX);
        self.expected_ns.fetch_max(wait_ns, Ordering::Relaxed);
    }

    /// The time of this clock when another one, which does not stop, shows `now`.
    pub fn at(&self, now: Duration) -> Duration {
        let now_ns = u64::try_from(now.as_nanos()).unwrap_or(u64::MAX);
        // Of several threads one sees a gap first, and the others none: it is left out once.
        let last_ns = self.last_ns.fetch_max(now_ns, Ordering::AcqRel);
        let expected_ns = self.expected_ns.swap(0, Ordering::Relaxed);
        let passed_ns = now_ns.saturating_sub(last_ns);
        if passed_ns > expected_ns.saturating_add(LATENESS_MAX.as_nanos() as u64) {
            let counted_ns = (expected_ns / 2).max(STEP_MIN.as_nanos() as u64);
            self.stood_ns.fetch_add(passed_ns - counted_ns, Ordering::AcqRel);
        }
        Duration::from_nanos(now_ns.saturating_sub(self.stood_ns.load(Ordering::Acquire)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Waits count, and so does a busy machine; a process that stood still has hardly waited.
    #[test]
    fn what_stood_still_has_hardly_waited() {
        let patience = Patience::new();
        let wait = |asked: u32, until: u32| {
            patience.expect(asked * MS);
            patience.at(until * MS)
        };
        assert_eq!(wait(100, 100), 100 * MS);
        assert_eq!(wait(100, 300), 300 * MS);
        assert_eq!(wait(100, 1500), 350 * MS);
        assert_eq!(wait(100, 1600), 450 * MS);
        assert_eq!(wait(0, 6600), 451 * MS);
    }

    /// A wait of any length counts whole, and what stood still again and again waits all the same.
    #[test]
    fn every_wait_ends() {
        let patience = Patience::new();
        patience.expect(60_000 * MS);
        assert_eq!(patience.at(60_000 * MS), 60_000 * MS);
        for n in 1..=20 {
            patience.expect(100 * MS);
            assert_eq!(patience.at(60_000 * MS + n * 5_000 * MS), 60_000 * MS + n * 50 * MS);
        }
    }
}
