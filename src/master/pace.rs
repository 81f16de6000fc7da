//! A PLL that follows the reference clock, and computes from it the deadline of the next cycle.

use crate::ethercat::Ns;

/// The cycle time, and the phase of cycles to the reference clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    /// The cycle time, ns.
    pub cycle_ns: Ns,
    /// When a frame should pass the slave with the reference clock, as an offset from multiples of the cycle in
    /// reference time, ns.
    pub phase_ns: Ns,
}

/// \[OURS] How much one cycle is shifted at most to reach the phase: 1/50 of a cycle.
const STEP_DIVISOR: i64 = 50;
/// \[OURS] Gains of the PLL: 1/16 of the phase error, and 1/512 of it for the frequency.
const TIME_GAIN: i64 = 16;
const SPEED_GAIN: i64 = 512;
/// \[OURS] A phase error above this, ns, means that the reference clock was stepped: the PLL locks anew.
const JUMP_NS: i64 = 1_000_000;
/// [`Pacer::speed`] counts in this fraction of a nanosecond, 2^-20 ns, per cycle.
const SPEED_UNIT: i64 = 1 << 20;

/// A PLL that follows the reference clock.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pacer {
    /// How much the reference clock was ahead of the master's clock when the newest frame was sent, ns; `None`: not
    /// locked yet.
    ahead: Option<i64>,
    /// The fraction of `ahead` below a nanosecond, in 1/[`SPEED_UNIT`] ns.
    fraction: i64,
    /// The difference in frequency between the two clocks: how much `ahead` grows in each cycle, in 1/[`SPEED_UNIT`]
    /// ns.
    speed: i64,
    /// The deadline that was returned last: that of the cycle after the newest measured one.
    planned: Option<Ns>,
}

impl Pacer {
    /// Takes the measurement of a cycle: it was sent at `sent_at`, and the reference clock read `reference` then.
    /// Returns the deadline of the next cycle.
    pub(super) fn next(&mut self, pace: Pace, sent_at: Ns, reference: u64) -> Option<Ns> {
        let cycle = i64::try_from(pace.cycle_ns).ok().filter(|cycle| *cycle > 0)?;
        let seen = reference.wrapping_sub(sent_at).cast_signed();
        let whole = self.fraction.saturating_add(self.speed);
        let expected = self.ahead.map(|ahead| ahead.wrapping_add(whole.div_euclid(SPEED_UNIT)));
        self.fraction = whole.rem_euclid(SPEED_UNIT);
        let ahead = match expected {
            Some(expected) if seen.wrapping_sub(expected).unsigned_abs() <= JUMP_NS.unsigned_abs() => {
                let error = seen.wrapping_sub(expected);
                self.speed = self.speed.saturating_add(error * (SPEED_UNIT / SPEED_GAIN));
                let part = self.fraction + error * (SPEED_UNIT / TIME_GAIN);
                self.fraction = part.rem_euclid(SPEED_UNIT);
                expected.wrapping_add(part.div_euclid(SPEED_UNIT))
            }
            _ => {
                (self.fraction, self.speed) = (0, 0);
                seen
            }
        };
        self.ahead = Some(ahead);
        // If the cycle was sent up to half a cycle late or early, the next deadline follows from the planned one, so
        // that a delay does not shift all later cycles. Otherwise it follows from the time at which the cycle was sent.
        let is_near = |planned: &Ns| planned.abs_diff(sent_at) < pace.cycle_ns / 2;
        let base = self.planned.filter(is_near).unwrap_or(sent_at).saturating_add(pace.cycle_ns);
        let then = ahead.wrapping_add(self.speed / SPEED_UNIT);
        let phase = base.wrapping_add_signed(then).wrapping_sub(pace.phase_ns) % pace.cycle_ns;
        let late = phase.cast_signed();
        let late = if late > cycle / 2 { late - cycle } else { late };
        let most = (cycle / STEP_DIVISOR).max(1);
        let next = base.saturating_add_signed(-late.clamp(-most, most));
        self.planned = Some(next);
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cycles keep in phase with a clock that is faster or slower, whatever phase they begin with. A late cycle
    /// disturbs that only briefly.
    #[test]
    fn cycles_keep_step_with_a_clock_that_drifts() {
        for (drift_ppb, phase_ns, begin) in [(100_000, 0, 0), (-100_000, 300_000, 777_777), (0, 999_999, 500_000)] {
            let pace = Pace { cycle_ns: 1_000_000, phase_ns };
            let (mut pacer, mut at) = (Pacer::default(), 5_000_000_000 + begin);
            for turn in 0..5_000u64 {
                let late = if turn % 7 == 0 { 40_000 } else { 0 };
                let sent = at + late;
                let drifted = |at: u64| at.wrapping_add_signed(at as i64 / 1_000 * drift_ppb / 1_000_000);
                let reference = 123_456_789 + drifted(sent);
                at = pacer.next(pace, sent, reference).expect("a time");
                assert!((sent + 900_000..sent + 1_100_000).contains(&at));
                if turn > 2_000 {
                    let met = 123_456_789 + drifted(at);
                    let error = (met + 500_000 - phase_ns) % 1_000_000;
                    assert!(error.abs_diff(500_000) < 20, "{drift_ppb} {turn}: {error}");
                }
            }
        }
    }

    /// A stepped clock, and times at the limits of their type, cause no panic.
    #[test]
    fn any_times_do_no_harm() {
        let mut pacer = Pacer::default();
        for reference in [0, u64::MAX, 1 << 63, 5, u64::MAX / 3] {
            for sent_at in [0, 1, u64::MAX / 2, u64::MAX] {
                for cycle_ns in [0, 1, 3, 1_000_000, u64::MAX] {
                    pacer.next(Pace { cycle_ns, phase_ns: u64::MAX }, sent_at, reference);
                }
            }
        }
    }
}
