//! The trends as text and as JSON.

use std::collections::BTreeMap;
use std::path::Path;

use ecmsk::machine_file::{MachineAxis, MachineFile, Unit};
use serde_json::{Value, json};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::By;
use super::motions::{Way, common};
use super::part::{AxisPart, Part};
use super::sources::Sources;
use crate::machine_option::in_unit;
use crate::motion::Quantity;
use crate::summary::extremes::named;

/// The data of the report on the trends.
pub struct Report<'a> {
    pub folder: &'a Path,
    pub by: By,
    /// The parts of the time with their numbers, oldest first.
    pub parts: &'a [(u64, Part)],
    pub sources: &'a Sources,
    pub machine: Option<&'a MachineFile>,
}

/// The trend of an axis over all parts.
pub struct AxisTrend<'a> {
    pub slave: usize,
    /// The motion whose following error is compared.
    pub way: Option<Way>,
    /// The position at which the first homing has found home, in counts.
    pub first_home: Option<i64>,
    /// The results of the axis in each part; `None` for a part in which it was not moved.
    pub parts: Vec<Option<&'a AxisPart>>,
}

impl AxisTrend<'_> {
    /// The largest following error in a part during the motion that is compared, in counts.
    pub fn same_motion(&self, axis: &AxisPart) -> Option<u64> {
        axis.motions.of(self.way?).map(|seen| seen.error)
    }

    /// The distance of the home of the last homing of a part from the home of the very first homing, in counts.
    pub fn home_change(&self, axis: &AxisPart) -> Option<i64> {
        Some(axis.homings.last? - self.first_home?)
    }
}

impl Report<'_> {
    /// The axes that were moved in any part.
    pub fn axes(&self) -> Vec<AxisTrend<'_>> {
        let mut found: BTreeMap<usize, ()> = BTreeMap::new();
        for (_, part) in self.parts {
            found.extend(part.axes().into_keys().map(|slave| (slave, ())));
        }
        let trend = |slave: usize| {
            let parts: Vec<Option<&AxisPart>> = self.parts.iter().map(|(_, part)| part.axis(slave)).collect();
            let way = common(parts.iter().flatten().map(|axis| &axis.motions));
            let first_home = parts.iter().flatten().find_map(|axis| axis.homings.first);
            AxisTrend { slave, way, first_home, parts }
        };
        found.into_keys().map(trend).collect()
    }

    /// The tables as text: one of the board, and one of each axis.
    pub fn text(&self) -> String {
        let heads = [
            self.by.word(),
            "recorded",
            "incomplete",
            "alarms",
            "failed states",
            "lost slaves",
            "gaps",
            "lost commands",
            "wrong CRCs",
            "FIFO reserve",
        ];
        let row = |(_, part): &(u64, Part)| -> Vec<String> {
            let recorded = format!("{:.1} s", part.recorded_ns as f64 / 1e9);
            let counts =
                [part.incomplete, part.alarms, part.states_failed, part.lost_slaves, part.gaps, part.full, part.crc];
            let reserve = part.reserve.map_or_else(none, |reserve| reserve.to_string());
            let counts = counts.iter().map(u64::to_string);
            [part.name.clone(), recorded].into_iter().chain(counts).chain([reserve]).collect()
        };
        let mut text = table(&heads, self.parts.iter().map(row).collect());
        for trend in self.axes() {
            text += &format!("\n{}", self.axis_text(&trend));
        }
        text
    }

    fn axis_text(&self, trend: &AxisTrend) -> String {
        let (axis, name) = named(trend.slave, self.machine);
        let heads = [
            self.by.word(),
            "following error",
            "same motion",
            "target step",
            "velocity",
            "torque",
            "homings",
            "home found at",
            "change",
        ];
        let row = |((_, part), of_axis): (&(u64, Part), &Option<&AxisPart>)| -> Vec<String> {
            let Some(found) = of_axis else {
                return [part.name.clone()].into_iter().chain((1..heads.len()).map(|_| none())).collect();
            };
            let largest =
                |quantity: Quantity| found.largest(quantity).map_or_else(none, |value| brief(quantity, value, axis));
            let same = trend.same_motion(found).map_or_else(none, |value| brief(Quantity::FollowingError, value, axis));
            let home = found.homings.last.map_or_else(none, |counts| distance(counts, axis));
            let change = trend.home_change(found).map_or_else(none, |counts| distance(counts, axis));
            vec![
                part.name.clone(),
                largest(Quantity::FollowingError),
                same,
                largest(Quantity::TargetStep),
                largest(Quantity::Velocity),
                largest(Quantity::Torque),
                found.homings.times.to_string(),
                home,
                change,
            ]
        };
        let rows = self.parts.iter().zip(&trend.parts).map(row).collect();
        format!("axis {name}{}\n{}", self.way_text(trend), table(&heads, rows))
    }

    /// The text for the motion that is compared.
    pub fn way_text(&self, trend: &AxisTrend) -> String {
        let (axis, _) = named(trend.slave, self.machine);
        match trend.way {
            Some((from, to)) => {
                format!("; same motion: from {} to {}", distance(from.into(), axis), distance(to.into(), axis))
            }
            None => String::new(),
        }
    }

    /// The report as a JSON object. Values are in counts.
    pub fn json(&self) -> Value {
        let trends = self.axes();
        let parts = self.parts.iter().enumerate().map(|(number, (_, part))| {
            let axes: Vec<Value> =
                trends.iter().filter_map(|trend| Some(self.axis_json(trend, trend.parts[number]?))).collect();
            json!({"name": part.name, "begin_ns": part.begin_ns, "begin": self.begin(part),
                "recorded_s": part.recorded_ns as f64 / 1e9, "recordings": part.recordings, "incomplete": part.incomplete,
                "alarms": part.alarms, "states_failed": part.states_failed, "lost_slaves": part.lost_slaves,
                "gaps": part.gaps, "lost_commands": part.full, "crc_errors": part.crc, "fifo_reserve": part.reserve,
                "axes": axes})
        });
        let passed_over =
            self.sources.passed_over.iter().map(|(file, why)| json!({"file": file.display().to_string(), "why": why}));
        json!({"by": self.by.word(), "parts": parts.collect::<Vec<_>>(),
            "passed_over": passed_over.collect::<Vec<_>>()})
    }

    /// The time at which a part begins, in UTC; `None` on a virtual clock, whose times are near 1970.
    fn begin(&self, part: &Part) -> Option<String> {
        const YEAR_NS: u64 = 365 * 86_400_000_000_000;
        let at = OffsetDateTime::from_unix_timestamp_nanos(part.begin_ns.into()).ok()?;
        at.format(&Rfc3339).ok().filter(|_| part.begin_ns > YEAR_NS)
    }

    fn axis_json(&self, trend: &AxisTrend, found: &AxisPart) -> Value {
        let mut axis = json!({"slave": trend.slave});
        if let (Some(named), _) = named(trend.slave, self.machine) {
            axis["name"] = named.name.clone().into();
            axis["unit"] = named.unit.word().into();
            axis["counts_per_unit"] = named.scale.counts_per_unit.into();
        }
        for quantity in Quantity::ALL {
            let value = found.largest(quantity);
            axis[quantity.word().replace('-', "_")] = match quantity {
                Quantity::Torque => value.map(|value| value as f64 / 10.0).into(),
                _ => value.into(),
            };
        }
        let seen = trend.way.and_then(|way| Some((way, found.motions.of(way)?)));
        axis["same_motion"] = seen
            .map(|((from, to), seen)| {
                json!({"from": from, "to": to, "times": seen.times, "following_error": seen.error})
            })
            .into();
        axis["homings"] = json!({"times": found.homings.times, "found_at": found.homings.last,
            "change": trend.home_change(found)});
        axis
    }
}

