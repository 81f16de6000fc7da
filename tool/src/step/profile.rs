//! The motion profile along a path, with limited velocity, acceleration and optionally jerk. All axes of a move share one
//! profile, so that they start and end together on a straight line. The crate `rsruckig` calculates it.

use std::time::Duration;

use rsruckig::prelude::{ControlInterface, DataArrayOrVec, InputParameter, Ruckig, ThrowErrorHandler, Trajectory};

/// The limits along the path, in the caller's unit of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Units of length per second, above 0.
    pub velocity: f64,
    /// Units of length per second squared, above 0.
    pub acceleration: f64,
    /// Units of length per second cubed, above 0; `None`: the jerk is not limited.
    pub jerk: Option<f64>,
}

/// A point of the motion: the distance from the start of the path, with velocity and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathPoint {
    pub length: f64,
    pub velocity: f64,
    pub acceleration: f64,
}

/// A motion along the path, from time 0 to [`Profile::seconds`].
pub struct Profile {
    /// The motion in the units of `scale`; `None` for a standstill.
    trajectory: Option<Trajectory<1>>,
    /// The point of the path where the motion begins, in the caller's unit.
    from: f64,
    scale: Scale,
}

/// The units of length and time for the calculation. `rsruckig` has a relative precision of about 1e-8 and fails with
/// numbers far from 1. So lengths and times are scaled to values near 1.
#[derive(Clone, Copy, Debug)]
struct Scale {
    length: f64,
    seconds: f64,
}

/// \[OURS] The highest limits in scaled units. Higher limits would hardly make the motion faster, and `rsruckig` does
/// not keep them precisely.
const SCALED_MAX: Limits = Limits { velocity: 1e1, acceleration: 1e3, jerk: Some(1e6) };
/// \[OURS] A speed below this fraction of the velocity limit counts as a standstill, so no braking is calculated.
const STANDSTILL: f64 = 1e-9;
/// If braking takes too long, the acceleration limit is doubled, at most this many times. After that, braking fails.
const DOUBLINGS_MAX: usize = 64;

impl Profile {
    /// The motion from rest to rest over `length`, which is above 0 and in the unit of length of `limits`.
    ///
    /// # Errors
    /// `rsruckig` finds no motion within the limits, or its duration is not finite.
    pub fn rest_to_rest(length: f64, limits: Limits) -> Result<Self, String> {
        let Limits { velocity, acceleration, jerk } = limits;
        // The duration of the motion for each limit, if only that limit applied. The longest one is near the real
        // duration.
        let alone =
            [length / velocity, (length / acceleration).sqrt(), jerk.map_or(0.0, |jerk| (length / jerk).cbrt())];
        let scale = Scale { length, seconds: alone.into_iter().fold(0.0, f64::max) };
        let mut input = InputParameter::new(None);
        input.target_position[0] = 1.0;
        Self::calculate(input, limits, 0.0, scale)
    }

    /// The motion that brakes from a point of another profile to rest. The limits determine where it ends. If it would
    /// take longer than `within`, the limits of acceleration and jerk are raised until it does not.
    ///
    /// # Errors
    /// `rsruckig` finds no motion, or the motion takes too long even with the highest acceleration that is tried.
    pub fn to_rest(from: PathPoint, mut limits: Limits, within: Duration) -> Result<Self, String> {
        for _ in 0..DOUBLINGS_MAX {
            let profile = Self::brake(from, limits)?;
            if profile.seconds() <= within.as_secs_f64() {
                return Ok(profile);
            }
            limits.acceleration *= 2.0;
            limits.jerk = limits.jerk.map(|jerk| jerk * 4.0);
        }
        Err(format!("no acceleration brakes {from:?} within {within:?}"))
    }

    fn brake(from: PathPoint, limits: Limits) -> Result<Self, String> {
        let Limits { acceleration, jerk, .. } = limits;
        // While the axis is still accelerating, its speed rises further until the jerk has reduced the acceleration to
        // 0.
        let now = jerk.map_or(0.0, |_| from.acceleration);
        let speed = from.velocity.abs().max(jerk.map_or(0.0, |jerk| now * now / jerk));
        if speed <= limits.velocity * STANDSTILL {
            return Ok(Self { trajectory: None, from: from.length, scale: Scale { length: 1.0, seconds: 1.0 } });
        }
        let alone = [speed / acceleration, jerk.map_or(0.0, |jerk| (speed / jerk).sqrt().max(now.abs() / jerk))];
        let seconds = alone.into_iter().fold(0.0, f64::max);
        let scale = Scale { length: speed * seconds, seconds };
        let mut input = InputParameter::new(None);
        input.control_interface = ControlInterface::Velocity;
        input.current_velocity[0] = from.velocity / speed;
        input.current_acceleration[0] = now * seconds / speed;
        Self::calculate(input, limits, from.length, scale)
    }

    fn calculate(mut input: InputParameter<1>, limits: Limits, from: f64, scale: Scale) -> Result<Self, String> {
        let Scale { length, seconds } = scale;
        input.max_velocity[0] = (limits.velocity * seconds / length).min(SCALED_MAX.velocity);
        input.max_acceleration[0] = (limits.acceleration * seconds.powi(2) / length).min(SCALED_MAX.acceleration);
        let jerk = limits.jerk.map(|jerk| jerk * seconds.powi(3) / length);
        input.max_jerk[0] = jerk.zip(SCALED_MAX.jerk).map_or(f64::INFINITY, |(jerk, most)| jerk.min(most));
        let mut trajectory = Trajectory::new(None);
        let calculated = Ruckig::<1, ThrowErrorHandler>::new(None, 1e-3).calculate(&input, &mut trajectory);
        calculated.map_err(|error| error.to_string().lines().next().unwrap_or_default().to_owned())?;
        let profile = Self { trajectory: Some(trajectory), from, scale };
        let duration = profile.seconds();
        if duration.is_finite() { Ok(profile) } else { Err(format!("it would take {duration} s")) }
    }

