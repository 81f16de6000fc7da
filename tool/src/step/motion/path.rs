//! The straight path of all axes of a move, and the limits of its motion.

use ecmsk::ecm::{Scale, Snapshot};

use super::super::profile::{Limits, Profile};
use super::target::Jerk;
use crate::board::{BoardError, Units};

/// \[OURS] The default speed in counts per second, which is slow for every motor: with a 17-bit encoder it is less than
/// a tenth of a turn per second (13107 counts).
pub const DEFAULT_VELOCITY: f64 = 10_000.0;
/// \[OURS] The default acceleration is such that an axis reaches its velocity limit in this many seconds.
pub const DEFAULT_ACCELERATION_TIME_S: f64 = 0.2;
/// \[OURS] The default jerk is such that an axis reaches its acceleration limit in this many seconds.
pub const DEFAULT_JERK_TIME_S: f64 = 0.1;

/// The limits of one axis, in counts and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speeds {
    pub velocity: f64,
    pub acceleration: f64,
    pub jerk: Option<f64>,
}

/// A limit for the velocity or the acceleration: the value of the option, and the highest value that the machine file
/// allows. Each is `None` if there is no such value.
type Asked = (Option<f64>, Option<f64>);

impl Speeds {
    /// Makes the limits. A missing option gets its default value, which is reduced to the limit of the machine file if
    /// it is above it.
    pub fn of(velocity: Asked, acceleration: Asked, jerk: Option<Jerk>) -> Self {
        let or = |(asked, max): Asked, default: f64| asked.unwrap_or(max.map_or(default, |max| default.min(max)));
        let velocity = or(velocity, DEFAULT_VELOCITY);
        let acceleration = or(acceleration, velocity / DEFAULT_ACCELERATION_TIME_S);
        let jerk = match jerk {
            None => Some(acceleration / DEFAULT_JERK_TIME_S),
            Some(Jerk::Limit(limit)) => Some(limit),
            Some(Jerk::Off) => None,
        };
        Self { velocity, acceleration, jerk }
    }
}

/// The speed options of a verb, in the unit of an axis; `None` for an option that was not given.
#[derive(Clone, Copy, Debug, Default)]
pub struct AskedSpeeds {
    pub velocity: Option<f64>,
    pub acceleration: Option<f64>,
    pub jerk: Option<Jerk>,
}

impl AskedSpeeds {
    /// The velocity, acceleration and jerk limits of an axis, in counts and seconds.
    ///
    /// # Errors
    /// An option is above the limit of the axis in the machine file.
    pub fn of_axis(self, what: &str, slave: u8, scale: Scale, units: Units<'_>) -> Result<Speeds, BoardError> {
        let counts = scale.counts_per_unit.abs();
        let axis = units.axis(slave);
        let limit = |asked: Option<f64>, max: Option<f64>, word: &str, per: &str| {
            let asked = asked.map(|units| units * counts);
            let Some((axis, max)) = axis.zip(max) else { return Ok((asked, None)) };
            let max_counts = max * axis.scale.counts_per_unit.abs();
            // An option equal to the limit of the machine file may exceed it by a rounding error, if the two have
            // different units. This is allowed.
            if asked.is_none_or(|asked| asked <= max_counts * (1.0 + f64::EPSILON)) {
                return Ok((asked, Some(max_counts)));
            }
            let why =
                format!("--{word} is beyond the limit of axis {}, max_{word} = {max} {}{per}", axis.name, axis.unit);
            let next = "name a lower one, or correct the limit in the machine file".into();
            Err(BoardError::Refused { what: what.into(), why, next })
        };
        let velocity = limit(self.velocity, axis.and_then(|axis| axis.max_velocity), "velocity", "/s")?;
        let acceleration =
            limit(self.acceleration, axis.and_then(|axis| axis.max_acceleration), "acceleration", "/s^2")?;
        Ok(Speeds::of(velocity, acceleration, self.jerk.map(|jerk| jerk.scaled(counts))))
    }
}

/// The straight path of one axis from start to end, in counts, with its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPath {
    pub slave: u8,
    pub start: i32,
    pub end: i32,
    pub speeds: Speeds,
}

impl AxisPath {
    /// The distance of the axis from its end position, in counts; 0 if the report `now` has no position of the axis.
    pub fn off(&self, now: &Snapshot) -> u32 {
        now.position(self.slave).map_or(0, |at| self.end.abs_diff(at))
    }

    fn distance(&self) -> f64 {
        f64::from(self.end) - f64::from(self.start)
    }

    /// The position at the fraction `part` of the path, 0 to 1.
    pub fn at(&self, part: f64) -> i32 {
        // Both ends fit into 32 bits, and so do all positions between them.
        (f64::from(self.start) + self.distance() * part.clamp(0.0, 1.0)).round() as i32
    }
}

/// The path of all axes of a move. All axes follow the same motion profile, each scaled to its own distance.
pub struct Path {
    pub axes: Vec<AxisPath>,
    /// The distance of the axis that moves furthest, in counts.
    pub length: f64,
    pub limits: Limits,
    /// The motion profile along the path; `None` if no axis has to move.
    pub profile: Option<Profile>,
}

impl Path {
    /// Makes a path. Its limits are chosen so that no axis exceeds its own limits.
    ///
    /// # Errors
    /// The trajectory library finds no motion within the limits, or the motion would take infinitely long.
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

    /// The rest of the path, from the fraction `part` (0 to 1) at which the axes have stopped.
    ///
    /// # Errors
    /// As [`Path::new`].
    pub fn resumed(&self, part: f64) -> Result<Self, String> {
        Self::new(self.axes.iter().map(|axis| AxisPath { start: axis.at(part), ..*axis }).collect())
    }
}
