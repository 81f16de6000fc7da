//! The results of one part of the time: a recording, an hour or a day.

use std::collections::BTreeMap;

use ecmsk::sk::dump::MAX_SLAVES;

use super::homings::Homed;
use super::motions::Motions;
use crate::motion::Quantity;
use crate::summary::extremes::AxisExtremes;

/// One part of the time, with its results.
#[derive(Clone, Debug)]
pub struct Part {
    /// The name of the recording, the hour or the day.
    pub name: String,
    /// The time of the first frame of this part, ns.
    pub begin_ns: u64,
    /// How much of this time is recorded, ns.
    pub recorded_ns: u64,
    /// The number of recordings with frames in this time. The next field is how many of them are incomplete.
    pub recordings: u64,
    pub incomplete: u64,
    /// The numbers of alarms of drives, of failed state changes, and of losses of a slave.
    pub alarms: u64,
    pub states_failed: u64,
    pub lost_slaves: u64,
    /// The numbers of gaps in motions, of commands that were lost because the FIFO was full, and of command frames with
    /// a wrong CRC.
    pub gaps: u64,
    pub full: u64,
    pub crc: u64,
    /// The smallest number of commands in the FIFO when the next command of a motion arrived; `None` without a motion.
    pub reserve: Option<u16>,
    axes: Vec<AxisPart>,
}

/// The results of an axis in one part of the time.
#[derive(Clone, Debug, Default)]
pub struct AxisPart {
    /// Whether the axis was moved.
    pub is_moved: bool,
    /// The largest values. Their times are in ns since the first frame of the part.
    pub extremes: AxisExtremes,
    pub motions: Motions,
    pub homings: Homings,
}

/// The successful homings of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Homings {
    pub times: u64,
    /// The position at which the first homing has found home, and (next field) the last one, in counts. Homings for
    /// which it is unknown are left out.
    pub first: Option<i64>,
    pub last: Option<i64>,
}

impl Part {
    pub fn new(name: String, begin_ns: u64) -> Self {
        Self {
            name,
            begin_ns,
            recorded_ns: 0,
            recordings: 0,
            incomplete: 0,
            alarms: 0,
            states_failed: 0,
            lost_slaves: 0,
            gaps: 0,
            full: 0,
            crc: 0,
            reserve: None,
            axes: vec![AxisPart::default(); MAX_SLAVES],
        }
    }

    /// The axes that were moved, by slave number.
    pub fn axes(&self) -> BTreeMap<usize, &AxisPart> {
        (1..).zip(&self.axes).filter(|(_, axis)| axis.is_moved).collect()
    }

    /// The axis of a slave, if it was moved.
    pub fn axis(&self, slave: usize) -> Option<&AxisPart> {
        self.axes.get(slave.checked_sub(1)?).filter(|axis| axis.is_moved)
    }

    /// The axis of a slave, which is marked as moved.
    pub fn moved(&mut self, slave: usize) -> Option<&mut AxisPart> {
        let axis = self.axes.get_mut(slave.checked_sub(1)?)?;
        axis.is_moved = true;
        Some(axis)
    }

    /// Processes the number of commands that were in the FIFO when the next command of a motion arrived.
    pub fn waited(&mut self, commands: u16) {
        self.reserve = Some(self.reserve.map_or(commands, |reserve| reserve.min(commands)));
    }
}

impl AxisPart {
    /// The largest value of a quantity; `None` if there was no value other than 0.
    pub const fn largest(&self, quantity: Quantity) -> Option<u64> {
        match self.extremes.of(quantity).value {
            0 => None,
            value => Some(value),
        }
    }
}

impl Homings {
    pub fn add(&mut self, homed: Homed) {
        self.times += 1;
        self.first = self.first.or(homed.found_at);
        self.last = homed.found_at.or(self.last);
    }
}
