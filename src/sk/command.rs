//! Commands with their meaning: one type per kind of slot. Decoding yields only what a board would execute in some
//! state; encoding writes what it is given.
//!
//! A slot that cannot be given a meaning is not lost: an id that does not belong into that kind of slot survives as
//! `Other`, a known id with an argument no guide allows is [`Malformed`].
//!
//! ```
//! use ecmsk::coe::{ObjectAddress, SdoSize};
//! use ecmsk::sk::{Frame, Malformed, SdoCommand, SlotSize};
//!
//! let size = SlotSize::Bytes16;
//! let homing = ObjectAddress::new(0x6060, 0);
//! let mut frame = Frame::new();
//! frame.put_sdo(size, &SdoCommand::Write { slave: 31, object: homing, size: SdoSize::One, value: 6 });
//!
//! let slot = frame.slot(size, size.sdo_slot());
//! assert_eq!(SdoCommand::decode(&slot, size), Err(Malformed::SdoSlave(31)));
//! assert_eq!(Malformed::SdoSlave(31).to_string(), "the board has no slave 31");
//! ```

use super::argument::{CycleTime, DcShift, DriveSync, FifoAction, Malformed, SlaveKind};
use super::id::CommandId;
use super::response::MasterState;
use super::slot::{RawSlot, SlotSize, TwoChannelSlot};
use crate::cia402::Mode;
use crate::coe::{ObjectAddress, SdoSize};

/// A command for the board itself: slot 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MasterCommand {
    /// Ask for nothing.
    GetStatus,
    /// Change the EtherCAT state; takes many cycles.
    SetState(MasterState),
    /// Say what eight slaves are: slave `group * 8 + k + 1` is `kinds[k]`.
    SetAxis {
        /// 0..=4.
        group: u8,
        /// Kinds of the eight slaves; those the board has no slot for are ignored.
        kinds: [SlaveKind; 8],
    },
    /// Set the EtherCAT cycle.
    SetDc {
        /// Cycle time.
        cycle: CycleTime,
        /// Data2.
        shift: DcShift,
    },
    /// Switch the CRCs, from the next boot on.
    SetEx {
        /// Data1 bit 0: check command frames.
        check_commands: bool,
        /// Data1 bit 4: fill response frames.
        fill_responses: bool,
    },
    /// Clear the FIFO or set its threshold.
    SetFifo(FifoAction),
    /// Read the chip's six inputs.
    LocalRead,
    /// Write the chip's six outputs, bit k is output k; bits 6 and 7 have no output and do not travel.
    LocalWrite(u8),
    /// Boot again.
    SoftReset,
    /// An id that has no business in slot 0, or that no guide lists.
    Other(RawSlot),
}

/// SK-8: the chip has six inputs and six outputs.
const LOCAL_BITS: u32 = 0x3F;

