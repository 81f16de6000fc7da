//! How fast along a path: velocity, acceleration and, if wanted, jerk stay in their limits. One profile for all axes of
//! a move, so that they begin and end together on a straight line. Calculated by `rsruckig`.

use std::time::Duration;

use rsruckig::prelude::{ControlInterface, DataArrayOrVec, InputParameter, Ruckig, ThrowErrorHandler, Trajectory};

/// Along the path; the unit of length is the caller's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Length a second, above 0.
    pub velocity: f64,
    /// Length a second squared, above 0.
    pub acceleration: f64,
    /// Length a second cubed, above 0; `None`: the acceleration may change at once.
    pub jerk: Option<f64>,
}

/// Where on the path, and how fast.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Along {
    pub length: f64,
    pub velocity: f64,
    pub acceleration: f64,
}

/// A way along the path, from time 0 to [`Profile::seconds`].
pub struct Profile {
    trajectory: Trajectory<1>,
    /// Length and seconds of one unit of the calculation: its numbers stay near 1, whatever counts and speeds are.
    scale: (f64, f64),
}

impl Profile {
    /// From rest to rest over `length`, above 0.
    ///
    /// # Errors
    /// Why there is no such way.
    pub fn rest_to_rest(length: f64, limits: Limits) -> Result<Self, String> {
        let seconds = length / limits.velocity + limits.velocity / limits.acceleration;
        let mut input = InputParameter::new(None);
        input.target_position[0] = 1.0;
        Self::calculate(input, limits, (length, seconds))
    }

    /// From a point of another profile to rest, anywhere. Within that time: the limits of the acceleration are raised as
    /// far as that takes.
    ///
    /// # Errors
    /// Why there is no such way.
    pub fn to_rest(from: Along, limits: Limits, within: Duration) -> Result<Self, String> {
        let mut limits = limits;
        loop {
            let seconds = limits.velocity / limits.acceleration;
            let scale = (limits.velocity * seconds, seconds);
            let mut input = InputParameter::new(None);
            input.control_interface = ControlInterface::Velocity;
            input.current_position[0] = from.length / scale.0;
            input.current_velocity[0] = from.velocity * scale.1 / scale.0;
            input.current_acceleration[0] = from.acceleration * scale.1.powi(2) / scale.0;
            let profile = Self::calculate(input, limits, scale)?;
            if profile.seconds() <= within.as_secs_f64() {
                return Ok(profile);
            }
            limits.acceleration *= 2.0;
            limits.jerk = limits.jerk.map(|jerk| jerk * 4.0);
        }
    }

    fn calculate(mut input: InputParameter<1>, limits: Limits, scale: (f64, f64)) -> Result<Self, String> {
        let (length, seconds) = scale;
        input.max_velocity[0] = limits.velocity * seconds / length;
        input.max_acceleration[0] = limits.acceleration * seconds.powi(2) / length;
        input.max_jerk[0] = limits.jerk.map_or(f64::INFINITY, |jerk| jerk * seconds.powi(3) / length);
        let mut trajectory = Trajectory::new(None);
        let calculated = Ruckig::<1, ThrowErrorHandler>::new(None, 1e-3).calculate(&input, &mut trajectory);
        calculated.map_err(|error| error.to_string())?;
        let profile = Self { trajectory, scale };
        let duration = profile.seconds();
        if duration.is_finite() { Ok(profile) } else { Err(format!("it would take {duration} s")) }
    }

    /// How long it takes.
    pub fn seconds(&self) -> f64 {
        self.trajectory.get_duration() * self.scale.1
    }

    /// Where that is at a time; before the beginning and after the end, the first and the last point.
    pub fn at(&self, seconds: f64) -> Along {
        let (length, unit) = self.scale;
        let time = (seconds / unit).clamp(0.0, self.trajectory.get_duration());
        let new = || DataArrayOrVec::new(None, 0.0);
        let (mut position, mut velocity, mut acceleration) = (new(), new(), new());
        let (p, v, a) = (Some(&mut position), Some(&mut velocity), Some(&mut acceleration));
        self.trajectory.at_time(time, &mut p.map(|p| p), &mut v.map(|v| v), &mut a.map(|a| a), &mut None, &mut None);
        Along {
            length: position[0] * length,
            velocity: velocity[0] * length / unit,
            acceleration: acceleration[0] * length / unit.powi(2),
        }
    }
}
