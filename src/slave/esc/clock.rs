//! The clock of a controller: local time, which drifts and is slewed, and system time, which is distributed.

use crate::ethercat::Ns;
use crate::ethercat::registers::SystemTimeDifference;

/// \[OURS] The most by which one received system time corrects the local time, ns. A master that writes 0 at its start makes
/// a clock jump by no more than that.
pub const SLEW_MAX_NS: i64 = 1_000;
/// \[OURS] How much faster or slower a clock runs while it is corrected: one part of this many.
const SLEW_DIVISOR: u64 = 100;
/// The value of the speed counter start at power-on.
pub(super) const SPEED_START: u16 = 0x1000;
/// The filter depths at power-on.
pub(super) const FILTERS: [u8; 2] = [0x04, 0x0C];

/// The clock.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    /// The time of the network at which the clock was looked at last, ns.
    now: Ns,
    /// The local time then, ns.
    local: u64,
    drift_ppb: i32,
    /// What of the drift is less than a nanosecond, in 1e-9 ns.
    remainder: i64,
    /// What is left to correct, ns.
    correction: i64,
    /// System time is local time plus this.
    pub(super) offset: u64,
    /// The delay from the reference clock to this one, ns.
    pub(super) delay: u32,
    /// The mean difference to the received times, ns.
    difference: i64,
}

impl Clock {
    pub(super) const fn new(now: Ns, local: u64, drift_ppb: i32) -> Self {
        Self { now, local, drift_ppb, remainder: 0, correction: 0, offset: 0, delay: 0, difference: 0 }
    }

    /// Time passes up to `now`.
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

    /// The part of [`Self::advance`] in which a clock differs from the time of the network.
    fn drift(&mut self, passed: Ns) {
        if self.drift_ppb != 0 {
            let drifted = i128::from(passed) * i128::from(self.drift_ppb) + i128::from(self.remainder);
            // Numbers of 64 bits are divided much faster.
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

    /// The time of the network before which the clock does not go on by that many ns, however it is corrected.
    pub(super) fn soonest(&self, ns: u64) -> Ns {
        let drift = u128::from(ns) * u128::from(self.drift_ppb.max(0).unsigned_abs()) / 1_000_000_000;
        let at_its_own = ns.saturating_sub(u64::try_from(drift).unwrap_or(u64::MAX));
        self.now.saturating_add(at_its_own - at_its_own / SLEW_DIVISOR)
    }

    /// The local time, ns.
    pub(super) const fn local(&self) -> u64 {
        self.local
    }

    /// The local time at another time of the network nearby, ns.
    pub(super) fn local_at(&self, at: Ns) -> u64 {
        let ahead = i128::from(at) - i128::from(self.now);
        let drift = (ahead * i128::from(self.drift_ppb)).div_euclid(1_000_000_000);
        self.local.wrapping_add_signed((ahead + drift) as i64)
    }

    /// The system time as the slave's own controller reads it, ns.
    pub(super) const fn system(&self) -> u64 {
        self.local.wrapping_add(self.offset)
    }

    /// The system time at another time of the network nearby, ns.
    pub(super) fn system_at(&self, at: Ns) -> u64 {
        self.local_at(at).wrapping_add(self.offset)
    }

    /// The system time as the network reads it: less the delay from the reference, ns.
    pub(super) const fn system_for_network(&self) -> u64 {
        self.system().wrapping_sub(self.delay as u64)
    }

    /// A system time was received: its lower 32 bits. `depth`: how slowly the mean difference follows.
    pub(super) fn receive(&mut self, received: u32, depth: u8) {
        let ahead = i64::from((self.system_for_network() as u32).wrapping_sub(received).cast_signed());
        self.difference += (ahead - self.difference) >> depth.min(15);
        self.correction = (-ahead).clamp(-SLEW_MAX_NS, SLEW_MAX_NS);
    }

    /// The filters begin anew.
    pub(super) const fn reset_filters(&mut self) {
        self.difference = 0;
    }

    /// Register 0x092C.
    pub(super) const fn shown_difference(&self) -> SystemTimeDifference {
        SystemTimeDifference::of(self.difference)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever a clock drifts by and is corrected by meanwhile, it does not go on by so much sooner.
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
