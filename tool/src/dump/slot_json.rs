//! One slot of a JSON dump: its meaning as fields, the raw fields, the text.

use ecmsk::coe::ObjectAddress;
use ecmsk::sk::dump::{ByteOne, KindEvidence, SlaveData, SlaveReading, SlotLine, SlotMeaning, SlotRole};
use ecmsk::sk::{
    CommandId, DcShift, DriveSync, FifoAction, HspAxis, MASTER_CYCLIC, MasterCommand, MasterResponse, Motion, RawSlot,
    SdoCommand, SdoResponse, SlaveCommand, SlotSize,
};
use serde::Serialize;

use crate::kinds;

/// A slot.
#[derive(Serialize)]
pub struct SlotJson {
    slot: usize,
    role: &'static str,
    /// Name of the command asked for or answered.
    id: &'static str,
    #[serde(flatten)]
    fields: Fields,
    raw: RawJson,
    text: String,
}

/// The numbers as they stand in the slot; in slot 0 the high byte of `parm` is the CRC.
#[derive(Serialize)]
struct RawJson {
    id: u8,
    index: u8,
    parm: u16,
    data1: u32,
    data2: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    data3: Option<u32>,
}

impl SlotJson {
    /// Slot `i`.
    pub fn of(i: usize, line: &SlotLine) -> Self {
        let RawSlot { id, index, parm, data1, data2, data3 } = line.raw;
        let data3 = (line.size == SlotSize::Bytes16).then_some(data3);
        let cyclic = line.role == SlotRole::Master && id == MASTER_CYCLIC;
        Self {
            slot: i,
            role: match line.role {
                SlotRole::Master => "ecm",
                SlotRole::Slave(_) => "slave",
                SlotRole::Sdo => "sdo",
            },
            id: if cyclic { "CYCLIC" } else { CommandId::from_code(id).name() },
            fields: Fields::of(&line.meaning),
            raw: RawJson { id, index, parm, data1, data2, data3 },
            text: line.to_string(),
        }
    }
}

/// The meaning. What a kind of slot does not have is left out.
#[derive(Default, Serialize)]
#[serde(untagged)]
enum Fields {
    #[default]
    Nothing,
    Malformed {
        malformed: String,
    },
    State {
        state: &'static str,
    },
    Axes {
        group: u8,
        kinds: [&'static str; 8],
    },
    Dc {
        cycle_us: u32,
        shift: &'static str,
    },
    Crc {
        check_commands: bool,
        fill_responses: bool,
    },
    Fifo {
        action: &'static str,
        #[serde(skip_serializing_if = "Option::is_none")]
        threshold_entries: Option<u32>,
    },
    LocalOutputs {
        outputs: u8,
    },
    Slave(SlaveFields),
    Sdo(SdoFields),
    Master {
        state: String,
        state_code: u8,
        state_failed: bool,
        crc_errors: u8,
        result: u32,
        fifo_free_entries: u16,
        full_count: u16,
    },
    Reading(ReadingFields),
}

/// A slave's slot of a command.
#[derive(Default, Serialize)]
#[serde(default)]
struct SlaveFields {
    index: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sync: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target_counts: Option<i32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target_velocity: Option<i32>,
    /// 0.1 % of rated.
    #[serde(skip_serializing_if = "Option::is_none")]
    target_torque_permille: Option<i16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    outputs: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis2: Option<Axis2>,
}

/// Axis 2 of a two-channel HSP.
#[derive(Serialize)]
#[serde(untagged)]
enum Axis2 {
    Target { target: i32, outputs: u16 },
    Actual { position_counts: i32, inputs: u16 },
}

/// The SDO slot, both ways.
#[derive(Serialize)]
struct SdoFields {
    slave: u8,
    object: Object,
    #[serde(skip_serializing_if = "Option::is_none")]
    size_bytes: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    abort_code: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    abort_text: Option<&'static str>,
}

#[derive(Serialize)]
struct Object {
    index: u16,
    sub: u8,
}

/// A slave's slot of a response.
#[derive(Default, Serialize)]
struct ReadingFields {
    #[serde(skip_serializing_if = "Option::is_none")]
    index: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<&'static str>,
    /// `given`, `implied` by the id, `guessed` by the fields or `unknown`.
    kind_from: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    statusword: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    drive_state: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position_counts: Option<i32>,
    /// 0.1 % of rated.
    #[serde(skip_serializing_if = "Option::is_none")]
    torque_permille: Option<i16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error_code: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    inputs: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    outputs: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis2: Option<Axis2>,
}

impl Fields {
    fn of(meaning: &SlotMeaning) -> Self {
        match meaning {
            SlotMeaning::MasterCommand(command) => Self::master_command(command),
            SlotMeaning::SlaveCommand(slot) => Self::Slave(SlaveFields::of(slot.index, &slot.command)),
            SlotMeaning::SdoCommand(command) => SdoFields::of_command(command).map_or_else(Self::default, Self::Sdo),
            SlotMeaning::Malformed(reason) => Self::Malformed { malformed: reason.to_string() },
            SlotMeaning::MasterResponse(response) => Self::master_response(response),
            SlotMeaning::SlaveResponse(reading) => Self::Reading(ReadingFields::of(reading)),
            SlotMeaning::SdoResponse(response) => {
                SdoFields::of_response(response).map_or_else(Self::default, Self::Sdo)
            }
        }
    }

