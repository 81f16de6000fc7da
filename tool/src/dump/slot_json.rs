//! One slot of a frame as JSON: its decoded fields, its raw fields, and its text.

use ecmsk::coe::ObjectAddress;
use ecmsk::link::slaves;
use ecmsk::sk::dump::{ByteOne, KindEvidence, SlaveData, SlaveReading, SlotLine, SlotMeaning, SlotRole};
use ecmsk::sk::{
    Argument, AxisTarget, CommandId, HspAxis, MASTER_CYCLIC, MasterResponse, RawSlot, SdoResponse, SlotSize,
};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::filter::CYCLIC;

/// One slot of a frame, as JSON.
#[derive(Serialize)]
pub struct SlotJson {
    slot: usize,
    role: &'static str,
    /// The name of the command that is sent or answered.
    id: &'static str,
    #[serde(flatten)]
    fields: Fields,
    raw: RawJson,
    text: String,
}

/// The raw numbers of the slot; in slot 0 the high byte of `parm` is the CRC.
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
    /// The JSON form of slot `i`.
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
            id: if cyclic { CYCLIC } else { CommandId::from_code(id).name() },
            fields: Fields::of(&line.meaning),
            raw: RawJson { id, index, parm, data1, data2, data3 },
            text: line.to_string(),
        }
    }
}

/// The decoded fields of a slot. Fields that this kind of slot does not have are left out.
#[derive(Default, Serialize)]
#[serde(untagged)]
enum Fields {
    #[default]
    Nothing,
    Malformed {
        malformed: String,
    },
    Command(Arguments),
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

/// The arguments of a command with their names, in the order of the command.
struct Arguments(Vec<(&'static str, Argument)>);

impl Serialize for Arguments {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, argument) in &self.0 {
            match argument {
                Argument::Number(number) => map.serialize_entry(name, number)?,
                Argument::Flag(flag) => map.serialize_entry(name, flag)?,
                Argument::Word(word) => map.serialize_entry(name, word)?,
                Argument::Kinds(kinds) => map.serialize_entry(name, &kinds.map(slaves::word))?,
                Argument::Object(object) => map.serialize_entry(name, &Object::of(*object))?,
                Argument::Axis(AxisTarget { target, outputs }) => {
                    map.serialize_entry(name, &Axis2::Target { target: *target, outputs: *outputs })?;
                }
            }
        }
        map.end()
    }
}

/// Axis 2 of a two-channel HSP (a pulse module): its target in a command, or its position in a response.
#[derive(Serialize)]
#[serde(untagged)]
enum Axis2 {
    Target { target: i32, outputs: u16 },
    Actual { position_counts: i32, inputs: u16 },
}

/// The JSON fields of a response's SDO slot.
#[derive(Serialize)]
struct SdoFields {
    slave: u8,
    object: Object,
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

impl Object {
    const fn of(object: ObjectAddress) -> Self {
        Self { index: object.index, sub: object.sub }
    }
}

/// The JSON fields of a slave's slot in a response.
#[derive(Default, Serialize)]
struct ReadingFields {
    #[serde(skip_serializing_if = "Option::is_none")]
    index: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<&'static str>,
    /// How the slave's kind is known: `given`, `implied` by the command, `guessed` from the fields, or `unknown`.
    kind_from: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    statusword: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    drive_state: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position_counts: Option<i32>,
    /// Torque in 0.1 % of the rated torque.
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
            SlotMeaning::MasterCommand(command) => Self::command(|give| command.arguments(give)),
            SlotMeaning::SlaveCommand(slot) => Self::command(|give| {
                give("index", Argument::Number(slot.index.into()));
                slot.command.arguments(give);
            }),
            SlotMeaning::SdoCommand(command) => Self::command(|give| command.arguments(give)),
            SlotMeaning::Malformed(reason) => Self::Malformed { malformed: reason.to_string() },
            SlotMeaning::MasterResponse(response) => Self::master_response(response),
            SlotMeaning::SlaveResponse(reading) => Self::Reading(ReadingFields::of(reading)),
            SlotMeaning::SdoResponse(response) => {
                SdoFields::of_response(response).map_or_else(Self::default, Self::Sdo)
            }
        }
    }

    fn command(give_all: impl FnOnce(&mut dyn FnMut(&'static str, Argument))) -> Self {
        let mut arguments = Vec::new();
        give_all(&mut |name, argument| arguments.push((name, argument)));
        Self::Command(Arguments(arguments))
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

impl SdoFields {
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
        Self { slave, object: Object::of(object), value: None, abort_code: None, abort_text: None }
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
        let kind = reading.kind.kind().map(slaves::word);
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