impl MasterCommand {
    /// The meaning of slot 0 of a command frame. Byte 3, the CRC, is not looked at.
    ///
    /// # Errors
    /// [`Malformed`] if the id is a board's command and an argument is not.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, Malformed> {
        let argument = slot.parm as u8;
        Ok(match CommandId::from_code(slot.id) {
            CommandId::GetStatus => Self::GetStatus,
            CommandId::SetState => {
                Self::SetState(MasterState::from_request(slot.data1).ok_or(Malformed::State(slot.data1))?)
            }
            CommandId::SetAxis => Self::decode_axes(argument, slot.data1, size)?,
            CommandId::SetDc => Self::SetDc {
                cycle: CycleTime::from_us(slot.data1).ok_or(Malformed::CycleTime(slot.data1))?,
                shift: DcShift::from_raw(slot.data2),
            },
            CommandId::SetEx => {
                Self::SetEx { check_commands: slot.data1 & 1 != 0, fill_responses: slot.data1 & 0x10 != 0 }
            }
            CommandId::SetFifo => Self::SetFifo(match (argument, slot.data1) {
                (1, _) => FifoAction::Clear,
                (2, 0) => return Err(Malformed::ZeroThreshold),
                (2, threshold) => FifoAction::Threshold(threshold),
                (other, _) => return Err(Malformed::FifoAction(other)),
            }),
            CommandId::LocalRead => Self::LocalRead,
            CommandId::LocalWrite => Self::LocalWrite((slot.data1 & LOCAL_BITS) as u8),
            CommandId::SoftReset => Self::SoftReset,
            // Byte 3 is the frame's CRC and no part of a command: two frames with the same command must compare equal.
            _ => Self::Other(RawSlot { parm: argument.into(), ..*slot }),
        })
    }

    fn decode_axes(group: u8, nibbles: u32, size: SlotSize) -> Result<Self, Malformed> {
        if group > 4 {
            return Err(Malformed::Group(group));
        }
        let mut kinds = [SlaveKind::None; 8];
        for (k, kind) in kinds.iter_mut().enumerate() {
            let slave = group as usize * 8 + k + 1;
            let nibble = (nibbles >> (4 * k) & 0xF) as u8;
            match SlaveKind::from_nibble(nibble) {
                Some(known) => *kind = known,
                // SK-4 [OURS]: nibbles of slaves the board has no slot for are ignored.
                None if slave > size.max_slaves() => {}
                None => return Err(Malformed::Kind { slave: slave as u8, nibble }),
            }
        }
        Ok(Self::SetAxis { group, kinds })
    }

    /// The slot, byte 3 (the CRC) 0.
    pub fn encode(&self) -> RawSlot {
        let slot = RawSlot { id: self.id().code(), ..RawSlot::ZERO };
        match *self {
            Self::GetStatus | Self::LocalRead | Self::SoftReset => slot,
            Self::SetState(state) => RawSlot { data1: state.code().into(), ..slot },
            Self::SetAxis { group, kinds } => {
                let nibbles = kinds.iter().rev().fold(0, |acc, kind| acc << 4 | u32::from(kind.nibble()));
                RawSlot { parm: group.into(), data1: nibbles, ..slot }
            }
            Self::SetDc { cycle, shift } => RawSlot { data1: cycle.us(), data2: shift.raw(), ..slot },
            Self::SetEx { check_commands, fill_responses } => {
                RawSlot { data1: u32::from(check_commands) | u32::from(fill_responses) << 4, ..slot }
            }
            Self::SetFifo(FifoAction::Clear) => RawSlot { parm: 1, ..slot },
            Self::SetFifo(FifoAction::Threshold(free)) => RawSlot { parm: 2, data1: free, ..slot },
            Self::LocalWrite(bits) => RawSlot { data1: u32::from(bits) & LOCAL_BITS, ..slot },
            Self::Other(raw) => RawSlot { parm: raw.parm & 0xFF, ..raw },
        }
    }

    /// The command's id.
    pub const fn id(&self) -> CommandId {
        match self {
            Self::GetStatus => CommandId::GetStatus,
            Self::SetState(_) => CommandId::SetState,
            Self::SetAxis { .. } => CommandId::SetAxis,
            Self::SetDc { .. } => CommandId::SetDc,
            Self::SetEx { .. } => CommandId::SetEx,
            Self::SetFifo(_) => CommandId::SetFifo,
            Self::LocalRead => CommandId::LocalRead,
            Self::LocalWrite(_) => CommandId::LocalWrite,
            Self::SoftReset => CommandId::SoftReset,
            Self::Other(raw) => CommandId::from_code(raw.id),
        }
    }
}

/// Target and digital outputs of one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AxisTarget {
    /// CSP: absolute target position, counts. CSV: target velocity, counts/s as the drive scales it.
    pub target: i32,
    /// Outputs of an HSP; a plain drive ignores them.
    pub outputs: u16,
}

/// Arguments of CSP and CSV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Motion {
    /// The axis; of an HSP, axis 1.
    pub first: AxisTarget,
    /// Axis 2 of a two-channel HSP in 16-byte mode; any other slave ignores it. In 12-byte mode it does not travel.
    pub second: AxisTarget,
}

impl Motion {
    /// One axis, no outputs.
    pub const fn to(target: i32) -> Self {
        Self { first: AxisTarget { target, outputs: 0 }, second: AxisTarget { target: 0, outputs: 0 } }
    }

    fn decode(slot: &RawSlot, size: SlotSize) -> Self {
        let wide = slot.two_channel();
        Self {
            first: AxisTarget { target: wide.counts1.get(), outputs: wide.bits1.get() },
            second: match size {
                SlotSize::Bytes12 => AxisTarget::default(),
                SlotSize::Bytes16 => AxisTarget { target: wide.counts2.get(), outputs: wide.bits2.get() },
            },
        }
    }

