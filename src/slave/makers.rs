//! Objects of a drive's maker: 0x2000 and others that programs write before they go on, and that no simulated slave has by
//! itself. They have no effect: what is written is read back.
//!
//! ```
//! use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
//! use ecmsk::slave::{Drive, DriveConfig, MakersObjects, Slave};
//! use ecmsk::ethercat::AlState;
//!
//! let text = "0x2101:1 u16 rw 0x0010 Motor code\n0x2102:0 i32 ro -5 Encoder offset\n";
//! let mut drive = Drive::new(DriveConfig::default());
//! drive.give_makers_objects(MakersObjects::parse(text).unwrap());
//! drive.enter(AlState::PreOp).unwrap();
//!
//! let code = ObjectAddress::new(0x2101, 1);
//! assert_eq!(drive.upload(code).unwrap().bits, 0x10);
//! drive.download(code, SdoSize::Two, 0x20).unwrap();
//! assert_eq!(drive.upload(code).unwrap().bits, 0x20);
//! assert_eq!(drive.download(code, SdoSize::Four, 1), Err(AbortCode::TOO_LONG));
//! ```

mod format;

use std::fmt;

use super::SdoValue;
use super::dictionary::{Access, number_of, put_first};
use crate::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};

pub use format::{FormatError, MAKERS_BYTES_MAX};

/// Data type of a maker's object. The board moves 4 bytes at most: of longer ones it reads the first 4, and it can write
/// none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MakersType {
    /// `bool`, one byte.
    Bool,
    /// `i8`.
    I8,
    /// `u8`.
    U8,
    /// `i16`.
    I16,
    /// `u16`.
    U16,
    /// `i32`.
    I32,
    /// `u32`.
    U32,
    /// `f32`, IEEE 754.
    F32,
    /// `i64`.
    I64,
    /// `u64`.
    U64,
    /// `f64`, IEEE 754.
    F64,
    /// `text`, its first 8 bytes.
    Text,
    /// `any`: 4 bytes at most, nobody knows how many, as an object that was read over the board. A write of 1, 2 and 4
    /// bytes is taken.
    Any,
}

impl MakersType {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::Bool,
        Self::I8,
        Self::U8,
        Self::I16,
        Self::U16,
        Self::I32,
        Self::U32,
        Self::F32,
        Self::I64,
        Self::U64,
        Self::F64,
        Self::Text,
        Self::Any,
    ];

    /// Its word in a file.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::I8 => "i8",
            Self::U8 => "u8",
            Self::I16 => "i16",
            Self::U16 => "u16",
            Self::I32 => "i32",
            Self::U32 => "u32",
            Self::F32 => "f32",
            Self::I64 => "i64",
            Self::U64 => "u64",
            Self::F64 => "f64",
            Self::Text => "text",
            Self::Any => "any",
        }
    }

    /// Bytes that it takes; `None`: nobody knows.
    pub const fn bytes(self) -> Option<u8> {
        match self {
            Self::Bool | Self::I8 | Self::U8 => Some(1),
            Self::I16 | Self::U16 => Some(2),
            Self::I32 | Self::U32 | Self::F32 => Some(4),
            Self::I64 | Self::U64 | Self::F64 => Some(8),
            Self::Text | Self::Any => None,
        }
    }

    /// Bytes that are read of it: of a text the 8 that are kept, and of what nobody knows 4.
    const fn shown_bytes(self) -> u8 {
        match self.bytes() {
            Some(bytes) => bytes,
            None if matches!(self, Self::Text) => 8,
            None => 4,
        }
    }
}

/// One object of a maker, or a sub-index of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MakersObject {
    /// Where it stands.
    pub address: ObjectAddress,
    /// Its data type.
    pub data: MakersType,
    /// Who may do what with it; [`Access::ReadWriteUpTo`] is written `rw`.
    pub access: Access,
    /// Its value, as the bytes stand in an SDO, the lowest first.
    pub bits: u64,
    /// Its name for people; may be empty.
    pub name: String,
}

/// As a line of a file, see [`MakersObjects::parse`].
impl fmt::Display for MakersObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let access = match self.access {
            Access::ReadOnly => "ro",
            Access::WriteOnly => "wo",
            Access::ReadWrite | Access::ReadWriteUpTo(_) => "rw",
        };
        let ObjectAddress { index, sub } = self.address;
        write!(f, "0x{index:04X}:{sub} {} {access} 0x{:X}", self.data.word(), self.bits)?;
        let name = self.name.replace(|c: char| c.is_control(), " ");
        match name.trim() {
            "" => Ok(()),
            name => write!(f, " {name}"),
        }
    }
}

/// Objects that a slave of [`MakersObjects::any`] makes of writes \[OURS]: more than any start of a program writes.
const MADE_MAX: usize = 4096;

/// The objects of a maker that a slave has besides its own. An object that the slave has itself is not looked for here.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MakersObjects {
    /// In the order of their addresses.
    objects: Vec<MakersObject>,
    /// Every address of [`Self::ANY`] is one that can be read and written.
    any: bool,
}

impl MakersObjects {
    /// Indexes that [`Self::any`] takes: the maker's area (ETG.1000.6 table 63) and that of the device profiles, of whose
    /// objects a simulated slave has only some (0x6093 it has not) \[OURS].
    pub const ANY: [std::ops::RangeInclusive<u16>; 2] = [0x2000..=0x5FFF, 0x6000..=0x9FFF];

    /// None.
    pub const fn new() -> Self {
        Self { objects: Vec::new(), any: false }
    }

