//! Commands with their meaning: one type per kind of slot, always valid, both ways.
//!
//! A slot that cannot be given a meaning is not lost: an id that does not belong into that kind of slot survives as
//! `Other`, a known id with an argument no guide allows is [`Malformed`].

use core::fmt;

use super::id::CommandId;
use super::response::MasterState;
use super::slot::{RawSlot, SlotSize, TwoChannelSlot};
use crate::cia402::Mode;
use crate::coe::{ObjectAddress, SdoSize};

/// What kind of slave a slot drives: a nibble of SET_AXIS (UG17 2.1.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum SlaveKind {
    /// Servo drive.
    Drive = 0,
    /// 16 + 16 digital inputs and outputs: the default of every slot.
    #[default]
    Io = 1,
    /// NEXTW high-speed pulse module, one or two channels.
    Hsp = 2,
    /// Stepper (OBS).
    Step = 3,
    /// No slave.
    None = 0xF,
}

impl SlaveKind {
    /// The kind of a nibble, `None` for 4..=14.
    pub const fn from_nibble(nibble: u8) -> Option<Self> {
        match nibble {
            0 => Some(Self::Drive),
            1 => Some(Self::Io),
            2 => Some(Self::Hsp),
            3 => Some(Self::Step),
            0xF => Some(Self::None),
            _ => None,
        }
    }

    /// 0..=3 or 0xF.
    pub const fn nibble(self) -> u8 {
        self as u8
    }

    /// The guides' name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drive => "DRIVE",
            Self::Io => "IO",
            Self::Hsp => "HSP",
            Self::Step => "STEP",
            Self::None => "None",
        }
    }
}

/// An EtherCAT cycle time SET_DC accepts: 250 us * 2^n, n in 0..=11 (UG17 2.1.4; at most 1 s: OURS).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CycleTime(u32);

impl CycleTime {
    /// The board's default, 1000 us.
    pub const DEFAULT: Self = Self(1000);
    /// SK-4 [OURS]: no cycle is longer than a second.
    const MAX_US: u32 = 1_000_000;

    /// Checks the time: `None` unless it is 250 * 2^n us and at most 1 s.
    pub const fn from_us(us: u32) -> Option<Self> {
        if us <= Self::MAX_US && us.is_multiple_of(250) && (us / 250).is_power_of_two() { Some(Self(us)) } else { None }
    }

    /// Microseconds.
    pub const fn us(self) -> u32 {
        self.0
    }

    /// Nanoseconds.
    pub const fn ns(self) -> u64 {
        self.0 as u64 * 1000
    }
}

/// Data2 of SET_DC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DcShift {
    /// 0xFFFF, as applications send it.
    Auto,
    /// 0xFFFF0000, as the guide's text prints it; the same meaning.
    AutoHigh,
    /// Any other value: accepted, without effect.
    Other(u32),
}

impl DcShift {
    const fn from_raw(raw: u32) -> Self {
        match raw {
            0xFFFF => Self::Auto,
            0xFFFF_0000 => Self::AutoHigh,
            other => Self::Other(other),
        }
    }

    const fn raw(self) -> u32 {
        match self {
            Self::Auto => 0xFFFF,
            Self::AutoHigh => 0xFFFF_0000,
            Self::Other(raw) => raw,
        }
    }
}

/// What SET_FIFO does (UG17 2.1.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FifoAction {
    /// 1: drop the content and the threshold.
    Clear,
    /// 2: take nothing out until the free space falls below this; not 0.
    Threshold(u32),
}

/// DRIVE_TYPE of DRIVE_MODE (UG17 2.1.7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum DriveSync {
    /// 0: each slave runs on its own clock.
    FreeRun = 0,
    /// 1: synchronised by distributed clocks, the default.
    #[default]
    DcSync = 1,
}

