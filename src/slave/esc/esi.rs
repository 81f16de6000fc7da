//! Generates the ESI file of a device (ETG.2000) from the same description as its EEPROM, for TwinCAT and other
//! configuration tools.

use std::ops::Range;

use super::{DescriptionError, EscSettings, eeprom_of};
use crate::ethercat::coe::ObjectAddress;
use crate::ethercat::sii::{
    CategoryKind, CoeDetails, FmmuUsage, MailboxProtocols, Sii, SiiGeneral, SiiInfo, SiiPdoEntry, SiiSmEnable,
    SiiSmType,
};
use crate::ethercat::{AlState, WireError};
use crate::slave::Slave;

/// \[OURS] The vendor name of all simulated devices.
const VENDOR: &str = "ecmsk";

/// Generates the ESI file of a device from its EEPROM and the names of its objects. The device must be in Init, and returns
/// to Init.
///
/// # Errors
/// [`DescriptionError`] under the same conditions as [`eeprom_of`].
pub fn esi_of(device: &mut dyn Slave, settings: &EscSettings) -> Result<String, DescriptionError> {
    let eeprom = eeprom_of(device, settings)?;
    device.enter(AlState::PreOp).map_err(DescriptionError::State)?;
    let written = write(&*device, settings, &eeprom);
    // Every device can go to a lower state, so the result is always `Ok`.
    let _ = device.enter(AlState::Init);
    Ok(written?)
}

fn write(device: &dyn Slave, settings: &EscSettings, eeprom: &[u8]) -> Result<String, WireError> {
    let sii = Sii::new(eeprom)?;
    let info = sii.info();
    let text = |number| {
        let strings = sii.category(CategoryKind::Strings).and_then(|category| category.strings().get(number));
        escaped(&strings.map(String::from_utf8_lossy).unwrap_or_default())
    };
    let general =
        sii.category(CategoryKind::General).map(|category| category.general()).transpose()?.unwrap_or_default();
    let mut esi = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<EtherCATInfo Version=\"1.6\">\n");
    let (vendor, product, revision) = (info.identity.vendor, info.identity.product, info.identity.revision);
    let ports: String =
        settings.ports.iter().filter_map(|port| [None, None, Some('K'), Some('Y')][usize::from(port & 3)]).collect();
    let (order, name, group) = (text(general.order), text(general.name), text(general.group));
    let mut lines = |line: String| esi.push_str(&(line + "\n"));
    lines(format!(" <Vendor><Id>#x{vendor:08X}</Id><Name>{VENDOR}</Name></Vendor>"));
    lines(" <Descriptions>".into());
    lines(format!("  <Groups><Group><Type>{group}</Type><Name>{group}</Name></Group></Groups>"));
    lines(format!("  <Devices>\n   <Device Physics=\"{ports}\">"));
    lines(format!("    <Type ProductCode=\"#x{product:08X}\" RevisionNo=\"#x{revision:08X}\">{order}</Type>"));
    lines(format!("    <Name>{name}</Name>\n    <GroupType>{group}</GroupType>"));
    for usage in sii.category(CategoryKind::Fmmus).iter().flat_map(|category| category.fmmus()) {
        let usage = match usage {
            FmmuUsage::Outputs => "Outputs",
            FmmuUsage::Inputs => "Inputs",
            FmmuUsage::MailboxState => "MBoxState",
            _ => continue,
        };
        lines(format!("    <Fmmu>{usage}</Fmmu>"));
    }
    for manager in sii.category(CategoryKind::SyncManagers).iter().flat_map(|category| category.sync_managers()) {
        let kind = match manager.kind {
            SiiSmType::MailboxOut => "MBoxOut",
            SiiSmType::MailboxIn => "MBoxIn",
            SiiSmType::Outputs => "Outputs",
            SiiSmType::Inputs => "Inputs",
            _ => continue,
        };
        let enable = u8::from(manager.enable.contains(SiiSmEnable::ENABLE));
        let (len, start, control) = (manager.len, manager.start, manager.control.0);
        lines(format!(
            "    <Sm DefaultSize=\"{len}\" StartAddress=\"#x{start:04X}\" ControlByte=\"#x{control:02X}\" Enable=\"{enable}\">{kind}</Sm>"
        ));
    }
    for (kind, tag) in [(CategoryKind::RxPdos, "RxPdo"), (CategoryKind::TxPdos, "TxPdo")] {
        for pdo in sii.category(kind).iter().flat_map(|category| category.pdos()) {
            let pdo = pdo?;
            let index = pdo.index;
            lines(format!(
                "    <{tag} Sm=\"{}\"><Index>#x{index:04X}</Index><Name>{tag} {index:04X}</Name>",
                pdo.sync_manager
            ));
            pdo.entries.iter().for_each(|entry| lines(entry_line(device, entry)));
            lines(format!("    </{tag}>"));
        }
    }
    lines(mailbox(&general, info.protocols, device.has_long_values()));
    if sii.category(CategoryKind::DcModes).is_some() {
        for mode in sii.category(CategoryKind::DcModes).iter().flat_map(|category| category.dc_modes()) {
            lines(format!(
                "    <Dc><OpMode><Name>DC</Name><AssignActivate>#x{:04X}</AssignActivate></OpMode></Dc>",
                mode.assign_activate
            ));
        }
    }
    lines(memory(&info, eeprom));
    lines("   </Device>\n  </Devices>\n </Descriptions>\n</EtherCATInfo>".into());
    Ok(esi)
}

