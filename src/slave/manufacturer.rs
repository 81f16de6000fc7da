//! Manufacturer-specific objects (from 0x2000 on), and objects of any other index that programs expect but the simulated slave
//! lacks. They have no effect; a value written by SDO or as process data is read back.
//!
//! ```
//! use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
//! use ecmsk::slave::{Drive, DriveConfig, ManufacturerObjects, Slave};
//! use ecmsk::ethercat::AlState;
//!
//! let text = "0x2101:1 u16 rw 0x0010 Motor code\n0x2102:0 i32 ro -5 Encoder offset\n";
//! let mut drive = Drive::new(DriveConfig::default());
//! drive.add_manufacturer_objects(ManufacturerObjects::parse(text).unwrap());
//! drive.enter(AlState::PreOp).unwrap();
//!
//! let code = ObjectAddress::new(0x2101, 1);
//! assert_eq!(drive.upload(code).unwrap().bits, 0x10);
//! drive.download(code, SdoSize::Two, 0x20).unwrap();
//! assert_eq!(drive.upload(code).unwrap().bits, 0x20);
//! assert_eq!(drive.download(code, SdoSize::Four, 1), Err(AbortCode::TOO_LONG));
//! ```

mod format;
mod value;

use super::dictionary::{
    Access, DataType, DataTypeCode, EntryDescription, ObjectDescription, PdoDirection, access_of, put_first,
};
use crate::ethercat::coe::{AbortCode, ObjectAccess, ObjectAddress, ObjectCode, SdoScope};

pub use format::{FormatError, MANUFACTURER_FILE_BYTES_MAX};
pub use value::ManufacturerValue;

/// The data type of a manufacturer-specific object. The board transfers at most 4 bytes: it reads the first 4 bytes of a
/// longer value, and it cannot write such a value. Other masters transfer the whole value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ManufacturerType {
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
    /// `text`, of variable length.
    Text,
    /// `any`: a value of unknown size, for example of an object that was read through the board, which returns at most
    /// 4 bytes. A write of any size is accepted; an upload returns at least 4 bytes, padded with zeros.
    Any,
}

impl ManufacturerType {
    /// All data types.
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

    /// The keyword of the data type in the text format of [`ManufacturerObjects::parse`].
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

    /// The size of a value, bytes; `None` if the size is not fixed.
    pub const fn bytes(self) -> Option<u8> {
        match self {
            Self::Bool | Self::I8 | Self::U8 => Some(1),
            Self::I16 | Self::U16 => Some(2),
            Self::I32 | Self::U32 | Self::F32 => Some(4),
            Self::I64 | Self::U64 | Self::F64 => Some(8),
            Self::Text | Self::Any => None,
        }
    }

    /// The code of the data type in an object dictionary. \[OURS] Values of unknown size are octet strings.
    const fn code(self) -> DataTypeCode {
        match self {
            Self::Bool => DataTypeCode::of(DataType::Bool),
            Self::I8 => DataTypeCode::of(DataType::I8),
            Self::U8 => DataTypeCode::of(DataType::U8),
            Self::I16 => DataTypeCode::of(DataType::I16),
            Self::U16 => DataTypeCode::of(DataType::U16),
            Self::I32 => DataTypeCode::of(DataType::I32),
            Self::U32 => DataTypeCode::of(DataType::U32),
            Self::F32 => DataTypeCode::REAL32,
            Self::I64 => DataTypeCode::of(DataType::I64),
            Self::U64 => DataTypeCode::of(DataType::U64),
            Self::F64 => DataTypeCode::REAL64,
            Self::Text => DataTypeCode::of(DataType::Text),
            Self::Any => DataTypeCode::OCTET_STRING,
        }
    }

    /// The data type with this code in an object dictionary, for a value of `bytes` bytes. If the text format of objects has
    /// no type with this code and length, the result is the unsigned integer of that length, or [`ManufacturerType::Any`] if
    /// there is none (3, 5 to 7, or more than 8 bytes).
    pub fn of_code(code: DataTypeCode, bytes: usize) -> Self {
        let fits = |data: &Self| data.bytes().is_none_or(|len| usize::from(len) == bytes);
        let named = Self::ALL.into_iter().find(|data| data.code() == code && fits(data));
        let unsigned = [Self::U8, Self::U16, Self::U32, Self::U64];
        named.or_else(|| unsigned.into_iter().find(fits)).unwrap_or(Self::Any)
    }

