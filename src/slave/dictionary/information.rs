//! What a device tells of its objects: the data of the SDO information services (ETG.1000.6 5.6.3), without their bytes.

use super::object::Cell;
use super::{Access, DataType, Device, Object, PdoDirection};
use crate::coe::{AbortCode, ObjectAddress};
use crate::ethercat::AlState;

/// The number of a data type in the object dictionary (ETG.1000.6 5.6.7.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataTypeCode(pub u16);

impl DataTypeCode {
    /// No type of its own: a record whose structure has no number.
    pub const NONE: Self = Self(0x0000);
    /// REAL32.
    pub const REAL32: Self = Self(0x0008);
    /// OCTET_STRING.
    pub const OCTET_STRING: Self = Self(0x000A);
    /// REAL64.
    pub const REAL64: Self = Self(0x0011);
    /// The record of a PDO mapping.
    pub const PDO_MAPPING: Self = Self(0x0021);
    /// The record of the identity.
    pub const IDENTITY: Self = Self(0x0023);
    /// The record of the parameters of a sync manager.
    pub const SYNC_MANAGER_PARAMETER: Self = Self(0x0029);

    /// The number of a data type.
    pub const fn of(data: DataType) -> Self {
        Self(match data {
            DataType::Bool => 0x0001,
            DataType::I8 => 0x0002,
            DataType::I16 => 0x0003,
            DataType::I32 => 0x0004,
            DataType::U8 => 0x0005,
            DataType::U16 => 0x0006,
            DataType::U32 => 0x0007,
            DataType::Text => 0x0009,
            DataType::I64 => 0x0015,
            DataType::U64 => 0x001B,
        })
    }
}

/// What an object is made of (ETG.1000.6, object codes).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectCode {
    /// One value.
    Variable = 7,
    /// Values of one type, behind their number.
    Array = 8,
    /// Values of several types.
    Record = 9,
}

/// The description of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectDescription<'a> {
    /// The index.
    pub index: u16,
    /// The data type: that of the values of a variable or an array, that of the structure of a record.
    pub data_type: DataTypeCode,
    /// The highest sub-index.
    pub max_sub: u8,
    /// What the object is made of.
    pub code: ObjectCode,
    /// The name.
    pub name: &'a str,
}

/// The access rights of an entry: bits 0 to 2 it can be read in PreOP, SafeOP, OP; 3 to 5 it can be written there; 6 and 7 it
/// can be mapped into RxPDOs, TxPDOs; 8 it is kept without power; 9 it is a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryAccess(pub u16);

impl EntryAccess {
    const READ: u16 = 0b111;
    const WRITE_IN_PREOP: u16 = 1 << 3;
    const WRITE_IN_SAFEOP: u16 = 1 << 4;
    const WRITE_IN_OP: u16 = 1 << 5;
    /// It can be mapped into an RxPDO.
    pub const RX: u16 = 1 << 6;
    /// It can be mapped into a TxPDO.
    pub const TX: u16 = 1 << 7;
    /// It is kept without power.
    pub const BACKUP: u16 = 1 << 8;
    /// It is a setting that masters write at the start.
    pub const SETTING: u16 = 1 << 9;
    /// It can only be read.
    pub const READ_ONLY: Self = Self(Self::READ);
    /// It can be read, and written in PreOP.
    pub const MAPPING: Self = Self(Self::READ | Self::WRITE_IN_PREOP);

    /// The rights of SDOs.
    pub const fn of(access: Access) -> Self {
        let all = Self::WRITE_IN_PREOP | Self::WRITE_IN_SAFEOP | Self::WRITE_IN_OP;
        Self(match access {
            Access::ReadOnly => Self::READ,
            Access::ReadWrite => Self::READ | all,
            Access::WriteOnly => all,
            Access::ReadWriteUpTo(AlState::Init) => Self::READ,
            Access::ReadWriteUpTo(AlState::PreOp) => Self::READ | Self::WRITE_IN_PREOP,
            Access::ReadWriteUpTo(AlState::SafeOp) => Self::READ | Self::WRITE_IN_PREOP | Self::WRITE_IN_SAFEOP,
            Access::ReadWriteUpTo(AlState::Op) => Self::READ | all,
        })
    }
}

/// The description of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryDescription<'a> {
    /// The address.
    pub at: ObjectAddress,
    /// The data type.
    pub data_type: DataTypeCode,
    /// The length of a value, bits; of a text that of its present value.
    pub bits: u16,
    /// Who can read and write it, and where it can be mapped.
    pub access: EntryAccess,
    /// The value at power-on, the least and the greatest value, as numbers; `None`: the entry has none to tell.
    pub values: Option<EntryValues>,
    /// The name.
    pub name: &'a str,
}

