//! Generates the EEPROM of a device from the device's own description.
//!
//! \[OURS] Categories 20 (data types), 42 and 43 (extended FMMU and sync unit data) are left out: masters that do not know
//! them skip them by their length, and no known master needs them.

use super::EscSettings;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::registers::{Features, SmControl};
use crate::ethercat::sii::{
    CategoryKind, CoeDetails, FmmuUsage, MailboxArea, MailboxAreas, MailboxProtocols, SiiDcMode, SiiGeneral,
    SiiIdentity, SiiInfo, SiiPdo, SiiPdoEntry, SiiSmEnable, SiiSmType, SiiSyncManager, SiiWriter,
};
use crate::ethercat::{AlState, AlStatus, WireError};
use crate::slave::Slave;

/// \[OURS] The size of a device's EEPROM, bytes.
const EEPROM_BYTES: usize = 2048;
/// \[OURS] EEPROM word 2, the length of the SYNC0 and SYNC1 pulses, in units of 10 ns: 10 us.
const SYNC_PULSE_LENGTH: u16 = 1000;
/// \[OURS] The mailbox areas of every simulated device: the first 256 bytes of RAM, which leaves the rest for process data.
const MAILBOX: MailboxAreas =
    MailboxAreas { receive: MailboxArea { start: 0x1000, len: 128 }, send: MailboxArea { start: 0x1080, len: 128 } };
/// \[OURS] The bootstrap mailbox areas of a device with files. Longer mailboxes transfer a file in fewer packets.
const BOOT_MAILBOX: MailboxAreas =
    MailboxAreas { receive: MailboxArea { start: 0x1000, len: 256 }, send: MailboxArea { start: 0x1100, len: 256 } };
/// \[OURS] The start addresses of outputs and inputs, with room for three buffers of the longest process data, 64 bytes, each.
const OUTPUTS_START: u16 = 0x1100;
const INPUTS_START: u16 = 0x1400;
/// The object index of a padding entry in a PDO mapping.
const PADDING: u16 = 0;

/// Why the EEPROM of a device cannot be generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DescriptionError {
    /// The device refuses PreOP, the state in which its PDO mapping can be read.
    #[error("the device refuses PreOP with AL status code {0}; describe a device that was just switched on")]
    State(AlStatus),
    /// A required object cannot be read.
    #[error("object {object} cannot be read: {code}; a device needs 0x1018, 0x1C12 and 0x1C13 to be described")]
    Object {
        /// The address of the object.
        object: ObjectAddress,
        /// The abort code of the read.
        code: AbortCode,
    },
    /// The description of the device does not fit into the EEPROM.
    #[error("the description does not fit into {EEPROM_BYTES} bytes: {0}; map fewer objects")]
    TooLong(WireError),
}

impl From<WireError> for DescriptionError {
    fn from(error: WireError) -> Self {
        Self::TooLong(error)
    }
}

fn number(device: &mut dyn Slave, index: u16, sub: u8) -> Result<u32, DescriptionError> {
    let object = ObjectAddress::new(index, sub);
    device.upload(object).map(|value| value.bits).map_err(|code| DescriptionError::Object { object, code })
}

/// Reads the items of a list object, such as a PDO mapping. Sub-index 0 contains the number of items.
fn list(device: &mut dyn Slave, index: u16) -> Result<Vec<u32>, DescriptionError> {
    let count = number(device, index, 0)? as u8;
    (1..=count).map(|sub| number(device, index, sub)).collect()
}

/// The PDOs of one direction, each as its index and its entries. `assignment` is the object that lists them: 0x1C12 or 0x1C13.
fn pdos(device: &mut dyn Slave, assignment: u16) -> Result<Vec<(u16, Vec<SiiPdoEntry>)>, DescriptionError> {
    let mut pdos = Vec::new();
    for index in list(device, assignment)? {
        let index = index as u16;
        let entries = list(device, index)?.into_iter().map(|entry| described(&*device, entry)).collect();
        pdos.push((index, entries));
    }
    Ok(pdos)
}

fn described(device: &dyn Slave, entry: u32) -> SiiPdoEntry {
    let [bits, sub, low, high] = entry.to_le_bytes();
    let object = ObjectAddress::new(u16::from_le_bytes([low, high]), sub);
    let known = if object.index == PADDING { None } else { device.describe_entry(object).ok() };
    let data_type = known.map_or(0, |entry| entry.data_type.0 as u8);
    SiiPdoEntry { index: object.index, sub, name: 0, data_type, bits, flags: 0 }
}

/// The total length of PDOs, bytes.
fn bytes_of(pdos: &[(u16, Vec<SiiPdoEntry>)]) -> u16 {
    let bits: usize = pdos.iter().flat_map(|(_, entries)| entries).map(|entry| usize::from(entry.bits)).sum();
    bits.div_ceil(8) as u16
}

/// The text of object 0x1008, or else the display name of the device.
fn name_of(device: &mut dyn Slave) -> String {
    let mut text = [0; 64];
    match device.read(ObjectAddress::new(0x1008, 0), SdoScope::Entry, &mut text) {
        Ok(len) => String::from_utf8_lossy(&text[..len.min(text.len())]).into_owned(),
        Err(_) => device.name().to_owned(),
    }
}