fn none() -> String {
    "-".to_owned()
}

/// A value in the unit of the machine file; in counts without one.
fn brief(quantity: Quantity, value: u64, axis: Option<&MachineAxis>) -> String {
    match (quantity, axis.filter(|axis| axis.unit != Unit::Counts)) {
        (Quantity::Torque, _) | (_, None) => quantity.shown(value, None),
        (Quantity::Velocity, Some(axis)) => format!("{}/s", magnitude(axis, value)),
        (_, Some(axis)) => magnitude(axis, value),
    }
}

/// A magnitude in the unit of the axis. It is positive also on an axis with a negative scale.
fn magnitude(axis: &MachineAxis, value: u64) -> String {
    in_unit(axis, value as f64 * axis.scale.counts_per_unit.signum())
}

/// A position, or the difference of two positions, with its sign.
fn distance(counts: i64, axis: Option<&MachineAxis>) -> String {
    match axis.filter(|axis| axis.unit != Unit::Counts) {
        Some(axis) => in_unit(axis, counts as f64),
        None => format!("{counts} counts"),
    }
}

/// A table with aligned columns: the first column to the left, the numbers to the right.
fn table(heads: &[&str], rows: Vec<Vec<String>>) -> String {
    let all: Vec<Vec<String>> =
        [heads.iter().map(|head| (*head).to_owned()).collect()].into_iter().chain(rows).collect();
    let width = |column: usize| all.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..heads.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, width))| match column {
            0 => format!("{cell:<width$}"),
            _ => format!("  {cell:>width$}"),
        });
        cells.collect::<String>() + "\n"
    };
    all.iter().map(line).collect()
}
