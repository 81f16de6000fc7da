//! What a device says about its objects: which ones it has, their names, types and access, for SDO information.

use super::device::Model;
use super::dictionary::{self, Access, DataType, Object, PdoDirection};
use crate::coe::{
    AbortCode, EntryDescription, ObjectAccess, ObjectAddress, ObjectCode, ObjectDescription, ObjectListType, SdoScope,
    ValueInfo,
};
use crate::ethercat::AlState;

/// A device that describes its objects.
pub trait ObjectDirectory {
    /// Calls `visit` with the index of each object of a list, ascending.
    fn each_object(&self, list: ObjectListType, visit: &mut dyn FnMut(u16));

    /// The description of an object.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`].
    fn object(&self, index: u16) -> Result<ObjectDescription<'_>, AbortCode>;

    /// The description of a sub-index.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`], [`AbortCode::NO_SUB_INDEX`].
    fn entry(&self, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode>;
}

/// The data types of records that the standard defines (ETG.1000.6 table 64).
mod records {
    pub const PDO_MAPPING: u16 = 0x21;
    pub const IDENTITY: u16 = 0x23;
    pub const SYNC_PARAMETER: u16 = 0x29;
    /// A record of the device's own.
    pub const OTHER: u16 = 0x00;
}

/// The code of a data type (ETG.1000.6 table 64).
const fn type_code(data: DataType) -> u16 {
    match data {
        DataType::Bool => 0x01,
        DataType::I8 => 0x02,
        DataType::I16 => 0x03,
        DataType::I32 => 0x04,
        DataType::U8 => 0x05,
        DataType::U16 => 0x06,
        DataType::U32 => 0x07,
        DataType::Text => 0x09,
        DataType::I64 => 0x15,
        DataType::U64 => 0x1B,
    }
}

const fn access_of(access: Access, pdo: Option<PdoDirection>) -> ObjectAccess {
    let rights = match access {
        Access::ReadOnly => ObjectAccess::READ,
        Access::WriteOnly => ObjectAccess::WRITE,
        Access::ReadWrite | Access::ReadWriteUpTo(AlState::Op) => ObjectAccess::READ.with(ObjectAccess::WRITE),
        Access::ReadWriteUpTo(AlState::SafeOp) => {
            ObjectAccess::READ.with(ObjectAccess::WRITE_PREOP).with(ObjectAccess::WRITE_SAFEOP)
        }
        Access::ReadWriteUpTo(_) => ObjectAccess::READ.with(ObjectAccess::WRITE_PREOP),
    };
    match pdo {
        Some(PdoDirection::Rx) => rights.with(ObjectAccess::RX_MAPPABLE),
        Some(PdoDirection::Tx) => rights.with(ObjectAccess::TX_MAPPABLE),
        None => rights,
    }
}

/// The indices of the mapping objects of a device, those of PDOs and of their assignment.
fn mapping_indices<M: Model>(device: &M) -> impl Iterator<Item = u16> {
    let mapping = device.base().mapping();
    [0x1600..=0x17FF, 0x1A00..=0x1BFF, 0x1C12..=0x1C13].into_iter().flatten().filter(|index| mapping.has(*index))
}

/// The rows of the table that the device has.
fn rows<M: Model>(device: &M) -> impl Iterator<Item = &'static Object<M>> {
    M::objects().iter().filter(|row| dictionary::find(device, row.address()).is_ok())
}

fn rows_of<M: Model>(device: &M, index: u16) -> impl Iterator<Item = &'static Object<M>> {
    rows(device).filter(move |row| row.address().index == index)
}

/// How many items a mapping object has now.
fn mapped_items<M: Model>(device: &M, index: u16) -> Option<u8> {
    let mut count = [0];
    device.base().mapping().read(ObjectAddress::new(index, 0), SdoScope::Entry, &mut count).ok()?;
    Some(count[0])
}