/// Why a slot with a known id has no meaning. The engine rejects such a command with this as the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Malformed {
    /// SET_STATE: Data1 is none of 1, 2, 4, 8.
    State(u32),
    /// SET_AXIS: byte 2 is above 4.
    Group(u8),
    /// SET_AXIS: the nibble of this slave is 4..=14.
    Kind {
        /// Slave, 1..=40.
        slave: u8,
        /// The nibble.
        nibble: u8,
    },
    /// SET_DC: Data1 is not 250 us * 2^n or more than 1 s.
    CycleTime(u32),
    /// SET_FIFO: byte 2 is neither 1 nor 2.
    FifoAction(u8),
    /// SET_FIFO 2 with Data1 = 0, a threshold that could never fire.
    ZeroThreshold,
    /// DRIVE_MODE: Data1 is none of 8, 9, 10.
    DriveMode(u32),
    /// DRIVE_MODE: Data2 is neither 0 nor 1.
    DriveType(u32),
    /// SDO_RD, SDO_WR: the slave number is 0 or above 40 (30).
    SdoSlave(u16),
    /// SDO_RD, SDO_WR: the low half of Data1 is above 255.
    SubIndex(u16),
    /// SDO_WR: the high byte of Parm is none of 1, 2, 4.
    SdoSize(u8),
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::State(v) => write!(f, "state {v} is none of 1 Init, 2 PreOP, 4 SafeOP, 8 OP"),
            Self::Group(v) => write!(f, "group {v} is above 4"),
            Self::Kind { slave, nibble } => {
                write!(f, "slave {slave} has kind 0x{nibble:X}: none of 0 drive, 1 IO, 2 HSP, 3 STEP, F none")
            }
            Self::CycleTime(v) => write!(f, "cycle time {v} us is not 250 us * 2^n up to 1 s"),
            Self::FifoAction(v) => write!(f, "FIFO action {v} is neither 1 clear nor 2 threshold"),
            Self::ZeroThreshold => write!(f, "FIFO threshold 0 could never be reached"),
            Self::DriveMode(v) => write!(f, "mode {v} is none of 8 CSP, 9 CSV, 10 CST"),
            Self::DriveType(v) => write!(f, "drive type {v} is neither 0 free run nor 1 DC sync"),
            Self::SdoSlave(v) => write!(f, "the board has no slave {v}"),
            Self::SubIndex(v) => write!(f, "sub-index {v} is above 255"),
            Self::SdoSize(v) => write!(f, "object size {v} is none of 1, 2, 4 bytes"),
        }
    }
}

impl core::error::Error for Malformed {}

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
    /// Write the chip's six outputs, bit k is output k.
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
            _ => Self::Other(*slot),
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
            Self::Other(raw) => raw,
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
    /// Axis 2 of a two-channel HSP in 16-byte mode; any other slave ignores it.
    pub second: AxisTarget,
}

impl Motion {
    /// One axis, no outputs.
    pub const fn to(target: i32) -> Self {
        Self { first: AxisTarget { target, outputs: 0 }, second: AxisTarget { target: 0, outputs: 0 } }
    }

    fn decode(slot: &RawSlot) -> Self {
        let wide = slot.two_channel();
        Self {
            first: AxisTarget { target: wide.counts1.get(), outputs: wide.bits1.get() },
            second: AxisTarget { target: wide.counts2.get(), outputs: wide.bits2.get() },
        }
    }

    fn encode(&self, id: u8, index: u8) -> RawSlot {
        RawSlot::from_two_channel(TwoChannelSlot {
            id,
            index,
            parm: 0.into(),
            counts1: self.first.target.into(),
            bits1: self.first.outputs.into(),
            counts2: self.second.target.into(),
            bits2: self.second.outputs.into(),
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
    /// The meaning of a slave's slot of a command frame.
    ///
    /// # Errors
    /// [`Malformed`] if the id is a slave's command and an argument is not.
    pub fn decode(slot: &RawSlot) -> Result<Self, Malformed> {
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
            CommandId::Csp => SlaveCommand::Csp(Motion::decode(slot)),
            CommandId::Csv => SlaveCommand::Csv(Motion::decode(slot)),
            CommandId::Cst => SlaveCommand::Cst(slot.data1 as i16),
            CommandId::GoHome => SlaveCommand::GoHome,
            CommandId::AbortHome => SlaveCommand::AbortHome,
            _ => SlaveCommand::Other(*slot),
        };
        Ok(Self { index: slot.index, command })
    }

    /// The slot.
    pub fn encode(&self) -> RawSlot {
        let slot = RawSlot { id: self.command.id().code(), index: self.index, ..RawSlot::ZERO };
        match self.command {
            SlaveCommand::DriveMode { mode, sync } => {
                RawSlot { data1: mode.code().into(), data2: u32::from(sync as u8), ..slot }
            }
            SlaveCommand::IoWrite(outputs) => RawSlot { data1: outputs.into(), ..slot },
            SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion) => motion.encode(slot.id, slot.index),
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
