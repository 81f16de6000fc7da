//! What a slot of a dump means, as types: for tools that write something else than text.

use crate::sk::{
    CommandId, DriveResponse, HspResponse, IoResponse, Malformed, MasterCommand, MasterResponse, RawSlot, SdoCommand,
    SdoResponse, SlaveKind, SlotCommand, SlotSize,
};

/// What one slot says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotMeaning {
    /// Slot 0 of a command frame.
    MasterCommand(MasterCommand),
    /// A slave's slot of a command frame.
    SlaveCommand(SlotCommand),
    /// The SDO slot of a command frame.
    SdoCommand(SdoCommand),
    /// A slot of a command frame whose id is known and has business there, with an argument that is none.
    Malformed(Malformed),
    /// Slot 0 of a response frame.
    MasterResponse(MasterResponse),
    /// A slave's slot of a response frame.
    SlaveResponse(SlaveReading),
    /// The SDO slot of a response frame.
    SdoResponse(SdoResponse),
}

impl SlotMeaning {
    /// The slot that this meaning makes, byte 3 of slot 0 (the CRC) 0; `None` if the slot has no meaning.
    ///
    /// Where it differs from the slot it was read from, bytes are set there that the meaning does not use.
    pub fn encode(&self, size: SlotSize) -> Option<RawSlot> {
        Some(match self {
            Self::MasterCommand(command) => command.encode(),
            Self::SlaveCommand(command) => command.encode(size),
            Self::SdoCommand(command) => command.encode(),
            Self::Malformed(_) => return None,
            Self::MasterResponse(response) => response.encode(),
            Self::SlaveResponse(reading) => reading.encode(size),
            Self::SdoResponse(response) => response.encode(),
        })
    }
}

/// How the kind of the slave behind a response slot is known; it is not on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotKind {
    /// The caller said so.
    Given(SlaveKind),
    /// Only this kind takes the command that the slot answers.
    Implied(SlaveKind),
    /// The fields look like it.
    Guessed(SlaveKind),
    /// Nothing tells.
    Unknown,
}

impl SlotKind {
    /// The kind, however it is known.
    pub const fn kind(self) -> Option<SlaveKind> {
        match self {
            Self::Given(kind) | Self::Implied(kind) | Self::Guessed(kind) => Some(kind),
            Self::Unknown => None,
        }
    }

    /// See [`super::ResponseDump`] for the rules.
    fn from_fields(slot: &RawSlot) -> Self {
        match CommandId::from_code(slot.id) {
            CommandId::IoRead | CommandId::IoWrite => Self::Implied(SlaveKind::Io),
            CommandId::Cst => Self::Implied(SlaveKind::Drive),
            // Bytes 12..15 are reserved but for the two-channel HSP.
            _ if slot.data3 != 0 => Self::Guessed(SlaveKind::Hsp),
            CommandId::AlarmClear
            | CommandId::ServoOn
            | CommandId::ServoOff
            | CommandId::Csp
            | CommandId::Csv
            | CommandId::GoHome
            | CommandId::AbortHome => Self::Guessed(SlaveKind::Drive),
            _ if slot.parm != 0 => Self::Guessed(SlaveKind::Drive),
            _ if slot.data1 != 0 && slot.data1 <= 0xFFFF && slot.data2 == 0 => Self::Guessed(SlaveKind::Io),
            _ => Self::Unknown,
        }
    }
}

/// Byte 1 of a slave's slot in a response, by what the firmware puts there (SK-3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ByteOne {
    /// Firmware 1.7: the index of the command answered.
    Index(u8),
    /// Firmware 1.5: the drive's mode of operation, a value of 0x6060; 0 for an IO slave.
    Mode(u8),
}

/// A slave's slot of a response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveReading {
    /// Byte 0: the command executed last for the slave.
    pub id: CommandId,
    /// Byte 1.
    pub byte_one: ByteOne,
    /// What the slave is, and how that is known.
    pub kind: SlotKind,
    /// Bytes 2 and up, read as that kind's.
    pub data: SlaveData,
}

/// Bytes 2 and up of a slave's slot in a response. Each layout repeats bytes 0 and 1 in its `head`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveData {
    /// All zero, and nothing says that a value of 0 is meant.
    Nothing,
    /// A drive's or a stepper's.
    Drive(DriveResponse),
    /// An IO slave's.
    Io(IoResponse),
    /// An HSP's.
    Hsp(HspResponse),
    /// Not to be read: the kind is unknown, or there should be no slave.
    Unread(RawSlot),
}

impl SlaveReading {
    /// Reads a slot, byte 1 as an index. `in_op`: the frame's state is OP, where zeros are values.
    pub(super) fn of(slot: &RawSlot, size: SlotSize, given: Option<SlaveKind>, in_op: bool) -> Self {
        let kind = given.map_or_else(|| SlotKind::from_fields(slot), SlotKind::Given);
        let no_data = RawSlot { id: 0, index: 0, ..*slot }.is_zero();
        let data = match kind.kind() {
            _ if no_data && !in_op => SlaveData::Nothing,
            Some(SlaveKind::Drive | SlaveKind::Step) => SlaveData::Drive(DriveResponse::decode(slot)),
            Some(SlaveKind::Io) => SlaveData::Io(IoResponse::decode(slot)),
            Some(SlaveKind::Hsp) => SlaveData::Hsp(HspResponse::decode(slot, size)),
            Some(SlaveKind::None) | None if no_data => SlaveData::Nothing,
            Some(SlaveKind::None) | None => SlaveData::Unread(*slot),
        };
        Self { id: CommandId::from_code(slot.id), byte_one: ByteOne::Index(slot.index), kind, data }
    }

    fn encode(&self, size: SlotSize) -> RawSlot {
        match &self.data {
            SlaveData::Nothing => {
                let (ByteOne::Index(byte) | ByteOne::Mode(byte)) = self.byte_one;
                RawSlot { id: self.id.code(), index: byte, ..RawSlot::ZERO }
            }
            SlaveData::Drive(drive) => drive.encode(),
            SlaveData::Io(io) => io.encode(),
            SlaveData::Hsp(hsp) => hsp.encode(size),
            SlaveData::Unread(raw) => *raw,
        }
    }
}
