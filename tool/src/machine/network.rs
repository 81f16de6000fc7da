//! Identifies the slaves of a network, or behind a board, as far as their objects and EEPROMs allow it.

use ecmsk::bus::{self, BusError, Network};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ecm::{Ecm, EcmError};
use ecmsk::link::slaves::SlaveModel;
use ecmsk::link::uri::LinkUri;

use super::MachineVerbError;

/// The object "device type": the lower half is the device profile (CiA 401 or 402), the upper half the kind of device.
const DEVICE_TYPE: ObjectAddress = ObjectAddress::new(0x1000, 0);
/// Vendor id, product code and revision number: sub-indices 1 to 3 of the identity object.
const IDENTITY: [ObjectAddress; 3] =
    [ObjectAddress::new(0x1018, 1), ObjectAddress::new(0x1018, 2), ObjectAddress::new(0x1018, 3)];

/// A slave that was found on a network, or that answers SDOs behind a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundSlave {
    pub vendor: u32,
    pub product: u32,
    pub revision: u32,
    /// The name of the slave in its EEPROM; empty if it has none, and always behind a board, which does not give access
    /// to EEPROMs.
    pub name: String,
    /// The kind of the slave, from its name or its device type; `None` if neither shows it.
    pub kind: Option<SlaveModel>,
}

/// Finds the slaves of a network or behind a board, in network order.
///
/// # Errors
/// [`MachineVerbError::NoSlave`] if no slave answers; errors of the network or the board.
pub fn slaves(link: &LinkUri) -> Result<Vec<FoundSlave>, MachineVerbError> {
    crate::recording_end::note_opened(link);
    let link = link.to_string();
    let found = match bus::open(&link) {
        Ok(network) => of_network(network)?,
        Err(BusError::IsBoard { .. }) => of_board(&Ecm::open(&link)?)?,
        Err(error) => return Err(error.into()),
    };
    if found.is_empty() { Err(MachineVerbError::NoSlave { link }) } else { Ok(found) }
}

fn of_network(mut network: Box<dyn Network>) -> Result<Vec<FoundSlave>, MachineVerbError> {
    let found = network.scan()?;
    let one = |slave: bus::FoundSlave| {
        // A slave without a mailbox has no device type. This is no error; the device type is then 0.
        let answer = network.upload(slave.slave, DEVICE_TYPE, SdoScope::Entry).unwrap_or_default();
        let device_type = answer.iter().take(4).rev().fold(0, |number, byte| number << 8 | u32::from(*byte));
        let identity = slave.identity;
        let (vendor, product, revision) = (identity.vendor, identity.product, identity.revision);
        FoundSlave { vendor, product, revision, kind: kind(&slave.name, device_type), name: slave.name }
    };
    Ok(found.into_iter().map(one).collect())
}

/// Finds the slaves behind a board by SDOs. A board does not report the number of its slaves, so each slave is queried
/// in turn until one does not answer.
fn of_board(ecm: &Ecm) -> Result<Vec<FoundSlave>, MachineVerbError> {
    let mut found = Vec::new();
    for slave in 1..=ecm.slot_size()?.max_slaves() as u8 {
        let read = |object| match ecm.sdo_read::<u32>(slave, object) {
            Ok(value) => Ok(Some(value)),
            Err(EcmError::SdoAborted { code, .. }) if code != AbortCode::TIMEOUT => Ok(Some(0)),
            Err(EcmError::SdoAborted { .. } | EcmError::Timeout { .. }) => Ok(None),
            Err(error) => Err(error),
        };
        let Some(device_type) = read(DEVICE_TYPE)? else { break };
        let mut numbers = [0; 3];
        for (object, number) in IDENTITY.into_iter().zip(&mut numbers) {
            *number = read(object)?.unwrap_or_default();
        }
        let [vendor, product, revision] = numbers;
        found.push(FoundSlave { vendor, product, revision, name: String::new(), kind: kind("", device_type) });
    }
    Ok(found)
}

/// The kind of a slave. If its name is that of a simulated slave, the name decides, otherwise the device type. CiA 402
/// is a stepper or a servo drive, CiA 401 an IO slave. A pulse module has the device type of a stepper.
fn kind(name: &str, device_type: u32) -> Option<SlaveModel> {
    let by_name = SlaveModel::ALL.into_iter().find(|model| model.name().eq_ignore_ascii_case(name));
    by_name.or(match (device_type & 0xFFFF, device_type >> 16 & 0xFF) {
        (402, 0x04) => Some(SlaveModel::Step),
        (402, _) => Some(SlaveModel::Drive),
        (401, _) => Some(SlaveModel::Io),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_those_of_names_and_device_types() {
        assert_eq!(kind("MADLN05BE", 0x0002_0192), Some(SlaveModel::Drive));
        assert_eq!(kind("", 0x0004_0192), Some(SlaveModel::Step));
        assert_eq!(kind("HSP2", 0x0004_0192), Some(SlaveModel::Hsp2));
        assert_eq!(kind("EL1004", 0), None);
        assert_eq!(kind("", 0x0003_0191), Some(SlaveModel::Io));
    }
}