    fn encode(&self, id: u8, index: u8, size: SlotSize) -> RawSlot {
        let second = match size {
            SlotSize::Bytes12 => AxisTarget::default(),
            SlotSize::Bytes16 => self.second,
        };
        RawSlot::from_two_channel(TwoChannelSlot {
            id,
            index,
            parm: 0.into(),
            counts1: self.first.target.into(),
            bits1: self.first.outputs.into(),
            counts2: second.target.into(),
            bits2: second.outputs.into(),
        })
    }
}

/// A command for one slave: slots 1..=40 (30).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlaveCommand {
    /// Ask for nothing.
    GetStatus,
    /// Choose the mode and thereby the PDOs, before SafeOP.
    DriveMode {
        /// CSP, CSV or CST.
        mode: Mode,
        /// Free run or DC sync.
        sync: DriveSync,
    },
    /// Fault reset.
    AlarmClear,
    /// Walk the drive up to Operation enabled.
    ServoOn,
    /// Walk the drive down to Switch on disabled.
    ServoOff,
    /// Read an IO slave's inputs.
    IoRead,
    /// Write an IO slave's outputs, bit k is output k.
    IoWrite(u16),
    /// Cyclic synchronous position.
    Csp(Motion),
    /// Cyclic synchronous velocity.
    Csv(Motion),
    /// Cyclic synchronous torque, in 0.1 % of the rated torque.
    Cst(i16),
    /// Start homing.
    GoHome,
    /// End the homing of all slaves.
    AbortHome,
    /// An id that has no business in a slave's slot, or that no guide lists.
    Other(RawSlot),
}

impl SlaveCommand {
    /// The command's id.
    pub const fn id(&self) -> CommandId {
        match self {
            Self::GetStatus => CommandId::GetStatus,
            Self::DriveMode { .. } => CommandId::DriveMode,
            Self::AlarmClear => CommandId::AlarmClear,
            Self::ServoOn => CommandId::ServoOn,
            Self::ServoOff => CommandId::ServoOff,
            Self::IoRead => CommandId::IoRead,
            Self::IoWrite(_) => CommandId::IoWrite,
            Self::Csp(_) => CommandId::Csp,
            Self::Csv(_) => CommandId::Csv,
            Self::Cst(_) => CommandId::Cst,
            Self::GoHome => CommandId::GoHome,
            Self::AbortHome => CommandId::AbortHome,
            Self::Other(raw) => CommandId::from_code(raw.id),
        }
    }

    /// With a command index of the caller's choice, which the answer repeats.
    pub const fn with_index(self, index: u8) -> SlotCommand {
        SlotCommand { index, command: self }
    }
}

/// A slave's command and its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotCommand {
    /// Byte 1: a number of the application's own; firmware 1.7 repeats it in the answer.
    pub index: u8,
    /// The command.
    pub command: SlaveCommand,
}

impl From<SlaveCommand> for SlotCommand {
    fn from(command: SlaveCommand) -> Self {
        command.with_index(0)
    }
}

