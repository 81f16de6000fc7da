//! Prints what the parser `ethercat-esi` 0.2.0, of the bindings to IgH's master, finds in an ESI file.

use ethercat_esi::{EtherCatInfo, Pdo};

fn main() {
    let file = std::env::args().nth(1).expect("usage: esi_reader FILE");
    let text = std::fs::read_to_string(&file).expect("the file");
    let info = EtherCatInfo::from_xml_str(&text).expect("an ESI file");
    println!("vendor {:08X} {}", info.vendor.id, info.vendor.name.unwrap_or_default());
    for group in &info.description.groups {
        println!("group {} {}", group.r#type, group.name);
    }
    for device in info.description.devices {
        let (product, revision) = (device.product_code, device.revision_no);
        println!("device {product:08X} {revision:08X} {} {}", device.physics.unwrap_or_default(), device.name);
        for sm in device.sm {
            let (start, control) = (sm.start_address, sm.control_byte);
            println!("sm {start:04X} {control:02X} {} {}", sm.default_size.unwrap_or_default(), u8::from(sm.enable));
        }
        for (kind, pdos) in [("rx", device.rx_pdo), ("tx", device.tx_pdo)] {
            pdos.into_iter().for_each(|pdo| show(kind, pdo));
        }
    }
}

fn show(kind: &str, pdo: Pdo) {
    println!("{kind} {:04X} {}", u16::from(pdo.idx), u8::from(pdo.sm));
    for entry in pdo.entries {
        let (index, sub) = (u16::from(entry.entry_idx.idx), u8::from(entry.entry_idx.sub_idx));
        println!("entry {index:04X}:{sub} {} {}", entry.bit_len, entry.data_type.unwrap_or_default());
    }
}
