//! The meaning of a dump's slots as types, for tools that write another format than text, such as JSON.

use crate::sk::{
    CommandId, DriveResponse, HspResponse, InvalidArgument, IoResponse, MasterCommand, MasterResponse, RawSlot,
    SdoCommand, SdoResponse, SlaveKind, SlotCommand, SlotSize,
};

/// The meaning of a slot, by the frame's direction and the slot's position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotMeaning {
    /// Slot 0 of a command frame.
    MasterCommand(MasterCommand),
    /// A slave's slot of a command frame.
    SlaveCommand(SlotCommand),
    /// The SDO slot of a command frame.
    SdoCommand(SdoCommand),
    /// A command that belongs in the slot and has an argument that no guide allows.
    Malformed(InvalidArgument),
    /// Slot 0 of a response frame.
    MasterResponse(MasterResponse),
    /// A slave's slot of a response frame.
    SlaveResponse(SlaveReading),
    /// The SDO slot of a response frame.
    SdoResponse(SdoResponse),
}

impl SlotMeaning {
    /// Encodes the meaning as a slot, with byte 3 of slot 0 (the CRC) set to 0; `None` for [`Self::Malformed`].
    ///
    /// If the result differs from the decoded slot, that slot has bytes set that its meaning does not use.
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

/// The kind of slave that a response slot belongs to, and how certain it is, since the kind is not on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum KindEvidence {
    /// The caller declared the kind.
    Given(SlaveKind),
    /// Only this kind takes the command that the slot answers.
    Implied(SlaveKind),
    /// The slot's fields are typical of this kind.
    Guessed(SlaveKind),
    /// The slot's fields are typical of no kind.
    Unknown,
}

impl KindEvidence {
    /// The kind, whatever its certainty; `None` if unknown.
    pub const fn kind(self) -> Option<SlaveKind> {
        match self {
            Self::Given(kind) | Self::Implied(kind) | Self::Guessed(kind) => Some(kind),
            Self::Unknown => None,
        }
    }

    /// Applies the rules listed at [`super::ResponseDump`].
    fn from_fields(slot: &RawSlot) -> Self {
        let id = CommandId::from_code(slot.id);
        match id.only_kind() {
            Some(kind) => Self::Implied(kind),
            // Only the two-channel HSP uses bytes 12..15 (`data3`).
            None if slot.data3 != 0 => Self::Guessed(SlaveKind::Hsp),
            None if id.is_for_axes() || slot.parm != 0 => Self::Guessed(SlaveKind::Drive),
            None if slot.data1 != 0 && slot.data1 <= 0xFFFF && slot.data2 == 0 => Self::Guessed(SlaveKind::Io),
            None => Self::Unknown,
        }
    }
}

/// Byte 1 of a slave's slot in a response, whose meaning depends on the firmware (SK-3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ByteOne {
    /// Firmware 1.7: the index of the command answered.
    Index(u8),
    /// Firmware 1.5: the drive's mode of operation, a value of 0x6060; 0 for an IO slave.
    Mode(u8),
}

/// A slave's slot of a response, decoded for the kind of slave that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveReading {
    /// Byte 0: the last command executed for the slave.
    pub id: CommandId,
    /// Byte 1: the index of that command, or the mode of operation.
    pub byte_one: ByteOne,
    /// The kind of the slave, and how certain the kind is.
    pub kind: KindEvidence,
    /// Bytes 2 onward, in the layout of that kind.
    pub data: SlaveData,
}

/// Bytes 2 onward of a slave's slot in a response. Each layout repeats bytes 0 and 1 in its `head`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveData {
    /// All bytes are 0, and zeros are no values here: the network is not in OP, or the kind of slave is unknown.
    Nothing,
    /// The layout of a drive or a stepper.
    Drive(DriveResponse),
    /// The layout of an IO slave.
    Io(IoResponse),
    /// The layout of an HSP.
    Hsp(HspResponse),
    /// Not decoded, because the kind is unknown or no slave was declared for the slot.
    Undecoded(RawSlot),
}

impl SlaveReading {
    /// Decodes a slot, with byte 1 as the command index. `in_op` says that slot 0 reports OP, where zeros are values.
    pub(super) fn of(slot: &RawSlot, size: SlotSize, given: Option<SlaveKind>, in_op: bool) -> Self {
        let kind = given.map_or_else(|| KindEvidence::from_fields(slot), KindEvidence::Given);
        let no_data = RawSlot { id: 0, index: 0, ..*slot }.is_zero();
        let data = match kind.kind() {
            _ if no_data && !in_op => SlaveData::Nothing,
            Some(SlaveKind::Drive | SlaveKind::Step) => SlaveData::Drive(DriveResponse::decode(slot)),
            Some(SlaveKind::Io) => SlaveData::Io(IoResponse::decode(slot)),
            Some(SlaveKind::Hsp) => SlaveData::Hsp(HspResponse::decode(slot, size)),
            Some(SlaveKind::None) | None if no_data => SlaveData::Nothing,
            Some(SlaveKind::None) | None => SlaveData::Undecoded(*slot),
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
            SlaveData::Undecoded(raw) => *raw,
        }
    }
}