    /// The duration in seconds.
    pub fn seconds(&self) -> f64 {
        self.trajectory.as_ref().map_or(0.0, Trajectory::get_duration) * self.scale.seconds
    }

    /// The point at a time. Before the start it is the first point, after the end the last one.
    pub fn at(&self, seconds: f64) -> PathPoint {
        let Some(trajectory) = &self.trajectory else { return PathPoint { length: self.from, ..PathPoint::default() } };
        let time = (seconds / self.scale.seconds).clamp(0.0, trajectory.get_duration());
        let new = || DataArrayOrVec::new(None, 0.0);
        let (mut length, mut velocity, mut acceleration) = (new(), new(), new());
        let (l, v, a) = (&mut Some(&mut length), &mut Some(&mut velocity), &mut Some(&mut acceleration));
        trajectory.at_time(time, l, v, a, &mut None, &mut None);
        PathPoint {
            length: self.from + length[0] * self.scale.length,
            velocity: velocity[0] * self.scale.length / self.scale.seconds,
            acceleration: acceleration[0] * self.scale.length / self.scale.seconds.powi(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Samples a profile, and checks that velocity, acceleration and jerk between samples are within the limits, apart
    /// from rounding errors.
    fn check(profile: &Profile, limits: Limits, from: PathPoint) -> Result<PathPoint, TestCaseError> {
        if profile.seconds() == 0.0 {
            prop_assert!(from.velocity.abs() <= limits.velocity * STANDSTILL);
            return Ok(from);
        }
        let steps = 2000;
        let dt = profile.seconds() / f64::from(steps);
        let mut last = from;
        for step in 1..=steps {
            let now = profile.at(f64::from(step) * dt);
            let close = 1.0 + 1e-6;
            prop_assert!(now.velocity.abs() <= limits.velocity * close, "{now:?} {limits:?}");
            prop_assert!(now.acceleration.abs() <= limits.acceleration * close, "{now:?} {limits:?}");
            let moved = now.length - last.length;
            let bound = limits.velocity * dt * close + limits.velocity * 1e-9;
            prop_assert!(
                moved.abs() <= bound + profile.scale.length * 1e-9 + from.length * 1e-15,
                "{moved} in {dt} s, {limits:?}"
            );
            if let Some(jerk) = limits.jerk {
                let change = (now.acceleration - last.acceleration).abs();
                prop_assert!(
                    change <= jerk * dt * close + limits.acceleration * 1e-6,
                    "{change} in {dt} s, {limits:?}"
                );
            }
            last = now;
        }
        Ok(last)
    }

    fn limits() -> impl Strategy<Value = Limits> {
        // The speeds cover seven decades. The acceleration reaches the speed in 1 ms to 100 s, and the jerk reaches the
        // acceleration in 1 ms to 10 s.
        (0.0..7.0, -3.0..2.0, proptest::option::of(-3.0..1.0)).prop_map(|(v, t, s): (f64, f64, Option<f64>)| {
            let velocity = 10_f64.powf(v);
            let acceleration = velocity / 10_f64.powf(t);
            Limits { velocity, acceleration, jerk: s.map(|s| acceleration / 10_f64.powf(s)) }
        })
    }

    proptest! {
        /// A move keeps its limits and ends at its target, for distances from one count to the whole range of 32 bits.
        #[test]
        fn a_move_keeps_its_limits_and_arrives(length in (0.0..9.63_f64).prop_map(|l| 10_f64.powf(l).round()), limits in limits()) {
            let profile = Profile::rest_to_rest(length, limits).unwrap();
            let end = check(&profile, limits, PathPoint::default())?;
            prop_assert!((end.length - length).abs() < length * 1e-9 + 1e-6, "{end:?}, not {length}");
            prop_assert!(end.velocity.abs() <= limits.velocity * 1e-6);
        }

        /// Braking from any point of a move keeps the limits if there is enough time, and otherwise still ends within
        /// the time limit.
        #[test]
        fn braking_from_any_point_keeps_the_limits_within_any_time(
            length in (0.0..9.63_f64).prop_map(|l| 10_f64.powf(l).round()), limits in limits(), part in 0.0..1.0,
        ) {
            let profile = Profile::rest_to_rest(length, limits).unwrap();
            let from = profile.at(part * profile.seconds());
            let brake = Profile::to_rest(from, limits, Duration::from_secs(1_000_000)).unwrap();
            let end = check(&brake, limits, from)?;
            prop_assert!(end.velocity.abs() <= limits.velocity * 1e-6);
            prop_assert!(end.length <= length * (1.0 + 1e-6) + 1e-6 && end.length >= from.length * (1.0 - 1e-6) - 1e-6);
            let short = Profile::to_rest(from, limits, Duration::from_millis(1500)).unwrap();
            prop_assert!(short.seconds() <= 1.5 && short.at(1.5).velocity.abs() <= limits.velocity * 1e-6);
            prop_assert!((short.at(0.0).velocity - from.velocity).abs() <= limits.velocity * 1e-6);
        }
    }
}
