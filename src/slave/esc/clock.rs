//! The clock of a slave controller: the local time, which drifts and is corrected gradually, and the distributed system
//! time.

use crate::ethercat::Ns;
use crate::ethercat::registers::SystemTimeDifference;

/// \[OURS] The maximum correction of the local time by one received system time, ns. So a master that starts and writes a
/// system time of 0 cannot make the clock jump.
pub const SLEW_MAX_NS: i64 = 1_000;
/// \[OURS] The divisor of the rate change during a correction: the clock runs faster or slower by 1/100.
const SLEW_DIVISOR: u64 = 100;
/// The power-on value of the speed counter start register, 0x0930.
pub(super) const SPEED_START: u16 = 0x1000;
/// The power-on values of the filter depth registers, from 0x0934: time difference and speed counter.
pub(super) const FILTERS: [u8; 2] = [0x04, 0x0C];

/// The clock of one slave controller.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    /// The simulated time of the last update, ns: one time for the whole network, which no slave can read.
    now: Ns,
    /// The local time at the last update, ns.
    local: u64,
    drift_ppb: i32,
    /// The accumulated drift below one nanosecond, in 1e-9 ns.
    remainder: i64,
    /// The remaining correction of the local time, ns.
    correction: i64,
    /// The offset of the system time to the local time, ns.
    pub(super) offset: u64,
    /// The propagation delay from the reference clock to this one, ns.
    pub(super) delay: u32,
    /// The filtered difference of this clock to the received system times, ns; positive if this clock is ahead.
    difference: i64,
}

impl Clock {
    pub(super) const fn new(now: Ns, local: u64, drift_ppb: i32) -> Self {
        Self { now, local, drift_ppb, remainder: 0, correction: 0, offset: 0, delay: 0, difference: 0 }
    }

    /// Advances the clock to `now`, the time of the simulated network, which is not the distributed system time.
    #[inline]
    pub(super) fn advance(&mut self, now: Ns) {
        let passed = now.saturating_sub(self.now);
        if passed == 0 {
            return;
        }
        self.now = now;
        self.local = self.local.wrapping_add(passed);
        if self.drift_ppb != 0 || self.correction != 0 {
            self.drift(passed);
        }
    }

    /// Applies drift and correction for a period of simulated time, as part of [`Self::advance`].
    fn drift(&mut self, passed: Ns) {
        if self.drift_ppb != 0 {
            let drifted = i128::from(passed) * i128::from(self.drift_ppb) + i128::from(self.remainder);
            // A 64-bit division is much faster than a 128-bit one, and the product nearly always fits into 64 bits.
            let (drift, remainder) = match i64::try_from(drifted) {
                Ok(drifted) => (drifted.div_euclid(1_000_000_000), drifted.rem_euclid(1_000_000_000)),
                Err(_) => (drifted.div_euclid(1_000_000_000) as i64, drifted.rem_euclid(1_000_000_000) as i64),
            };
            self.remainder = remainder;
            self.local = self.local.wrapping_add_signed(drift);
        }
        if self.correction != 0 {
            let most = i64::try_from(passed / SLEW_DIVISOR).unwrap_or(i64::MAX);
            let corrected = self.correction.clamp(-most, most);
            self.correction -= corrected;
            self.local = self.local.wrapping_add_signed(corrected);
        }
    }

    /// The earliest simulated time at which the clock can have advanced by `ns`, whatever corrections it receives.
    pub(super) fn soonest(&self, ns: u64) -> Ns {
        let drift = u128::from(ns) * u128::from(self.drift_ppb.max(0).unsigned_abs()) / 1_000_000_000;
        let at_its_own = ns.saturating_sub(u64::try_from(drift).unwrap_or(u64::MAX));
        self.now.saturating_add(at_its_own - at_its_own / SLEW_DIVISOR)
    }

    /// The local time at the last update, ns.
    pub(super) const fn local(&self) -> u64 {
        self.local
    }

    /// The local time at the simulated time `at`, ns. A correction between the last update and `at` is not included, so the
    /// result may be off by 1 % of the time between them.
    pub(super) fn local_at(&self, at: Ns) -> u64 {
        let ahead = i128::from(at) - i128::from(self.now);
        let drift = (ahead * i128::from(self.drift_ppb)).div_euclid(1_000_000_000);
        self.local.wrapping_add_signed((ahead + drift) as i64)
    }

    /// The system time as the slave's processor reads it, ns.
    pub(super) const fn system(&self) -> u64 {
        self.local.wrapping_add(self.offset)
    }

    /// The system time at the simulated time `at`, ns. As for [`Self::local_at`], the result may be off by 1 % of the time
    /// since the last update.
    pub(super) fn system_at(&self, at: Ns) -> u64 {
        self.local_at(at).wrapping_add(self.offset)
    }

    /// The system time as the network reads it, ns: without the propagation delay from the reference clock.
    pub(super) const fn system_for_network(&self) -> u64 {
        self.system().wrapping_sub(self.delay as u64)
    }

    /// Compares the clock with the lower 32 bits of a received system time, and begins to correct the local time. The mean
    /// difference is filtered with the gain 1/2^`depth`.
    pub(super) fn receive(&mut self, received: u32, depth: u8) {
        let ahead = i64::from((self.system_for_network() as u32).wrapping_sub(received).cast_signed());
        self.difference += (ahead - self.difference) >> depth.min(15);
        self.correction = (-ahead).clamp(-SLEW_MAX_NS, SLEW_MAX_NS);
    }

    /// Resets the filter of the time difference.
    pub(super) const fn reset_filters(&mut self) {
        self.difference = 0;
    }

    /// The value of register 0x092C, system time difference.
    pub(super) const fn shown_difference(&self) -> SystemTimeDifference {
        SystemTimeDifference::of(self.difference)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The clock does not advance faster than [`Clock::soonest`] predicts, whatever its drift and its corrections.
    #[test]
    fn no_correction_makes_a_clock_faster_than_it_says() {
        let mut dice = oorandom::Rand64::new(13);
        for _ in 0..2_000 {
            let drift_ppb = dice.rand_range(0..2_000_000_000) as i32 - 1_000_000_000;
            let mut clock = Clock::new(dice.rand_range(0..1_000_000), 0, drift_ppb);
            clock.offset = dice.rand_u64();
            let (begin, ns) = (clock.system(), dice.rand_range(1..10_000_000));
            let soonest = clock.soonest(ns);
            while clock.now < soonest {
                let gone = clock.system().wrapping_sub(begin).cast_signed();
                assert!(gone < ns.cast_signed(), "{gone} of {ns} ns are gone at {}, before {soonest}", clock.now);
                clock.receive(dice.rand_u64() as u32, 0);
                clock.advance(clock.now + dice.rand_range(1..1_000_000));
            }
        }
    }
}
