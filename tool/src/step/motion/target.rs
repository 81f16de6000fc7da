//! The targets and the `--jerk` option of `move`.

use ecmsk::ecm::Scale;
use ecmsk::machine_file::Unit;

use crate::board::{AxisWord, BoardError, SLAVES_MAX, Units, positive};
use crate::machine_option::{self, number_and_unit};

/// A target of one axis as the user writes it: `1=10000`, `X=12.5`, `X=12.5mm`, `X=500counts`.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    axis: AxisWord,
    value: f64,
    unit: Option<Unit>,
}

/// A target of one axis, with the slave number and the scale of the value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisTarget {
    pub slave: u8,
    /// The position, or with `--relative` the distance, in the unit of `scale`.
    pub value: f64,
    /// The unit of `value`, as counts per unit.
    pub scale: Scale,
    /// Whether the user has given the name of the axis in the machine file, and not its number.
    pub is_named: bool,
}

impl Target {
    /// Parses `AXIS=TARGET`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let read = |text: &str| {
            let (axis, value) = text.split_once('=')?;
            let (value, unit) = value_and_unit(value.trim())?;
            Some(Self { axis: AxisWord::parse(axis)?, value, unit })
        };
        read(text).ok_or_else(|| allowed(text))
    }

    /// Finds the slave of the target, and the scale of its unit.
    ///
    /// # Errors
    /// The machine file has no such axis, or the target has another unit than the axis.
    pub fn resolve(&self, what: &str, units: Units<'_>) -> Result<AxisTarget, BoardError> {
        let slave = units.slave(what, &self.axis)?;
        let axis = units.axis(slave);
        let scale = match (self.unit, axis) {
            (None, _) => units.scale(&self.axis, slave),
            (Some(Unit::Counts), _) => Scale::COUNTS,
            (Some(unit), Some(axis)) if axis.unit == unit => axis.scale,
            (Some(unit), axis) => {
                let known = axis.map_or("which has no unit in a machine file".to_owned(), |axis| {
                    format!("which is in {}", axis.unit)
                });
                let why = format!("{}{unit} is written for axis {}, {known}", self.value, units.label(slave));
                let next = "write the number in the unit of the axis, or in counts, e.g. 500counts".into();
                return Err(BoardError::Refused { what: what.into(), why, next });
            }
        };
        Ok(AxisTarget { slave, value: self.value, scale, is_named: self.axis.is_name() })
    }
}

/// The error text that says what a target may be. If a number has a decimal comma, the text suggests a decimal point.
fn allowed(text: &str) -> String {
    let axes = match machine_option::names_of_axes() {
        Some((file, names)) => format!("one of {file}: {names}"),
        None => "a name of the machine file".to_owned(),
    };
    let number = match text.split_once('=') {
        Some((_, value)) if value_and_unit(value.replacen(',', ".", 1).trim()).is_some() && value.contains(',') => {
            format!("a number with a decimal point, {}", text.replacen(',', ".", 1))
        }
        _ => "a number, with a decimal point if it has decimals".to_owned(),
    };
    format!("allowed: AXIS=TARGET, e.g. 1=10000 or X=12.5: an axis from 1 to {SLAVES_MAX} or {axes}; and {number}")
}

/// Splits a number and the word for its unit, which follows without a space.
fn value_and_unit(text: &str) -> Option<(f64, Option<Unit>)> {
    let plain = text.parse().ok().map(|value| (value, None));
    let found = plain.or_else(|| number_and_unit(text).map(|(value, unit)| (value, Some(unit))));
    found.filter(|(value, _): &(f64, _)| value.is_finite())
}

/// Converts a target to counts. With units it is rounded to the nearest count; without units a fraction of a count is
/// refused.
///
/// # Errors
/// The target does not fit the range of positions.
pub fn counts(what: &str, target: &AxisTarget, units: Units<'_>) -> Result<i32, BoardError> {
    if target.scale == Scale::COUNTS && target.value.fract() != 0.0 {
        let why = format!("{} of axis {} is no whole number of counts", target.value, units.label(target.slave));
        let next = "name a whole number, or say with --counts-per-unit what a unit is".into();
        return Err(BoardError::Refused { what: what.into(), why, next });
    }
    target.scale.to_counts(target.value).ok_or_else(|| outside(what, target, units))
}

/// Refuses a position beyond the soft limits of its axis.
///
/// # Errors
/// [`BoardError::Refused`], which names the limit.
pub fn check_limits(what: &str, units: Units<'_>, slave: u8, position_counts: i32) -> Result<(), BoardError> {
    let (Some(machine), Some(axis)) = (units.machine, units.axis(slave)) else { return Ok(()) };
    if axis.limits.contains(position_counts) {
        return Ok(());
    }
    let (position, word, limit) = axis.beyond(position_counts);
    let (name, unit) = (&axis.name, axis.unit);
    let why = format!("axis {name} would be at {position} {unit}, beyond its limit, {word} = {limit} {unit}");
    let next = format!("name another target, or correct {word} in {}", machine.path.display());
    Err(BoardError::Refused { what: what.into(), why, next })
}

/// The error for a target that does not fit into the 32 bits of a position in a frame.
pub fn outside(what: &str, target: &AxisTarget, units: Units<'_>) -> BoardError {
    let label = units.label(target.slave);
    let why = format!("target {} of axis {label} is outside the 32 bits of a position", target.value);
    let ends = [i32::MIN, i32::MAX].map(|counts| target.scale.to_units(counts));
    let next = if target.scale == Scale::COUNTS {
        "name one from -2147483648 to 2147483647 counts".into()
    } else {
        format!("name one from {} to {}", ends[0].min(ends[1]), ends[0].max(ends[1]))
    };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_may_have_a_unit_directly_behind_it() {
        let read = |text| value_and_unit(text);
        assert_eq!(read("12.5"), Some((12.5, None)));
        assert_eq!(read("1e3"), Some((1000.0, None)));
        assert_eq!(read("-5mm"), Some((-5.0, Some(Unit::Mm))));
        assert_eq!(read("5m"), Some((5.0, Some(Unit::M))));
        assert_eq!(read("500 counts"), Some((500.0, Some(Unit::Counts))));
        for wrong in ["", "mm", "5 furlongs", "nan", "infmm", "1e999", "5mmm"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
