//! SDO information: services that list a slave's objects and describe them (ETG.1000.6 5.6.3).
//!
//! A response that is longer than the mailbox is sent in fragments. Each fragment says how many fragments follow; the last
//! one says 0.

use super::{AbortCode, ObjectAddress};
use crate::ethercat::wire_error::{room_for, split};
use crate::ethercat::{WireError, bits};

/// The operation code of an SDO information message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InformationKind {
    /// 1: requests a list of objects; the data are an [`ObjectListType`].
    ListRequest,
    /// 2: responds with a list of object indices; the first fragment begins with the list type.
    ListResponse,
    /// 3: requests the description of an object; the data are the object's index.
    ObjectRequest,
    /// 4: responds with an [`ObjectDescription`].
    ObjectResponse,
    /// 5: requests the description of a sub-index; the data are an [`EntryRequest`].
    EntryRequest,
    /// 6: responds with an [`EntryDescription`].
    EntryResponse,
    /// 7: reports an error; the data are an [`AbortCode`].
    Error,
    /// Any other code, 0..=127.
    Unknown(u8),
}

impl InformationKind {
    /// The operation with this code on the wire. Only the lower 7 bits of the code are used.
    pub const fn from_code(code: u8) -> Self {
        match code & 0x7F {
            1 => Self::ListRequest,
            2 => Self::ListResponse,
            3 => Self::ObjectRequest,
            4 => Self::ObjectResponse,
            5 => Self::EntryRequest,
            6 => Self::EntryResponse,
            7 => Self::Error,
            code => Self::Unknown(code),
        }
    }

    /// The code on the wire, 0..=127.
    pub const fn code(self) -> u8 {
        match self {
            Self::ListRequest => 1,
            Self::ListResponse => 2,
            Self::ObjectRequest => 3,
            Self::ObjectResponse => 4,
            Self::EntryRequest => 5,
            Self::EntryResponse => 6,
            Self::Error => 7,
            Self::Unknown(code) => code & 0x7F,
        }
    }
}

/// An SDO information message: a request, a response, or one fragment of a response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InformationFragment<'a> {
    /// The operation code.
    pub kind: InformationKind,
    /// Whether more fragments follow.
    pub incomplete: bool,
    /// The number of fragments that follow.
    pub left: u16,
    /// The data; `kind` determines their format.
    pub data: &'a [u8],
}

impl<'a> InformationFragment<'a> {
    /// Length in bytes of the header in front of the data.
    pub const HEADER_LEN: usize = 4;
    const INCOMPLETE: u8 = 0x80;

    /// A request or response that fits into one mailbox message, so that no fragments follow.
    pub const fn whole(kind: InformationKind, data: &'a [u8]) -> Self {
        Self { kind, incomplete: false, left: 0, data }
    }

    /// Decodes the bytes after the CoE header.
    ///
    /// # Errors
    /// [`WireError::Short`]: fewer than 4 bytes.
    pub fn decode(body: &'a [u8]) -> Result<Self, WireError> {
        let ([code, _, low, high], data) = split::<4>(body, "SDO information")?;
        Ok(Self {
            kind: InformationKind::from_code(*code),
            incomplete: code & Self::INCOMPLETE != 0,
            left: u16::from_le_bytes([*low, *high]),
            data,
        })
    }

    /// Writes the bytes after the CoE header and returns their number.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: `room` is shorter than header and data.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        let len = Self::HEADER_LEN + self.data.len();
        let (header, data) = room_for(room, "SDO information", len)?.split_at_mut(Self::HEADER_LEN);
        let [low, high] = self.left.to_le_bytes();
        let incomplete = if self.incomplete { Self::INCOMPLETE } else { 0 };
        header.copy_from_slice(&[self.kind.code() | incomplete, 0, low, high]);
        data.copy_from_slice(self.data);
        Ok(len)
    }
}

/// The type of an object list: which objects it contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectListType {
    /// 0: the number of objects in each of the lists 1 to 5.
    Lengths,
    /// 1: all objects.
    All,
    /// 2: objects that can be mapped into an RxPDO.
    RxMappable,
    /// 3: objects that can be mapped into a TxPDO.
    TxMappable,
    /// 4: objects that a master has to store, to restore them when the device is replaced.
    Backup,
    /// 5: objects that are startup settings.
    Settings,
    /// Any other type.
    Unknown(u16),
}

impl ObjectListType {
    /// The five lists of objects. [`Self::Lengths`] requests their lengths.
    pub const LISTS: [Self; 5] = [Self::All, Self::RxMappable, Self::TxMappable, Self::Backup, Self::Settings];

