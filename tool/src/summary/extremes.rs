//! The extremes of each axis in a run: following error, step of the target, velocity and torque, with their times.

use ecmsk::link::Dir;
use ecmsk::machine_file::{MachineAxis, MachineFile, Unit};
use ecmsk::recording::{Entry, ExecutionReport, RunExecution};
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, DriveResponse, SlaveCommand, SlaveKind};
use serde_json::{Value, json};

use crate::machine_option::{in_unit, label};
use crate::recording::Framed;

/// \[OURS] No velocity is computed between two reports that are more than this many cycles apart: the mean over a longer
/// time says little about the largest velocity.
const CYCLES_APART_MAX: i64 = 8;

/// The largest magnitude of a quantity, and when it occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Peak {
    /// The absolute value, in the unit of the [`Quantity`].
    pub value: u64,
    /// Nanoseconds since the first frame.
    pub at_ns: i64,
}

impl Peak {
    fn take(&mut self, value: i64, at_ns: i64) {
        if value.unsigned_abs() > self.value {
            *self = Self { value: value.unsigned_abs(), at_ns };
        }
    }
}

/// A quantity of which the largest value is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The executed target minus the actual position of an enabled axis, in counts.
    FollowingError,
    /// The change of the target from one executed command to the next, in counts.
    TargetStep,
    /// The change of the actual position, in counts per second.
    Velocity,
    /// The actual torque, in 0.1 % of the rated torque.
    Torque,
}

impl Quantity {
    pub const ALL: [Self; 4] = [Self::FollowingError, Self::TargetStep, Self::Velocity, Self::Torque];

    /// The name of the quantity on the command line; in JSON `-` is replaced by `_`.
    pub const fn word(self) -> &'static str {
        match self {
            Self::FollowingError => "following-error",
            Self::TargetStep => "target-step",
            Self::Velocity => "velocity",
            Self::Torque => "torque",
        }
    }

    /// A value with its unit; in the unit of the machine file, too, if the axis has one.
    pub fn shown(self, value: u64, axis: Option<&MachineAxis>) -> String {
        // A magnitude is positive also on an axis with a negative scale, so the sign of the scale is taken out.
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
}

/// The extremes of an axis, and its last values, while frames are read.
#[derive(Debug, Default)]
struct Axis {
    extremes: AxisExtremes,
    /// Whether the slave is an axis: it was sent a command that only axes have. Reports alone do not tell an axis from
    /// other slaves.
    is_axis: bool,
    /// The target that was executed last, while it is in force.
    target: Option<i32>,
    /// The time in nanoseconds and the position in counts of the last report.
    position: Option<(i64, i32)>,
    /// The id of the command that the last report answered.
    answered: Option<u8>,
}

impl Axis {
    fn peak(&mut self, quantity: Quantity, value: i64, at_ns: i64) {
        self.extremes.peaks[quantity as usize].take(value, at_ns);
    }

    fn executed(&mut self, at_ns: i64, order: &SlaveCommand) {
        match order {
            SlaveCommand::Csp(motion) => {
                self.is_axis = true;
                let target = motion.first.target;
                if let Some(before) = self.target.replace(target) {
                    self.peak(Quantity::TargetStep, i64::from(target) - i64::from(before), at_ns);
                }
            }
            SlaveCommand::GetStatus | SlaveCommand::Other(_) | SlaveCommand::IoRead | SlaveCommand::IoWrite(_) => {}
            order => {
                self.is_axis |= order.id().is_for_axes();
                self.target = None;
            }
        }
    }

    fn report(&mut self, at_ns: i64, cycle_ns: i64, drive: &DriveResponse, is_drive: bool, is_certain: bool) {
        // Homing moves the zero of the position, so positions before and after it are not compared.
        let is_homing = CommandId::from_code(drive.head.id) == CommandId::GoHome;
        if is_homing || self.answered.replace(drive.head.id) != Some(drive.head.id) {
            self.position = None;
        }
        if is_homing {
            self.target = None;
        }
        let before = self.position.replace((at_ns, drive.position));
        if let Some((then_ns, position)) = before {
            let passed = at_ns.saturating_sub(then_ns);
            if passed > 0 && passed <= CYCLES_APART_MAX.saturating_mul(cycle_ns) {
                let counts = i64::from(drive.position) - i64::from(position);
                self.peak(Quantity::Velocity, counts.saturating_mul(1_000_000_000) / passed.max(cycle_ns), at_ns);
            }
        }
        if is_drive {
            self.peak(Quantity::Torque, drive.torque.into(), at_ns);
        }
        if !drive.statusword.is_enabled() {
            self.target = None;
        } else if let Some(target) = self.target.filter(|_| is_certain) {
            self.peak(Quantity::FollowingError, i64::from(target) - i64::from(drive.position), at_ns);
        }
    }
}

