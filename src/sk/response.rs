//! Responses with their meaning: slot 0, the slaves' slots and the SDO slot of a response frame.
//!
//! ```
//! use ecmsk::cia402::DriveState;
//! use ecmsk::sk::{CrcError, CrcPolicy, DriveResponse, Frame, MasterResponse, MasterState, SlotSize};
//!
//! /// The position of slave 1 in counts, once it is on.
//! fn position(report: &Frame) -> Result<Option<i32>, CrcError> {
//!     let size = SlotSize::Bytes12;
//!     report.check_crc(size, CrcPolicy::AbsentAllowed)?;
//!     let board = MasterResponse::decode(&report.slot(size, 0));
//!     let drive = DriveResponse::decode(&report.slot(size, 1));
//!     let on = drive.statusword.state() == Some(DriveState::OperationEnabled);
//!     Ok((board.state.state() == Some(MasterState::Op) && on).then_some(drive.position))
//! }
//!
//! let mut report = Frame::new();
//! report.bytes_mut()[..3].copy_from_slice(&[0xBF, 0, 0x08]);
//! report.bytes_mut()[12..20].copy_from_slice(&[0x15, 0, 0x37, 0x16, 0x2A, 0, 0, 0]);
//! assert_eq!(position(&report), Ok(Some(42)));
//! report.bytes_mut()[3] = 1;
//! assert!(position(&report).is_err());
//! ```
//!
//! The wire does not show which of these types fits a slave's slot. It follows from the kind of slave that the
//! application has declared with SET_AXIS.

use super::command_table::CommandId;
use super::slot::{RawSlot, SlotSize, TwoChannelSlot, object_word};
pub use super::state::{MasterState, StateByte};
use crate::ethercat::cia402::Statusword;
use crate::ethercat::coe::{AbortCode, ObjectAddress};

/// Slot 0 of a response (SK-2), without byte 3, the CRC, which belongs to the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MasterResponse {
    /// Byte 0: id of the answered command; [`super::MASTER_CYCLIC`] whenever the state is OP.
    pub id: u8,
    /// Byte 1, the error code. With firmware 1.7 it counts command frames with a wrong CRC and wraps, so only a change
    /// of it shows errors on the wire. With firmware 1.5 it is a reject code whose values are not published.
    pub error: u8,
    /// Byte 2: the current state of the network, or a failure.
    pub state: StateByte,
    /// Bytes 4..7: the result of the last command for the board itself. Its meaning depends on the command.
    pub result: u32,
    /// Bytes 8..9: in OP the number of free entries of the command FIFO, 0..=160.
    pub fifo_free: u16,
    /// Bytes 10..11: in OP the number of command frames that found the FIFO full and were lost.
    pub full_count: u16,
}

impl MasterResponse {
    /// Decodes slot 0 of a response frame.
    pub const fn decode(slot: &RawSlot) -> Self {
        Self {
            id: slot.id,
            error: slot.index,
            state: StateByte(slot.parm as u8),
            result: slot.data1,
            fifo_free: slot.data2_low(),
            full_count: slot.data2_high(),
        }
    }

    /// Encodes the response as slot 0, with byte 3 (the frame's CRC) set to 0.
    pub const fn encode(&self) -> RawSlot {
        RawSlot {
            id: self.id,
            index: self.error,
            parm: self.state.0 as u16,
            data1: self.result,
            data2: self.fifo_free as u32 | (self.full_count as u32) << 16,
            data3: 0,
        }
    }
}

/// The first two bytes of a slave's slot in a response, which all kinds of slaves share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SlaveResponse {
    /// Byte 0: id of the last command executed for the slave.
    pub id: u8,
    /// Byte 1: that command's index (firmware 1.7) or the drive's mode of operation (firmware 1.5).
    pub index: u8,
}

/// The slot of a servo drive or a stepper in a response (UG17 2.1.15).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DriveResponse {
    /// Bytes 0..1: the id of the last command executed for the slave, and its index (firmware 1.7).
    pub head: SlaveResponse,
    /// Bytes 2..3: the statusword, object 0x6041.
    pub statusword: Statusword,
    /// Bytes 4..7: the actual position, object 0x6064, in counts.
    pub position: i32,
    /// Bytes 8..9: the actual torque, object 0x6077, in 0.1 % of the rated torque.
    pub torque: i16,
    /// Bytes 10..11: the error code, object 0x603F; 0 means no error.
    pub error_code: u16,
}

impl DriveResponse {
    /// Decodes a drive's slot of a response frame.
    pub const fn decode(slot: &RawSlot) -> Self {
        Self {
            head: SlaveResponse { id: slot.id, index: slot.index },
            statusword: Statusword(slot.parm),
            position: slot.data1 as i32,
            torque: slot.data2_low() as i16,
            error_code: slot.data2_high(),
        }
    }

    /// Encodes the response as a slot.
    pub const fn encode(&self) -> RawSlot {
        RawSlot {
            id: self.head.id,
            index: self.head.index,
            parm: self.statusword.0,
            data1: self.position as u32,
            data2: self.torque as u16 as u32 | (self.error_code as u32) << 16,
            data3: 0,
        }
    }
}

