//! The EEPROM through the registers of a slave.

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::{self, DlStatus, SiiControl};
use ecmsk::ethercat::sii::{CategoryKind, Sii, SiiIdentity, checksum};
use ecmsk::ethercat::{AlState, AlStatus, Command};
use ecmsk::slave::device::VENDOR_ID;
use ecmsk::slave::esc::{EscSettings, EscSlave, eeprom_of, esi_of};
use ecmsk::slave::{Dp3cl, Dp3clConfig, Drive, DriveConfig, Hsp, HspConfig, Io, Slave};

use super::rig::{FIRST, MS, Rig, drive, slave};

/// Reads 8 bytes of the EEPROM as masters do.
fn read_words(rig: &mut Rig, word: u32) -> Vec<u8> {
    let [a, b, c, d] = word.to_le_bytes();
    rig.write(FIRST, registers::SII_CONTROL, &[0, 1, a, b, c, d]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL) & 0xFF00, 0);
    rig.read(FIRST, registers::SII_DATA, 8)
}

/// Writes a word of the EEPROM; returns the control word after it.
fn write_word(rig: &mut Rig, control: u8, word: u16, value: u16) -> SiiControl {
    let ([a, b], [low, high]) = (word.to_le_bytes(), value.to_le_bytes());
    rig.write(FIRST, registers::SII_CONTROL, &[control, 2, a, b, 0, 0, low, high]);
    SiiControl(rig.read_u16(FIRST, registers::SII_CONTROL))
}

/// ECAT-9.3 A read command returns the words at an address, odd ones too; behind the end it reads 0xFF.
#[test]
fn s13_words_are_read() {
    let mut rig = Rig::drives(1);
    assert_eq!(read_words(&mut rig, 8)[..4], VENDOR_ID.to_le_bytes());
    let eeprom = rig.chain.slave(0).controller().eeprom().to_vec();
    for word in [0, 7, 9, 0x41] {
        assert_eq!(read_words(&mut rig, word), eeprom[2 * word as usize..][..8]);
    }
    assert_eq!(read_words(&mut rig, 1023), [eeprom[2046], eeprom[2047], 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]);
    assert_eq!(read_words(&mut rig, u32::MAX), [0xFF; 8]);
    read_words(&mut rig, 0);
    // The short form of some masters: the command with a bit that cannot be written, and 16 bits of the address.
    rig.write(FIRST, registers::SII_CONTROL, &[0x80, 0x01, 8, 0]);
    assert_eq!(rig.read(FIRST, registers::SII_DATA, 4), VENDOR_ID.to_le_bytes());
}

/// ECAT-9.4 Bit 6 selects whether a read returns 8 bytes or 4.
#[test]
fn s14_a_read_gives_8_bytes_or_4() {
    for (reads_8_bytes, bit) in [(true, 0x40), (false, 0)] {
        let mut rig = Rig::with_stations([drive(EscSettings { reads_8_bytes, ..EscSettings::default() })]);
        assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), bit);
        rig.write(FIRST, registers::SII_DATA, &[0xEE; 8]);
        let eeprom = rig.chain.slave(0).controller().eeprom()[16..24].to_vec();
        let read = read_words(&mut rig, 8);
        assert_eq!(read[..4], eeprom[..4]);
        assert_eq!(read[4..], if reads_8_bytes { eeprom[4..].to_vec() } else { vec![0xEE; 4] });
    }
}

/// ECAT-9.5 While the slave's own controller has the EEPROM, no command runs; a master takes it back by 2 and 0 in 0x0500.
#[test]
fn s15_the_eeprom_has_one_owner() {
    let mut rig = Rig::drives(1);
    read_words(&mut rig, 8);
    let before = rig.read(FIRST, registers::SII_CONTROL, 14);
    rig.write(FIRST, registers::SII_CONFIGURATION, &[1]);
    rig.chain.slave_mut(0).controller_mut().take_eeprom(true);
    assert_eq!(rig.read(FIRST, registers::SII_CONFIGURATION, 2), [1, 1]);
    let refused = rig.one(Command::Fpwr, FIRST, registers::SII_CONTROL, &[0, 1, 10, 0, 0, 0]);
    assert_eq!((refused.wkc, rig.read(FIRST, registers::SII_CONTROL, 14)), (0, before));
    for byte in [2, 0] {
        rig.write(FIRST, registers::SII_CONFIGURATION, &[byte]);
    }
    assert_eq!(rig.read(FIRST, registers::SII_CONFIGURATION, 2), [0, 0]);
    assert_eq!(read_words(&mut rig, 8)[..4], VENDOR_ID.to_le_bytes());
}

