//! The ramps of profile position, profile velocity and halt: a position demand with limited velocity, acceleration and
//! deceleration (0x6086 = 0, linear ramps). Positions are in command units, speeds in command units/s.

use crate::ethercat::Ns;
use crate::slave::axis::rounded;

/// The limits of a motion profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ramps {
    /// The maximum speed, units/s.
    pub(super) velocity: f64,
    /// The rate at which the speed increases, units/s².
    pub(super) acceleration: f64,
    /// The rate at which the speed decreases, units/s².
    pub(super) deceleration: f64,
}

/// The position demand that the profile gives to the motor: `whole` plus `fraction` command units, moving at `velocity`,
/// command units/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Profile {
    whole: i64,
    fraction: f64,
    velocity: f64,
}

impl Profile {
    /// A demand at standstill at a position.
    pub(super) const fn standing_at(position: i64) -> Self {
        Self { whole: position, fraction: 0.0, velocity: 0.0 }
    }

    /// A demand that is at `position` and moves at `velocity`, units/s.
    pub(super) const fn moving_at(position: i64, velocity: f64) -> Self {
        Self { whole: position, fraction: 0.0, velocity }
    }

    /// The position, rounded to the nearest unit.
    pub(super) const fn position(&self) -> i64 {
        self.whole
    }

    /// The velocity, units/s.
    pub(super) const fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Whether the demand is at standstill.
    pub(super) const fn stands(&self) -> bool {
        self.velocity == 0.0
    }

    /// Moves the demand for `ns` towards a target position. Returns true once the demand is at standstill there.
    pub(super) fn run_to(&mut self, target: i64, ramps: &Ramps, ns: Ns) -> bool {
        let seconds = ns as f64 / 1e9;
        let Ramps { velocity, acceleration, deceleration } = *ramps;
        let left = target.wrapping_sub(self.whole) as f64 - self.fraction;
        let least_step = deceleration * seconds;
        if left.abs() <= (least_step * seconds).min(velocity * seconds) && self.velocity.abs() <= least_step {
            *self = Self::standing_at(target);
            return true;
        }
        let towards = if left < 0.0 { -1.0 } else { 1.0 };
        let (way, now) = (left * towards, self.velocity * towards);
        if now < 0.0 {
            // The demand is still moving away from its target, so it first brakes to a standstill.
            self.move_on((now + least_step).min(0.0) * towards, seconds);
            return false;
        }
        // The maximum velocity `to` at the end of this step from which the deceleration d still stops at the target: the
        // solution of to^2 / 2d + (now + to) t / 2 = way, where t is the duration of the step (`seconds`).
        let root = seconds * seconds * 0.25 + 2.0 / deceleration * (way - now * seconds * 0.5);
        let stopping = if root > 0.0 { deceleration * (root.sqrt() - seconds * 0.5) } else { 0.0 };
        let wanted = stopping.clamp(0.0, velocity);
        let to = wanted.min(now + acceleration * seconds).max(now - least_step);
        self.move_on(to * towards, seconds);
        false
    }

    /// Changes the velocity for `ns` towards `wanted`. Returns true once the demand has that velocity.
    pub(super) fn run_at(&mut self, wanted: f64, ramps: &Ramps, ns: Ns) -> bool {
        let seconds = ns as f64 / 1e9;
        let from = self.velocity;
        let shrinks = from != 0.0 && (wanted * from < 0.0 || wanted.abs() < from.abs());
        let most = if shrinks { ramps.deceleration } else { ramps.acceleration } * seconds;
        let bound = if shrinks && wanted * from < 0.0 { 0.0 } else { wanted };
        let to = bound.clamp(from - most, from + most);
        self.move_on(to, seconds);
        to == wanted
    }

    /// Brakes the demand for `ns`. Returns true once it is at standstill.
    pub(super) fn brake(&mut self, deceleration: f64, ns: Ns) -> bool {
        self.run_at(0.0, &Ramps { velocity: 0.0, acceleration: deceleration, deceleration }, ns)
    }

    fn move_on(&mut self, to: f64, seconds: f64) {
        if self.velocity == 0.0 && to == 0.0 {
            // At standstill there is nothing to move. A remainder of exactly half a unit in `fraction` would otherwise be
            // rounded away from 0 in each step, so the position would alternate between two units.
            return;
        }
        self.fraction += (self.velocity + to) * 0.5 * seconds;
        let counts = rounded(self.fraction);
        self.whole = self.whole.wrapping_add(counts);
        self.fraction -= counts as f64;
        self.velocity = to;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    /// DP3CL-6.10 A move takes the time of a trapezoid, never exceeds its speed and its ramps, and ends exactly at the target.
    #[test]
    fn trapezoid() {
        for (way, velocity, acceleration, deceleration) in
            [(100_000, 50_000.0, 1e5, 2e5), (-100_000, 50_000.0, 2e5, 1e5), (300, 1e6, 1e4, 1e4), (1, 10.0, 1e6, 1e6)]
        {
            let ramps = Ramps { velocity, acceleration, deceleration };
            let mut profile = Profile::standing_at(7);
            let (mut ms, mut last) = (0, 0.0);
            while !profile.run_to(7 + way, &ramps, MS) {
                ms += 1;
                let now: f64 = profile.velocity();
                assert!(now.abs() <= velocity + 1e-9, "{now}");
                let change = (now.abs() - f64::abs(last)) * 1000.0;
                assert!(change <= acceleration + 1e-6 && change >= -deceleration - 1e-6, "{change}");
                last = now;
                assert!(ms < 100_000, "it ends");
            }
            let distance = (way as f64).abs();
            let top =
                velocity.min((2.0 * distance * acceleration * deceleration / (acceleration + deceleration)).sqrt());
            let seconds = distance / top + top / 2.0 / acceleration + top / 2.0 / deceleration;
            assert!((f64::from(ms) / 1000.0 - seconds).abs() < 0.006, "{ms} ms for {seconds} s");
            assert_eq!((profile.position(), profile.velocity()), (7 + way, 0.0));
        }
    }

    /// DP3CL-6.11 The speed of a demand increases by the acceleration and decreases by the deceleration. A reversal brakes to
    /// standstill first, then accelerates in the other direction.
    #[test]
    fn velocities() {
        let ramps = Ramps { velocity: 0.0, acceleration: 1000.0, deceleration: 4000.0 };
        let mut profile = Profile::standing_at(0);
        let mut time = |wanted: f64| (1..).find(|_| profile.run_at(wanted, &ramps, MS)).unwrap_or(0);
        assert_eq!(time(100.0), 100);
        assert_eq!(time(20.0), 20);
        assert_eq!(time(-40.0), 5 + 40);
        assert_eq!(time(0.0), 10);
    }
}