/// Finds the extremes of all axes in the frames of a run, sorted by time.
pub struct Extremes {
    axes: Vec<Axis>,
    run: RunExecution,
}

impl Extremes {
    pub fn new() -> Self {
        Self { axes: (0..MAX_SLAVES).map(|_| Axis::default()).collect(), run: RunExecution::new() }
    }

    /// The extremes of each slave that is an axis, with its number from 1.
    pub fn axes(&self) -> impl Iterator<Item = (usize, &AxisExtremes)> {
        (1..).zip(&self.axes).filter(|(_, axis)| axis.is_axis).map(|(slave, axis)| (slave, &axis.extremes))
    }

    /// Adds the next frame; frames are sorted by time.
    pub fn frame(&mut self, framed: &Framed) {
        match framed.recorded.dir {
            Dir::Write => self.run.command(framed.time_ns, &framed.recorded.frame, framed.size),
            Dir::Read => self.report(framed),
        }
    }

    fn report(&mut self, framed: &Framed) {
        let (frame, size, at_ns) = (&framed.recorded.frame, framed.size, framed.time_ns);
        let is_certain = match self.run.report(at_ns, frame, size) {
            None => {
                self.axes.iter_mut().for_each(|axis| (axis.target, axis.position) = (None, None));
                return;
            }
            Some(ExecutionReport::Executed { entries, .. }) => {
                entries.iter().for_each(|entry| self.execute(entry));
                true
            }
            Some(ExecutionReport::Later) => false,
            Some(ExecutionReport::Unknown) => {
                self.axes.iter_mut().for_each(|axis| axis.target = None);
                false
            }
        };
        for (slave, axis) in (1..=size.max_slaves()).zip(&mut self.axes).filter(|(_, axis)| axis.is_axis) {
            // An HSP (a pulse module) has inputs where a drive has its torque.
            let is_drive = self.run.kind(slave) != Some(SlaveKind::Hsp);
            axis.report(
                at_ns,
                self.run.cycle_ns(),
                &DriveResponse::decode(&frame.slot(size, slave)),
                is_drive,
                is_certain,
            );
        }
    }

    fn execute(&mut self, Entry { at_ns, orders }: &Entry) {
        for (axis, order) in self.axes.iter_mut().zip(orders) {
            if let Some(order) = order {
                axis.executed(*at_ns, order);
            }
        }
    }
}

/// A time of a recording: `1.758 s`.
pub fn seconds(at_ns: i64) -> String {
    format!("{:.3} s", at_ns as f64 / 1e9)
}

/// The line of an axis in the summary: the largest value of each quantity and its time, or that the axis stood still.
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

/// An axis as JSON; values are in counts.
pub fn axis_json(slave: usize, extremes: &AxisExtremes, machine: Option<&MachineFile>) -> Value {
    let mut axis = json!({ "slave": slave });
    if let (Some(named), _) = named(slave, machine) {
        axis["name"] = named.name.clone().into();
        axis["unit"] = named.unit.word().into();
        axis["counts_per_unit"] = named.scale.counts_per_unit.into();
    }
    for quantity in Quantity::ALL {
        let Peak { value, at_ns } = extremes.of(quantity);
        axis[quantity.word().replace('-', "_")] = match (value, quantity) {
            (0, _) => Value::Null,
            (_, Quantity::Torque) => json!({"value": value as f64 / 10.0, "at_s": at_ns as f64 / 1e9}),
            _ => json!({"value": value, "at_s": at_ns as f64 / 1e9}),
        };
    }
    axis
}
