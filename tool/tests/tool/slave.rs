//! `ecmsk slave`: the EEPROM and the ESI file of a kind of simulated slave.

use ecmsk::ethercat::sii::CategoryKind;
use ecmsk::link::slaves::SlaveModel;

use crate::common::ecmsk;

/// ECAT-15.15 The ESI file of each kind agrees with its EEPROM: identity, process data, sync managers.
#[test]
fn the_esi_file_says_what_the_eeprom_says() {
    for kind in SlaveModel::ALL.map(SlaveModel::name) {
        let said = |file: &str| {
            let output = ecmsk(["slave", file, kind]).output().expect("the tool starts");
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            output.stdout
        };
        let eeprom = said("sii");
        assert_eq!(eeprom.len(), 2048, "{kind}");
        let sii = ecmsk::ethercat::sii::Sii::new(&eeprom).expect("an EEPROM");
        assert!(sii.has_right_checksum(), "{kind}");
        let esi = String::from_utf8(said("esi")).expect("UTF-8");
        let esi = roxmltree::Document::parse(&esi).expect("XML");
        let nodes = |tag: &'static str| esi.descendants().filter(move |node| node.has_tag_name(tag));
        let number = |text: &str| match text.strip_prefix("#x") {
            Some(hex) => u32::from_str_radix(hex, 16).expect("a number"),
            None => text.parse().expect("a number"),
        };
        let vendor = nodes("Vendor").next().and_then(|vendor| vendor.first_element_child()).expect("Vendor/Id");
        let device = nodes("Device").next().expect("a device");
        let kind_of = device.children().find(|node| node.has_tag_name("Type")).expect("a type");
        let code = |attribute| number(kind_of.attribute(attribute).expect("a code"));
        let identity = sii.info().identity;
        let found = (number(vendor.text().expect("an id")), code("ProductCode"), code("RevisionNo"));
        assert_eq!(found, (identity.vendor, identity.product, identity.revision), "{kind}");
        // The name of the device in the ESI file is that in the EEPROM.
        let category = |kind| sii.category(kind).expect("it has one");
        let name = category(CategoryKind::General).general().expect("it is whole").name;
        let name = category(CategoryKind::Strings).strings().get(name).expect("a text");
        let in_esi = device.children().find(|node| node.has_tag_name("Name")).and_then(|node| node.text());
        assert_eq!(in_esi.map(str::as_bytes), Some(name), "{kind}");
        for (tag, manager) in [("RxPdo", 2), ("TxPdo", 3)] {
            let pdos = nodes(tag).flat_map(|pdo| pdo.descendants()).filter(|node| node.has_tag_name("BitLen"));
            let bits: u32 = pdos.map(|bits| number(bits.text().expect("a length"))).sum();
            let size = nodes("Sm").nth(manager).and_then(|sm| sm.attribute("DefaultSize")).expect("a size");
            assert_eq!(number(size), bits.div_ceil(8), "{kind}: {tag}");
        }
    }
}

/// `ecmsk slave` takes one kind and no list; a file that cannot be written is a failure with the next step.
#[test]
fn what_slave_refuses() {
    let run = |arguments: &[&str]| ecmsk([&["slave"][..], arguments].concat()).output().expect("the tool starts");
    let list = run(&["esi", "drive*2"]);
    assert_eq!(list.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&list.stderr).contains("allowed: one kind of slave"));
    let unwritable = run(&["sii", "io", "-o", "/no/such/folder/io.bin"]);
    assert_eq!(unwritable.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&unwritable.stderr).contains("name another file with --output"));
}
