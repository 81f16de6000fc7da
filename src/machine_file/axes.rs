//! Checks the axes of a machine file and converts them: names, slaves, scales, soft limits, homing.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use super::check::{Fault, Source, fault, slave_number};
use super::format::{AxisFields, HomingFields, Number};
use super::unit::Unit;
use super::{AxisHoming, AxisKind, MachineAxis, MachineFileError, MachineSlave, same_name};
use crate::address::scale::{Scale, SoftLimits, fraction};
use crate::address::text::visible;
use crate::sk::SlaveKind;

/// The longest name of an axis or of an input or output, characters. \[OURS]
const NAME_MAX: usize = 32;

/// Checks the axes of the file and returns them in the order of their slaves. It is an error if two axes have the same
/// slave, or if the slave of an axis is of a kind without axes.
pub(super) fn axes(
    source: &Source<'_>,
    fields: &BTreeMap<String, AxisFields>,
    slaves: &[MachineSlave],
) -> Result<Vec<MachineAxis>, MachineFileError> {
    let mut axes: Vec<MachineAxis> = Vec::new();
    for (name, fields) in fields {
        let wrong = |field: &str, fault| match field {
            "" => source.wrong(&["axes", name], fault),
            field => source.wrong(&[&["axes", name], &*field.split('.').collect::<Vec<_>>()].concat(), fault),
        };
        check_name(name, axes.iter().map(|axis| &*axis.name)).map_err(|fault| wrong("", fault))?;
        let slave = slave_number(fields.slave, slaves).map_err(|fault| wrong("slave", fault))?;
        if matches!(slaves[usize::from(slave) - 1].kind, SlaveKind::Io | SlaveKind::None) {
            let what = format!("slave {slave} is of a kind without an axis");
            return Err(wrong("slave", fault(what, "correct the number, or its kind in [slaves]")));
        }
        if let Some(other) = axes.iter().find(|other| other.slave == slave) {
            let what = format!("axis {} is on slave {slave}, too", other.name);
            return Err(wrong("slave", fault(what, "give each axis a slave of its own")));
        }
        axes.push(axis(name, slave, fields, &wrong)?);
    }
    axes.sort_by_key(|axis| axis.slave);
    Ok(axes)
}

fn axis(
    name: &str,
    slave: u8,
    fields: &AxisFields,
    wrong: &dyn Fn(&str, Fault) -> MachineFileError,
) -> Result<MachineAxis, MachineFileError> {
    let (unit, scale) = scale(fields).map_err(|(field, fault)| wrong(field, fault))?;
    let above_0 = |field: &str, value: Option<f64>| match value {
        Some(value) if !(value.is_finite() && value > 0.0) => {
            Err(wrong(field, fault(format!("{value} is no limit"), "write a number above 0, or take it out")))
        }
        value => Ok(value),
    };
    let limits = limits(fields, unit, scale).map_err(|(field, fault)| wrong(field, fault))?;
    let homing = fields.homing.as_ref().map(|homing| self::homing(homing, unit, scale, limits));
    let homing = homing.transpose().map_err(|(field, fault)| wrong(&format!("homing.{field}"), fault))?;
    Ok(MachineAxis {
        name: name.to_owned(),
        slave,
        unit,
        kind: kind(fields.kind, unit).map_err(|fault| wrong("kind", fault))?,
        scale,
        limits,
        max_velocity: above_0("max_velocity", fields.max_velocity)?,
        max_acceleration: above_0("max_acceleration", fields.max_acceleration)?,
        homing: homing.unwrap_or_default(),
    })
}

/// The kind of an axis: as the file says, otherwise rotary if the unit is an angle, and linear if not. It is an error
/// if the file makes an axis rotary whose unit is no angle.
fn kind(given: Option<AxisKind>, unit: Unit) -> Result<AxisKind, Fault> {
    let of_unit = if unit.per_turn().is_some() { AxisKind::Rotary } else { AxisKind::Linear };
    if given == Some(AxisKind::Rotary) && of_unit == AxisKind::Linear {
        let what = format!("how many {unit} a turn has is not known");
        return Err(fault(what, "give the axis unit deg, rad or turn, with its per, or take kind out"));
    }
    Ok(given.unwrap_or(of_unit))
}

