//! Commands with their meaning: one type per kind of slot. Decoding yields only commands that the board executes in at
//! least one state of the network. Encoding does not check its arguments.
//!
//! A command that does not belong in the kind of slot being decoded becomes `Other`. A command with an argument that no
//! guide allows is the error [`InvalidArgument`].
//!
//! ```
//! use ecmsk::coe::{ObjectAddress, SdoSize};
//! use ecmsk::sk::{Frame, InvalidArgument, SdoCommand, SlotSize};
//!
//! let size = SlotSize::Bytes16;
//! let homing = ObjectAddress::new(0x6060, 0);
//! let mut frame = Frame::new();
//! frame.put_sdo(size, &SdoCommand::Write { slave: 31, object: homing, size: SdoSize::One, value: 6 });
//!
//! let slot = frame.slot(size, size.sdo_slot());
//! assert_eq!(SdoCommand::decode(&slot, size), Err(InvalidArgument::SdoSlave(31)));
//! assert_eq!(InvalidArgument::SdoSlave(31).to_string(), "the board has no slave 31");
//! ```

mod sdo;
mod slave;

use core::fmt::{self, Display, Formatter};

use super::argument::{Argument, CycleTime, DcShift, FifoAction, InvalidArgument, SlaveKind};
use super::command_table::CommandId;
use super::slot::{RawSlot, SlotSize};
use super::state::MasterState;

pub use super::argument::AxisTarget;
pub use sdo::SdoCommand;
pub use slave::{Motion, SlaveCommand, SlotCommand};

/// A command for the board itself, in slot 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MasterCommand {
    /// No request: the board answers with the state of the network alone.
    GetStatus,
    /// Change the EtherCAT state of all slaves; takes many cycles.
    SetState(MasterState),
    /// Declare the kinds of eight slaves: slave `group * 8 + k + 1` is `kinds[k]`.
    SetAxis {
        /// Byte 2 of the slot: the number of the group of eight slaves, 0..=4.
        group: u8,
        /// The kinds of the eight slaves. Kinds of slaves for which the board has no slot are ignored.
        kinds: [SlaveKind; 8],
    },
    /// Set the EtherCAT cycle and the distributed clocks.
    SetDc {
        /// Data1: the cycle time.
        cycle: CycleTime,
        /// Data2: the shift of SYNC0.
        shift: DcShift,
    },
    /// Enable or disable the CRCs of command frames and of response frames, from the board's next boot on.
    SetEx {
        /// Data1 bit 0: the board checks the CRC of command frames.
        check_commands: bool,
        /// Data1 bit 4: the board fills in the CRC of response frames.
        fill_responses: bool,
    },
    /// Clear the command FIFO or set its threshold.
    SetFifo(FifoAction),
    /// Read the board's own six digital inputs.
    LocalRead,
    /// Write the board's own six digital outputs: bit k is output k. Bits 6 and 7 have no output and are not sent.
    LocalWrite(u8),
    /// Reset the board, which then boots again.
    SoftReset,
    /// A command that does not belong in slot 0, or an id that no guide lists.
    Other(RawSlot),
}

/// The bits of LIO_WR that have an output: the board itself has six digital outputs (SK-8).
const LOCAL_OUTPUTS_MASK: u32 = 0x3F;

impl MasterCommand {
    /// Whether the board executes the command on arrival and thereby discards the entries of its FIFO (SK-5).
    pub fn discards_fifo(&self) -> bool {
        match self {
            Self::SetFifo(action) => *action == FifoAction::Clear,
            Self::SetState(state) => *state != MasterState::Op,
            Self::SoftReset => true,
            Self::GetStatus
            | Self::SetAxis { .. }
            | Self::SetDc { .. }
            | Self::SetEx { .. }
            | Self::LocalRead
            | Self::LocalWrite(_)
            | Self::Other(_) => false,
        }
    }