/// Generates the EEPROM of a device: identity, mailbox, PDOs as mapped now, and distributed clocks. The device must be in
/// Init, and returns to Init.
///
/// # Errors
/// [`DescriptionError`] if the device refuses PreOP, lacks an object that the EEPROM needs, or maps too many objects for the
/// size of the EEPROM.
pub fn eeprom_of(device: &mut dyn Slave, settings: &EscSettings) -> Result<Vec<u8>, DescriptionError> {
    device.enter(AlState::PreOp).map_err(DescriptionError::State)?;
    let written = write(device, settings);
    // Every device can go to a lower state, so the result is always `Ok`.
    let _ = device.enter(AlState::Init);
    written
}

fn write(device: &mut dyn Slave, settings: &EscSettings) -> Result<Vec<u8>, DescriptionError> {
    let (outputs, inputs) = (pdos(device, 0x1C12)?, pdos(device, 0x1C13)?);
    let identity = SiiIdentity {
        vendor: number(device, 0x1018, 1)?,
        product: number(device, 0x1018, 2)?,
        revision: number(device, 0x1018, 3)?,
        serial: number(device, 0x1018, 4)?,
    };
    let has_files = device.files().is_some();
    let info = SiiInfo {
        pdi_control: settings.pdi_control,
        pdi_configuration: settings.pdi_configuration,
        sync_pulse_length: SYNC_PULSE_LENGTH,
        alias: device.station_alias(),
        identity,
        mailbox: MAILBOX,
        boot_mailbox: if has_files { BOOT_MAILBOX } else { MailboxAreas::default() },
        protocols: if has_files { MailboxProtocols::COE | MailboxProtocols::FOE } else { MailboxProtocols::COE },
        ..SiiInfo::default()
    };
    let mut eeprom = vec![0; EEPROM_BYTES];
    let mut sii = SiiWriter::new(&mut eeprom, &info)?;
    let (name, kind) = (name_of(device), device.name().to_owned());
    // Masters that are based on SOEM show the first string as the name, and ignore which string the general category names.
    sii.strings(&[&name, "ecmsk", &kind])?;
    let coe = coe_details(device);
    let ports = settings.ports.map(|port| match port {
        2 => 3,
        3 => 1,
        _ => 0,
    });
    let foe = u8::from(has_files);
    sii.general(&SiiGeneral { group: 2, order: 1, name: 3, coe, foe, ports, ..SiiGeneral::default() })?;
    sii.fmmus(&[FmmuUsage::Outputs, FmmuUsage::Inputs, FmmuUsage::MailboxState])?;
    sii.sync_managers(&sync_managers(bytes_of(&outputs), bytes_of(&inputs)))?;
    for (kind, pdos, manager) in [(CategoryKind::TxPdos, &inputs, 3), (CategoryKind::RxPdos, &outputs, 2)] {
        let pdos: Vec<(SiiPdo<'_>, &[SiiPdoEntry])> =
            pdos.iter().map(|(index, entries)| (SiiPdo::new(*index, manager, 0), &**entries)).collect();
        sii.pdos(kind, &pdos)?;
    }
    if device.has_dc() && settings.features.contains(Features::CLOCK) {
        sii.dc_modes(&[SiiDcMode { assign_activate: 0x0300, ..SiiDcMode::default() }])?;
    }
    sii.finish();
    Ok(eeprom)
}

/// The CoE features that the EEPROM announces. If complete access is announced, some masters read PDO assignment and
/// mapping with it. So it is announced only if 0x1C00 of the device can be read with complete access.
fn coe_details(device: &mut dyn Slave) -> CoeDetails {
    let has_information = device.object_from(0).is_some();
    let sync_manager_types = ObjectAddress::new(0x1C00, 0);
    let has_complete_access = device.read(sync_manager_types, SdoScope::Complete, &mut []).is_ok();
    let mut details = CoeDetails::SDO | CoeDetails::PDO_ASSIGN | CoeDetails::PDO_CONFIG;
    if has_information {
        details = details | CoeDetails::SDO_INFO;
    }
    if has_complete_access {
        details = details | CoeDetails::COMPLETE_ACCESS;
    }
    details
}

fn sync_managers(outputs: u16, inputs: u16) -> [SiiSyncManager; 4] {
    let manager = |start, len, control, kind| {
        let enable = if len > 0 { SiiSmEnable::ENABLE } else { SiiSmEnable::NONE };
        SiiSyncManager { start, len, control, status: 0, enable, kind }
    };
    let MailboxAreas { receive, send } = MAILBOX;
    [
        manager(receive.start, receive.len, SmControl::MAILBOX_OUT, SiiSmType::MailboxOut),
        manager(send.start, send.len, SmControl::MAILBOX_IN, SiiSmType::MailboxIn),
        manager(OUTPUTS_START, outputs, SmControl::OUTPUTS, SiiSmType::Outputs),
        manager(INPUTS_START, inputs, SmControl::INPUTS, SiiSmType::Inputs),
    ]
}
