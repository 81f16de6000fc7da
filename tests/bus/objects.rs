//! The objects of a slave.

use ecmsk::bus::dictionary::{self, ObjectValue};
use ecmsk::coe::{DataTypeCode, ObjectAccess, ObjectAddress, ObjectCode, SdoScope};
use ecmsk::ethercat::sii::{CategoryKind, Sii, checksum};

use crate::{network, refused};

/// BUS-3.1 All objects of the slave's own dictionary, each with its sub-indices, types, rights and values.
#[test]
fn the_dictionary_of_a_slave() {
    let (mut network, _) = network("drive");
    let objects = dictionary::objects(&mut *network, 1).expect("a dictionary");
    assert!(objects.is_sorted_by_key(|object| object.index) && objects.len() > 20, "{}", objects.len());
    let identity = objects.iter().find(|object| object.index == 0x1018).expect("it is there");
    assert_eq!((identity.code, identity.max_sub, &*identity.name), (ObjectCode::Record, 4, "Identity"));
    let entries = dictionary::entries(&mut *network, 1, identity).expect("its entries");
    assert_eq!(entries.len(), 5);
    let vendor = &entries[1];
    assert_eq!((vendor.data_type, vendor.bits, &*vendor.name), (DataTypeCode::UNSIGNED32, 32, "Vendor ID"));
    assert!(vendor.access.contains(ObjectAccess::READ) && !vendor.access.intersects(ObjectAccess::WRITE));
    let bytes = dictionary::value(&mut *network, 1, vendor).expect("an answer").expect("readable").expect("a value");
    assert_eq!(ObjectValue::of(vendor.data_type, &bytes), ObjectValue::Whole(0x4543_4D53));
    let unreadable = dictionary::Entry { access: ObjectAccess::WRITE, ..vendor.clone() };
    assert_eq!(dictionary::value(&mut *network, 1, &unreadable).expect("not asked"), None);
    let missing = dictionary::Entry { object: ObjectAddress::new(0x1018, 9), ..vendor.clone() };
    assert!(matches!(dictionary::value(&mut *network, 1, &missing), Ok(Some(Err(_)))));
}

/// Single objects are read and written; aborts are reported as texts.
#[test]
fn single_objects() {
    let (mut network, _) = network("drive");
    let speed = ObjectAddress::new(0x6099, 1);
    network.download(1, speed, SdoScope::Entry, &[0x50, 0xC3, 0, 0]).expect("it is written");
    assert_eq!(network.upload(1, speed, SdoScope::Entry).expect("it is read"), [0x50, 0xC3, 0, 0]);
    let said = refused(network.upload(1, ObjectAddress::new(0x5555, 0), SdoScope::Entry));
    assert!(said.contains("0x06020000 (object does not exist") && said.contains("`ecmsk bus sdo list`"), "{said}");
    let said = refused(network.download(1, ObjectAddress::new(0x6041, 0), SdoScope::Entry, &[0, 0]));
    assert!(said.contains("read-only object") && said.contains("manual"), "{said}");
}

/// Without CoE in the EEPROM there are no objects. A slave whose EEPROM does not give SDO information is asked all the same.
#[test]
fn slaves_without_objects_or_a_dictionary_are_told() {
    let (mut network, _) = network("io");
    let content = network.read_eeprom(1).expect("an EEPROM");
    // The flag of SDO information is bit 1 of byte 5 of the general category.
    let sii = Sii::new(&content).expect("whole");
    let general = sii.category(CategoryKind::General).expect("it has one").data.as_ptr() as usize;
    let word = (general - content.as_ptr() as usize + 4) / 2;
    let flags = u16::from_le_bytes([content[2 * word], content[2 * word + 1]]);
    network.write_eeprom_words(1, word as u16, &[flags & !0x0200]).expect("it is written");
    network.scan().expect("a slave");
    assert!(network.object_list(1).expect("it answers").contains(&0x1000));
    network.upload(1, ObjectAddress::new(0x1000, 0), SdoScope::Entry).expect("it has objects");
    // The protocols are word 0x1C.
    network.write_eeprom_words(1, 0x1C, &[0]).expect("it is written");
    assert!(network.scan().expect("a slave")[0].protocols.is_some_and(|protocols| protocols.0 == 0));
    for said in [
        refused(network.upload(1, ObjectAddress::new(0x1000, 0), SdoScope::Entry)),
        refused(network.object_list(1)),
        refused(dictionary::objects(&mut *network, 1)),
    ] {
        assert!(said.contains("slave 1 has no objects: its EEPROM declares no CoE"), "{said}");
    }
    assert_eq!(checksum(content.first_chunk().expect("14 bytes")), content[14], "the protocols are not covered by it");
}
