//! Responses with their meaning: what slot 0, the slaves' slots and the SDO slot of a response frame say.
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
//! Which of these types a slave's slot has to be decoded with is not on the wire: it follows from the kind of slave that
//! the application has declared with SET_AXIS.

use core::fmt;

use super::command::object_word;
use super::id::CommandId;
use super::slot::{RawSlot, SlotSize, TwoChannelSlot};
use crate::cia402::Statusword;
use crate::coe::{AbortCode, ObjectAddress};

/// An EtherCAT state of the network that SET_STATE can ask for (UG17 2.1.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum MasterState {
    /// 1: Init.
    Init = 1,
    /// 2: Pre-operational.
    PreOp = 2,
    /// 4: Safe-operational.
    SafeOp = 4,
    /// 8: Operational.
    Op = 8,
}

impl MasterState {
    /// The state that Data1 of SET_STATE asks for; `None` if it is none of 1, 2, 4, 8.
    pub const fn from_request(data1: u32) -> Option<Self> {
        match data1 {
            1 => Some(Self::Init),
            2 => Some(Self::PreOp),
            4 => Some(Self::SafeOp),
            8 => Some(Self::Op),
            _ => None,
        }
    }

    /// The state's value on the wire: 1, 2, 4 or 8.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The name as the guides spell it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Init => "Init",
            Self::PreOp => "PreOP",
            Self::SafeOp => "SafeOP",
            Self::Op => "OP",
        }
    }
}

impl fmt::Display for MasterState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Byte 2 of slot 0 of a response: the current state of the network, or that a slave failed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct StateByte(pub u8);

impl StateByte {
    /// 0: the board has booted and looks for slaves.
    pub const NETWORK_INIT: Self = Self(0);
    /// SK-2 `[OURS]`: the bit that is set beside the last good state when slaves were not found or did not follow.
    pub const FAILED: u8 = 0x10;

    /// The byte that reports that all slaves are in `state`.
    pub const fn reached(state: MasterState) -> Self {
        Self(state.code())
    }

    /// The byte that reports a failure, with the last state that all slaves had reached, if any.
    pub const fn failed(last_good: Option<MasterState>) -> Self {
        match last_good {
            Some(state) => Self(Self::FAILED | state.code()),
            None => Self(Self::FAILED),
        }
    }

    /// Whether the byte reports that no slave was found or that a slave did not reach the state asked for: any value but 0,
    /// 1, 2, 4 and 8 (SK-2).
    pub const fn is_failed(self) -> bool {
        self.0 != Self::NETWORK_INIT.0 && MasterState::from_request(self.0 as u32).is_none()
    }

    /// For a failure, its usual cause and what to do, as a text for users; `None` if the byte reports none. Which slave it
    /// was is not on the wire; a modelled board in this process knows it ([`StateFailure`](crate::engine::StateFailure)).
    pub const fn explanation(self) -> Option<&'static str> {
        if !self.is_failed() {
            return None;
        }
        Some(match (self.0, self.state()) {
            (Self::FAILED, _) | (_, None) => {
                "the board finds no slave, or a slave failed; look at the network cable and at the slaves' power"
            }
            (_, Some(MasterState::Init)) => {
                "a slave did not go to PreOP; look at the slaves' power and at the cable, then SET_STATE again"
            }
            (_, Some(MasterState::PreOp)) => {
                "a slave did not go on from PreOP; most often it is declared as something else than it is, or not at all, \
                 which counts as IO: declare every slave in PreOP with SET_AXIS (0 drive, 1 IO, 2 HSP, 3 STEP, F none) and \
                 its mode with DRIVE_MODE, then SET_STATE again"
            }
            (_, Some(MasterState::Op)) => {
                "a slave has left OP: by its watchdog, if this machine was late, or as its cable or its power is gone; look at its \
                 own display, then send SET_STATE to bring it back"
            }
            (_, Some(MasterState::SafeOp)) => {
                "a slave fell out of the network or refused the next state; look at its power, its cable and its own \
                 display, then send SET_STATE to bring it back"
            }
        })
    }

    /// The state that decides which commands are allowed, which is the low nibble, after a failure too; `None` while the
    /// network is initialised and for unknown values.
    pub const fn state(self) -> Option<MasterState> {
        if self.0 & !(Self::FAILED | 0x0F) != 0 {
            return None;
        }
        MasterState::from_request((self.0 & 0x0F) as u32)
    }
}

impl fmt::Display for StateByte {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.0, self.state()) {
            (0, _) => f.write_str("network initialising"),
            (Self::FAILED, _) => f.write_str("no slave found"),
            (_, Some(state)) if self.is_failed() => write!(f, "{state} (a slave failed)"),
            (_, Some(state)) => state.fmt(f),
            (other, None) => write!(f, "unknown 0x{other:02X} (no slave found, or a slave failed)"),
        }
    }
}

/// Slot 0 of a response (SK-2), without byte 3, the CRC, which belongs to the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MasterResponse {
    /// Byte 0: id of the command answered; [`super::MASTER_CYCLIC`] whenever the state is OP.
    pub id: u8,
    /// Byte 1, the error code: with firmware 1.7 the count of command frames with a wrong CRC, which wraps, so that only a
    /// change of it tells of errors on the wire; with firmware 1.5 a reject code whose values are not published.
    pub error: u8,
    /// Byte 2: the current state.
    pub state: StateByte,
    /// Bytes 4..7: the result of the last command for the board.
    pub result: u32,
    /// Bytes 8..9: in OP how many more entries fit into the command FIFO, 0..=160.
    pub fifo_free: u16,
    /// Bytes 10..11: in OP how many command frames found the FIFO full and were lost.
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

    /// Encodes the response as slot 0, byte 3 (the CRC) 0.
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
    /// Bytes 0..1.
    pub head: SlaveResponse,
    /// Bytes 2..3: object 0x6041.
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
    /// Bytes 0..1.
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
    /// Bytes 0..1.
    pub head: SlaveResponse,
    /// Bytes 2..3: the statusword of axis 1. That of axis 2 is not in the slot.
    pub statusword: Statusword,
    /// Axis 1.
    pub first: HspAxis,
    /// Axis 2 of a two-channel HSP in 16-byte mode, otherwise 0.
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

/// SK-6 `[OURS]`: the bit in Parm of the SDO slot that says that the transfer was aborted and Data2 holds the abort code.
const SDO_ABORTED: u16 = 0x8000;

/// The SDO slot of a response: how the last SDO transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoResponse {
    /// All bytes are 0: no transfer has ended since the board booted.
    Empty,
    /// An object was read or written.
    Done {
        /// SDO_RD or SDO_WR.
        id: CommandId,
        /// The slave's number, 1..=40 (30).
        slave: u8,
        /// Index and sub-index of the object.
        object: ObjectAddress,
        /// The value read, zero-extended, or the value written.
        value: u32,
    },
    /// The slave, or the board on its behalf, aborted the transfer.
    Aborted {
        /// SDO_RD or SDO_WR.
        id: CommandId,
        /// The slave's number, 1..=40 (30).
        slave: u8,
        /// Index and sub-index of the object.
        object: ObjectAddress,
        /// The reason.
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