    /// Whatever is read in [`Self::ANY`] is 0, and whatever is written there is stored, of any size. It is a leniency: a
    /// real drive may answer with an abort code.
    pub fn any() -> Self {
        // A transfer does not allocate.
        Self { objects: Vec::with_capacity(MADE_MAX), any: true }
    }

    /// Those objects; of two with one address the later one counts.
    pub fn of(objects: impl IntoIterator<Item = MakersObject>) -> Self {
        let mut objects: Vec<_> = objects.into_iter().collect();
        objects.sort_by_key(|object| object.address);
        objects.reverse();
        objects.dedup_by_key(|object| object.address);
        objects.reverse();
        Self { objects, any: false }
    }

    /// The objects, in the order of their addresses.
    pub fn objects(&self) -> &[MakersObject] {
        &self.objects
    }

    /// Whether any address of [`Self::ANY`] is taken.
    pub const fn takes_any(&self) -> bool {
        self.any
    }

    fn find(&self, at: ObjectAddress) -> Result<usize, usize> {
        self.objects.binary_search_by_key(&at, |object| object.address)
    }

    fn is_any(&self, at: ObjectAddress) -> bool {
        self.any && Self::ANY.iter().any(|range| range.contains(&at.index))
    }

    /// SDO upload of at most 4 bytes of an object that the slave does not have itself, whose own answer is `otherwise`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn upload(&self, at: ObjectAddress, otherwise: AbortCode) -> Result<SdoValue, AbortCode> {
        SdoValue::of(|value| self.read(at, SdoScope::Entry, value, otherwise))
    }

    /// SDO download of at most 4 bytes to an object that the slave does not have itself, whose own answer is `otherwise`.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn download(
        &mut self,
        at: ObjectAddress,
        size: SdoSize,
        value: u32,
        otherwise: AbortCode,
    ) -> Result<(), AbortCode> {
        self.write(at, SdoScope::Entry, &value.to_le_bytes()[..size.bytes().into()], otherwise)
    }

    /// SDO upload: the first bytes of the value go into `value`. How long the value is.
    ///
    /// # Errors
    /// [`AbortCode::WRITE_ONLY`], [`AbortCode::NO_SUB_INDEX`], `otherwise`; [`AbortCode::COMPLETE_ACCESS`] always \[OURS].
    pub fn read(
        &self,
        at: ObjectAddress,
        scope: SdoScope,
        value: &mut [u8],
        otherwise: AbortCode,
    ) -> Result<usize, AbortCode> {
        self.one_entry(at, scope)?;
        match self.find(at) {
            Ok(place) if self.objects[place].access == Access::WriteOnly => Err(AbortCode::WRITE_ONLY),
            Ok(place) => {
                let MakersObject { data, bits, .. } = self.objects[place];
                Ok(put_first(&bits.to_le_bytes()[..data.shown_bytes().into()], value))
            }
            Err(_) if self.is_any(at) => Ok(put_first(&[0; 4], value)),
            Err(_) => Err(self.no_object(at, otherwise)),
        }
    }

    /// SDO download of a whole value. The order of the checks is that of
    /// [`dictionary::write`](super::dictionary::write()).
    ///
    /// # Errors
    /// [`AbortCode::READ_ONLY`], [`AbortCode::TOO_LONG`], [`AbortCode::TOO_SHORT`], [`AbortCode::NO_SUB_INDEX`],
    /// [`AbortCode::OUT_OF_MEMORY`], `otherwise`; [`AbortCode::COMPLETE_ACCESS`] always \[OURS].
    pub fn write(
        &mut self,
        at: ObjectAddress,
        scope: SdoScope,
        value: &[u8],
        otherwise: AbortCode,
    ) -> Result<(), AbortCode> {
        self.one_entry(at, scope)?;
        let place = match self.find(at) {
            Ok(place) => place,
            Err(place) if self.is_any(at) => {
                if value.len() > size_of::<u64>() {
                    return Err(AbortCode::TOO_LONG);
                }
                if self.objects.len() >= MADE_MAX {
                    return Err(AbortCode::OUT_OF_MEMORY);
                }
                let (data, access, bits) = (MakersType::Any, Access::ReadWrite, number_of(value));
                self.objects.insert(place, MakersObject { address: at, data, access, bits, name: String::new() });
                return Ok(());
            }
            Err(_) => return Err(self.no_object(at, otherwise)),
        };
        let object = &mut self.objects[place];
        let most = usize::from(object.data.bytes().unwrap_or(8));
        match object.data.bytes() {
            _ if object.access == Access::ReadOnly => Err(AbortCode::READ_ONLY),
            _ if value.len() > most => Err(AbortCode::TOO_LONG),
            Some(_) if value.len() < most => Err(AbortCode::TOO_SHORT),
            _ => {
                object.bits = number_of(value);
                Ok(())
            }
        }
    }

    /// Nobody knows what other sub-indices such an object has.
    fn one_entry(&self, at: ObjectAddress, scope: SdoScope) -> Result<(), AbortCode> {
        let is_here = self.is_any(at) || self.objects.iter().any(|object| object.address.index == at.index);
        if scope == SdoScope::Complete && is_here { Err(AbortCode::COMPLETE_ACCESS) } else { Ok(()) }
    }

    /// Why there is nothing at an address.
    fn no_object(&self, at: ObjectAddress, otherwise: AbortCode) -> AbortCode {
        let has_index = self.objects.iter().any(|object| object.address.index == at.index);
        if has_index { AbortCode::NO_SUB_INDEX } else { otherwise }
    }
}