    /// The list type with this code on the wire.
    pub const fn from_code(code: u16) -> Self {
        match code {
            0 => Self::Lengths,
            1 => Self::All,
            2 => Self::RxMappable,
            3 => Self::TxMappable,
            4 => Self::Backup,
            5 => Self::Settings,
            code => Self::Unknown(code),
        }
    }

    /// The code on the wire.
    pub const fn code(self) -> u16 {
        match self {
            Self::Lengths => 0,
            Self::All => 1,
            Self::RxMappable => 2,
            Self::TxMappable => 3,
            Self::Backup => 4,
            Self::Settings => 5,
            Self::Unknown(code) => code,
        }
    }
}

/// Decodes the 16-bit number at the beginning of the data of an [`InformationFragment`]: the code of an
/// [`ObjectListType`] or an object index.
///
/// # Errors
/// [`WireError::Short`]: fewer than 2 bytes.
pub fn decode_u16(data: &[u8]) -> Result<u16, WireError> {
    split::<2>(data, "SDO information").map(|(bytes, _)| u16::from_le_bytes(*bytes))
}

/// Decodes the abort code in the data of [`InformationKind::Error`].
///
/// # Errors
/// [`WireError::Short`]: fewer than 4 bytes.
pub fn decode_abort(data: &[u8]) -> Result<AbortCode, WireError> {
    split::<4>(data, "abort code").map(|(bytes, _)| AbortCode(u32::from_le_bytes(*bytes)))
}

/// The object code (ETG.1000.6 table 62): a variable, an array, a record and so on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectCode {
    /// 2: DOMAIN, data of variable length.
    Domain,
    /// 5: DEFTYPE, the definition of a data type.
    DefType,
    /// 6: DEFSTRUCT, the definition of a record type.
    DefStruct,
    /// 7: VAR, a single value.
    Variable,
    /// 8: ARRAY, values of the same type.
    Array,
    /// 9: RECORD, values of different types.
    Record,
    /// Any other code.
    Unknown(u8),
}

impl ObjectCode {
    /// The object code for the number on the wire.
    pub const fn from_code(code: u8) -> Self {
        match code {
            2 => Self::Domain,
            5 => Self::DefType,
            6 => Self::DefStruct,
            7 => Self::Variable,
            8 => Self::Array,
            9 => Self::Record,
            code => Self::Unknown(code),
        }
    }

    /// The code on the wire.
    pub const fn code(self) -> u8 {
        match self {
            Self::Domain => 2,
            Self::DefType => 5,
            Self::DefStruct => 6,
            Self::Variable => 7,
            Self::Array => 8,
            Self::Record => 9,
            Self::Unknown(code) => code,
        }
    }
}

/// The description of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ObjectDescription<'a> {
    /// The object's index.
    pub index: u16,
    /// The object's data type (ETG.1000.6 table 64).
    pub data_type: u16,
    /// The object's highest sub-index.
    pub max_sub: u8,
    /// The object code: variable, array, record and so on.
    pub code: ObjectCode,
    /// The object's name as raw bytes, because the standard does not define their encoding.
    pub name: &'a [u8],
}

impl<'a> ObjectDescription<'a> {
    /// Length in bytes of the fixed part in front of the name.
    pub const HEADER_LEN: usize = 6;

    /// Decodes the data of [`InformationKind::ObjectResponse`].
    ///
    /// # Errors
    /// [`WireError::Short`]: fewer than 6 bytes.
    pub fn decode(data: &'a [u8]) -> Result<Self, WireError> {
        let ([i0, i1, t0, t1, max_sub, code], name) = split::<6>(data, "object description")?;
        Ok(Self {
            index: u16::from_le_bytes([*i0, *i1]),
            data_type: u16::from_le_bytes([*t0, *t1]),
            max_sub: *max_sub,
            code: ObjectCode::from_code(*code),
            name,
        })
    }

    /// Writes the data of [`InformationKind::ObjectResponse`] and returns their length in bytes.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: `room` is shorter than the description.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        let len = Self::HEADER_LEN + self.name.len();
        let (header, name) = room_for(room, "object description", len)?.split_at_mut(Self::HEADER_LEN);
        let ([i0, i1], [t0, t1]) = (self.index.to_le_bytes(), self.data_type.to_le_bytes());
        header.copy_from_slice(&[i0, i1, t0, t1, self.max_sub, self.code.code()]);
        name.copy_from_slice(self.name);
        Ok(len)
    }
}