    /// Decodes slot 0 of a command frame. Byte 3, the frame's CRC, is ignored.
    ///
    /// # Errors
    /// [`InvalidArgument`] if the id is a command for the board and an argument is not allowed.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, InvalidArgument> {
        let argument = slot.parm as u8;
        Ok(match CommandId::from_code(slot.id) {
            CommandId::GetStatus => Self::GetStatus,
            CommandId::SetState => {
                Self::SetState(MasterState::from_request(slot.data1).ok_or(InvalidArgument::State(slot.data1))?)
            }
            CommandId::SetAxis => Self::decode_axes(argument, slot.data1, size)?,
            CommandId::SetDc => Self::SetDc {
                cycle: CycleTime::from_us(slot.data1).ok_or(InvalidArgument::CycleTime(slot.data1))?,
                shift: DcShift::from_raw(slot.data2),
            },
            CommandId::SetEx => {
                Self::SetEx { check_commands: slot.data1 & 1 != 0, fill_responses: slot.data1 & 0x10 != 0 }
            }
            CommandId::SetFifo => Self::SetFifo(match (argument, slot.data1) {
                (1, _) => FifoAction::Clear,
                (2, 0) => return Err(InvalidArgument::ZeroThreshold),
                (2, threshold) => FifoAction::Threshold(threshold),
                (other, _) => return Err(InvalidArgument::FifoAction(other)),
            }),
            CommandId::LocalRead => Self::LocalRead,
            CommandId::LocalWrite => Self::LocalWrite((slot.data1 & LOCAL_OUTPUTS_MASK) as u8),
            CommandId::SoftReset => Self::SoftReset,
            // Byte 3 is the frame's CRC and not part of the command: the same command in two frames must compare equal.
            _ => Self::Other(RawSlot { parm: argument.into(), ..*slot }),
        })
    }

    fn decode_axes(group: u8, nibbles: u32, size: SlotSize) -> Result<Self, InvalidArgument> {
        if group > 4 {
            return Err(InvalidArgument::Group(group));
        }
        let mut kinds = [SlaveKind::None; 8];
        for (k, kind) in kinds.iter_mut().enumerate() {
            let slave = group as usize * 8 + k + 1;
            let nibble = (nibbles >> (4 * k) & 0xF) as u8;
            match SlaveKind::from_nibble(nibble) {
                Some(known) => *kind = known,
                // SK-4 [OURS]: nibbles of slaves for which the board has no slot are ignored.
                None if slave > size.max_slaves() => {}
                None => return Err(InvalidArgument::Kind { slave: slave as u8, nibble }),
            }
        }
        Ok(Self::SetAxis { group, kinds })
    }

    /// Encodes the command as slot 0, with byte 3 (the frame's CRC) set to 0.
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
            Self::LocalWrite(bits) => RawSlot { data1: u32::from(bits) & LOCAL_OUTPUTS_MASK, ..slot },
            Self::Other(raw) => RawSlot { parm: raw.parm & 0xFF, ..raw },
        }
    }

    /// The command's id, byte 0 of its slot.
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

    /// Writes the arguments in the form of a dump, each after a blank.
    pub(super) fn write_arguments(&self, f: &mut Formatter<'_>, size: SlotSize) -> fmt::Result {
        match *self {
            Self::SetState(state) => write!(f, " {state}"),
            Self::SetAxis { group, kinds } => write_axes(f, group, &kinds, size),
            Self::SetDc { cycle, shift } => {
                write!(f, " {} us, ", cycle.us())?;
                match shift {
                    DcShift::Auto => f.write_str("auto shift"),
                    DcShift::AutoHigh => f.write_str("auto shift (0xFFFF0000)"),
                    DcShift::Other(raw) => write!(f, "shift 0x{raw:08X} (without effect)"),
                }
            }
            Self::SetEx { check_commands, fill_responses } => {
                let word = |on| if on { "on" } else { "off" };
                write!(f, " command CRC check {}, response CRC {}", word(check_commands), word(fill_responses))
            }
            Self::SetFifo(FifoAction::Clear) => f.write_str(" clear"),
            Self::SetFifo(FifoAction::Threshold(free)) => write!(f, " threshold {free}"),
            Self::LocalWrite(outputs) => write!(f, " outputs 0b{outputs:06b}"),
            Self::GetStatus | Self::LocalRead | Self::SoftReset | Self::Other(_) => Ok(()),
        }
    }

    /// Calls `give` once for each argument of the command, with its name and its value.
    pub fn arguments(&self, give: &mut dyn FnMut(&'static str, Argument)) {
        match *self {
            Self::SetState(state) => give("state", Argument::Word(state.name())),
            Self::SetAxis { group, kinds } => {
                give("group", Argument::Number(group.into()));
                give("kinds", Argument::Kinds(kinds));
            }
            Self::SetDc { cycle, shift } => {
                give("cycle_us", Argument::Number(cycle.us().into()));
                let shift = match shift {
                    DcShift::Auto | DcShift::AutoHigh => "auto",
                    DcShift::Other(_) => "without effect",
                };
                give("shift", Argument::Word(shift));
            }
            Self::SetEx { check_commands, fill_responses } => {
                give("check_commands", Argument::Flag(check_commands));
                give("fill_responses", Argument::Flag(fill_responses));
            }
            Self::SetFifo(FifoAction::Clear) => give("action", Argument::Word("clear")),
            Self::SetFifo(FifoAction::Threshold(free)) => {
                give("action", Argument::Word("threshold"));
                give("threshold_entries", Argument::Number(free.into()));
            }
            Self::LocalWrite(outputs) => give("outputs", Argument::Number(outputs.into())),
            Self::GetStatus | Self::LocalRead | Self::SoftReset | Self::Other(_) => {}
        }
    }
}

/// The arguments of SET_AXIS, such as ` group 0: 1 DRIVE, 2 IO, 3..8 none`. Three or more neighbours of the same kind are
/// written as a range.
fn write_axes(f: &mut Formatter<'_>, group: u8, kinds: &[SlaveKind; 8], size: SlotSize) -> fmt::Result {
    write!(f, " group {group}:")?;
    let first = usize::from(group) * 8 + 1;
    let slaves_of_group = size.max_slaves().saturating_sub(first - 1).min(8);
    let mut comma = "";
    let mut k = 0;
    while k < slaves_of_group {
        let equal = kinds[k..slaves_of_group].iter().take_while(|kind| **kind == kinds[k]).count();
        let run = if equal >= 3 { equal } else { 1 };
        write!(f, "{comma} {} {}", SlaveRange(first + k, first + k + run - 1), kinds[k].dump_name())?;
        comma = ",";
        k += run;
    }
    if slaves_of_group < 8 {
        write!(f, "{comma} {} ignored", SlaveRange(first + slaves_of_group, first + 7))?;
    }
    Ok(())
}

/// The first and the last slave of a range, both included, as text: `5`, or `6..8` for slaves 6 to 8.
struct SlaveRange(usize, usize);

impl Display for SlaveRange {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self(first, last) if first == last => write!(f, "{first}"),
            Self(first, last) => write!(f, "{first}..{last}"),
        }
    }
}