    /// Whether a PDO entry of this length in bits can contain a value of this type. \[OURS] A `u8` fits entries of 1 to 8 bits,
    /// because the text format has no types of 2 to 7 bits and their objects are listed as `u8`.
    const fn can_be_mapped_with(self, bits: u8) -> bool {
        match (self, self.bytes()) {
            (Self::Bool, _) => bits == 1,
            (Self::U8, _) => bits >= 1 && bits <= 8,
            (_, Some(bytes)) => bits == bytes * 8,
            (_, None) => false,
        }
    }
}

/// The PDO directions that an object can be mapped into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mappable {
    /// Whether the object can be mapped into RxPDOs, as an output.
    pub rx: bool,
    /// Whether the object can be mapped into TxPDOs, as an input.
    pub tx: bool,
}

impl Mappable {
    /// The keyword in the text format of [`ManufacturerObjects::parse`]; `None` for an object that cannot be mapped.
    pub const fn word(self) -> Option<&'static str> {
        match (self.rx, self.tx) {
            (false, false) => None,
            (true, false) => Some("rx"),
            (false, true) => Some("tx"),
            (true, true) => Some("rxtx"),
        }
    }

    const fn has(self, direction: PdoDirection) -> bool {
        match direction {
            PdoDirection::Rx => self.rx,
            PdoDirection::Tx => self.tx,
        }
    }
}

/// The maximum length of a value, bytes \[OURS]. A longer write is refused.
pub const MANUFACTURER_VALUE_BYTES_MAX: usize = 0x1_0000;
/// The minimum length of an upload of a value of unknown size, bytes. A shorter value is padded with zeros.
const ANY_BYTES_MIN: usize = 4;

/// One sub-index of a manufacturer-specific object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ManufacturerObject {
    /// The index and the sub-index of the object.
    pub address: ObjectAddress,
    /// The data type of the value.
    pub data: ManufacturerType,
    /// The SDO access rights. The text format shows [`Access::ReadWriteUpTo`] as `rw`.
    pub access: Access,
    /// The PDOs that the object can be mapped into; without effect for a type without a fixed size.
    pub mappable: Mappable,
    /// The value at power-on, and later the value that was last written.
    pub value: ManufacturerValue,
    /// A descriptive name, possibly empty.
    pub name: String,
}

/// \[OURS] The maximum number of objects in [`ManufacturerObjects::any`], where a write to an unused address creates one. It
/// bounds the memory, and is more than any program writes at startup. A write that would create a further object is refused.
const MADE_MAX: usize = 4096;

/// The manufacturer-specific objects of a slave. An object that the slave's own dictionary has takes precedence over an
/// object of this set with the same address.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ManufacturerObjects {
    /// The objects in ascending order of address.
    objects: Vec<ManufacturerObject>,
    /// Whether every address in [`Self::ANY`] can be read and written, even if it is not in `objects`.
    any: bool,
}

impl ManufacturerObjects {
    /// The index ranges that [`Self::any`] accepts: the manufacturer-specific area (ETG.1000.6 table 63) and the area of
    /// the device profiles, of which a simulated slave has only some objects (for example, 0x6093 is missing) \[OURS].
    pub const ANY: [std::ops::RangeInclusive<u16>; 2] = [0x2000..=0x5FFF, 0x6000..=0x9FFF];

    /// An empty set of objects.
    pub const fn new() -> Self {
        Self { objects: Vec::new(), any: false }
    }

    /// Objects that accept everything in [`Self::ANY`]: an object reads 0 until it is written, and a write of any size is
    /// stored. A real drive may answer with an abort code instead.
    pub fn any() -> Self {
        // Reserved in advance, so that transfers do not allocate.
        Self { objects: Vec::with_capacity(MADE_MAX), any: true }
    }

