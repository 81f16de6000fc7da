//! Formats the content of an EEPROM as text and as JSON.

use std::fmt::Write as _;

use ecmsk::ethercat::sii::{
    Category, CategoryKind, FmmuUsage, MailboxArea, MailboxAreas, Sii, SiiInfo, SiiPdo, SiiSmType, SiiText,
};
use serde_json::{Value, json};

/// The name of the EEPROM word at an address; `None` if it has none.
pub const fn word_name(word: u16) -> Option<&'static str> {
    Some(match word {
        0x00 => "PDI control",
        0x01 => "PDI configuration",
        0x02 => "SYNC pulse length",
        0x03 => "extended PDI configuration",
        0x04 => "station alias",
        0x07 => "checksum",
        0x08 | 0x09 => "vendor ID",
        0x0A | 0x0B => "product code",
        0x0C | 0x0D => "revision",
        0x0E | 0x0F => "serial number",
        0x14..=0x17 => "mailbox in bootstrap",
        0x18..=0x1B => "mailbox",
        0x1C => "mailbox protocols",
        0x3E => "size",
        0x3F => "version",
        _ => return None,
    })
}

/// The string of the EEPROM with this number, quoted, e.g. ` "drive"`. Number 0 means "no string" and gives an empty text.
fn named(sii: &Sii<'_>, number: u8) -> String {
    sii.text(number).map_or(String::new(), |text| format!(" \"{text}\""))
}

fn area(area: MailboxArea) -> String {
    if area.len == 0 { "none".to_owned() } else { format!("0x{:04X}, {} bytes", area.start, area.len) }
}

fn areas(of: MailboxAreas) -> String {
    format!("to the slave {}; from it {}", area(of.receive), area(of.send))
}

/// The content of an EEPROM as text, line by line.
pub fn text(content: &[u8]) -> String {
    let Ok(sii) = Sii::new(content) else { return format!("{} bytes, which are too few", content.len()) };
    let info = sii.info();
    let (found, expected) = sii.checksums();
    let checksum = match sii.has_right_checksum() {
        true => format!("0x{found:02X}, right"),
        false => format!("0x{found:02X}, WRONG: it should be 0x{expected:02X}, and the slave loads nothing"),
    };
    let SiiInfo { identity, .. } = info;
    let protocols: Vec<&str> = info.protocols.names().collect();
    let mut text = format!(
        "vendor 0x{:08X}, product 0x{:08X}, revision 0x{:08X}, serial {}\n\
         alias {}, checksum {checksum}\n\
         size {} bytes, {} read\n\
         PDI control 0x{:04X}, configuration 0x{:04X}, extended 0x{:04X}; SYNC pulses of {} ns\n\
         mailbox: {}; protocols {}\n\
         in bootstrap: {}\n",
        identity.vendor,
        identity.product,
        identity.revision,
        identity.serial,
        info.alias,
        (usize::from(info.kbit_less_1) + 1) * 128,
        content.len(),
        info.pdi_control,
        info.pdi_configuration,
        info.extended_pdi_configuration,
        u32::from(info.sync_pulse_length) * 10,
        areas(info.mailbox),
        if protocols.is_empty() { "none".to_owned() } else { protocols.join(", ") },
        areas(info.boot_mailbox),
    );
    for category in sii.categories() {
        match category {
            Ok(category) => put_category(&category, &sii, &mut text),
            // Writing to a String does not fail.
            Err(error) => drop(writeln!(text, "the categories are not whole: {error}")),
        }
    }
    text.trim_end().to_owned()
}

