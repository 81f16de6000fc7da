//! An object for testing masters. It stores any value of up to 512 octets and returns the same octets. So a master can
//! test SDO transfers of any length, in one segment and in several.

use crate::ethercat::coe::{AbortCode, ObjectAddress, ObjectCode, SdoScope};
use crate::slave::dictionary::{Access, DataTypeCode, EntryDescription, ObjectDescription, access_of, put_first};

/// The index of the object. \[OURS] An index of the manufacturer-specific area that few vendors use.
pub const TEST_MEMORY: u16 = 0x4FFF;
/// The maximum number of octets that the object stores \[OURS].
pub const TEST_MEMORY_BYTES_MAX: usize = 512;

const NAME: &str = "Test memory";

/// The description of the object for SDO information.
pub(super) const OBJECT: ObjectDescription<'static> = ObjectDescription {
    index: TEST_MEMORY,
    data_type: DataTypeCode::OCTET_STRING,
    max_sub: 0,
    code: ObjectCode::Variable,
    name: NAME,
};

/// The description of the object's entry for SDO information, when it contains these octets.
pub(super) fn entry(octets: &[u8]) -> EntryDescription<'static> {
    EntryDescription {
        at: ObjectAddress::new(TEST_MEMORY, 0),
        data_type: DataTypeCode::OCTET_STRING,
        bits: octets.len() as u16 * 8,
        access: access_of(Access::ReadWrite),
        values: None,
        name: NAME,
    }
}

fn check(at: ObjectAddress, scope: SdoScope) -> Result<(), AbortCode> {
    match scope {
        SdoScope::Complete => Err(AbortCode::COMPLETE_ACCESS),
        SdoScope::Entry if at.sub > 0 => Err(AbortCode::NO_SUB_INDEX),
        SdoScope::Entry => Ok(()),
    }
}

/// SDO upload: copies the octets into `value`, as far as there is room. Returns the length of all octets. The error is
/// the abort code for another sub-index or for complete access.
pub(super) fn read(octets: &[u8], at: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
    check(at, scope)?;
    Ok(put_first(octets, value))
}

/// SDO download: checks whether the octets in `value` may be stored.
pub(super) fn may_write(at: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
    check(at, scope)?;
    if value.len() > TEST_MEMORY_BYTES_MAX { Err(AbortCode::TOO_LONG) } else { Ok(()) }
}
