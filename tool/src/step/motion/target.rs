//! The operands and options of `move`.

use ecmsk::ecm::Scale;

use crate::board::{BoardError, positive};

/// The target of one axis as the user gives it: `1=10000`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    pub slave: u8,
    /// The target position, or with `--relative` the distance, in the units of the axis.
    pub value: f64,
}

impl Target {
    /// Parses `AXIS=TARGET`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let read = |text: &str| {
            let (slave, value) = text.split_once('=')?;
            let slave = slave.trim().parse().ok().filter(|slave| (1..=40).contains(slave))?;
            let value = value.trim().parse().ok().filter(|value: &f64| value.is_finite())?;
            Some(Self { slave, value })
        };
        read(text).ok_or_else(|| "allowed: AXIS=TARGET, e.g. 1=10000, with an axis from 1 to 40 and a number".into())
    }
}

/// Converts a target to counts. With units it is rounded to the nearest count; without units a fraction of a count is
/// refused.
///
/// # Errors
/// The target does not fit the range of positions.
pub fn counts(what: &str, target: &Target, scale: Scale) -> Result<i32, BoardError> {
    if scale == Scale::COUNTS && target.value.fract() != 0.0 {
        let why = format!("{} of axis {} is no whole number of counts", target.value, target.slave);
        let next = "name a whole number, or say with --counts-per-unit what a unit is".into();
        return Err(BoardError::Refused { what: what.into(), why, next });
    }
    scale.to_counts(target.value).ok_or_else(|| outside(what, target))
}

/// The error for a target that does not fit into the 32 bits of the wire.
pub fn outside(what: &str, target: &Target) -> BoardError {
    let why = format!("target {} of axis {} is outside the 32 bits of a position", target.value, target.slave);
    let next = "name one from -2147483648 to 2147483647 counts".into();
    BoardError::Refused { what: what.into(), why, next }
}

/// The value of `--jerk`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Jerk {
    /// The jerk is limited to this value.
    Limit(f64),
    /// The jerk is not limited.
    Off,
}

impl Jerk {
    /// Parses a number or `off`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text == "off" {
            Ok(Self::Off)
        } else {
            positive(text).map(Self::Limit).map_err(|why| format!("{why}, or off"))
        }
    }

    /// The value multiplied by `by`, to convert units to counts.
    pub fn scaled(self, by: f64) -> Self {
        match self {
            Self::Limit(limit) => Self::Limit(limit * by),
            Self::Off => Self::Off,
        }
    }
}
