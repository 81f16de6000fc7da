//! Reads and writes the objects of a drive, either on a network that this process runs itself, or behind a board.

use std::ops::RangeInclusive;

use ecmsk::bus::dictionary::{self, Entry, Object};
use ecmsk::bus::{BusError, Network};
use ecmsk::coe::{AbortCode, ObjectAccess, ObjectAddress, ObjectCode, SdoScope};
use ecmsk::ecm::{Ecm, EcmError};
use ecmsk::master::SdoError;
use ecmsk::slave::dictionary::Access;
use ecmsk::slave::{ManufacturerObject, ManufacturerType, ManufacturerValue, Mappable};

use super::ParamsError;
use super::choice::is_parameter;
use super::file::{Device, IDENTITY, TEXTS};
use super::kept::{Carries, Kept};

/// The answer of a drive to an SDO request: a value, or an abort code.
pub type Answer<T> = Result<T, AbortCode>;

/// A drive on any kind of link. The outer error of a method means that the drive or its link does not answer.
pub trait Drive {
    /// The numbers of the slaves.
    fn slaves(&mut self) -> Result<Vec<u8>, ParamsError>;

    /// Chooses the slave, from 1, for all following calls. Behind a board, a missing slave is detected only when its
    /// first object is read.
    fn choose(&mut self, slave: u8) -> Result<(), ParamsError>;

    /// Reads an object. Behind a board the result is always 4 bytes, little-endian: a shorter value is padded with
    /// zeros, and a longer value is cut.
    fn read(&mut self, object: ObjectAddress) -> Result<Answer<Vec<u8>>, ParamsError>;

    /// Writes an object. The inner error is the abort code of the drive. Behind a board the value must have 1, 2 or 4
    /// bytes; any other length gives [`AbortCode::LENGTH`].
    fn write(&mut self, object: ObjectAddress, value: &[u8]) -> Result<Answer<()>, ParamsError>;

    /// Reads all parameters of the drive without a list of its objects from the manufacturer; the result is sorted by
    /// address. `at` is called with each index before it is read.
    fn parameters(&mut self, at: &mut dyn FnMut(u16)) -> Result<Kept, ParamsError>;

    /// Which values the link can transfer completely.
    fn carries(&self) -> Carries;

    /// Reads the identity of the drive from its objects. Missing numbers are 0, and missing texts are empty.
    fn device(&mut self) -> Result<Device, ParamsError> {
        let mut number = |sub| -> Result<u32, ParamsError> {
            let bytes = self.read(ObjectAddress::new(IDENTITY, sub))?.unwrap_or_default();
            Ok(bytes.iter().take(4).rev().fold(0, |number, byte| number << 8 | u32::from(*byte)))
        };
        let [vendor, product, revision, serial] = [number(1)?, number(2)?, number(3)?, number(4)?];
        let mut texts = [const { String::new() }; 3];
        if self.carries() != Carries::Board {
            for ((_, object), text) in TEXTS.iter().zip(&mut texts) {
                let bytes = self.read(*object)?.unwrap_or_default();
                *text = String::from_utf8_lossy(&bytes).trim_end_matches('\0').trim().to_owned();
            }
        }
        Ok(Device { vendor, product, revision, serial, texts })
    }
}

/// A drive on a network that this process runs. Its objects are listed by its SDO information service.
pub struct OnNetwork {
    pub network: Box<dyn Network>,
    /// The numbers of the slaves that the scan has found.
    pub slaves: Vec<u8>,
    pub slave: u8,
}

/// Turns an SDO abort code into an [`Answer`], because the drive has answered. Any other error is returned as an error.
fn answered<T>(done: Result<T, BusError>) -> Result<Answer<T>, ParamsError> {
    match done {
        Ok(value) => Ok(Ok(value)),
        Err(BusError::Sdo { error: SdoError::Abort(code), .. }) => Ok(Err(code)),
        Err(error) => Err(error.into()),
    }
}

impl Drive for OnNetwork {
    fn slaves(&mut self) -> Result<Vec<u8>, ParamsError> {
        Ok(self.slaves.clone())
    }

    fn choose(&mut self, slave: u8) -> Result<(), ParamsError> {
        if !self.slaves.contains(&slave) {
            return Err(BusError::NoSuchSlave { slave, found: self.slaves.len() }.into());
        }
        self.slave = slave;
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress) -> Result<Answer<Vec<u8>>, ParamsError> {
        answered(self.network.upload(self.slave, object, SdoScope::Entry))
    }

    fn write(&mut self, object: ObjectAddress, value: &[u8]) -> Result<Answer<()>, ParamsError> {
        answered(self.network.download(self.slave, object, SdoScope::Entry, value))
    }

    fn parameters(&mut self, at: &mut dyn FnMut(u16)) -> Result<Kept, ParamsError> {
        let slave = self.slave;
        let listed = dictionary::objects(&mut *self.network, slave).map_err(|error| match error {
            BusError::NoInformation { slave } => ParamsError::NoList { slave },
            error => error.into(),
        })?;
        let mut kept = Kept::default();
        for object in listed {
            at(object.index);
            if !is_parameter(ObjectAddress::new(object.index, 0)) || !has_values(object.code) {
                continue;
            }
            for entry in dictionary::entries(&mut *self.network, slave, &object)? {
                if !entry.access.intersects(ObjectAccess::READ) || !entry.access.intersects(ObjectAccess::WRITE) {
                    continue;
                }
                let answer = self.read(entry.object)?;
                let bytes = answer.as_ref().map_or(0, Vec::len);
                kept.put(parameter(&object, &entry, bytes), answer, self.carries());
            }
        }
        Ok(kept)
    }