    /// A set of these objects. Of two objects with the same address the later one is kept.
    pub fn of(objects: impl IntoIterator<Item = ManufacturerObject>) -> Self {
        let mut objects: Vec<_> = objects.into_iter().collect();
        objects.sort_by_key(|object| object.address);
        objects.reverse();
        objects.dedup_by_key(|object| object.address);
        objects.reverse();
        Self { objects, any: false }
    }

    /// The objects in ascending order of address.
    pub fn objects(&self) -> &[ManufacturerObject] {
        &self.objects
    }

    /// The lowest index of these objects from `from` on; `None` if there is none.
    pub(super) fn index_from(&self, from: u16) -> Option<u16> {
        self.objects.iter().map(|object| object.address.index).find(|index| *index >= from)
    }

    /// The description of an object for SDO information. \[OURS] An object with several sub-indices is a record.
    /// `None`: this set has no such object.
    pub(super) fn describe_object(&self, index: u16) -> Option<ObjectDescription<'_>> {
        let objects = || self.objects.iter().filter(|object| object.address.index == index);
        let (first, last) = (objects().next()?, objects().next_back()?);
        let max_sub = last.address.sub;
        let (code, data_type) = match max_sub {
            0 => (ObjectCode::Variable, first.data.code()),
            _ => (ObjectCode::Record, DataTypeCode::NONE),
        };
        Some(ObjectDescription { index, data_type, max_sub, code, name: &first.name })
    }

    /// The description of a sub-index for SDO information. `None`: this set has no such sub-index.
    pub(super) fn describe_entry(&self, at: ObjectAddress) -> Option<EntryDescription<'_>> {
        let object = &self.objects[self.find(at).ok()?];
        let bits = match (object.data, object.data.bytes()) {
            (ManufacturerType::Bool, _) => 1,
            (_, Some(bytes)) => u16::from(bytes) * 8,
            (_, None) => object.shown(|value| u16::try_from(value.len() * 8).unwrap_or(u16::MAX)),
        };
        let mut access = access_of(object.access);
        for (direction, right) in
            [(PdoDirection::Rx, ObjectAccess::RX_MAPPABLE), (PdoDirection::Tx, ObjectAccess::TX_MAPPABLE)]
        {
            if object.mappable.has(direction) && object.data.bytes().is_some() {
                access = access | right;
            }
        }
        Some(EntryDescription { at, data_type: object.data.code(), bits, access, values: None, name: &object.name })
    }

    fn find(&self, at: ObjectAddress) -> Result<usize, usize> {
        self.objects.binary_search_by_key(&at, |object| object.address)
    }

    fn is_any(&self, at: ObjectAddress) -> bool {
        self.any && Self::ANY.iter().any(|range| range.contains(&at.index))
    }

    /// SDO upload: copies the value into `value`, as far as there is room. Returns the length of the whole value,
    /// bytes. `otherwise` is the abort code of the slave's own dictionary, returned if this set does not have the
    /// object either.
    ///
    /// # Errors
    /// [`AbortCode::WRITE_ONLY`] for a write-only object; [`AbortCode::NO_SUB_INDEX`] if the object has no such sub-index;
    /// `otherwise` if there is no such object; [`AbortCode::COMPLETE_ACCESS`] for every complete access \[OURS].
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
            Ok(place) => Ok(self.objects[place].shown(|bytes| put_first(bytes, value))),
            Err(_) if self.is_any(at) => Ok(put_first(&[0; ANY_BYTES_MIN], value)),
            Err(_) => Err(self.absent_code(at, otherwise)),
        }
    }

    /// SDO download of a whole value; `otherwise` as for [`Self::read`]. The checks have the same order as in
    /// [`dictionary::write`](super::dictionary::write()).
    ///
    /// # Errors
    /// [`AbortCode::READ_ONLY`] for a read-only object; [`AbortCode::TOO_LONG`], [`AbortCode::TOO_SHORT`] for a value of the
    /// wrong length; [`AbortCode::NO_SUB_INDEX`] if the object has no such sub-index; [`AbortCode::OUT_OF_MEMORY`] if writes
    /// have created too many objects; `otherwise` if there is no such object; [`AbortCode::COMPLETE_ACCESS`] for every complete
    /// access \[OURS].
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
                if value.len() > MANUFACTURER_VALUE_BYTES_MAX {
                    return Err(AbortCode::TOO_LONG);
                }
                if self.objects.len() >= MADE_MAX {
                    return Err(AbortCode::OUT_OF_MEMORY);
                }
                let object = ManufacturerObject {
                    address: at,
                    data: ManufacturerType::Any,
                    access: Access::ReadWrite,
                    mappable: Mappable::default(),
                    value: ManufacturerValue::of_bytes(value),
                    name: String::new(),
                };
                self.objects.insert(place, object);
                return Ok(());
            }
            Err(_) => return Err(self.absent_code(at, otherwise)),
        };
        let object = &mut self.objects[place];
        let most = object.data.bytes().map_or(MANUFACTURER_VALUE_BYTES_MAX, usize::from);
        match object.data.bytes() {
            _ if object.access == Access::ReadOnly => Err(AbortCode::READ_ONLY),
            _ if value.len() > most => Err(AbortCode::TOO_LONG),
            Some(_) if value.len() < most => Err(AbortCode::TOO_SHORT),
            _ => {
                object.value.put(value);
                Ok(())
            }
        }
    }

    /// The index in [`Self::objects`] of the object that a mapping entry of `bits` bits maps into a PDO of this direction.
    ///
    /// # Errors
    /// [`AbortCode::NOT_MAPPABLE`] if the object cannot be mapped into a PDO of this direction or has another length;
    /// [`AbortCode::NO_SUB_INDEX`] if the object has no such sub-index; `otherwise` if there is no such object.
    pub(super) fn mapped(
        &self,
        at: ObjectAddress,
        direction: PdoDirection,
        bits: u8,
        otherwise: AbortCode,
    ) -> Result<usize, AbortCode> {
        let place = self.find(at).map_err(|_| self.absent_code(at, otherwise))?;
        let object = &self.objects[place];
        let fits = object.mappable.has(direction) && object.data.can_be_mapped_with(bits);
        if fits { Ok(place) } else { Err(AbortCode::NOT_MAPPABLE) }
    }

    /// The low 64 bits of the value of the object with index `place`.
    pub(super) fn bits(&self, place: usize) -> u64 {
        self.objects.get(place).map_or(0, |object| object.value.bits())
    }

    /// Writes a value from process data to the object with index `place`.
    pub(super) fn take_bits(&mut self, place: usize, bits: u64) {
        if let Some(ManufacturerObject { data, value, .. }) = self.objects.get_mut(place) {
            *value = ManufacturerValue::of_bits(bits, data.bytes().unwrap_or(0).into());
        }
    }

    /// Refuses complete access to a manufacturer-specific object, because not all of its sub-indices are known.
    fn one_entry(&self, at: ObjectAddress, scope: SdoScope) -> Result<(), AbortCode> {
        let is_here = self.is_any(at) || self.objects.iter().any(|object| object.address.index == at.index);
        if scope == SdoScope::Complete && is_here { Err(AbortCode::COMPLETE_ACCESS) } else { Ok(()) }
    }

    /// The abort code for an address that this set does not have: [`AbortCode::NO_SUB_INDEX`] if the index has other
    /// sub-indices, or else `otherwise`.
    fn absent_code(&self, at: ObjectAddress, otherwise: AbortCode) -> AbortCode {
        let has_index = self.objects.iter().any(|object| object.address.index == at.index);
        if has_index { AbortCode::NO_SUB_INDEX } else { otherwise }
    }
}

impl ManufacturerObject {
    /// Calls `show` with the bytes that an SDO upload of the object returns. The bytes are not returned, because a
    /// short value is padded in a temporary array.
    fn shown<T>(&self, show: impl FnOnce(&[u8]) -> T) -> T {
        match self.value.bytes() {
            short if self.data == ManufacturerType::Any && short.len() < ANY_BYTES_MIN => {
                show(&self.value.bits().to_le_bytes()[..ANY_BYTES_MIN])
            }
            whole => show(whole),
        }
    }
}
