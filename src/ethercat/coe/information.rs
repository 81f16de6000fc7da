//! SDO information: what objects a slave has, and what they are (ETG.1000.6 5.6.3).
//!
//! An answer that is longer than the mailbox comes in fragments, whose numbers count down to 0.

use super::{AbortCode, ObjectAddress};
use crate::ethercat::wire_error::{room_for, split};
use crate::ethercat::{WireError, bits};

/// What a fragment is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InformationKind {
    /// 1: asks for a list of objects; the data are an [`ObjectListType`].
    ListRequest,
    /// 2: the list: its type in the first fragment, then indices.
    ListResponse,
    /// 3: asks for the description of an object; the data are its index.
    ObjectRequest,
    /// 4: an [`ObjectDescription`].
    ObjectResponse,
    /// 5: asks for the description of a sub-index; the data are an [`EntryRequest`].
    EntryRequest,
    /// 6: an [`EntryDescription`].
    EntryResponse,
    /// 7: an [`AbortCode`].
    Error,
    /// Another one, 0..=127.
    Unknown(u8),
}

impl InformationKind {
    /// The kind with that code; of the code the lower 7 bits count.
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

/// A question or an answer, or a part of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InformationFragment<'a> {
    /// What it is.
    pub kind: InformationKind,
    /// Whether others follow.
    pub incomplete: bool,
    /// How many others follow.
    pub left: u16,
    /// The data, by its kind.
    pub data: &'a [u8],
}

impl<'a> InformationFragment<'a> {
    /// Bytes in front of the data.
    pub const HEADER_LEN: usize = 4;
    const INCOMPLETE: u8 = 0x80;

    /// A question or an answer in one piece.
    pub const fn whole(kind: InformationKind, data: &'a [u8]) -> Self {
        Self { kind, incomplete: false, left: 0, data }
    }

    /// Decodes what follows the CoE header.
    ///
    /// # Errors
    /// [`WireError::Short`].
    pub fn decode(body: &'a [u8]) -> Result<Self, WireError> {
        let ([code, _, low, high], data) = split::<4>(body, "SDO information")?;
        Ok(Self {
            kind: InformationKind::from_code(*code),
            incomplete: code & Self::INCOMPLETE != 0,
            left: u16::from_le_bytes([*low, *high]),
            data,
        })
    }

    /// Writes what follows the CoE header; how many bytes it has.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
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

/// Which objects a list has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectListType {
    /// 0: how long each of the lists 1 to 5 is.
    Lengths,
    /// 1: all objects.
    All,
    /// 2: those that can be mapped into an RxPDO.
    RxMappable,
    /// 3: those that can be mapped into a TxPDO.
    TxMappable,
    /// 4: those that have to be stored for a replacement of the device.
    Backup,
    /// 5: those that are settings at the start.
    Settings,
    /// Another one.
    Unknown(u16),
}

impl ObjectListType {
    /// The lists of objects, whose lengths [`Self::Lengths`] asks for.
    pub const LISTS: [Self; 5] = [Self::All, Self::RxMappable, Self::TxMappable, Self::Backup, Self::Settings];

    /// The type with that code.
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

/// Decodes a number of 16 bits at the beginning of data: an [`ObjectListType`] or an index.
///
/// # Errors
/// [`WireError::Short`].
pub fn decode_u16(data: &[u8]) -> Result<u16, WireError> {
    split::<2>(data, "SDO information").map(|(bytes, _)| u16::from_le_bytes(*bytes))
}

/// Decodes the abort code of [`InformationKind::Error`].
///
/// # Errors
/// [`WireError::Short`].
pub fn decode_abort(data: &[u8]) -> Result<AbortCode, WireError> {
    split::<4>(data, "abort code").map(|(bytes, _)| AbortCode(u32::from_le_bytes(*bytes)))
}

/// What kind of thing an object is (ETG.1000.6 table 62).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectCode {
    /// 2: bytes of any length.
    Domain,
    /// 5: the definition of a data type.
    DefType,
    /// 6: the definition of a record.
    DefStruct,
    /// 7: one value.
    Variable,
    /// 8: values of one type.
    Array,
    /// 9: values of several types.
    Record,
    /// Another one.
    Unknown(u8),
}

