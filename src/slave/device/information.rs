//! SDO information about all objects of a device: those of its kind, its PDO mapping, its test memory and its
//! manufacturer-specific objects.

use super::Model;
use super::test_memory::{self, TEST_MEMORY};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::slave::dictionary::{EntryDescription, ObjectDescription, describe_entry, describe_object, object_from};

/// The lowest existing index from `from` on; `None` if there is none.
pub(super) fn next_object<M: Model>(device: &M, from: u16) -> Option<u16> {
    let base = device.base();
    let test_memory = base.has_test_memory().then_some(TEST_MEMORY).filter(|index| *index >= from);
    let manufacturer = base.manufacturer.as_deref().and_then(|objects| objects.index_from(from));
    [object_from(device, from), base.mapping.index_from(from), test_memory, manufacturer].into_iter().flatten().min()
}

/// The description of an object for the SDO information services.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`]: the device has no object with this index.
pub(super) fn object<M: Model>(device: &M, index: u16) -> Result<ObjectDescription<'_>, AbortCode> {
    let base = device.base();
    if let Some(description) = base.mapping.describe_object(index) {
        return Ok(description);
    }
    if base.has_test_memory() && index == TEST_MEMORY {
        return Ok(test_memory::OBJECT);
    }
    match (describe_object(device, index), &base.manufacturer) {
        (Err(code), Some(manufacturer)) => manufacturer.describe_object(index).ok_or(code),
        (answer, _) => answer,
    }
}

/// The description of a sub-index for the SDO information services.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`]: the device has no object with this index; [`AbortCode::NO_SUB_INDEX`]: the object has no
/// such sub-index.
pub(super) fn entry<M: Model>(device: &M, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode> {
    let base = device.base();
    if base.mapping.has(at.index) {
        return base.mapping.describe_entry(at).ok_or(AbortCode::NO_SUB_INDEX);
    }
    if base.has_test_memory() && at.index == TEST_MEMORY {
        return if at.sub == 0 { Ok(test_memory::entry(base.test_memory())) } else { Err(AbortCode::NO_SUB_INDEX) };
    }
    match (describe_entry(device, at), &base.manufacturer) {
        (Err(code), Some(manufacturer)) => manufacturer.describe_entry(at).ok_or(code),
        (answer, _) => answer,
    }
}
