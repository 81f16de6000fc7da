//! Commands for one slave, in that slave's slot.

use core::fmt::{self, Formatter};

use crate::ethercat::cia402::Mode;
use crate::sk::argument::{Argument, AxisTarget, DriveSync, InvalidArgument, TorquePercent};
use crate::sk::command_table::CommandId;
use crate::sk::slot::{RawSlot, SlotSize, TwoChannelSlot};

/// The arguments of CSP and CSV: a target for each axis of the slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Motion {
    /// Target of the slave's only axis, or of axis 1 of an HSP (pulse module).
    pub first: AxisTarget,
    /// Target of axis 2 of a two-channel HSP; any other slave ignores it. A slot of 12 bytes has no room for it.
    pub second: AxisTarget,
}

impl Motion {
    /// A target for the slave's only or first axis, with all digital outputs off.
    pub const fn to(target: i32) -> Self {
        Self { first: AxisTarget { target, outputs: 0 }, second: AxisTarget { target: 0, outputs: 0 } }
    }

    fn decode(slot: &RawSlot, size: SlotSize) -> Self {
        let slot = slot.two_channel(size);
        Self {
            first: AxisTarget { target: slot.counts1.get(), outputs: slot.bits1.get() },
            second: AxisTarget { target: slot.counts2.get(), outputs: slot.bits2.get() },
        }
    }

    /// Writes the targets in the form of a dump, with axis 2 only if its target or its outputs are not 0.
    fn write(&self, f: &mut Formatter<'_>, what: &str) -> fmt::Result {
        let axis = |f: &mut Formatter<'_>, axis: &AxisTarget| {
            write!(f, " {what} {}", axis.target)?;
            match axis.outputs {
                0 => Ok(()),
                outputs => write!(f, ", outputs 0x{outputs:04X}"),
            }
        };
        axis(f, &self.first)?;
        if self.second == AxisTarget::default() {
            return Ok(());
        }
        f.write_str("; axis 2")?;
        axis(f, &self.second)
    }

    /// Calls `give` with the name and the value of each target. Outputs and axis 2, which most slaves do not have, are
    /// left out when they are 0.
    fn give(&self, what: &'static str, give: &mut dyn FnMut(&'static str, Argument)) {
        give(what, Argument::Number(self.first.target.into()));
        if self.first.outputs != 0 {
            give("outputs", Argument::Number(self.first.outputs.into()));
        }
        if self.second != AxisTarget::default() {
            give("axis2", Argument::Axis(self.second));
        }
    }

    #[inline]
    fn encode(&self, id: u8, index: u8, size: SlotSize) -> RawSlot {
        let slot = TwoChannelSlot {
            id,
            index,
            parm: 0.into(),
            counts1: self.first.target.into(),
            bits1: self.first.outputs.into(),
            counts2: self.second.target.into(),
            bits2: self.second.outputs.into(),
        };
        RawSlot::from_two_channel(slot, size)
    }
}

/// A command for one slave, in the slot of that slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlaveCommand {
    /// No new request: the slave continues with its last command.
    GetStatus,
    /// Choose the mode of operation and with it the slave's process data, before SafeOP.
    DriveMode {
        /// The mode of operation: CSP, CSV or CST.
        mode: Mode,
        /// The synchronisation: free run or DC sync.
        sync: DriveSync,
    },
    /// Clear a drive's fault: fault reset of CiA 402.
    AlarmClear,
    /// Take the drive through the CiA 402 states up to Operation enabled.
    ServoOn,
    /// Take the drive down to Switch on disabled.
    ServoOff,
    /// Read the inputs of an IO slave.
    IoRead,
    /// Write the outputs of an IO slave: bit k is output k.
    IoWrite(u16),
    /// Cyclic synchronous position.
    Csp(Motion),
    /// Cyclic synchronous velocity.
    Csv(Motion),
    /// Cyclic synchronous torque, in 0.1 % of the rated torque.
    Cst(i16),
    /// Start homing by the method that is set in object 0x6098.
    GoHome,
    /// Abort the homing of all slaves.
    AbortHome,
    /// A command that does not belong in a slave's slot, or an id that no guide lists.
    Other(RawSlot),
}

