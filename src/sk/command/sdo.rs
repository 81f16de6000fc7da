//! Commands for the SDO slot.

use crate::coe::{ObjectAddress, SdoSize};
use crate::sk::argument::Malformed;
use crate::sk::id::CommandId;
use crate::sk::slot::{RawSlot, SlotSize};

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
    /// The slave is the low byte of Parm, of a read and of a write. The high byte of a read is not looked at: programs put
    /// the object's size there, as a write has it (OBS).
    ///
    /// # Errors
    /// [`Malformed`] if the id is an SDO command and an argument is not.
    pub fn decode(slot: &RawSlot, size: SlotSize) -> Result<Self, Malformed> {
        let [slave, high] = slot.parm.to_le_bytes();
        let target = || {
            if slave == 0 || usize::from(slave) > size.max_slaves() {
                return Err(Malformed::SdoSlave(slave.into()));
            }
            let sub = slot.data1 as u16;
            let sub = u8::try_from(sub).map_err(|_| Malformed::SubIndex(sub))?;
            Ok(ObjectAddress::new((slot.data1 >> 16) as u16, sub))
        };
        Ok(match CommandId::from_code(slot.id) {
            CommandId::GetStatus => Self::GetStatus,
            CommandId::SdoRead => Self::Read { slave, object: target()? },
            CommandId::SdoWrite => {
                let object = target()?;
                let size = SdoSize::from_bytes(high).ok_or(Malformed::SdoSize(high))?;
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
pub(in crate::sk) const fn object_word(object: ObjectAddress) -> u32 {
    (object.index as u32) << 16 | object.sub as u32
}
