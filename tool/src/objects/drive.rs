//! Reads the objects of a drive behind a board, by SDO.

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ecm::{Close, Ecm, EcmError};
use ecmsk::slave::dictionary::Access;
use ecmsk::slave::{ManufacturerObject, ManufacturerType, ManufacturerValue, Mappable};

/// Reads all readable objects with these indexes, and writes nothing to the drive. `found` is called with each object,
/// and `at` with each index before it is read.
///
/// SDO answers show neither the data type nor the access rights of an object. So all objects get
/// [`ManufacturerType::Any`] and `rw`, except those that the drive reports as write-only.
///
/// # Errors
/// [`EcmError`], for example if the slave no longer answers; errors of `found`.
pub fn read<E: From<EcmError>>(
    link: &str,
    slave: u8,
    indexes: &[std::ops::RangeInclusive<u16>],
    mut found: impl FnMut(ManufacturerObject) -> Result<(), E>,
    mut at: impl FnMut(u16),
) -> Result<(), E> {
    let ecm = Ecm::open(link)?;
    read_from(&ecm, slave, indexes, &mut found, &mut at)?;
    Ok(ecm.close(Close::Leave)?)
}

/// Like [`read`], on a board that is already open.
///
/// # Errors
/// As [`read`].
pub fn read_from<E: From<EcmError>>(
    ecm: &Ecm,
    slave: u8,
    indexes: &[std::ops::RangeInclusive<u16>],
    found: &mut dyn FnMut(ManufacturerObject) -> Result<(), E>,
    at: &mut dyn FnMut(u16),
) -> Result<(), E> {
    for index in indexes.iter().cloned().flatten() {
        at(index);
        let Some(first) = upload(ecm, slave, index, 0)? else { continue };
        let count = first.value.bits();
        let is_readable = first.access != Access::WriteOnly;
        found(first)?;
        if !is_readable {
            continue;
        }
        // In a record or an array, sub-index 0 is the highest sub-index. In a simple object it is the value, and there
        // are no other sub-indexes.
        for sub in (1..=count.min(254) as u8).take_while(|_| count <= 254) {
            match upload(ecm, slave, index, sub)? {
                Some(object) => found(object)?,
                None if sub == 1 => break,
                None => {}
            }
        }
    }
    Ok(())
}

/// Reads one sub-index; `None` if it does not exist.
fn upload(ecm: &Ecm, slave: u8, index: u16, sub: u8) -> Result<Option<ManufacturerObject>, EcmError> {
    let address = ObjectAddress::new(index, sub);
    let object = |access, bits: u32| ManufacturerObject {
        address,
        data: ManufacturerType::Any,
        access,
        mappable: Mappable::default(),
        value: ManufacturerValue::of_bits(bits.into(), size_of::<u32>()),
        name: String::new(),
    };
    match ecm.sdo_read::<u32>(slave, address) {
        Ok(bits) => Ok(Some(object(Access::ReadWrite, bits))),
        Err(EcmError::SdoAborted { code: AbortCode::WRITE_ONLY, .. }) => Ok(Some(object(Access::WriteOnly, 0))),
        // A timeout means that the slave does not exist or no longer answers. Other abort codes mean that this object
        // cannot be read.
        Err(error @ EcmError::SdoAborted { code: AbortCode::TIMEOUT, .. }) => Err(error),
        Err(EcmError::SdoAborted { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}