/// The value of an entry at power-on, and its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryValues {
    /// The value at power-on.
    pub default: i64,
    /// The least value that can be written.
    pub min: i64,
    /// The greatest value that can be written.
    pub max: i64,
}

/// Which objects a list of the SDO information services has (ETG.1000.6 table 43).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectListKind {
    /// All objects.
    All = 1,
    /// Those with an entry that can be mapped into an RxPDO.
    RxMappable = 2,
    /// Those with an entry that can be mapped into a TxPDO.
    TxMappable = 3,
    /// Those whose values are kept without power.
    Backup = 4,
    /// Those that masters write at the start.
    Settings = 5,
}

impl ObjectListKind {
    /// Every kind, in the order of their numbers.
    pub const ALL: [Self; 5] = [Self::All, Self::RxMappable, Self::TxMappable, Self::Backup, Self::Settings];

    /// Whether an entry with these access rights brings its object into the list.
    pub const fn has(self, EntryAccess(access): EntryAccess) -> bool {
        match self {
            Self::All => true,
            Self::RxMappable => access & EntryAccess::RX != 0,
            Self::TxMappable => access & EntryAccess::TX != 0,
            Self::Backup => access & EntryAccess::BACKUP != 0,
            Self::Settings => access & EntryAccess::SETTING != 0,
        }
    }
}

/// The name of sub-index 0 of an object with further ones \[OURS].
pub const NUMBER_OF_ENTRIES: &str = "Number of entries";

/// The rows that a device has.
fn rows_of<D: Device>(device: &D) -> impl Iterator<Item = &'static Object<D>> {
    D::objects().iter().filter(|row| row.only_if.is_none_or(|has| has(device)))
}

/// The first object with an index of at least `from`.
pub fn object_from<D: Device>(device: &D, from: u16) -> Option<u16> {
    rows_of(device).map(|row| row.index).find(|index| *index >= from)
}

/// The description of an object.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`].
pub fn describe_object<D: Device>(device: &D, index: u16) -> Result<ObjectDescription<'static>, AbortCode> {
    let rows = || rows_of(device).filter(|row| row.index == index);
    let (Some(first), Some(last)) = (rows().next(), rows().last()) else { return Err(AbortCode::NO_OBJECT) };
    let max_sub = last.first_sub + (last.count - 1);
    let of_first = DataTypeCode::of(last.data);
    let structure = match index {
        0x1018 => Some(DataTypeCode::IDENTITY),
        0x1C32 | 0x1C33 => Some(DataTypeCode::SYNC_MANAGER_PARAMETER),
        _ => None,
    };
    let entries = || rows().filter(|row| row.first_sub > 0);
    let subs: usize = entries().map(|row| usize::from(row.count)).sum();
    let is_array = entries().all(|row| row.data == last.data) && subs == usize::from(max_sub);
    let (code, data_type) = match structure {
        Some(structure) => (ObjectCode::Record, structure),
        None if max_sub == 0 => (ObjectCode::Variable, of_first),
        None if is_array => (ObjectCode::Array, of_first),
        None => (ObjectCode::Record, DataTypeCode::NONE),
    };
    Ok(ObjectDescription { index, data_type, max_sub, code, name: first.name })
}

/// The description of an entry.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`], [`AbortCode::NO_SUB_INDEX`].
pub fn describe_entry<D: Device>(device: &D, at: ObjectAddress) -> Result<EntryDescription<'static>, AbortCode> {
    let place = super::find(device, at)?;
    let row = &D::objects()[place.row];
    let bits = match row.cell {
        Cell::Text(text) => text(device).len().saturating_mul(8).min(u16::MAX.into()) as u16,
        _ => row.data.bits().into(),
    };
    let EntryAccess(mut access) = EntryAccess::of(row.access);
    access |= match row.pdo {
        Some(PdoDirection::Rx) => EntryAccess::RX,
        Some(PdoDirection::Tx) => EntryAccess::TX,
        None => 0,
    };
    if row.backup {
        access |= EntryAccess::BACKUP;
    }
    let values = match row.cell {
        Cell::Stored { .. } => Some(EntryValues { default: row.default, min: row.min, max: row.max }),
        _ => None,
    };
    let is_count = at.sub == 0 && describe_object(device, at.index)?.max_sub > 0;
    let name = if is_count { NUMBER_OF_ENTRIES } else { row.name };
    Ok(EntryDescription { at, data_type: DataTypeCode::of(row.data), bits, access: EntryAccess(access), values, name })
}