    fn master_command(command: &MasterCommand) -> Self {
        match *command {
            MasterCommand::SetState(state) => Self::State { state: state.name() },
            MasterCommand::SetAxis { group, kinds } => Self::Axes { group, kinds: kinds.map(kinds::word) },
            MasterCommand::SetDc { cycle, shift } => Self::Dc {
                cycle_us: cycle.us(),
                shift: match shift {
                    DcShift::Auto | DcShift::AutoHigh => "auto",
                    DcShift::Other(_) => "without effect",
                },
            },
            MasterCommand::SetEx { check_commands, fill_responses } => Self::Crc { check_commands, fill_responses },
            MasterCommand::SetFifo(FifoAction::Clear) => Self::Fifo { action: "clear", threshold_entries: None },
            MasterCommand::SetFifo(FifoAction::Threshold(free)) => {
                Self::Fifo { action: "threshold", threshold_entries: Some(free) }
            }
            MasterCommand::LocalWrite(outputs) => Self::LocalOutputs { outputs },
            MasterCommand::GetStatus
            | MasterCommand::LocalRead
            | MasterCommand::SoftReset
            | MasterCommand::Other(_) => Self::Nothing,
        }
    }

    fn master_response(response: &MasterResponse) -> Self {
        Self::Master {
            state: response.state.to_string(),
            state_code: response.state.0,
            state_failed: response.state.is_failed(),
            crc_errors: response.error,
            result: response.result,
            fifo_free_entries: response.fifo_free,
            full_count: response.full_count,
        }
    }
}

impl SlaveFields {
    fn of(index: u8, command: &SlaveCommand) -> Self {
        let fields = Self { index, ..Self::default() };
        match *command {
            SlaveCommand::DriveMode { mode, sync } => Self {
                mode: Some(mode.name()),
                sync: Some(match sync {
                    DriveSync::FreeRun => "free run",
                    DriveSync::DcSync => "dc",
                }),
                ..fields
            },
            SlaveCommand::IoWrite(outputs) => Self { outputs: Some(outputs), ..fields },
            SlaveCommand::Csp(motion) => Self { target_counts: Some(motion.first.target), ..fields.moving(&motion) },
            SlaveCommand::Csv(motion) => Self { target_velocity: Some(motion.first.target), ..fields.moving(&motion) },
            SlaveCommand::Cst(torque) => Self { target_torque_permille: Some(torque), ..fields },
            SlaveCommand::GetStatus
            | SlaveCommand::AlarmClear
            | SlaveCommand::ServoOn
            | SlaveCommand::ServoOff
            | SlaveCommand::IoRead
            | SlaveCommand::GoHome
            | SlaveCommand::AbortHome
            | SlaveCommand::Other(_) => fields,
        }
    }

    /// What CSP and CSV share; most slaves have neither outputs nor a second axis.
    fn moving(self, motion: &Motion) -> Self {
        let second = motion.second;
        let axis2 =
            (second != Default::default()).then_some(Axis2::Target { target: second.target, outputs: second.outputs });
        Self { outputs: Some(motion.first.outputs).filter(|outputs| *outputs != 0), axis2, ..self }
    }
}

impl SdoFields {
    fn of_command(command: &SdoCommand) -> Option<Self> {
        match *command {
            SdoCommand::Read { slave, object } => Some(Self::new(slave, object)),
            SdoCommand::Write { slave, object, size, value } => {
                Some(Self { size_bytes: Some(size.bytes()), value: Some(value), ..Self::new(slave, object) })
            }
            SdoCommand::GetStatus | SdoCommand::Other(_) => None,
        }
    }

    fn of_response(response: &SdoResponse) -> Option<Self> {
        match *response {
            SdoResponse::Done { slave, object, value, .. } => {
                Some(Self { value: Some(value), ..Self::new(slave, object) })
            }
            SdoResponse::Aborted { slave, object, code, .. } => {
                Some(Self { abort_code: Some(code.0), abort_text: code.text(), ..Self::new(slave, object) })
            }
            SdoResponse::Empty | SdoResponse::Other(_) => None,
        }
    }

    const fn new(slave: u8, object: ObjectAddress) -> Self {
        let object = Object { index: object.index, sub: object.sub };
        Self { slave, object, size_bytes: None, value: None, abort_code: None, abort_text: None }
    }
}

impl ReadingFields {
    fn of(reading: &SlaveReading) -> Self {
        let (index, mode) = match reading.byte_one {
            ByteOne::Index(index) => (Some(index), None),
            ByteOne::Mode(mode) => (None, Some(mode)),
        };
        let kind_from = match reading.kind {
            KindEvidence::Given(_) => "given",
            KindEvidence::Implied(_) => "implied",
            KindEvidence::Guessed(_) => "guessed",
            KindEvidence::Unknown => "unknown",
        };
        let kind = reading.kind.kind().map(kinds::word);
        let fields = Self { index, mode, kind, kind_from, ..Self::default() };
        match &reading.data {
            SlaveData::Nothing | SlaveData::Undecoded(_) => fields,
            SlaveData::Drive(drive) => Self {
                statusword: Some(drive.statusword.0),
                drive_state: drive.statusword.state().map(|state| state.name()),
                position_counts: Some(drive.position),
                torque_permille: Some(drive.torque),
                error_code: Some(drive.error_code),
                ..fields
            },
            SlaveData::Io(io) if reading.id == CommandId::IoWrite => Self { outputs: Some(io.bits), ..fields },
            SlaveData::Io(io) => Self { inputs: Some(io.bits), ..fields },
            SlaveData::Hsp(hsp) => Self {
                statusword: Some(hsp.statusword.0),
                drive_state: hsp.statusword.state().map(|state| state.name()),
                position_counts: Some(hsp.first.position),
                inputs: Some(hsp.first.inputs),
                axis2: (hsp.second != HspAxis::default())
                    .then_some(Axis2::Actual { position_counts: hsp.second.position, inputs: hsp.second.inputs }),
                ..fields
            },
        }
    }
}
