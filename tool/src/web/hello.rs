//! What a page is told before points: the source, the slaves, words for numbers, channels and events.

use std::collections::BTreeMap;

use ecmsk::cia402::Statusword;
use ecmsk::ecm::Scales;
use ecmsk::link::slaves;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{SlaveKind, StateByte};
use serde::Serialize;

use super::channels::{Channel, Key, Naming, Quantity};
use super::events::{Event, Span};

/// The version of the messages and blocks of a page.
pub const FORMAT: u32 = 1;

/// The first message.
#[derive(Debug, Serialize)]
pub struct Hello<'a> {
    /// [`FORMAT`].
    pub format: u32,
    /// The version of the tool.
    pub version: &'static str,
    /// `recording` or `board`.
    pub source: &'static str,
    /// The link of the board, or that of the recording.
    pub name: String,
    /// What a person has to know of the data, such as a truncated recording.
    pub notes: Vec<String>,
    /// The slaves that are known.
    pub slaves: Vec<Slave>,
    /// Words for numbers.
    pub words: Words,
    /// The channels so far.
    pub channels: &'a [Channel],
    /// The events so far, in the order of their times.
    pub events: &'a [Event],
    /// Times in which an axis has a state that is shaded; of recordings alone.
    pub spans: Vec<Span>,
    /// The two axes of the plane that is shown first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<[u8; 2]>,
    /// The block of a recording, in base64.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub block: String,
}

/// A slave.
#[derive(Debug, PartialEq, Serialize)]
pub struct Slave {
    /// The number, from 1.
    pub number: u8,
    /// The kind as links name it.
    pub kind: &'static str,
    /// The name of its axis in the machine file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// The slaves of known kinds, and those with an axis in the machine file.
pub fn slaves(kinds: &Kinds, machine: Option<&MachineFile>) -> Vec<Slave> {
    let slave = |number: u8| {
        let axis = machine.and_then(|machine| machine.axis_of(number));
        let kind =
            kinds.of(number.into()).or(axis.map(|_| SlaveKind::Drive)).filter(|kind| *kind != SlaveKind::None)?;
        Some(Slave { number, kind: slaves::word(kind), name: axis.map(|axis| axis.name.clone()) })
    };
    (1..=MAX_SLAVES as u8).filter_map(slave).collect()
}

/// Words for numbers, so that a page needs no tables of its own.
#[derive(Debug, Serialize)]
pub struct Words {
    /// The states of a drive by bits 0 to 6 of its statusword; empty where CiA 402 defines none.
    drive_states: Vec<&'static str>,
    /// The states of the board by its state byte.
    al_states: BTreeMap<u8, String>,
}

impl Words {
    /// The words of this tool.
    pub fn new() -> Self {
        let name = |bits| Statusword(bits).state().map_or("", |state| state.name());
        Self {
            drive_states: (0..128).map(name).collect(),
            al_states: [0, 1, 2, 4, 8, 0x10, 0x11, 0x12, 0x14, 0x18]
                .map(|byte| (byte, StateByte(byte).to_string()))
                .into(),
        }
    }
}

/// Names and scales from the machine file and `--counts-per-unit`.
pub struct Names<'a> {
    /// The machine file.
    pub machine: Option<&'a MachineFile>,
    /// The scales of the command line, which win over the machine file's.
    pub scales: Option<&'a Scales>,
    /// The name of the unit of these scales.
    pub unit: &'a str,
}

impl Names<'_> {
    /// The counts per unit of a slave, and the unit.
    fn scale(&self, slave: u8) -> (f64, &str) {
        if let Some(scales) = self.scales {
            return (scales.of(slave).counts_per_unit, self.unit);
        }
        let axis = self.machine.and_then(|machine| machine.axis_of(slave));
        axis.map_or((1.0, "counts"), |axis| (axis.scale.counts_per_unit, axis.unit.word()))
    }

    fn line(&self, (slave, quantity, bit): Key) -> Option<String> {
        let machine = self.machine?;
        let lines = match quantity {
            Quantity::Input => &machine.inputs,
            Quantity::Output => &machine.outputs,
            _ => return None,
        };
        lines.iter().find(|line| (line.slave, line.bit) == (slave, bit)).map(|line| line.name.clone())
    }
}

impl Naming for Names<'_> {
    fn channel(&self, key: Key) -> Channel {
        let (slave, quantity, bit) = key;
        let (per_unit, unit) = self.scale(slave);
        let is_speed = matches!(quantity, Quantity::Velocity | Quantity::TargetVelocity);
        let unit = match quantity {
            Quantity::Torque | Quantity::Cst => "%".to_owned(),
            _ if is_speed => format!("{unit}/s"),
            _ if quantity.is_scaled() => unit.to_owned(),
            _ => String::new(),
        };
        let factor = if quantity.is_scaled() { quantity.step() / per_unit } else { quantity.step() };
        Channel { slave, quantity, bit, name: self.line(key), factor, unit, held: quantity.is_held() }
    }
}
