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
//! What kind a slave is, and so which of the types a slot is to be read with, is not on the wire: the application said
//! it itself, with SET_AXIS.

use core::fmt;

use super::command::object_word;
use super::id::CommandId;
use super::slot::{RawSlot, SlotSize, TwoChannelSlot};
use crate::cia402::Statusword;
use crate::coe::{AbortCode, ObjectAddress};

/// A state of the network that can be asked for (UG17 2.1.2).
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
    /// The state of Data1 of SET_STATE, `None` if it is none of 1, 2, 4, 8.
    pub const fn from_request(data1: u32) -> Option<Self> {
        match data1 {
            1 => Some(Self::Init),
            2 => Some(Self::PreOp),
            4 => Some(Self::SafeOp),
            8 => Some(Self::Op),
            _ => None,
        }
    }

    /// 1, 2, 4 or 8.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The guides' spelling.
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

/// Byte 2 of slot 0: the current state, every value of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct StateByte(pub u8);

impl StateByte {
    /// 0: the board looks for slaves.
    pub const NETWORK_INIT: Self = Self(0);
    /// SK-2 `[OURS]`: set beside the last good state when slaves were not found or did not follow.
    pub const FAILED: u8 = 0x10;

    /// A state reached.
    pub const fn reached(state: MasterState) -> Self {
        Self(state.code())
    }

    /// A change that failed, and the last state that all slaves reached.
    pub const fn failed(last_good: Option<MasterState>) -> Self {
        match last_good {
            Some(state) => Self(Self::FAILED | state.code()),
            None => Self(Self::FAILED),
        }
    }

    /// No slave found, or a slave does not reach the state asked for: any value but 0, 1, 2, 4 and 8 (SK-2).
    pub const fn is_failed(self) -> bool {
        self.0 != Self::NETWORK_INIT.0 && MasterState::from_request(self.0 as u32).is_none()
    }

    /// What a state that has failed usually means and what to do, for wherever it is shown; `None`: it has not failed. The
    /// wire does not say which slave it was; a board in this process does
    /// ([`StateFailure`](crate::engine::StateFailure)).
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
            (_, Some(MasterState::SafeOp | MasterState::Op)) => {
                "a slave fell out of the network or refused the next state; look at its power, its cable and its own \
                 display, then send SET_STATE to bring it back"
            }
        })
    }

    /// The state by which commands are allowed: the low nibble's, `None` for "network initialising" and unknown values.
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

/// Slot 0 of a response (SK-2). Byte 3, the CRC, is the frame's business.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MasterResponse {
    /// Byte 0: id of the command answered; [`super::MASTER_CYCLIC`] whenever the state is OP.
    pub id: u8,
    /// Byte 1: CRC error count in firmware 1.7; a change is worth a report, no value is an error by itself.
    pub error: u8,
    /// Byte 2: current state.
    pub state: StateByte,
    /// Bytes 4..7: result of the last command for the board.
    pub result: u32,
    /// Bytes 8..9: in OP the free entries of the command FIFO, 0..=160.
    pub fifo_free: u16,
    /// Bytes 10..11: in OP the FIFO-full count; any increase means that commands were lost.
    pub full_count: u16,
}

impl MasterResponse {
    /// The meaning of slot 0 of a response frame.
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

    /// The slot, byte 3 (the CRC) 0.
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

/// A slave's slot of a response, whatever the slave: what all kinds share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SlaveResponse {
    /// Byte 0: id of the command executed last for the slave.
    pub id: u8,
    /// Byte 1: the command's index (firmware 1.7) or the drive's mode of operation (firmware 1.5).
    pub index: u8,
}

/// Slot of a drive or a stepper in a response (UG17 2.1.15).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DriveResponse {
    /// Bytes 0 and 1.
    pub head: SlaveResponse,
    /// Bytes 2..3: 0x6041.
    pub statusword: Statusword,
    /// Bytes 4..7: actual position 0x6064, counts.
    pub position: i32,
    /// Bytes 8..9: actual torque 0x6077, 0.1 % of rated.
    pub torque: i16,
    /// Bytes 10..11: error code 0x603F, 0 is none.
    pub error_code: u16,
}

