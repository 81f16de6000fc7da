//! The objects of a real drive, read by SDO over a link.

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ecm::{Close, Ecm, EcmError};
use ecmsk::slave::dictionary::Access;
use ecmsk::slave::{MakersObject, MakersType};

/// Reads what is readable of those indexes, and nothing is written. `found` takes each object, `at` hears where it is.
///
/// The wire says neither the size nor the access of an object, so that all are [`MakersType::Any`] and `rw`, but for those
/// that the drive says are write-only.
///
/// # Errors
/// [`EcmError`]: the slave does not answer any more, or whatever the board says; what `found` says.
pub fn read<E: From<EcmError>>(
    link: &str,
    slave: u8,
    indexes: &[std::ops::RangeInclusive<u16>],
    mut found: impl FnMut(MakersObject) -> Result<(), E>,
    mut at: impl FnMut(u16),
) -> Result<(), E> {
    let ecm = Ecm::open(link)?;
    for index in indexes.iter().cloned().flatten() {
        at(index);
        let Some(first) = upload(&ecm, slave, index, 0)? else { continue };
        let count = first.bits;
        let is_readable = first.access != Access::WriteOnly;
        found(first)?;
        if !is_readable {
            continue;
        }
        // Of a record or an array sub-index 0 is the last one; of a plain object it is the value, and there is no other.
        for sub in (1..=count.min(254) as u8).take_while(|_| count <= 254) {
            match upload(&ecm, slave, index, sub)? {
                Some(object) => found(object)?,
                None if sub == 1 => break,
                None => {}
            }
        }
    }
    Ok(ecm.close(Close::Leave)?)
}

/// One sub-index; `None`: there is none.
fn upload(ecm: &Ecm, slave: u8, index: u16, sub: u8) -> Result<Option<MakersObject>, EcmError> {
    let address = ObjectAddress::new(index, sub);
    let object = |access, bits| MakersObject { address, data: MakersType::Any, access, bits, name: String::new() };
    match ecm.sdo_read::<u32>(slave, address) {
        Ok(bits) => Ok(Some(object(Access::ReadWrite, bits.into()))),
        Err(EcmError::SdoAborted { code: AbortCode::WRITE_ONLY, .. }) => Ok(Some(object(Access::WriteOnly, 0))),
        // A slave that is not there, or gone.
        Err(error @ EcmError::SdoAborted { code: AbortCode::TIMEOUT, .. }) => Err(error),
        Err(EcmError::SdoAborted { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}
