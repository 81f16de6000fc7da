//! The rows of the monitor's table: one for each axis or IO slave.

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::link::slaves;
use ecmsk::machine_file::MachineAxis;
use ecmsk::sk::CommandId;
use ecmsk::sk::dump::{ByteOne, KindEvidence, SlaveData, SlotLine, SlotMeaning};

use super::watched::View;
use crate::machine_option::in_unit;

/// How a row is highlighted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Highlight {
    /// A slave without alarm that is not an enabled axis.
    #[default]
    Plain,
    /// The axis is in Operation enabled: its motor has torque.
    On,
    /// The slave has a fault or an error code.
    Alarm,
}

/// The texts of a row of the monitor's table; a text is empty if the slave has no such value.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// The number of the slave.
    pub slave: String,
    /// The name of the axis in the machine file; else the kind of the slave, with a question mark if it is guessed.
    pub kind: String,
    /// The CiA 402 state of the drive in words.
    pub state: String,
    /// The statusword, 0x6041.
    pub statusword: String,
    /// The position in counts, or in the unit of the machine file.
    pub position: String,
    /// The velocity in counts per second, or in units per second.
    pub velocity: String,
    /// The torque in percent of the rated torque.
    pub torque: String,
    /// The error code, 0x603F.
    pub error: String,
    /// The inputs of the slave as bits, or its outputs in the answer to IO_WR.
    pub bits: String,
    /// The command that the slot answers, with its index or the mode of operation.
    pub answers: String,
    /// How the row is highlighted.
    pub highlight: Highlight,
}

/// The rows of a view. The second axis of a pulse module has a row of its own.
pub fn rows(view: &View) -> Vec<Row> {
    let mut rows = Vec::new();
    for (i, line) in &view.lines {
        slave(*i, line, view, &mut rows);
    }
    rows
}

fn slave(i: usize, line: &SlotLine, view: &View, rows: &mut Vec<Row>) {
    let SlotMeaning::SlaveResponse(reading) = &line.meaning else { return };
    let axis = view.axis(i);
    let position = |counts: i32| axis.map_or_else(|| counts.to_string(), |axis| in_unit(axis, counts.into()));
    let velocity = view
        .velocities
        .get(i)
        .copied()
        .flatten()
        .map_or_else(String::new, |counts| axis.map_or_else(|| format!("{counts:.0}"), |axis| speed(axis, counts)));
    let kind = match reading.kind {
        _ if axis.is_some() => axis.map_or_else(String::new, |axis| axis.name.clone()),
        KindEvidence::Guessed(kind) => format!("{}?", slaves::word(kind)),
        KindEvidence::Given(kind) | KindEvidence::Implied(kind) => slaves::word(kind).to_owned(),
        KindEvidence::Unknown => "?".to_owned(),
    };
    let answers = match reading.byte_one {
        _ if reading.id == CommandId::GetStatus => String::new(),
        ByteOne::Index(0) | ByteOne::Mode(0) => reading.id.to_string(),
        ByteOne::Index(index) => format!("{} #{index}", reading.id),
        ByteOne::Mode(mode) => format!("{} mode {mode}", reading.id),
    };
    let row = Row { slave: i.to_string(), kind, answers, ..Row::default() };
    match &reading.data {
        SlaveData::Nothing => rows.push(Row { state: "says nothing".to_owned(), ..row }),
        SlaveData::Undecoded(raw) => {
            let state = format!("{:04X} {:08X} {:08X}", raw.parm, raw.data1, raw.data2);
            rows.push(Row { state, ..row });
        }
        SlaveData::Io(io) => {
            let what = if reading.id == CommandId::IoWrite { "out" } else { "in" };
            rows.push(Row { bits: format!("{what} 0x{:04X}", io.bits), ..row });
        }
        SlaveData::Drive(drive) => {
            let torque = drive.torque;
            let sign = if torque < 0 { "-" } else { "" };
            let error = match drive.error_code {
                0 => String::new(),
                code => format!("0x{code:04X}"),
            };
            rows.push(Row {
                torque: format!("{sign}{}.{} %", torque.unsigned_abs() / 10, torque.unsigned_abs() % 10),
                error,
                position: position(drive.position),
                velocity,
                ..row.with(drive.statusword, drive.error_code, view.alarm_text(i, drive.error_code))
            });
        }
        SlaveData::Hsp(hsp) => {
            rows.push(Row {
                position: position(hsp.first.position),
                bits: format!("in 0x{:04X}", hsp.first.inputs),
                velocity,
                ..row.with(hsp.statusword, 0, "")
            });
            if hsp.second != Default::default() {
                rows.push(Row {
                    kind: "axis 2".to_owned(),
                    position: hsp.second.position.to_string(),
                    bits: format!("in 0x{:04X}", hsp.second.inputs),
                    ..Row::default()
                });
            }
        }
    }
}

/// A speed in the unit of an axis, with as many digits as fit into the column: `-9.9 deg/s`.
fn speed(axis: &MachineAxis, counts_per_s: f64) -> String {
    let speed = counts_per_s / axis.scale.counts_per_unit;
    let decimals = usize::from(speed.abs() < 9.95);
    format!("{speed:.decimals$} {}/s", axis.unit)
}

impl Row {
    fn with(self, statusword: Statusword, error_code: u16, meaning: &str) -> Self {
        let state = statusword.state();
        let highlight = match state {
            Some(DriveState::Fault | DriveState::FaultReactionActive) => Highlight::Alarm,
            _ if error_code != 0 => Highlight::Alarm,
            Some(DriveState::OperationEnabled) => Highlight::On,
            _ => Highlight::Plain,
        };
        let name = state.map_or("no CiA 402 state", DriveState::name);
        let state = if error_code == 0 { name.to_owned() } else { format!("{name}: {meaning}") };
        Self { state, statusword: format!("0x{:04X}", statusword.0), highlight, ..self }
    }
}

/// Whether the slot of a slave has a position, which only axes have.
pub fn has_position(line: &SlotLine) -> bool {
    matches!(&line.meaning, SlotMeaning::SlaveResponse(reading) if matches!(reading.data, SlaveData::Drive(_) | SlaveData::Hsp(_)))
}