impl DriveResponse {
    /// The meaning of a drive's slot.
    pub const fn decode(slot: &RawSlot) -> Self {
        Self {
            head: SlaveResponse { id: slot.id, index: slot.index },
            statusword: Statusword(slot.parm),
            position: slot.data1 as i32,
            torque: slot.data2_low() as i16,
            error_code: slot.data2_high(),
        }
    }

    /// The slot.
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

/// Slot of an IO slave in a response (UG17 2.1.13).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct IoResponse {
    /// Bytes 0 and 1.
    pub head: SlaveResponse,
    /// Bytes 4..5: the inputs; the output image in the answer to IO_WR. Bit k is input (output) k.
    pub bits: u16,
}

impl IoResponse {
    /// The meaning of an IO slave's slot.
    pub const fn decode(slot: &RawSlot) -> Self {
        Self { head: SlaveResponse { id: slot.id, index: slot.index }, bits: slot.data1 as u16 }
    }

    /// The slot.
    pub const fn encode(&self) -> RawSlot {
        RawSlot { id: self.head.id, index: self.head.index, parm: 0, data1: self.bits as u32, data2: 0, data3: 0 }
    }
}

/// One axis of an HSP in a response.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HspAxis {
    /// Actual position 0x6064 (0x6864), counts.
    pub position: i32,
    /// Digital inputs 0x60FD (0x68FD), the low 16 bits.
    pub inputs: u16,
}

/// Slot of an HSP in a response (UG17 2.1.15, tables 2.15 and 2.16).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HspResponse {
    /// Bytes 0 and 1.
    pub head: SlaveResponse,
    /// Bytes 2..3: statusword of axis 1.
    pub statusword: Statusword,
    /// Axis 1.
    pub first: HspAxis,
    /// Axis 2 of a two-channel HSP in 16-byte mode, else zero.
    pub second: HspAxis,
}

impl HspResponse {
    /// The meaning of an HSP's slot. In 12-byte mode axis 2 does not travel and is zero.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Self {
        let wide = slot.two_channel();
        Self {
            head: SlaveResponse { id: slot.id, index: slot.index },
            statusword: Statusword(slot.parm),
            first: HspAxis { position: wide.counts1.get(), inputs: wide.bits1.get() },
            second: match size {
                SlotSize::Bytes12 => HspAxis::default(),
                SlotSize::Bytes16 => HspAxis { position: wide.counts2.get(), inputs: wide.bits2.get() },
            },
        }
    }

    /// The slot. In 12-byte mode bytes 10..11 are 0.
    pub fn encode(&self, size: SlotSize) -> RawSlot {
        let second = match size {
            SlotSize::Bytes12 => HspAxis::default(),
            SlotSize::Bytes16 => self.second,
        };
        RawSlot::from_two_channel(TwoChannelSlot {
            id: self.head.id,
            index: self.head.index,
            parm: self.statusword.0.into(),
            counts1: self.first.position.into(),
            bits1: self.first.inputs.into(),
            counts2: second.position.into(),
            bits2: second.inputs.into(),
        })
    }
}

/// SK-6 `[OURS]`: set in Parm of the SDO slot when the transfer was aborted and Data2 holds the code.
const SDO_ABORTED: u16 = 0x8000;

/// The SDO slot of a response: the last transfer that ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoResponse {
    /// No transfer has ended since the board came up: the slot is all zero.
    Empty,
    /// An object was read or written.
    Done {
        /// SDO_RD or SDO_WR.
        id: CommandId,
        /// Slave.
        slave: u8,
        /// Object.
        object: ObjectAddress,
        /// Value read, zero-extended, or written.
        value: u32,
    },
    /// The slave, or the board in its name, refused.
    Aborted {
        /// SDO_RD or SDO_WR.
        id: CommandId,
        /// Slave.
        slave: u8,
        /// Object.
        object: ObjectAddress,
        /// Why.
        code: AbortCode,
    },
    /// Something else than an answer to an SDO command.
    Other(RawSlot),
}

impl SdoResponse {
    /// The meaning of the SDO slot of a response frame.
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

    /// The slot.
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