bits! {
    /// The parts of an entry description that a request asks for, or that a response contains.
    ValueInfo(u8) {
        /// Bit 0: access rights.
        ACCESS = 1 << 0;
        /// Bit 1: the category of the object.
        CATEGORY = 1 << 1;
        /// Bit 2: whether the entry can be mapped into a PDO.
        MAPPING = 1 << 2;
        /// Bit 3: the entry's unit.
        UNIT = 1 << 3;
        /// Bit 4: the default value.
        DEFAULT = 1 << 4;
        /// Bit 5: the minimum value.
        MIN = 1 << 5;
        /// Bit 6: the maximum value.
        MAX = 1 << 6;
    }

    /// Access rights of a sub-index.
    ObjectAccess(u16) {
        /// Bits 0 to 2: readable in PreOP, SafeOP and OP.
        READ = 0b111;
        /// Bit 3: writable in PreOP.
        WRITE_PREOP = 1 << 3;
        /// Bit 4: writable in SafeOP.
        WRITE_SAFEOP = 1 << 4;
        /// Bit 5: writable in OP.
        WRITE_OP = 1 << 5;
        /// Bits 3 to 5: writable in PreOP, SafeOP and OP.
        WRITE = 0b111 << 3;
        /// Bit 6: mappable into an RxPDO.
        RX_MAPPABLE = 1 << 6;
        /// Bit 7: mappable into a TxPDO.
        TX_MAPPABLE = 1 << 7;
        /// Bit 8: a master has to store the value, to restore it when the device is replaced.
        BACKUP = 1 << 8;
        /// Bit 9: a startup setting.
        SETTINGS = 1 << 9;
    }
}

/// A request for the description of a sub-index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EntryRequest {
    /// The sub-index to describe.
    pub object: ObjectAddress,
    /// The parts of the description that the response shall contain.
    pub wanted: ValueInfo,
}

impl EntryRequest {
    /// Length in bytes of the data of a request for a description.
    pub const LEN: usize = 4;

    /// Decodes the data of [`InformationKind::EntryRequest`].
    ///
    /// # Errors
    /// [`WireError::Short`]: fewer than 4 bytes.
    pub fn decode(data: &[u8]) -> Result<Self, WireError> {
        let ([i0, i1, sub, wanted], _) = split::<4>(data, "entry request")?;
        let object = ObjectAddress::new(u16::from_le_bytes([*i0, *i1]), *sub);
        Ok(Self { object, wanted: ValueInfo(*wanted) })
    }

    /// Encodes the data of [`InformationKind::EntryRequest`].
    pub const fn encode(&self) -> [u8; Self::LEN] {
        let [i0, i1] = self.object.index.to_le_bytes();
        [i0, i1, self.object.sub, self.wanted.0]
    }
}

/// The description of a sub-index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EntryDescription<'a> {
    /// The sub-index described.
    pub object: ObjectAddress,
    /// The parts of the description that `data` contains.
    pub info: ValueInfo,
    /// The entry's data type (ETG.1000.6 table 64).
    pub data_type: u16,
    /// The entry's length in bits.
    pub bits: u16,
    /// The entry's access rights.
    pub access: ObjectAccess,
    /// The unit, default, minimum and maximum value, each only if its bit in `info` is set; then the entry's name.
    pub data: &'a [u8],
}

impl<'a> EntryDescription<'a> {
    /// Length in bytes of the fixed part in front of `data`.
    pub const HEADER_LEN: usize = 10;

    /// Decodes the data of [`InformationKind::EntryResponse`].
    ///
    /// # Errors
    /// [`WireError::Short`]: fewer than 10 bytes.
    pub fn decode(data: &'a [u8]) -> Result<Self, WireError> {
        let ([i0, i1, sub, info, t0, t1, b0, b1, a0, a1], data) = split::<10>(data, "entry description")?;
        Ok(Self {
            object: ObjectAddress::new(u16::from_le_bytes([*i0, *i1]), *sub),
            info: ValueInfo(*info),
            data_type: u16::from_le_bytes([*t0, *t1]),
            bits: u16::from_le_bytes([*b0, *b1]),
            access: ObjectAccess(u16::from_le_bytes([*a0, *a1])),
            data,
        })
    }

    /// Writes the data of [`InformationKind::EntryResponse`] and returns their length in bytes.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: `room` is shorter than the description.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        let len = Self::HEADER_LEN + self.data.len();
        let (header, data) = room_for(room, "entry description", len)?.split_at_mut(Self::HEADER_LEN);
        let [i0, i1] = self.object.index.to_le_bytes();
        let [[t0, t1], [b0, b1], [a0, a1]] = [self.data_type, self.bits, self.access.0].map(u16::to_le_bytes);
        header.copy_from_slice(&[i0, i1, self.object.sub, self.info.0, t0, t1, b0, b1, a0, a1]);
        data.copy_from_slice(self.data);
        Ok(len)
    }
}
