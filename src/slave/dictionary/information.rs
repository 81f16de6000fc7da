//! The descriptions of a device's objects for the SDO information services (ETG.1000.6 5.6.3), independent of their
//! encoding.

use super::object::Cell;
use super::{Access, DataType, Device, Object, PdoDirection};
use crate::ethercat::AlState;
use crate::ethercat::coe::{AbortCode, DataTypeCode, ObjectAccess, ObjectAddress, ObjectCode, ObjectListType};

impl DataTypeCode {
    /// The code of a data type in SDO information: its index in the object dictionary (ETG.1000.6 5.6.7).
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

/// The description of an object for the SDO information services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectDescription<'a> {
    /// The index of the object.
    pub index: u16,
    /// The data type: of the value for a variable, of the elements for an array, of the structure for a record.
    pub data_type: DataTypeCode,
    /// The highest sub-index.
    pub max_sub: u8,
    /// The object code: variable, array or record.
    pub code: ObjectCode,
    /// The name of the object.
    pub name: &'a str,
}

/// The access rights of a PDO mapping object: readable, and writable in PreOP.
pub const MAPPING_ACCESS: ObjectAccess = ObjectAccess::READ.with(ObjectAccess::WRITE_PREOP);

/// The access rights for SDO information that correspond to `access`.
pub const fn access_of(access: Access) -> ObjectAccess {
    match access {
        Access::ReadOnly | Access::ReadWriteUpTo(AlState::Init) => ObjectAccess::READ,
        Access::WriteOnly => ObjectAccess::WRITE,
        Access::ReadWriteUpTo(AlState::PreOp) => MAPPING_ACCESS,
        Access::ReadWriteUpTo(AlState::SafeOp) => MAPPING_ACCESS.with(ObjectAccess::WRITE_SAFEOP),
        Access::ReadWrite | Access::ReadWriteUpTo(AlState::Op) => ObjectAccess::READ.with(ObjectAccess::WRITE),
    }
}

/// The description of an entry (one sub-index of an object) for the SDO information services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryDescription<'a> {
    /// The index and sub-index of the entry.
    pub at: ObjectAddress,
    /// The data type of the entry.
    pub data_type: DataTypeCode,
    /// The length of the value, bits; for a text, the length of its present value.
    pub bits: u16,
    /// The access rights, and the PDOs into which the entry can be mapped.
    pub access: ObjectAccess,
    /// The default, minimum and maximum value; `None` if the entry has no such values.
    pub values: Option<EntryValues>,
    /// The name of the entry.
    pub name: &'a str,
}

/// The default value of an entry, and its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryValues {
    /// The value at power-on.
    pub default: i64,
    /// The minimum value that can be written.
    pub min: i64,
    /// The maximum value that can be written.
    pub max: i64,
}

/// Whether an entry with these access rights puts its object on an object list of SDO information (ETG.1000.6 table
/// 43). [`ObjectListType::Lengths`] asks for the lengths of the other lists, so neither it nor an unknown list contains
/// objects.
pub const fn is_listed(access: ObjectAccess, list: ObjectListType) -> bool {
    match list {
        ObjectListType::All => true,
        ObjectListType::RxMappable => access.contains(ObjectAccess::RX_MAPPABLE),
        ObjectListType::TxMappable => access.contains(ObjectAccess::TX_MAPPABLE),
        ObjectListType::Backup => access.contains(ObjectAccess::BACKUP),
        ObjectListType::Settings => access.contains(ObjectAccess::SETTINGS),
        ObjectListType::Lengths | ObjectListType::Unknown(_) => false,
    }
}

/// The name of sub-index 0 of an object with several sub-indices \[OURS].
pub const NUMBER_OF_ENTRIES: &str = "Number of entries";

/// The rows of the table that apply to this device.
fn rows_of<D: Device>(device: &D) -> impl Iterator<Item = &'static Object<D>> {
    D::objects().iter().filter(|row| row.only_if.is_none_or(|has| has(device)))
}

/// The lowest existing index from `from` on; `None` if there is none.
pub fn object_from<D: Device>(device: &D, from: u16) -> Option<u16> {
    rows_of(device).map(|row| row.index).find(|index| *index >= from)
}

/// The description of an object for the SDO information services.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`]: the device has no object with this index.
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

/// The description of a sub-index for the SDO information services.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`]: the device has no object with this index; [`AbortCode::NO_SUB_INDEX`]: the object has no
/// such sub-index.
pub fn describe_entry<D: Device>(device: &D, at: ObjectAddress) -> Result<EntryDescription<'static>, AbortCode> {
    let place = super::find(device, at)?;
    let row = &D::objects()[place.row];
    let bits = match row.cell {
        Cell::Text(text) => text(device).len().saturating_mul(8).min(u16::MAX.into()) as u16,
        _ => row.data.bits().into(),
    };
    let mut access = match (access_of(row.access), row.pdo) {
        (access, Some(PdoDirection::Rx)) => access | ObjectAccess::RX_MAPPABLE,
        (access, Some(PdoDirection::Tx)) => access | ObjectAccess::TX_MAPPABLE,
        (access, None) => access,
    };
    if row.backup {
        access = access | ObjectAccess::BACKUP;
    }
    let values = match row.cell {
        Cell::Stored { .. } => Some(EntryValues { default: row.default, min: row.min, max: row.max }),
        _ => None,
    };
    let is_count = at.sub == 0 && describe_object(device, at.index)?.max_sub > 0;
    let name = if is_count { NUMBER_OF_ENTRIES } else { row.name };
    Ok(EntryDescription { at, data_type: DataTypeCode::of(row.data), bits, access, values, name })
}