impl ObjectCode {
    /// The code's meaning.
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
    /// Its index.
    pub index: u16,
    /// Its data type (ETG.1000.6 table 64).
    pub data_type: u16,
    /// Its highest sub-index.
    pub max_sub: u8,
    /// What it is.
    pub code: ObjectCode,
    /// Its name, as bytes, since nobody says in which encoding it is.
    pub name: &'a [u8],
}

impl<'a> ObjectDescription<'a> {
    /// Bytes in front of the name.
    pub const HEADER_LEN: usize = 6;

    /// Decodes the data of [`InformationKind::ObjectResponse`].
    ///
    /// # Errors
    /// [`WireError::Short`].
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

    /// Writes the data; how many bytes they have.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
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
    /// What a description of a sub-index shall hold, or holds.
    ValueInfo(u8) {
        /// Bit 0: access rights.
        ACCESS = 1 << 0;
        /// Bit 1: the category of the object.
        CATEGORY = 1 << 1;
        /// Bit 2: whether it can be mapped.
        MAPPING = 1 << 2;
        /// Bit 3: its unit.
        UNIT = 1 << 3;
        /// Bit 4: its default value.
        DEFAULT = 1 << 4;
        /// Bit 5: its least value.
        MIN = 1 << 5;
        /// Bit 6: its greatest value.
        MAX = 1 << 6;
    }

    /// Access rights of a sub-index.
    ObjectAccess(u16) {
        /// Bits 0 to 2: it is read in PreOP, SafeOP and OP.
        READ = 0b111;
        /// Bit 3: it is written in PreOP.
        WRITE_PREOP = 1 << 3;
        /// Bit 4: it is written in SafeOP.
        WRITE_SAFEOP = 1 << 4;
        /// Bit 5: it is written in OP.
        WRITE_OP = 1 << 5;
        /// Bits 3 to 5: it is written in PreOP, SafeOP and OP.
        WRITE = 0b111 << 3;
        /// Bit 6: it can be mapped into an RxPDO.
        RX_MAPPABLE = 1 << 6;
        /// Bit 7: it can be mapped into a TxPDO.
        TX_MAPPABLE = 1 << 7;
        /// Bit 8: it has to be stored for a replacement of the device.
        BACKUP = 1 << 8;
        /// Bit 9: it is a setting at the start.
        SETTINGS = 1 << 9;
    }
}

/// The question for a sub-index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EntryRequest {
    /// Which one.
    pub object: ObjectAddress,
    /// What the answer shall hold.
    pub wanted: ValueInfo,
}

impl EntryRequest {
    /// Bytes of the data.
    pub const LEN: usize = 4;

    /// Decodes the data of [`InformationKind::EntryRequest`].
    ///
    /// # Errors
    /// [`WireError::Short`].
    pub fn decode(data: &[u8]) -> Result<Self, WireError> {
        let ([i0, i1, sub, wanted], _) = split::<4>(data, "entry request")?;
        let object = ObjectAddress::new(u16::from_le_bytes([*i0, *i1]), *sub);
        Ok(Self { object, wanted: ValueInfo(*wanted) })
    }

    /// The data as bytes.
    pub const fn encode(&self) -> [u8; Self::LEN] {
        let [i0, i1] = self.object.index.to_le_bytes();
        [i0, i1, self.object.sub, self.wanted.0]
    }
}

/// The description of a sub-index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EntryDescription<'a> {
    /// Which one.
    pub object: ObjectAddress,
    /// What the data hold.
    pub info: ValueInfo,
    /// Its data type (ETG.1000.6 table 64).
    pub data_type: u16,
    /// Its length, bits.
    pub bits: u16,
    /// Its access rights.
    pub access: ObjectAccess,
    /// Unit, default, least and greatest value, as `info` says, then the name.
    pub data: &'a [u8],
}

impl<'a> EntryDescription<'a> {
    /// Bytes in front of the data.
    pub const HEADER_LEN: usize = 10;

    /// Decodes the data of [`InformationKind::EntryResponse`].
    ///
    /// # Errors
    /// [`WireError::Short`].
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

    /// Writes the data; how many bytes they have.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
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
