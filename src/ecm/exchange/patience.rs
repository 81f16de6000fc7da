//! The clock of timeouts, which leaves out stalls of this process: SIGSTOP, swapping, a suspended machine. With an
//! ordinary clock all timeouts would have passed at the end of a stall, before the process could read a single report,
//! although the board has made one in every cycle.
//!
//! Before each wait a call announces its longest duration ([`Patience::expect`]). If much more time has passed when the
//! clock is read next, the process has stalled, and the clock advances by only half of the announced wait. So a stall
//! does not use up a timeout, and timeouts still pass if the process stalls in every wait.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// \[OURS] The longest single wait for a report. A call that may wait longer waits several times.
pub const WAIT_MAX: Duration = Duration::from_millis(100);
/// \[OURS] How much longer than announced a wait may take on a busy machine before it counts as a stall.
const LATENESS_MAX: Duration = Duration::from_millis(100);
/// \[OURS] The least advance of the clock after a stall, even if no wait was announced, so that timeouts pass in the end.
const STEP_MIN: Duration = Duration::from_millis(1);

/// The clock of timeouts, which leaves out stalls of this process. Threads may share it.
pub struct Patience {
    started: Instant,
    /// The newest time of the underlying clock that [`Patience::at`] got, ns.
    last_ns: AtomicU64,
    /// The longest duration that threads have announced for their next waits ([`Patience::expect`]), ns.
    expected_ns: AtomicU64,
    /// The sum of all stalls so far, ns.
    stood_ns: AtomicU64,
}

impl Patience {
    pub fn new() -> Self {
        let [last_ns, expected_ns, stood_ns] = [0; 3].map(AtomicU64::new);
        Self { started: Instant::now(), last_ns, expected_ns, stood_ns }
    }

    /// The real time since this clock was made, including stalls. The time of the clock without them is [`Patience::at`].
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Announces that the caller will now wait for at most `wait`. If much more time has passed at the next reading of
    /// the clock, this counts as a stall.
    pub fn expect(&self, wait: Duration) {
        let wait_ns = u64::try_from(wait.as_nanos()).unwrap_or(u64::MAX);
        self.expected_ns.fetch_max(wait_ns, Ordering::Relaxed);
    }

    /// The time of this clock when the underlying clock, which includes stalls, shows `now`.
    pub fn at(&self, now: Duration) -> Duration {
        let now_ns = u64::try_from(now.as_nanos()).unwrap_or(u64::MAX);
        // If several threads read the clock after a stall, only the first of them sees the gap since the last reading. So
        // the stall is subtracted once, as it has to be.
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

/// How long one call has waited by the clock of timeouts. While the thread of the call gets no processor or no lock,
/// other threads may move a virtual clock on by seconds. So the time between two readings counts as at most [`WAIT_MAX`],
/// [`LATENESS_MAX`] and one cycle together, and the call looks at many reports before it times out.
pub struct Waited {
    last: Duration,
    total: Duration,
}

impl Waited {
    /// A call that begins at the time `now` and has not waited yet.
    pub const fn since(now: Duration) -> Self {
        Self { last: now, total: Duration::ZERO }
    }

    /// How long the call has waited until `now`. `cycle`: the cycle of the board, which a wait for a report may take in
    /// addition.
    pub fn until(&mut self, now: Duration, cycle: Duration) -> Duration {
        self.total += now.saturating_sub(self.last).min(WAIT_MAX + LATENESS_MAX + cycle);
        self.last = now;
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Waits count in full, also if a busy machine prolongs them by up to 200 ms. A stall counts as half of the announced
    /// wait, or 1 ms without one.
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

    /// A thread that gets no lock while others move a virtual clock on by seconds does not time out when it reads the
    /// clock again.
    #[test]
    fn a_thread_without_a_turn_has_hardly_waited() {
        let mut waited = Waited::since(1000 * MS);
        assert_eq!(waited.until(1100 * MS, MS), 100 * MS);
        assert_eq!(waited.until(6100 * MS, MS), 301 * MS);
        assert_eq!(waited.until(6200 * MS, MS), 401 * MS);
        assert_eq!(Waited::since(MS).until(1001 * MS, 512 * MS), 712 * MS);
    }

    /// An announced wait of any length counts in full, and timeouts pass even if the process stalls again and again.
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
