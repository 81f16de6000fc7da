//! Commands for a slave, in its slot.

use crate::cia402::Mode;
use crate::sk::argument::{DriveSync, Malformed};
use crate::sk::id::CommandId;
use crate::sk::slot::{RawSlot, SlotSize, TwoChannelSlot};

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
        Self {
            first: AxisTarget { target: slot.data1 as i32, outputs: slot.data2_low() },
            second: match size {
                SlotSize::Bytes12 => AxisTarget::default(),
                SlotSize::Bytes16 => {
                    let wide = slot.two_channel();
                    AxisTarget { target: wide.counts2.get(), outputs: wide.bits2.get() }
                }
            },
        }
    }

    #[inline]
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
        Self::decode_as(CommandId::from_code(slot.id), slot, size)
    }

    /// The same, where the slot's id is known already.
    #[inline(always)]
    pub(crate) fn decode_as(id: CommandId, slot: &RawSlot, size: SlotSize) -> Result<Self, Malformed> {
        let command = match id {
            CommandId::GetStatus => SlaveCommand::GetStatus,
            CommandId::DriveMode => SlaveCommand::DriveMode {
                mode: u8::try_from(slot.data1)
                    .ok()
                    .and_then(Mode::from_code)
                    .filter(|mode| *mode != Mode::Homing)
                    .ok_or(Malformed::DriveMode(slot.data1))?,
                sync: if slot.data2 == 0 { DriveSync::FreeRun } else { DriveSync::DcSync },
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
    #[inline]
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