const fn mapping_name(index: u16) -> &'static str {
    match index {
        0x1C12 => "RxPDO assign",
        0x1C13 => "TxPDO assign",
        0x1600..=0x17FF => "RxPDO mapping",
        _ => "TxPDO mapping",
    }
}

const fn is_assignment(index: u16) -> bool {
    matches!(index, 0x1C12 | 0x1C13)
}

impl<M: Model> ObjectDirectory for M {
    fn each_object(&self, list: ObjectListType, visit: &mut dyn FnMut(u16)) {
        let is_in = |row: &Object<M>| match list {
            ObjectListType::All => true,
            ObjectListType::RxMappable => row.pdo() == Some(PdoDirection::Rx),
            ObjectListType::TxMappable => row.pdo() == Some(PdoDirection::Tx),
            _ => false,
        };
        let mut mapping = mapping_indices(self).filter(|_| list == ObjectListType::All).peekable();
        let mut last = None;
        for index in rows(self).filter(|row| is_in(row)).map(|row| row.address().index) {
            if last == Some(index) {
                continue;
            }
            last = Some(index);
            while let Some(before) = mapping.next_if(|before| *before < index) {
                visit(before);
            }
            visit(index);
        }
        mapping.for_each(visit);
    }

    fn object(&self, index: u16) -> Result<ObjectDescription<'_>, AbortCode> {
        if let Some(max_sub) = mapped_items(self, index) {
            let (data_type, code) = if is_assignment(index) {
                (type_code(DataType::U16), ObjectCode::Array)
            } else {
                (records::PDO_MAPPING, ObjectCode::Record)
            };
            return Ok(ObjectDescription { index, data_type, max_sub, code, name: mapping_name(index).as_bytes() });
        }
        let first = rows_of(self, index).next().ok_or(AbortCode::NO_OBJECT)?;
        let max_sub = rows_of(self, index).map(|row| row.address().sub + (row.count() - 1)).max().unwrap_or(0);
        let mut parts = rows_of(self, index).filter(|row| row.address().sub > 0).map(Object::data_type);
        let part = parts.next();
        let is_uniform = parts.all(|data| Some(data) == part);
        let (data_type, code) = match (part, index) {
            (None, _) => (type_code(first.data_type()), ObjectCode::Variable),
            (Some(_), 0x1018) => (records::IDENTITY, ObjectCode::Record),
            (Some(_), 0x1C30..=0x1C3F) => (records::SYNC_PARAMETER, ObjectCode::Record),
            (Some(part), _) if is_uniform => (type_code(part), ObjectCode::Array),
            (Some(_), _) => (records::OTHER, ObjectCode::Record),
        };
        Ok(ObjectDescription { index, data_type, max_sub, code, name: first.name().as_bytes() })
    }

    fn entry(&self, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode> {
        let info = ValueInfo::ACCESS | ValueInfo::CATEGORY | ValueInfo::MAPPING;
        if let Some(items) = mapped_items(self, at.index) {
            let (data, bits) = match at.sub {
                0 => (DataType::U8, 8),
                sub if sub > items => return Err(AbortCode::NO_SUB_INDEX),
                _ if is_assignment(at.index) => (DataType::U16, 16),
                _ => (DataType::U32, 32),
            };
            let access = access_of(Access::ReadWriteUpTo(AlState::PreOp), None);
            let data_type = type_code(data);
            return Ok(EntryDescription {
                object: at,
                info,
                data_type,
                bits,
                access,
                data: mapping_name(at.index).as_bytes(),
            });
        }
        let place = dictionary::find(self, at)?;
        let row = &M::objects()[place.row];
        let bits = match row.data_type() {
            DataType::Text => {
                let len = dictionary::read(self, at, SdoScope::Entry, &mut [])?;
                u16::try_from(8 * len).unwrap_or(u16::MAX)
            }
            data => data.bits().into(),
        };
        let (data_type, access) = (type_code(row.data_type()), access_of(row.access(), row.pdo()));
        Ok(EntryDescription { object: at, info, data_type, bits, access, data: row.name().as_bytes() })
    }
}