    fn carries(&self) -> Carries {
        Carries::AtMost(self.network.value_bytes_max())
    }
}

const fn has_values(code: ObjectCode) -> bool {
    !matches!(code, ObjectCode::Domain | ObjectCode::DefType | ObjectCode::DefStruct)
}

/// Describes a parameter, still without its value. `bytes` is the length of the value.
fn parameter(object: &Object, entry: &Entry, bytes: usize) -> ManufacturerObject {
    let name = match entry.name.as_str() {
        "" => object.name.clone(),
        name if name == object.name => name.to_owned(),
        name => format!("{}, {name}", object.name),
    };
    ManufacturerObject {
        address: entry.object,
        data: ManufacturerType::of_code(entry.data_type, bytes),
        access: Access::ReadWrite,
        mappable: Mappable::default(),
        value: ManufacturerValue::of_bytes(&[]),
        name,
    }
}

/// A drive behind a board. The board transfers at most 4 bytes of an object and has no SDO information service.
pub struct BehindBoard {
    pub ecm: Ecm,
    pub slave: u8,
}

/// The device type, which every slave has.
const DEVICE_TYPE: ObjectAddress = ObjectAddress::new(0x1000, 0);
/// The indexes that are tried if no file lists the objects: the manufacturer-specific objects, and the CiA 402 objects
/// of one axis.
const TRIED: [RangeInclusive<u16>; 2] = [0x2000..=0x5FFF, 0x6000..=0x67FF];

/// Turns an SDO abort code into an [`Answer`], because the drive has answered. Any other error of the board is returned
/// as an error.
fn told<T>(done: Result<T, EcmError>) -> Result<Answer<T>, ParamsError> {
    match done {
        Ok(value) => Ok(Ok(value)),
        // The board also reports an SDO timeout as an abort code. It means that the slave does not exist or no longer
        // answers.
        Err(EcmError::SdoAborted { code, .. }) if code != AbortCode::TIMEOUT => Ok(Err(code)),
        Err(error) => Err(error.into()),
    }
}

/// Whether an abort code means that the length of the value is not that of the object.
const fn is_length(code: AbortCode) -> bool {
    matches!(code, AbortCode::LENGTH | AbortCode::TOO_LONG | AbortCode::TOO_SHORT)
}

impl Drive for BehindBoard {
    /// Reads the device type of the slaves in order, up to the first slave that does not answer.
    fn slaves(&mut self) -> Result<Vec<u8>, ParamsError> {
        let mut found = Vec::new();
        for slave in 1..=self.ecm.slot_size()?.max_slaves() as u8 {
            match self.ecm.sdo_read::<u32>(slave, DEVICE_TYPE) {
                Err(EcmError::SdoAborted { code: AbortCode::TIMEOUT, .. } | EcmError::Timeout { .. }) => break,
                Ok(_) | Err(EcmError::SdoAborted { .. }) => found.push(slave),
                Err(error) => return Err(error.into()),
            }
        }
        if found.is_empty() { Err(BusError::NoSlave.into()) } else { Ok(found) }
    }

    fn choose(&mut self, slave: u8) -> Result<(), ParamsError> {
        self.slave = slave;
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress) -> Result<Answer<Vec<u8>>, ParamsError> {
        Ok(told(self.ecm.sdo_read::<u32>(self.slave, object))?.map(|bits| bits.to_le_bytes().to_vec()))
    }

    fn write(&mut self, object: ObjectAddress, value: &[u8]) -> Result<Answer<()>, ParamsError> {
        let byte = |at: usize| value.get(at).copied().unwrap_or(0);
        let bits = u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]);
        match value.len() {
            1 => told(self.ecm.sdo_write(self.slave, object, byte(0))),
            2 => told(self.ecm.sdo_write(self.slave, object, bits as u16)),
            4 => told(self.ecm.sdo_write(self.slave, object, bits)),
            _ => Ok(Err(AbortCode::LENGTH)),
        }
    }

    /// Reads the objects of [`TRIED`] that exist. It is not known what type they have or whether they can be written.
    /// Of a longer value only the first 4 bytes are kept, since a board does not report the length.
    fn parameters(&mut self, at: &mut dyn FnMut(u16)) -> Result<Kept, ParamsError> {
        let mut kept = Kept::default();
        let mut keep = |object: ManufacturerObject| {
            if object.access != Access::WriteOnly && is_parameter(object.address) {
                kept.objects.push(object);
            }
            Ok::<_, ParamsError>(())
        };
        crate::objects::read_drive(&self.ecm, self.slave, &TRIED, &mut keep, at)?;
        Ok(kept)
    }

    fn carries(&self) -> Carries {
        Carries::Board
    }
}

/// Writes a value whose length in the drive is not known. First all bytes are written. If the drive rejects the length,
/// 2 bytes and 1 byte are tried, provided that only zeros are cut off.
pub fn write_any(drive: &mut dyn Drive, object: ObjectAddress, value: &[u8]) -> Result<Answer<()>, ParamsError> {
    let mut answer = drive.write(object, value)?;
    for len in [2, 1] {
        let fits = value.len() > len && value[len..].iter().all(|byte| *byte == 0);
        if answer.is_err_and(is_length) && fits {
            answer = drive.write(object, &value[..len])?;
        }
    }
    Ok(answer)
}
