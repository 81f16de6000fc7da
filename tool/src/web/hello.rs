//! The first data of a page, before any points: the source, the slaves, the names of states, the channels and the
//! events.

use std::collections::BTreeMap;

use ecmsk::cia402::Statusword;
use ecmsk::ecm::Scales;
use ecmsk::link::slaves;
use ecmsk::machine_file::{self, AxisKind, MachineFile};
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{SlaveKind, StateByte};
use serde::Serialize;

use super::channels::{Channel, Key, Naming, Quantity};
use super::events::{Event, Span};

/// The version of the messages and blocks of a page.
pub const FORMAT: u32 = 1;

/// The first message to a page that shows a board, or the data in the page of a recording.
#[derive(Debug, Serialize)]
pub struct Hello<'a> {
    /// The version of messages and blocks, [`FORMAT`], which the page checks.
    pub format: u32,
    /// The version of the tool.
    pub version: &'static str,
    /// The source of the data: `recording` or `board`.
    pub source: &'static str,
    /// The link of the board, or the title of the recording.
    pub name: String,
    /// Notes on the recording for the user, such as that it is truncated.
    pub notes: Vec<String>,
    /// The known slaves.
    pub slaves: Vec<Slave>,
    /// The names of states, by their codes.
    pub words: Words,
    /// The channels so far.
    pub channels: &'a [Channel],
    /// The events so far, sorted by time.
    pub events: &'a [Event],
    /// The time spans of states that the page shades; empty for a board that is shown live.
    pub spans: Vec<Span>,
    /// The two axes whose path in their plane the page shows at first; `None` for no path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<[u8; 2]>,
    /// The axes that the page draws together; `None` if the machine file names none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<Picture>,
    /// The expression of `--find`, whose condition is among the events; `None` without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub find: Option<&'a str>,
    /// The points of a recording, as one block in base64. For a board, this is empty and blocks follow as binary
    /// messages.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub block: String,
}

/// A slave, as the page shows it in its list.
#[derive(Debug, PartialEq, Serialize)]
pub struct Slave {
    /// The number of the slave, from 1.
    pub number: u8,
    /// The kind of the slave, in the word that links use.
    pub kind: &'static str,
    /// The name of its axis in the machine file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The lower soft limit of its axis, in the unit in which the page shows positions; `None` without a limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// The upper soft limit, in the same unit; `None` without a limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// The length of a turn of its axis in the same unit; `None` for an axis that is not rotary.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn: Option<f64>,
}

/// The slaves that the page lists: those whose kind is known from frames or options, and those with an axis in the
/// machine file, which count as drives.
pub fn slaves(kinds: &Kinds, names: &Names) -> Vec<Slave> {
    let slave = |number: u8| {
        let axis = names.machine.and_then(|machine| machine.axis_of(number));
        let kind =
            kinds.of(number.into()).or(axis.map(|_| SlaveKind::Drive)).filter(|kind| *kind != SlaveKind::None)?;
        let per_unit = names.scale(number).0;
        let end = |counts: i32, open: i32| (counts != open).then(|| f64::from(counts) / per_unit);
        let ends =
            axis.map(|axis| [end(axis.limits.min, i32::MIN), end(axis.limits.max, i32::MAX)]).unwrap_or_default();
        // If the axis counts backwards, its lowest position in units has the highest count.
        let [min, max] = if per_unit < 0.0 { [ends[1], ends[0]] } else { ends };
        let turning = axis.filter(|axis| axis.kind == AxisKind::Rotary);
        let turn = turning.and_then(|axis| Some((axis.unit.per_turn()? * axis.scale.counts_per_unit / per_unit).abs()));
        Some(Slave { number, kind: slaves::word(kind), name: axis.map(|axis| axis.name.clone()), min, max, turn })
    };
    (1..=MAX_SLAVES as u8).filter_map(slave).collect()
}

/// The axes that the page draws together in one picture, by slave number.
#[derive(Debug, Serialize)]
pub struct Picture {
    /// The XY tables: for each the horizontal axis and the vertical one.
    xy: Vec<[u8; 2]>,
    /// The gantries.
    gantries: Vec<Gantry>,
}

/// A gantry: a bridge whose two ends are each moved by an axis.
#[derive(Debug, Serialize)]
struct Gantry {
    sides: [u8; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    bridge: Option<u8>,
}

impl Picture {
    /// The axes that are to be drawn together according to the machine file; `None` if there are none.
    pub fn of(machine: Option<&MachineFile>) -> Option<Self> {
        let machine_file::Picture { xy, gantries } = &machine?.picture;
        let gantry = |gantry: &machine_file::Gantry| Gantry { sides: gantry.sides, bridge: gantry.bridge };
        let picture = Self { xy: xy.clone(), gantries: gantries.iter().map(gantry).collect() };
        (!picture.xy.is_empty() || !picture.gantries.is_empty()).then_some(picture)
    }
}

/// The names of states by their codes, so that the page needs no tables of its own.
#[derive(Debug, Serialize)]
pub struct Words {
    /// The names of drive states by bits 0 to 6 of the statusword; empty where CiA 402 defines no state.
    drive_states: Vec<&'static str>,
    /// The names of the board's states by its state byte.
    al_states: BTreeMap<u8, String>,
}

impl Words {
    /// Makes the tables from the names that the tool uses.
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
    /// The scales of `--counts-per-unit`, which take precedence over those of the machine file.
    pub scales: Option<&'a Scales>,
    /// The name of the unit for these scales.
    pub unit: &'a str,
}

impl Names<'_> {
    /// The counts per unit of a slave's axis, and the name of the unit.
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
