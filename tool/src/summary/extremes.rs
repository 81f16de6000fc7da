//! The extreme values of each axis in a run, with their times: following error, step of the target, velocity and
//! torque.

use ecmsk::machine_file::{MachineAxis, MachineFile, Unit};
use ecmsk::sk::dump::MAX_SLAVES;
use serde_json::json;

use crate::filter::Times;
use crate::machine_option::{in_unit, label};
use crate::motion::{Axes, Quantity, Value};
use crate::recording::Framed;

/// The largest magnitude of a quantity, and when it occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Peak {
    /// The absolute value, in the unit of the [`Quantity`].
    pub value: u64,
    /// Time of the recording in nanoseconds.
    pub at_ns: i64,
}

impl Peak {
    fn take(&mut self, value: i64, at_ns: i64) {
        if value.unsigned_abs() > self.value {
            *self = Self { value: value.unsigned_abs(), at_ns };
        }
    }
}

impl Quantity {
    /// A value with its unit: in counts, and also in the unit of the machine file if the axis has one.
    pub fn shown(self, value: u64, axis: Option<&MachineAxis>) -> String {
        // `value` is a magnitude. On an axis with a negative scale it would become negative, so the sign of the scale
        // is removed.
        let in_unit = |axis: &MachineAxis| in_unit(axis, value as f64 * axis.scale.counts_per_unit.signum());
        match (self, axis.filter(|axis| axis.unit != Unit::Counts)) {
            (Self::FollowingError | Self::TargetStep, Some(axis)) => format!("{} ({value} counts)", in_unit(axis)),
            (Self::Velocity, Some(axis)) => format!("{}/s ({value} counts/s)", in_unit(axis)),
            (quantity, _) => quantity.shown_in_counts(value),
        }
    }

    fn shown_in_counts(self, value: u64) -> String {
        match self {
            Self::FollowingError | Self::TargetStep => format!("{value} counts"),
            Self::Velocity => format!("{value} counts/s"),
            Self::Torque => format!("{}.{} %", value / 10, value % 10),
        }
    }
}

/// The largest value of each [`Quantity`] of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisExtremes {
    peaks: [Peak; 4],
}

impl AxisExtremes {
    pub const fn of(&self, quantity: Quantity) -> Peak {
        self.peaks[quantity as usize]
    }

    /// Adds a value, which is kept if its magnitude is the largest so far.
    pub fn take(&mut self, quantity: Quantity, value: i64, at_ns: i64) {
        self.peaks[quantity as usize].take(value, at_ns);
    }
}

/// Finds the extreme values of all axes in the frames of a run, which must be sorted by time.
pub struct Extremes {
    axes: Axes,
    found: [AxisExtremes; MAX_SLAVES],
    times: Times,
}

impl Extremes {
    /// Starts without frames. Only values within `times` count.
    pub fn new(times: Times) -> Self {
        Self { axes: Axes::new(), found: [AxisExtremes::default(); MAX_SLAVES], times }
    }

    /// The extreme values of each slave that was moved, with its number from 1.
    pub fn axes(&self) -> impl Iterator<Item = (usize, &AxisExtremes)> {
        (1..).zip(&self.found).filter(|(slave, _)| self.axes.is_moved(*slave))
    }

    /// Processes the next frame.
    pub fn frame(&mut self, framed: &Framed) {
        let Self { axes, found, times } = self;
        axes.frame(framed, &mut |Value { slave, quantity, value, at_ns }| {
            if times.contains(at_ns)
                && let Some(extremes) = found.get_mut(slave - 1)
            {
                extremes.take(quantity, value, at_ns);
            }
        });
    }
}

/// A time of a recording as text: `1.758 s`.
pub fn seconds(at_ns: i64) -> String {
    format!("{:.3} s", at_ns as f64 / 1e9)
}

/// The line of an axis in the summary: the largest value of each quantity and its time, or that the axis did not move.
pub fn line(slave: usize, extremes: &AxisExtremes, machine: Option<&MachineFile>) -> String {
    let (axis, label) = named(slave, machine);
    let parts: Vec<String> = Quantity::ALL
        .into_iter()
        .map(|quantity| (quantity, extremes.of(quantity)))
        .filter(|(_, peak)| peak.value > 0)
        .map(|(quantity, peak)| {
            let name = quantity.word().replace('-', " ");
            format!("{name} up to {} ({})", quantity.shown(peak.value, axis), seconds(peak.at_ns))
        })
        .collect();
    match parts.as_slice() {
        [] => format!("axis {label}: it stood still"),
        parts => format!("axis {label}: {}", parts.join(", ")),
    }
}

/// The axis of a slave in the machine file, and its name in messages.
pub fn named(slave: usize, machine: Option<&MachineFile>) -> (Option<&MachineAxis>, String) {
    let number = u8::try_from(slave).unwrap_or(u8::MAX);
    (machine.and_then(|machine| machine.axis_of(number)), label(machine, number))
}

/// The extreme values of an axis as JSON, in counts.
pub fn axis_json(slave: usize, extremes: &AxisExtremes, machine: Option<&MachineFile>) -> serde_json::Value {
    let mut axis = json!({ "slave": slave });
    if let (Some(named), _) = named(slave, machine) {
        axis["name"] = named.name.clone().into();
        axis["unit"] = named.unit.word().into();
        axis["counts_per_unit"] = named.scale.counts_per_unit.into();
    }
    for quantity in Quantity::ALL {
        let Peak { value, at_ns } = extremes.of(quantity);
        axis[quantity.word().replace('-', "_")] = match (value, quantity) {
            (0, _) => serde_json::Value::Null,
            (_, Quantity::Torque) => json!({"value": value as f64 / 10.0, "at_s": at_ns as f64 / 1e9}),
            _ => json!({"value": value, "at_s": at_ns as f64 / 1e9}),
        };
    }
    axis
}