fn entry_line(device: &dyn Slave, entry: SiiPdoEntry) -> String {
    let SiiPdoEntry { index, sub, bits, data_type, .. } = entry;
    if index == 0 {
        return format!("     <Entry><Index>0</Index><BitLen>{bits}</BitLen></Entry>");
    }
    let known = device.describe_entry(ObjectAddress::new(index, sub));
    let name = known.map_or_else(|_| format!("{index:04X}:{sub}"), |entry| escaped(entry.name));
    format!(
        "     <Entry><Index>#x{index:04X}</Index><SubIndex>{sub}</SubIndex><BitLen>{bits}</BitLen><Name>{name}</Name>\
         <DataType>{}</DataType></Entry>",
        type_name(data_type, bits)
    )
}

/// The name of a data type by its code (ETG.1020). An unknown code gets the name of the unsigned type of the same length.
fn type_name(code: u8, bits: u8) -> String {
    let known = [
        (1, "BOOL"),
        (2, "SINT"),
        (3, "INT"),
        (4, "DINT"),
        (5, "USINT"),
        (6, "UINT"),
        (7, "UDINT"),
        (8, "REAL"),
        (0x15, "LINT"),
        (0x1B, "ULINT"),
    ];
    match (known.iter().find(|(known, _)| *known == code), bits) {
        (Some((_, name)), _) => (*name).to_owned(),
        (None, 8) => "USINT".to_owned(),
        (None, 16) => "UINT".to_owned(),
        (None, 32) => "UDINT".to_owned(),
        (None, bits) => format!("BIT{bits}"),
    }
}

/// The `Mailbox` element of the ESI file with the CoE features. `has_segments`: whether a value may be too long for one mailbox
/// message. \[OURS] Otherwise `SegmentedSdo` is 0, as in the manufacturer's ESI file of the DP3CL.
fn mailbox(general: &SiiGeneral, protocols: MailboxProtocols, has_segments: bool) -> String {
    let flag = |bit| u8::from(general.coe.contains(bit));
    let files = if protocols.contains(MailboxProtocols::FOE) { "<FoE/>" } else { "" };
    format!(
        "    <Mailbox><CoE SdoInfo=\"{}\" PdoAssign=\"{}\" PdoConfig=\"{}\" CompleteAccess=\"{}\" SegmentedSdo=\"{}\"/>{files}</Mailbox>",
        flag(CoeDetails::SDO_INFO),
        flag(CoeDetails::PDO_ASSIGN),
        flag(CoeDetails::PDO_CONFIG),
        flag(CoeDetails::COMPLETE_ACCESS),
        u8::from(has_segments)
    )
}

/// The EEPROM element: the configuration words 0 to 6 and, if the device supports FoE, the bootstrap mailboxes, each as
/// hexadecimal bytes in EEPROM order. A configuration tool writes them to the slave's EEPROM.
fn memory(info: &SiiInfo, eeprom: &[u8]) -> String {
    const CONFIGURED: Range<usize> = 0..14;
    const BOOT_MAILBOX: Range<usize> = 0x28..0x30;
    let words = info.encode();
    let hex = |bytes: Range<usize>| words[bytes].iter().map(|byte| format!("{byte:02X}")).collect::<String>();
    let config = hex(CONFIGURED);
    let boot = if info.protocols.contains(MailboxProtocols::FOE) {
        format!("<BootStrap>{}</BootStrap>", hex(BOOT_MAILBOX))
    } else {
        String::new()
    };
    format!("    <Eeprom><ByteSize>{}</ByteSize><ConfigData>{config}</ConfigData>{boot}</Eeprom>", eeprom.len())
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
