//! Commands for the SDO slot.

use core::fmt::{self, Formatter};

use crate::ethercat::coe::{ObjectAddress, SdoSize};
use crate::sk::argument::{Argument, InvalidArgument};
use crate::sk::command_table::CommandId;
use crate::sk::slot::{RawSlot, SlotSize, object_word};

/// A command for the SDO slot, the last slot of a frame. The board transfers one object at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoCommand {
    /// No request: GET_STATUS.
    GetStatus,
    /// Read an object of a slave: SDO upload.
    Read {
        /// The slave's number, 1..=40 (1..=30 in 16-byte mode).
        slave: u8,
        /// Index and sub-index of the object.
        object: ObjectAddress,
    },
    /// Write an object of a slave: expedited SDO download.
    Write {
        /// The slave's number, 1..=40 (1..=30 in 16-byte mode).
        slave: u8,
        /// Index and sub-index of the object.
        object: ObjectAddress,
        /// Number of bytes of `value` to send, which must be the object's size.
        size: SdoSize,
        /// Data2: the value. Bytes beyond `size` do not reach the slave.
        value: u32,
    },
    /// A command that does not belong in the SDO slot, or an id that no guide lists.
    Other(RawSlot),
}

impl SdoCommand {
    /// The slave and the object of a transfer; `None` if the command is not a transfer.
    pub const fn target(&self) -> Option<(u8, ObjectAddress)> {
        match *self {
            Self::Read { slave, object } | Self::Write { slave, object, .. } => Some((slave, object)),
            Self::GetStatus | Self::Other(_) => None,
        }
    }

    /// Decodes the SDO slot of a command frame.
    ///
    /// The slave is the low byte of Parm, in a read as in a write. The high byte of a read is ignored: programs put the
    /// object's size there, as in a write (OBS).
    ///
    /// # Errors
    /// [`InvalidArgument`] if the id is an SDO command and an argument is not allowed.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, InvalidArgument> {
        let [slave, high] = slot.parm.to_le_bytes();
        let target = || {
            if slave == 0 || usize::from(slave) > size.max_slaves() {
                return Err(InvalidArgument::SdoSlave(slave.into()));
            }
            let sub = slot.data1 as u16;
            let sub = u8::try_from(sub).map_err(|_| InvalidArgument::SubIndex(sub))?;
            Ok(ObjectAddress::new((slot.data1 >> 16) as u16, sub))
        };
        Ok(match CommandId::from_code(slot.id) {
            CommandId::GetStatus => Self::GetStatus,
            CommandId::SdoRead => Self::Read { slave, object: target()? },
            CommandId::SdoWrite => {
                let object = target()?;
                let size = SdoSize::from_bytes(high).ok_or(InvalidArgument::SdoSize(high))?;
                Self::Write { slave, object, size, value: slot.data2 }
            }
            _ => Self::Other(*slot),
        })
    }

    /// Encodes the command as the SDO slot.
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

    /// Writes the arguments in the form of a dump, each after a blank.
    pub(in crate::sk) fn write_arguments(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Read { slave, object } => write!(f, " slave {slave} {object}"),
            Self::Write { slave, object, size, value } => {
                let bits = match size {
                    SdoSize::One => "u8",
                    SdoSize::Two => "u16",
                    SdoSize::Four => "u32",
                };
                write!(f, " slave {slave} {object} {bits} = {}", value & size.mask())?;
                if value & !size.mask() != 0 {
                    write!(f, " (of 0x{value:08X})")?;
                }
                Ok(())
            }
            Self::GetStatus | Self::Other(_) => Ok(()),
        }
    }

    /// Calls `give` once for each argument of the command, with its name and its value.
    pub fn arguments(&self, give: &mut dyn FnMut(&'static str, Argument)) {
        let mut transfer = |slave: u8, object| {
            give("slave", Argument::Number(slave.into()));
            give("object", Argument::Object(object));
        };
        match *self {
            Self::Read { slave, object } => transfer(slave, object),
            Self::Write { slave, object, size, value } => {
                transfer(slave, object);
                give("size_bytes", Argument::Number(size.bytes().into()));
                give("value", Argument::Number(value.into()));
            }
            Self::GetStatus | Self::Other(_) => {}
        }
    }

    /// The command's id, byte 0 of its slot.
    pub const fn id(&self) -> CommandId {
        match self {
            Self::GetStatus => CommandId::GetStatus,
            Self::Read { .. } => CommandId::SdoRead,
            Self::Write { .. } => CommandId::SdoWrite,
            Self::Other(raw) => CommandId::from_code(raw.id),
        }
    }
}