/// ECAT-9.6 A write needs its bit in the same datagram; without it the word stays and bit 14 is set until the next
/// command.
#[test]
fn s16_words_are_written() {
    let mut rig = Rig::drives(1);
    assert_eq!(write_word(&mut rig, 1, 4, 0x1234).0, 0x0040);
    assert_eq!(read_words(&mut rig, 4)[..2], [0x34, 0x12]);
    assert_eq!(write_word(&mut rig, 0, 4, 0x5678).0, 0x4040);
    assert_eq!(read_words(&mut rig, 4)[..2], [0x34, 0x12]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x0040);
    assert_eq!(write_word(&mut rig, 1, 0x7FFF, 0).0, 0x2040, "there is no such word");
    rig.write(FIRST, registers::SII_CONTROL, &[0, 0]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x0040);
    rig.write(FIRST, registers::SII_CONTROL, &[0, 7]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x2040, "no such command");
}

/// ECAT-9.7 The checksum is that of the first 14 bytes; a wrong one is shown by bits 11 and 12, nothing is loaded, and
/// the slave refuses PreOP.
#[test]
fn s17_a_wrong_checksum_is_told() {
    let mut rig = Rig::drives(1);
    let eeprom = rig.chain.slave(0).controller().eeprom();
    let first: &[u8; 14] = eeprom.first_chunk().expect("14 bytes");
    assert_eq!(eeprom[14], checksum(first));

    let wrong = eeprom_checksum(&rig) ^ 1;
    assert_eq!(write_word(&mut rig, 1, 7, wrong.into()).0, 0x0040);
    rig.write(FIRST, registers::SII_CONTROL, &[0, 4]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x1840);
    assert_eq!(rig.read_u16(FIRST, registers::DL_STATUS) & DlStatus::SII_LOADED, 0);
    rig.set_mailbox(FIRST);
    assert_eq!(rig.request(FIRST, 2), (0x11, AlStatus::EEPROM_ERROR));
    let right = eeprom_checksum(&rig) ^ 1;
    write_word(&mut rig, 1, 7, right.into());
    rig.write(FIRST, registers::SII_CONTROL, &[0, 4]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x0040);
    assert_eq!(rig.request(FIRST, 0x12), (2, AlStatus::NONE));
}

fn eeprom_checksum(rig: &Rig) -> u8 {
    rig.chain.slave(0).controller().eeprom()[14]
}

/// ECAT-9.3 A slow EEPROM is busy, and takes no other command meanwhile.
#[test]
fn a_slow_eeprom_is_busy() {
    let mut rig = Rig::with_stations([drive(EscSettings { eeprom_ns: MS, ..EscSettings::default() })]);
    rig.write(FIRST, registers::SII_CONTROL, &[0, 1, 8, 0, 0, 0]);
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x8140);
    assert_eq!(rig.one(Command::Fpwr, FIRST, registers::SII_ADDRESS, &[0; 4]).wkc, 0);
    rig.now += MS;
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x0040);
    assert_eq!(rig.read(FIRST, registers::SII_DATA, 4), VENDOR_ID.to_le_bytes());
}

