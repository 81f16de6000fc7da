//! ESI files of devices with any mapping, name and controller: the file is XML, has what readers insist on, and says what the
//! EEPROM of the same device says.

#![no_main]

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::Features;
use ecmsk::ethercat::sii::{CategoryKind, Sii};
use ecmsk::slave::esc::{EscSettings, eeprom_of, esi_of};
use ecmsk::slave::{Channels, Dp3cl, Dp3clConfig, Drive, DriveConfig, Hsp, HspConfig, Io, ManufacturerObjects, Slave};
use libfuzzer_sys::fuzz_target;
use roxmltree::{Document, Node};

/// Bytes of the options, in front of what is written to objects.
const OPTIONS: usize = 8;
/// Bytes of a write: index, sub-index, length, value.
const WRITE: usize = 12;

fuzz_target!(|bytes: &[u8]| {
    let Some((options, rest)) = bytes.split_first_chunk::<OPTIONS>() else { return };
    let (writes, name) = rest.split_at(rest.len() / 2);
    let settings = EscSettings {
        features: Features(u16::from_le_bytes([options[1], options[2]])),
        ports: [options[3] & 3, options[3] >> 2 & 3, options[3] >> 4 & 3, options[3] >> 6],
        pdi_control: u16::from_le_bytes([options[4], options[5]]),
        pdi_configuration: u16::from_le_bytes([options[6], options[7]]),
        ..EscSettings::default()
    };
    let name = String::from_utf8_lossy(name);
    let device = || {
        let mut device = device(options[0], &name);
        // A mapping is written in PreOP; what is refused leaves the one before.
        device.enter(AlState::PreOp).expect("a device that was just switched on");
        for write in writes.as_chunks::<WRITE>().0 {
            let index = [0x1600, 0x1601, 0x1610, 0x1A00, 0x1A01, 0x1C12, 0x1C13, 0x2100][usize::from(write[0] % 8)];
            let scope = if write[1] & 0x80 == 0 { SdoScope::Entry } else { SdoScope::Complete };
            let len = usize::from(write[2]) % 9;
            let _ = device.write(ObjectAddress::new(index, write[1] & 0x1F), scope, &write[3..][..len]);
        }
        device.enter(AlState::Init).expect("Init");
        device
    };
    let (esi, eeprom) = match (esi_of(&mut *device(), &settings), eeprom_of(&mut *device(), &settings)) {
        (Ok(esi), Ok(eeprom)) => (esi, eeprom),
        (esi, eeprom) => {
            assert_eq!(esi.is_ok(), eeprom.is_ok(), "{esi:?}");
            return;
        }
    };
    check(&esi, &Sii::new(&eeprom).expect("an EEPROM"));
});

fn device(kind: u8, name: &str) -> Box<dyn Slave> {
    let name = name.to_owned();
    let mut device: Box<dyn Slave> = match kind % 6 {
        0 => Box::new(Drive::new(DriveConfig { name, ..DriveConfig::default() })),
        1 => Box::new(Drive::new(DriveConfig { name, ..DriveConfig::stepper() })),
        2 => Box::new(Dp3cl::new(Dp3clConfig { name, ..Dp3clConfig::default() })),
        3 => Box::new(Io::default()),
        4 => Box::new(Hsp::new(HspConfig::with(Channels::One))),
        _ => Box::new(Hsp::new(HspConfig::with(Channels::Two))),
    };
    if kind & 0x80 != 0 {
        let objects = ManufacturerObjects::parse("0x2100:0 u16 rw 0 <&\"> of a maker\n").expect("an object");
        device.add_manufacturer_objects(objects);
    }
    device
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Node<'a, 'a> {
    children(node, name).next().unwrap_or_else(|| panic!("{} has no {name}", node.tag_name().name()))
}

fn children<'a>(node: Node<'a, 'a>, name: &str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |node| node.has_tag_name(name))
}

fn text<'a>(node: Node<'a, 'a>, name: &str) -> &'a str {
    child(node, name).text().unwrap_or_default()
}

/// A number as ESI files have it: `#x` and hexadecimal, or decimal.
fn number(text: &str) -> u32 {
    match text.strip_prefix("#x") {
        Some(digits) => u32::from_str_radix(digits, 16).expect("hexadecimal"),
        None => text.parse().expect("a number"),
    }
}

fn check(esi: &str, sii: &Sii<'_>) {
    let document = Document::parse(esi).unwrap_or_else(|error| panic!("{error}: {esi}"));
    let root = document.root_element();
    let identity = sii.info().identity;
    assert_eq!(number(text(child(root, "Vendor"), "Id")), identity.vendor);
    let device = child(child(child(root, "Descriptions"), "Devices"), "Device");
    let kind = child(device, "Type");
    let code = |name| number(kind.attribute(name).expect("a code"));
    assert_eq!((code("ProductCode"), code("RevisionNo")), (identity.product, identity.revision));
    let count =
        |kind, of: fn(&ecmsk::ethercat::sii::Category<'_>) -> usize| sii.category(kind).iter().map(of).sum::<usize>();
    assert_eq!(children(device, "Sm").count(), count(CategoryKind::SyncManagers, |all| all.sync_managers().count()));
    assert_eq!(children(device, "Fmmu").count(), count(CategoryKind::Fmmus, |all| all.fmmus().count().min(3)));
    for (tag, kind) in [("RxPdo", CategoryKind::RxPdos), ("TxPdo", CategoryKind::TxPdos)] {
        let pdos = sii.category(kind).into_iter().flat_map(|all| all.pdos()).map(|pdo| pdo.expect("a PDO"));
        let pdos: Vec<_> = pdos.collect();
        assert_eq!(children(device, tag).count(), pdos.len());
        for (node, pdo) in children(device, tag).zip(pdos) {
            assert_eq!(number(text(node, "Index")), u32::from(pdo.index));
            assert!(!text(node, "Name").is_empty());
            assert_eq!(children(node, "Entry").count(), pdo.entries.iter().count());
            for (node, entry) in children(node, "Entry").zip(pdo.entries.iter()) {
                assert_eq!(number(text(node, "Index")), u32::from(entry.index));
                assert_eq!(number(text(node, "BitLen")), u32::from(entry.bits));
            }
        }
    }
    for mode in children(device, "Dc").map(|dc| child(dc, "OpMode")) {
        assert!(!text(mode, "Name").is_empty());
        number(text(mode, "AssignActivate"));
    }
    let eeprom = child(device, "Eeprom");
    number(text(eeprom, "ByteSize"));
    assert_eq!(text(eeprom, "ConfigData").len(), 28);
}