impl SlaveCommand {
    /// The command's id, byte 0 of its slot.
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

    /// Writes the arguments in the form of a dump, each after a blank.
    pub(in crate::sk) fn write_arguments(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::DriveMode { mode, sync: DriveSync::DcSync } => write!(f, " {mode}, DC sync"),
            Self::DriveMode { mode, sync: DriveSync::FreeRun } => write!(f, " {mode}, free run"),
            Self::IoWrite(outputs) => write!(f, " outputs 0x{outputs:04X}"),
            Self::Csp(motion) => motion.write(f, "target"),
            Self::Csv(motion) => motion.write(f, "velocity"),
            Self::Cst(torque) => write!(f, " torque {}", TorquePercent(*torque)),
            Self::GetStatus
            | Self::AlarmClear
            | Self::ServoOn
            | Self::ServoOff
            | Self::IoRead
            | Self::GoHome
            | Self::AbortHome
            | Self::Other(_) => Ok(()),
        }
    }

    /// Calls `give` once for each argument of the command, with its name and its value.
    pub fn arguments(&self, give: &mut dyn FnMut(&'static str, Argument)) {
        match self {
            Self::DriveMode { mode, sync } => {
                give("mode", Argument::Word(mode.name()));
                let sync = match sync {
                    DriveSync::FreeRun => "free run",
                    DriveSync::DcSync => "dc",
                };
                give("sync", Argument::Word(sync));
            }
            Self::IoWrite(outputs) => give("outputs", Argument::Number((*outputs).into())),
            Self::Csp(motion) => motion.give("target_counts", give),
            Self::Csv(motion) => motion.give("target_velocity", give),
            Self::Cst(torque) => give("target_torque_permille", Argument::Number((*torque).into())),
            Self::GetStatus
            | Self::AlarmClear
            | Self::ServoOn
            | Self::ServoOff
            | Self::IoRead
            | Self::GoHome
            | Self::AbortHome
            | Self::Other(_) => {}
        }
    }

    /// Adds a command index, a number of the caller's choice, which the response repeats.
    pub const fn with_index(self, index: u8) -> SlotCommand {
        SlotCommand { index, command: self }
    }
}

/// The content of a slave's slot: a command and its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotCommand {
    /// Byte 1: a number that the application chooses. Firmware 1.7 repeats it in the response to this command.
    pub index: u8,
    /// Byte 0 and bytes 2 onward: the command and its arguments.
    pub command: SlaveCommand,
}

impl From<SlaveCommand> for SlotCommand {
    fn from(command: SlaveCommand) -> Self {
        command.with_index(0)
    }
}

impl SlotCommand {
    /// Decodes a slave's slot of a command frame. In 12-byte mode axis 2 of an HSP is not on the wire and becomes 0.
    ///
    /// # Errors
    /// [`InvalidArgument`] if the id is a command for a slave and an argument is not allowed.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, InvalidArgument> {
        Self::decode_as(CommandId::from_code(slot.id), slot, size)
    }

    /// [`Self::decode`] for a caller that has already looked up the slot's id.
    #[inline(always)]
    pub(crate) fn decode_as(id: CommandId, slot: &RawSlot, size: SlotSize) -> Result<Self, InvalidArgument> {
        let command = match id {
            CommandId::GetStatus => SlaveCommand::GetStatus,
            CommandId::DriveMode => SlaveCommand::DriveMode {
                mode: u8::try_from(slot.data1)
                    .ok()
                    .and_then(Mode::from_code)
                    .filter(|mode| *mode != Mode::Homing)
                    .ok_or(InvalidArgument::DriveMode(slot.data1))?,
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

    /// Encodes the command as a slave's slot. In 12-byte mode bytes 10..11 of CSP and CSV are 0.
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
            SlaveCommand::GetStatus
            | SlaveCommand::AlarmClear
            | SlaveCommand::ServoOn
            | SlaveCommand::ServoOff
            | SlaveCommand::IoRead
            | SlaveCommand::GoHome
            | SlaveCommand::AbortHome => slot,
        }
    }
}