/// ECAT-9.11 The EEPROM of each kind of device has its identity, its mailbox, its PDOs and their sync managers.
#[test]
fn devices_describe_themselves() {
    let kinds: [fn() -> Box<dyn Slave>; 5] = [
        || Box::new(Drive::new(DriveConfig::default())),
        || Box::new(Drive::new(DriveConfig::stepper())),
        || Box::new(Hsp::new(HspConfig::default())),
        || Box::new(Io::default()),
        || Box::new(Dp3cl::new(Dp3clConfig::default())),
    ];
    for kind in kinds {
        let mut device = kind();
        let eeprom = eeprom_of(&mut *device, &EscSettings::default()).expect("it can be described");
        let name = device.name().to_owned();
        let sii = Sii::new(&eeprom).expect("64 words");
        assert!(sii.has_right_checksum(), "{name}");
        let (identity, serial) = device.identity().expect("it has one");
        let wanted = (identity.vendor_id, identity.product_code, identity.revision, serial);
        let SiiIdentity { vendor, product, revision, serial } = sii.info().identity;
        assert_eq!((vendor, product, revision, serial), wanted, "{name}");
        assert_eq!(sii.info().alias, device.station_alias(), "{name}");
        let managers: Vec<_> = sii.category(CategoryKind::SyncManagers).expect("some").sync_managers().collect();
        for (kind, manager) in [(CategoryKind::RxPdos, &managers[2]), (CategoryKind::TxPdos, &managers[3])] {
            let pdos = sii.category(kind).expect("some");
            let bits: usize = pdos
                .pdos()
                .flat_map(|pdo| {
                    pdo.expect("whole").entries.iter().map(|entry| usize::from(entry.bits)).collect::<Vec<_>>()
                })
                .sum();
            assert_eq!(bits.div_ceil(8), usize::from(manager.len), "{name}");
        }
        // ECAT-15.15 The ESI file carries the names of the EEPROM.
        let general = sii.category(CategoryKind::General).expect("one").general().expect("whole");
        let strings = sii.category(CategoryKind::Strings).expect("some").strings();
        let text = |number| String::from_utf8_lossy(strings.get(number).expect("a text")).into_owned();
        let [group, order, shown] = [general.group, general.order, general.name].map(text);
        let esi = esi_of(&mut *kind(), &EscSettings::default()).expect("it can be described");
        for element in [
            format!("\">{order}</Type>\n    <Name>{shown}</Name>\n    <GroupType>{group}</GroupType>"),
            format!("<Group><Type>{group}</Type>"),
        ] {
            assert!(esi.contains(&element), "{element}: {esi}");
        }
        device.enter(AlState::PreOp).expect("open");
        let mut named = [0; 64];
        let len = device.read(ObjectAddress::new(0x1008, 0), SdoScope::Entry, &mut named).expect("it has a name");
        assert_eq!((order.as_bytes(), shown.as_bytes()), (&named[..len], name.as_bytes()), "{name}");
        // With the settings of the EEPROM the slave goes to OP.
        let mut rig = Rig::with_stations([slave(kind(), EscSettings::default())]);
        rig.bring_to_op(FIRST, 0x1000);
    }
    let device = Drive::new(DriveConfig::default());
    let slave = EscSlave::new(Box::new(device), EscSettings::default(), Vec::new(), 0);
    assert_eq!(slave.controller().peek(registers::SII_CONTROL, 2), [0x40, 0x18], "without an EEPROM nothing is loaded");
}

/// The objects in a cell of the page on slaves, each with its bytes: `controlword 0x6040 (2), ..`.
fn objects(cell: &str) -> Vec<(u16, u8)> {
    let words = cell.split("0x").skip(1);
    let number = |word: &str| {
        let (index, bytes) = word.split_once(" (")?;
        Some((u16::from_str_radix(index, 16).ok()?, bytes.split(')').next()?.parse().ok()?))
    };
    words.map(|word| number(word).expect(cell)).collect()
}

/// ECAT-9.11 The page on slaves says which process data each kind has at power-on.
#[test]
fn the_page_has_the_process_data_of_each_kind() {
    let page = include_str!("../../../docs/SLAVES.md");
    let kinds: [(&str, Box<dyn Slave>); 5] = [
        ("`drive`", Box::new(Drive::new(DriveConfig::default()))),
        ("`step`", Box::new(Drive::new(DriveConfig::stepper()))),
        ("`dp3cl`", Box::new(Dp3cl::new(Dp3clConfig::default()))),
        ("`io`", Box::new(Io::default())),
        ("`hsp`", Box::new(Hsp::new(HspConfig::default()))),
    ];
    for (kind, mut device) in kinds {
        let rows = page.lines().filter_map(|line| line.strip_prefix("| ")?.split_once(" | "));
        let (_, row) = rows.into_iter().find(|(cell, row)| cell.contains(kind) && row.contains("(2)")).expect(kind);
        let eeprom = eeprom_of(&mut *device, &EscSettings::default()).expect("it can be described");
        let sii = Sii::new(&eeprom).expect("an EEPROM");
        for (cell, category) in row.split(" | ").zip([CategoryKind::RxPdos, CategoryKind::TxPdos]) {
            let pdos = sii.category(category).expect("PDOs").pdos().map(|pdo| pdo.expect("a PDO"));
            let mapped: Vec<(u16, u8)> =
                pdos.flat_map(|pdo| pdo.entries.iter().map(|entry| (entry.index, entry.bits / 8))).collect();
            assert_eq!(objects(cell), mapped, "{kind}");
        }
    }
}