fn put_category(category: &Category<'_>, sii: &Sii<'_>, text: &mut String) {
    let code = category.kind.code();
    let head = |what: &str| format!("category {code} ({what}), {} bytes", category.data.len());
    let named = |number| named(sii, number);
    // Writing to a String does not fail.
    let _ = match category.kind {
        CategoryKind::Strings => {
            // String numbers run through all categories of strings, so the strings of earlier categories are counted
            // first.
            let before: usize = sii
                .all_of(CategoryKind::Strings)
                .take_while(|other| !std::ptr::eq(other.data, category.data))
                .map(|other| other.strings().iter().count())
                .sum();
            let shown = |(n, text)| format!("{n} \"{}\"", SiiText(text));
            let all: Vec<String> = (before + 1..).zip(category.strings().iter()).map(shown).collect();
            writeln!(text, "{}: {}", head("texts"), all.join(", "))
        }
        CategoryKind::General => match category.general() {
            Ok(general) => writeln!(
                text,
                "{}: name{}, order{}, group{}; CoE {}; EBUS current {} mA",
                head("general"),
                named(general.name),
                named(general.order),
                named(general.group),
                general.coe.names().collect::<Vec<_>>().join(" "),
                general.ebus_current_ma
            ),
            Err(error) => writeln!(text, "{}: {error}", head("general")),
        },
        CategoryKind::Fmmus => {
            let uses: Vec<String> = category.fmmus().map(fmmu).collect();
            writeln!(text, "{}: {}", head("FMMUs"), uses.join(", "))
        }
        CategoryKind::SyncManagers => {
            let _ = writeln!(text, "{}:", head("sync managers"));
            for (n, manager) in category.sync_managers().enumerate() {
                let (start, len, control) = (manager.start, manager.len, manager.control.0);
                let _ = writeln!(
                    text,
                    "  {n}: {} at 0x{start:04X}, {len} bytes, control 0x{control:02X}",
                    use_of(manager.kind)
                );
            }
            Ok(())
        }
        CategoryKind::TxPdos => put_pdos(&head("PDOs for inputs"), category, sii, text),
        CategoryKind::RxPdos => put_pdos(&head("PDOs for outputs"), category, sii, text),
        CategoryKind::DcModes => {
            let _ = writeln!(text, "{}:", head("distributed clocks"));
            for mode in category.dc_modes() {
                let _ = writeln!(
                    text,
                    "  activation 0x{:04X}, SYNC0 {} ns shifted by {} ns{}",
                    mode.assign_activate,
                    mode.cycle0_ns,
                    mode.shift0_ns,
                    named(mode.name)
                );
            }
            Ok(())
        }
        CategoryKind::DataTypes => writeln!(text, "{}", head("data types")),
        _ => writeln!(text, "{}", head("unknown")),
    };
}

fn put_pdos(head: &str, category: &Category<'_>, sii: &Sii<'_>, text: &mut String) -> std::fmt::Result {
    writeln!(text, "{head}:")?;
    for pdo in category.pdos() {
        match pdo {
            Err(error) => writeln!(text, "  not whole: {error}")?,
            Ok(SiiPdo { index, sync_manager, name, entries, .. }) => {
                writeln!(text, "  0x{index:04X} in sync manager {sync_manager}{}", named(sii, name))?;
                for entry in entries.iter() {
                    let what = named(sii, entry.name);
                    match entry.index {
                        0 => writeln!(text, "    padding, {} bits", entry.bits)?,
                        index => writeln!(text, "    0x{index:04X}:{}, {} bits{what}", entry.sub, entry.bits)?,
                    }
                }
            }
        }
    }
    Ok(())
}

fn fmmu(usage: FmmuUsage) -> String {
    match usage {
        FmmuUsage::Unused(_) => "unused".to_owned(),
        FmmuUsage::Outputs => "outputs".to_owned(),
        FmmuUsage::Inputs => "inputs".to_owned(),
        FmmuUsage::MailboxState => "mailbox state".to_owned(),
        FmmuUsage::Unknown(code) => format!("use {code}"),
    }
}

fn use_of(kind: SiiSmType) -> String {
    match kind {
        SiiSmType::Unused => "unused".to_owned(),
        SiiSmType::MailboxOut => "mailbox to the slave".to_owned(),
        SiiSmType::MailboxIn => "mailbox from it".to_owned(),
        SiiSmType::Outputs => "outputs".to_owned(),
        SiiSmType::Inputs => "inputs".to_owned(),
        SiiSmType::Unknown(code) => format!("use {code}"),
    }
}

/// The content of an EEPROM as JSON.
pub fn json(content: &[u8]) -> Value {
    let Ok(sii) = Sii::new(content) else { return json!({ "len": content.len() }) };
    let SiiInfo { identity, alias, mailbox, boot_mailbox, protocols, kbit_less_1, .. } = sii.info();
    let area = |area: MailboxArea| json!({ "start": area.start, "len": area.len });
    let areas = |of: MailboxAreas| json!({ "receive": area(of.receive), "send": area(of.send) });
    let has_texts = sii.category(CategoryKind::Strings).is_some();
    let texts = has_texts.then(|| sii.texts().map(|text| text.to_string()).collect::<Vec<_>>());
    let categories: Vec<Value> = sii
        .categories()
        .map_while(Result::ok)
        .map(|category| json!({ "code": category.kind.code(), "len": category.data.len() }))
        .collect();
    json!({
        "len": content.len(), "size": (usize::from(kbit_less_1) + 1) * 128, "checksum_right": sii.has_right_checksum(),
        "vendor_id": identity.vendor, "product_code": identity.product, "revision": identity.revision,
        "serial_number": identity.serial, "alias": alias, "mailbox": areas(mailbox), "boot_mailbox": areas(boot_mailbox),
        "protocols": protocols.names().collect::<Vec<_>>(), "texts": texts, "categories": categories,
    })
}
