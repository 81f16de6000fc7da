//! Reads and writes the PDO assignment and mapping of slaves by SDO, and adds up the lengths of their PDOs.

use super::Lengths;
use super::requests::Requests;
use crate::ethercat::Ns;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::xf::chip::network::{IMAGE_MAX, SdoData};
use crate::xf::request::{MappedObject, PdoAssignment, PdoConfig, PdoConfigForm, PdoConfigRequest, PdoMap};

/// Timeout of an SDO transfer for a slave's mapping. `[OURS]`
const ANSWER_MAX_NS: Ns = 1_000_000_000;

/// Reads an object of up to 4 bytes; a longer one is a length error.
async fn read_number(requests: &Requests, slave: u8, index: u16, sub: u8) -> Result<u32, AbortCode> {
    let object = (slave, ObjectAddress::new(index, sub));
    let (value, len) = requests.read(object, SdoScope::Entry, 4, ANSWER_MAX_NS).await?;
    let mut bytes = [0; 4];
    match len {
        1..=4 => {
            bytes[..len].copy_from_slice(&value[..len]);
            Ok(u32::from_le_bytes(bytes))
        }
        _ => Err(AbortCode::LENGTH),
    }
}

async fn write_number(requests: &Requests, slave: u8, index: u16, sub: u8, value: &[u8]) -> Result<(), AbortCode> {
    let object = (slave, ObjectAddress::new(index, sub));
    requests.write(object, SdoScope::Entry, SdoData::of(0, value), ANSWER_MAX_NS).await
}

/// Reads one entry of a mapping object.
async fn read_entry(requests: &Requests, slave: u8, index: u16, sub: u8) -> Result<MappedObject, AbortCode> {
    Ok(MappedObject::from_bytes(read_number(requests, slave, index, sub).await?.to_le_bytes()))
}

/// Reads the index of the assigned PDO number `sub`, and the number of its objects.
///
/// # Errors
/// The abort code of the slave.
async fn assigned(requests: &Requests, slave: u8, assignment: PdoAssignment, sub: u8) -> Result<(u16, u8), AbortCode> {
    let index = read_number(requests, slave, assignment.code(), sub).await? as u16;
    let objects = read_number(requests, slave, index, 0).await? as u8;
    Ok((index, objects))
}

/// Reads the number of assigned PDOs.
async fn count(requests: &Requests, slave: u8, assignment: PdoAssignment) -> Result<u8, AbortCode> {
    match read_number(requests, slave, assignment.code(), 0).await {
        // The slave has no process data in this direction.
        Err(AbortCode::NO_OBJECT) => Ok(0),
        count => Ok(count?.min(u8::MAX.into()) as u8),
    }
}

/// The size of the process data in one direction according to the slave's mapping objects, in bytes.
///
/// # Errors
/// The abort code of the slave, or [`AbortCode::PDO_LENGTH`] for more than [`IMAGE_MAX`].
async fn mapped_bytes(requests: &Requests, slave: u8, assignment: PdoAssignment) -> Result<u16, AbortCode> {
    let mut bits = 0_usize;
    for sub in 1..=count(requests, slave, assignment).await? {
        let (index, objects) = assigned(requests, slave, assignment, sub).await?;
        for sub in 1..=objects {
            bits += usize::from(read_entry(requests, slave, index, sub).await?.bits);
        }
    }
    let bytes = bits.div_ceil(8);
    if bytes > IMAGE_MAX { Err(AbortCode::PDO_LENGTH) } else { Ok(bytes as u16) }
}

/// The sizes of each slave's outputs and inputs in bytes: the length that the host has assigned, otherwise the length
/// of the slave's mapping objects.
///
/// # Errors
/// The abort code of a slave, or [`AbortCode::PDO_LENGTH`] if the outputs or the inputs of all slaves together exceed the
/// process images.
pub(super) async fn lengths(requests: &Requests, assigned: &[[Option<u16>; 2]]) -> Result<Lengths, AbortCode> {
    let mut lengths = Lengths::empty([0; 2]);
    let mut totals = [0; 2];
    for (slave, assigned) in (0..).zip(assigned) {
        let mut of_slave = [0; 2];
        for (n, assignment) in [PdoAssignment::Rx, PdoAssignment::Tx].into_iter().enumerate() {
            of_slave[n] = match assigned[n] {
                Some(bytes) => bytes,
                None => mapped_bytes(requests, slave, assignment).await?,
            };
            totals[n] += usize::from(of_slave[n]);
        }
        if totals.iter().any(|total| *total > IMAGE_MAX) {
            return Err(AbortCode::PDO_LENGTH);
        }
        lengths.push(of_slave);
    }
    Ok(lengths)
}

/// Writes PDO mapping and assignment in the usual order of CoE: clears the assignment, fills each PDO and sets its
/// number of objects, then assigns the PDOs.
///
/// `[OURS]` A PDO without objects is assigned without changing its mapping, for slaves with fixed PDOs.
pub(super) async fn set(requests: &Requests, config: &PdoConfig) -> Result<(), AbortCode> {
    let (slave, assignment) = (config.slave.get(), config.assignment.code());
    write_number(requests, slave, assignment, 0, &[0]).await?;
    for map in config.maps().iter().filter(|map| !map.objects().is_empty()) {
        write_number(requests, slave, map.index(), 0, &[0]).await?;
        for (sub, object) in (1..).zip(map.objects()) {
            write_number(requests, slave, map.index(), sub, &object.to_bytes()).await?;
        }
        write_number(requests, slave, map.index(), 0, &[map.objects().len() as u8]).await?;
    }
    for (sub, map) in (1..).zip(config.maps()) {
        write_number(requests, slave, assignment, sub, &map.index().to_le_bytes()).await?;
    }
    write_number(requests, slave, assignment, 0, &[config.maps().len() as u8]).await
}

/// Reads PDO assignment and mapping. `[OURS]` If the answer has no room for all PDOs or objects, the result is the abort code
/// 0x06040042 (PDO length exceeded).
pub(super) async fn read(
    requests: &Requests,
    request: &PdoConfigRequest,
    form: PdoConfigForm,
) -> Result<PdoConfig, AbortCode> {
    let (slave, assignment) = (request.slave.get(), request.assignment);
    let (mut maps, mut found) = ([PdoMap::default(); 4], 0);
    for sub in 1..=count(requests, slave, assignment).await? {
        let (index, objects) = assigned(requests, slave, assignment, sub).await?;
        let mut entries = [MappedObject::default(); PdoMap::OBJECTS];
        let entries = entries.get_mut(..objects.into()).ok_or(AbortCode::PDO_LENGTH)?;
        for (sub, entry) in (1..).zip(entries.iter_mut()) {
            *entry = read_entry(requests, slave, index, sub).await?;
        }
        let place = maps.get_mut(found).ok_or(AbortCode::PDO_LENGTH)?;
        *place = PdoMap::new(index, entries).ok_or(AbortCode::PDO_LENGTH)?;
        found += 1;
    }
    PdoConfig::new(request.slave, request.assignment, form, &maps[..found]).ok_or(AbortCode::PDO_LENGTH)
}