impl SlotCommand {
    /// The meaning of a slave's slot of a command frame. In 12-byte mode axis 2 does not travel and is zero.
    ///
    /// # Errors
    /// [`Malformed`] if the id is a slave's command and an argument is not.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, Malformed> {
        let command = match CommandId::from_code(slot.id) {
            CommandId::GetStatus => SlaveCommand::GetStatus,
            CommandId::DriveMode => SlaveCommand::DriveMode {
                mode: u8::try_from(slot.data1)
                    .ok()
                    .and_then(Mode::from_code)
                    .filter(|mode| *mode != Mode::Homing)
                    .ok_or(Malformed::DriveMode(slot.data1))?,
                sync: match slot.data2 {
                    0 => DriveSync::FreeRun,
                    1 => DriveSync::DcSync,
                    other => return Err(Malformed::DriveType(other)),
                },
            },
            CommandId::AlarmClear => SlaveCommand::AlarmClear,
            CommandId::ServoOn => SlaveCommand::ServoOn,
            CommandId::ServoOff => SlaveCommand::ServoOff,
            CommandId::IoRead => SlaveCommand::IoRead,
            CommandId::IoWrite => SlaveCommand::IoWrite(slot.data1 as u16),
            CommandId::Csp => SlaveCommand::Csp(Motion::decode(slot, size)),
            CommandId::Csv => SlaveCommand::Csv(Motion::decode(slot, size)),
            CommandId::Cst => SlaveCommand::Cst(slot.data1 as i16),
            CommandId::GoHome => SlaveCommand::GoHome,
            CommandId::AbortHome => SlaveCommand::AbortHome,
            _ => SlaveCommand::Other(*slot),
        };
        Ok(Self { index: slot.index, command })
    }

    /// The slot. In 12-byte mode bytes 10..11 of a CSP or CSV are 0.
    pub fn encode(&self, size: SlotSize) -> RawSlot {
        let slot = RawSlot { id: self.command.id().code(), index: self.index, ..RawSlot::ZERO };
        match self.command {
            SlaveCommand::DriveMode { mode, sync } => {
                RawSlot { data1: mode.code().into(), data2: u32::from(sync as u8), ..slot }
            }
            SlaveCommand::IoWrite(outputs) => RawSlot { data1: outputs.into(), ..slot },
            SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion) => motion.encode(slot.id, slot.index, size),
            SlaveCommand::Cst(torque) => RawSlot { data1: u32::from(torque as u16), ..slot },
            SlaveCommand::Other(raw) => RawSlot { index: self.index, ..raw },
            _ => slot,
        }
    }
}

/// A command for the SDO slot, the last one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoCommand {
    /// Ask for nothing.
    GetStatus,
    /// Read an object.
    Read {
        /// Slave, 1..=40 (30).
        slave: u8,
        /// What to read.
        object: ObjectAddress,
    },
    /// Write an object.
    Write {
        /// Slave, 1..=40 (30).
        slave: u8,
        /// What to write.
        object: ObjectAddress,
        /// The object's size.
        size: SdoSize,
        /// The value, as it stands in Data2; bytes beyond `size` do not reach the slave.
        value: u32,
    },
    /// An id that has no business in the SDO slot, or that no guide lists.
    Other(RawSlot),
}

impl SdoCommand {
    /// The meaning of the SDO slot of a command frame.
    ///
    /// # Errors
    /// [`Malformed`] if the id is an SDO command and an argument is not.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, Malformed> {
        let target = |slave: u16| {
            if slave == 0 || usize::from(slave) > size.max_slaves() {
                return Err(Malformed::SdoSlave(slave));
            }
            let sub = slot.data1 as u16;
            let sub = u8::try_from(sub).map_err(|_| Malformed::SubIndex(sub))?;
            Ok((slave as u8, ObjectAddress::new((slot.data1 >> 16) as u16, sub)))
        };
        Ok(match CommandId::from_code(slot.id) {
            CommandId::GetStatus => Self::GetStatus,
            CommandId::SdoRead => {
                let (slave, object) = target(slot.parm)?;
                Self::Read { slave, object }
            }
            CommandId::SdoWrite => {
                let (slave, object) = target(slot.parm & 0xFF)?;
                let bytes = (slot.parm >> 8) as u8;
                let size = SdoSize::from_bytes(bytes).ok_or(Malformed::SdoSize(bytes))?;
                Self::Write { slave, object, size, value: slot.data2 }
            }
            _ => Self::Other(*slot),
        })
    }

    /// The slot.
    pub fn encode(&self) -> RawSlot {
        let slot = RawSlot { id: self.id().code(), ..RawSlot::ZERO };
        match *self {
            Self::GetStatus => slot,
            Self::Read { slave, object } => RawSlot { parm: slave.into(), data1: object_word(object), ..slot },
            Self::Write { slave, object, size, value } => RawSlot {
                parm: u16::from(slave) | u16::from(size.bytes()) << 8,
                data1: object_word(object),
                data2: value,
                ..slot
            },
            Self::Other(raw) => raw,
        }
    }

    /// The command's id.
    pub const fn id(&self) -> CommandId {
        match self {
            Self::GetStatus => CommandId::GetStatus,
            Self::Read { .. } => CommandId::SdoRead,
            Self::Write { .. } => CommandId::SdoWrite,
            Self::Other(raw) => CommandId::from_code(raw.id),
        }
    }
}

/// Data1 of the SDO slot: `index << 16 | sub-index`.
pub(super) const fn object_word(object: ObjectAddress) -> u32 {
    (object.index as u32) << 16 | object.sub as u32
}