/// A fault of a field, with the name of the field.
type FieldFault = (&'static str, Fault);

fn scale(fields: &AxisFields) -> Result<(Unit, Scale), FieldFault> {
    let unit = fields.unit.unwrap_or_default();
    let Some(per) = &fields.per else {
        if unit == Unit::Counts {
            return Ok((unit, Scale::COUNTS));
        }
        let next = format!("add per, the {unit} of one count, e.g. per = 0.001 or per = \"360/131072\"");
        return Err(("per", fault(format!("it is missing, and a count may be any number of {unit}"), next)));
    };
    // A fraction is inverted by exchanging its two numbers, not by dividing 1 by its value: `1/3000` gives exactly 3000
    // counts for one unit, without a rounding error.
    let (written, counts) = match per {
        Number::Value(value) => (value.to_string(), Some(1.0 / value)),
        Number::Fraction(text) => {
            let (over, under) = text.split_once('/').unwrap_or((text, "1"));
            (text.clone(), fraction(&format!("{under}/{over}")))
        }
    };
    let scale = counts.map(Scale::per_unit).filter(|scale| scale.is_valid()).ok_or_else(|| {
        let next = "write the units of one count: a number that is not 0, or a fraction such as \"360/131072\"";
        ("per", fault(format!("{} is no scale", visible(&written)), next))
    })?;
    if unit == Unit::Counts && scale != Scale::COUNTS {
        let what = if fields.unit.is_none() { "it has no unit" } else { "a count is one count" };
        return Err(("per", fault(what, "add the unit, e.g. unit = \"mm\", or take per out")));
    }
    Ok((unit, scale))
}

/// Converts a position of the axis from the file to counts. Fails if the position of an axis in counts is not a whole
/// number, or if the counts do not fit into 32 bits.
fn counts(value: f64, unit: Unit, scale: Scale) -> Result<i32, Fault> {
    if unit == Unit::Counts && value.fract() != 0.0 {
        return Err(fault(format!("{value} is no whole number of counts"), "write one, or add the unit of the axis"));
    }
    scale.to_counts(value).ok_or_else(|| {
        let ends = [i32::MIN, i32::MAX].map(|counts| scale.to_units(counts));
        let (min, max) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let what = format!("{value} is outside the 32 bits of a position");
        fault(what, format!("write a number from {min} to {max}"))
    })
}

/// Converts a soft limit like [`counts`], but also fails if rounding to the nearest count changes the limit by more
/// than a tenth of its value. This happens if `per` is inverted, or if the limit is shorter than a count.
fn limit(value: f64, unit: Unit, scale: Scale) -> Result<i32, Fault> {
    let counts = counts(value, unit, scale)?;
    let Some(place) = scale.rounds_to(value) else { return Ok(counts) };
    let what = format!("{value} {unit} would be {place} {unit}, since a count is {} {unit}", scale.count());
    Err(fault(what, "correct per, the units of one count, or the limit"))
}

fn limits(fields: &AxisFields, unit: Unit, scale: Scale) -> Result<SoftLimits, FieldFault> {
    let of = |field, value: Option<f64>| {
        value.map(|value| limit(value, unit, scale).map_err(|fault| (field, fault))).transpose()
    };
    let (min, max) = (of("min", fields.min)?, of("max", fields.max)?);
    if let (Some(low), Some(high)) = (fields.min, fields.max)
        && low >= high
    {
        let what = format!("{low} is not below max, {high}");
        return Err(("min", fault(what, "exchange them, or correct one")));
    }
    let ends = (min, max);
    // With a unit in the opposite direction the lowest position has the highest count.
    let (min, max) = if scale.counts_per_unit < 0.0 { (ends.1, ends.0) } else { ends };
    Ok(SoftLimits { min: min.unwrap_or(i32::MIN), max: max.unwrap_or(i32::MAX) })
}

fn homing(fields: &HomingFields, unit: Unit, scale: Scale, limits: SoftLimits) -> Result<AxisHoming, FieldFault> {
    let speed = |field, value: Option<i64>| {
        value.map(|value| number(value, 1..=u32::MAX.into()).map_err(|fault| (field, fault))).transpose()
    };
    let method = fields.method.map(|value| {
        let method = i8::try_from(value);
        method
            .map_err(|_| ("method", fault(format!("there is no homing method {value}"), "write one from -128 to 127")))
    });
    let offset_counts = fields.offset.map(|value| {
        let counts = counts(value, unit, scale).map_err(|fault| ("offset", fault))?;
        if limits.contains(counts) {
            return Ok(counts);
        }
        let what = format!("home would be at {value}, beyond min or max of the axis");
        Err(("offset", fault(what, "correct the offset or the limits")))
    });
    Ok(AxisHoming {
        method: method.transpose()?,
        speed_switch: speed("speed_switch", fields.speed_switch)?,
        speed_zero: speed("speed_zero", fields.speed_zero)?,
        acceleration: speed("acceleration", fields.acceleration)?,
        offset_counts: offset_counts.transpose()?,
    })
}

/// Checks that a number of the file is in the range `allowed`, which must be within `u32`.
pub(super) fn number(value: i64, allowed: RangeInclusive<i64>) -> Result<u32, Fault> {
    let number = u32::try_from(value).ok().filter(|_| allowed.contains(&value));
    number.ok_or_else(|| {
        let next = format!("write a whole number from {} to {}", allowed.start(), allowed.end());
        fault(format!("{value} is out of range"), next)
    })
}

/// Checks the name of an axis, an input or an output. On command lines a name is followed by signs and numbers
/// (`X=12.5`), so a name begins with a letter and contains no signs but `_` and `-`.
pub(super) fn check_name<'a>(name: &str, mut others: impl Iterator<Item = &'a str>) -> Result<(), Fault> {
    let begins = name.chars().next().is_some_and(char::is_alphabetic);
    let plain = name.chars().all(|letter| letter.is_alphanumeric() || matches!(letter, '_' | '-'));
    let reserved = name.eq_ignore_ascii_case("all");
    if !begins || !plain || reserved || name.chars().count() > NAME_MAX {
        let next = format!("begin with a letter, then letters, digits, _ and -, at most {NAME_MAX}, and not `all`");
        return Err(fault(format!("`{}` is no name", visible(name)), next));
    }
    match others.find(|other| same_name(other, name)) {
        Some(other) => Err(fault(format!("it differs from `{other}` in upper and lower case alone"), "rename one")),
        None => Ok(()),
    }
}