/// The slot of an IO slave in a response (UG17 2.1.13).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct IoResponse {
    /// Bytes 0..1: the id of the last command executed for the slave, and its index (firmware 1.7).
    pub head: SlaveResponse,
    /// Bytes 4..5: the inputs, or the outputs in the answer to IO_WR. Bit k is input (output) k.
    pub bits: u16,
}

impl IoResponse {
    /// Decodes an IO slave's slot of a response frame.
    pub const fn decode(slot: &RawSlot) -> Self {
        Self { head: SlaveResponse { id: slot.id, index: slot.index }, bits: slot.data1 as u16 }
    }

    /// Encodes the response as a slot.
    pub const fn encode(&self) -> RawSlot {
        RawSlot { id: self.head.id, index: self.head.index, parm: 0, data1: self.bits as u32, data2: 0, data3: 0 }
    }
}

/// One axis of an HSP in a response.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HspAxis {
    /// The actual position in counts: object 0x6064, of axis 2 0x6864.
    pub position: i32,
    /// The low 16 digital inputs: object 0x60FD, of axis 2 0x68FD.
    pub inputs: u16,
}

/// The slot of an HSP in a response (UG17 2.1.15, tables 2.15 and 2.16).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HspResponse {
    /// Bytes 0..1: the id of the last command executed for the slave, and its index (firmware 1.7).
    pub head: SlaveResponse,
    /// Bytes 2..3: the statusword of axis 1. The slot does not contain the statusword of axis 2.
    pub statusword: Statusword,
    /// The position and the inputs of axis 1.
    pub first: HspAxis,
    /// The position and the inputs of axis 2, for a two-channel HSP in 16-byte mode; otherwise 0.
    pub second: HspAxis,
}

impl HspResponse {
    /// Decodes an HSP's slot of a response frame. In 12-byte mode axis 2 is not on the wire and becomes 0.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Self {
        let wide = slot.two_channel(size);
        Self {
            head: SlaveResponse { id: slot.id, index: slot.index },
            statusword: Statusword(slot.parm),
            first: HspAxis { position: wide.counts1.get(), inputs: wide.bits1.get() },
            second: HspAxis { position: wide.counts2.get(), inputs: wide.bits2.get() },
        }
    }

    /// Encodes the response as a slot. In 12-byte mode bytes 10..11 are 0.
    pub fn encode(&self, size: SlotSize) -> RawSlot {
        let slot = TwoChannelSlot {
            id: self.head.id,
            index: self.head.index,
            parm: self.statusword.0.into(),
            counts1: self.first.position.into(),
            bits1: self.first.inputs.into(),
            counts2: self.second.position.into(),
            bits2: self.second.inputs.into(),
        };
        RawSlot::from_two_channel(slot, size)
    }
}

/// SK-6 `[OURS]`: bit of Parm in the SDO slot. When set, the transfer was aborted and Data2 holds the abort code.
const SDO_ABORTED: u16 = 0x8000;

/// The SDO slot of a response: how the last SDO transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoResponse {
    /// All bytes are 0: no transfer has ended since the board booted.
    Empty,
    /// An object was read or written.
    Done {
        /// The answered command: SDO_RD or SDO_WR.
        id: CommandId,
        /// The slave's number, 1..=40 (1..=30 in 16-byte mode).
        slave: u8,
        /// Index and sub-index of the object.
        object: ObjectAddress,
        /// The value read, zero-extended, or the value written.
        value: u32,
    },
    /// The slave, or the board on its behalf, aborted the transfer.
    Aborted {
        /// The answered command: SDO_RD or SDO_WR.
        id: CommandId,
        /// The slave's number, 1..=40 (1..=30 in 16-byte mode).
        slave: u8,
        /// Index and sub-index of the object.
        object: ObjectAddress,
        /// The abort code of the SDO transfer.
        code: AbortCode,
    },
    /// The slot holds no answer to an SDO command.
    Other(RawSlot),
}

impl SdoResponse {
    /// Decodes the SDO slot of a response frame.
    pub const fn decode(slot: &RawSlot) -> Self {
        let id = CommandId::from_code(slot.id);
        let object = ObjectAddress::new((slot.data1 >> 16) as u16, slot.data1 as u8);
        let slave = slot.parm as u8;
        match (id, slot.parm & !(SDO_ABORTED | 0xFF), slot.data1 & 0xFF00) {
            (CommandId::GetStatus, ..) if slot.is_zero() => Self::Empty,
            (CommandId::SdoRead | CommandId::SdoWrite, 0, 0) if slot.parm & SDO_ABORTED != 0 => {
                Self::Aborted { id, slave, object, code: AbortCode(slot.data2) }
            }
            (CommandId::SdoRead | CommandId::SdoWrite, 0, 0) => Self::Done { id, slave, object, value: slot.data2 },
            _ => Self::Other(*slot),
        }
    }

    /// Encodes the response as a slot.
    pub const fn encode(&self) -> RawSlot {
        let (id, parm, object, data2) = match *self {
            Self::Empty => return RawSlot::ZERO,
            Self::Other(raw) => return raw,
            Self::Done { id, slave, object, value } => (id, slave as u16, object, value),
            Self::Aborted { id, slave, object, code } => (id, slave as u16 | SDO_ABORTED, object, code.0),
        };
        RawSlot { id: id.code(), index: 0, parm, data1: object_word(object), data2, data3: 0 }
    }
}
