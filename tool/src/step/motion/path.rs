//! The straight line from where axes are to where they are to go, and how fast along it.

use ecmsk::ecm::Snapshot;

use super::super::profile::{Limits, Profile};
use super::target::Jerk;

/// \[OURS] Speed if nobody says: slow for every motor (a tenth of a turn a second with a 17-bit encoder is 13107).
pub const VELOCITY: f64 = 10_000.0;
/// \[OURS] The acceleration, if nobody says, reaches the speed in that many seconds.
pub const SPEED_UP: f64 = 0.2;
/// \[OURS] The jerk, if nobody says, reaches the acceleration in that many seconds.
pub const SMOOTH: f64 = 0.1;

/// Limits of one axis, in counts and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speeds {
    pub velocity: f64,
    pub acceleration: f64,
    pub jerk: Option<f64>,
}

impl Speeds {
    /// What is said, else the defaults.
    pub fn of(velocity: Option<f64>, acceleration: Option<f64>, jerk: Option<Jerk>) -> Self {
        let velocity = velocity.unwrap_or(VELOCITY);
        let acceleration = acceleration.unwrap_or(velocity / SPEED_UP);
        let jerk = match jerk {
            None => Some(acceleration / SMOOTH),
            Some(Jerk::Limit(limit)) => Some(limit),
            Some(Jerk::Off) => None,
        };
        Self { velocity, acceleration, jerk }
    }
}

/// From where to where one axis goes, counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPath {
    pub slave: u8,
    pub start: i32,
    pub end: i32,
    pub speeds: Speeds,
}

impl AxisPath {
    /// How far the axis is from its end, counts.
    pub fn off(&self, now: &Snapshot) -> u32 {
        now.position(self.slave).map_or(0, |at| self.end.abs_diff(at))
    }

    fn distance(&self) -> f64 {
        f64::from(self.end) - f64::from(self.start)
    }

    /// Where it is after a part of the way, 0 to 1.
    pub fn at(&self, part: f64) -> i32 {
        // Both ends fit into 32 bits, so what is between them does.
        (f64::from(self.start) + self.distance() * part.clamp(0.0, 1.0)).round() as i32
    }
}

/// The way of all axes.
pub struct Path {
    pub axes: Vec<AxisPath>,
    /// Counts that the axis goes which goes furthest.
    pub length: f64,
    pub limits: Limits,
    /// `None`: no axis has to go anywhere.
    pub profile: Option<Profile>,
}

impl Path {
    /// The limits along the path are those of the axis that they bind most.
    ///
    /// # Errors
    /// Why there is no such way.
    pub fn new(axes: Vec<AxisPath>) -> Result<Self, String> {
        let length = axes.iter().map(|axis| axis.distance().abs()).fold(0.0, f64::max);
        let moving = || axes.iter().filter(|axis| axis.distance() != 0.0);
        let least = |limit: fn(&Speeds) -> f64| {
            moving().map(|axis| limit(&axis.speeds) * length / axis.distance().abs()).fold(f64::INFINITY, f64::min)
        };
        let jerk = least(|speeds| speeds.jerk.unwrap_or(f64::INFINITY));
        let limits = Limits {
            velocity: least(|speeds| speeds.velocity),
            acceleration: least(|speeds| speeds.acceleration),
            jerk: jerk.is_finite().then_some(jerk),
        };
        let profile = if length > 0.0 { Some(Profile::rest_to_rest(length, limits)?) } else { None };
        Ok(Self { axes, length, limits, profile })
    }
}
