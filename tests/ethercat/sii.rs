//! The EEPROMs of slaves.

use ecmsk::ethercat::WireError;
use ecmsk::ethercat::registers::SmControl;
use ecmsk::ethercat::sii::{
    Category, CategoryKind, CoeDetails, FmmuUsage, MailboxArea, MailboxAreas, MailboxProtocols, Sii, SiiDcMode,
    SiiGeneral, SiiGeneralFlags, SiiIdentity, SiiInfo, SiiPdo, SiiPdoEntry, SiiSmEnable, SiiSmType, SiiSyncManager,
    SiiWriter, checksum,
};
use proptest::prelude::*;

/// A CRC-8 bit by bit: polynomial 0x07, 0xFF at the start, not reflected.
fn crc8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0xFF, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x07 })
    })
}

const MAILBOX: MailboxAreas =
    MailboxAreas { receive: MailboxArea { start: 0x1000, len: 0x80 }, send: MailboxArea { start: 0x1080, len: 0x80 } };

fn info() -> SiiInfo {
    SiiInfo {
        pdi_control: 0x0605,
        sync_pulse_length: 1000,
        alias: 0x1234,
        identity: SiiIdentity { vendor: 0x0AAA, product: 0x1234_5678, revision: 0x0001_0001, serial: 42 },
        mailbox: MAILBOX,
        protocols: MailboxProtocols::COE | MailboxProtocols::FOE,
        ..SiiInfo::default()
    }
}

/// ECAT-3.1 The fixed words are where the standard has them, little endian.
#[test]
fn the_fixed_words() {
    let mut eeprom = [0xA5; 256];
    SiiWriter::new(&mut eeprom, &info()).expect("room").finish();
    let words: Vec<u16> = eeprom.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect();
    assert_eq!(words[..5], [0x0605, 0, 1000, 0, 0x1234]);
    assert_eq!(words[8..16], [0x0AAA, 0, 0x5678, 0x1234, 1, 1, 42, 0]);
    assert_eq!(words[0x18..0x1D], [0x1000, 0x80, 0x1080, 0x80, 0x0C]);
    assert_eq!(words[0x14..0x18], [0; 4]);
    assert_eq!(words[0x3E..0x41], [1, 1, 0xFFFF]);
    let read = Sii::new(&eeprom).expect("64 words").info();
    assert_eq!(read, SiiInfo { kbit_less_1: 1, version: 1, ..info() });
    let short = WireError::Short { part: "SII", needed: 128, found: 127 };
    assert_eq!(Sii::new(&eeprom[..127]), Err(short));
}

/// ECAT-3.2 The checksum is a CRC-8 over the first 14 bytes, polynomial 0x07, 0xFF at the start, in the low byte of word 7.
#[test]
fn the_checksum() {
    let mut eeprom = info().encode();
    let expected = crc8(&eeprom[..14]);
    assert_eq!((eeprom[14], eeprom[15], checksum(eeprom.first_chunk().expect("14 bytes"))), (expected, 0, expected));
    assert!(Sii::new(&eeprom).expect("64 words").has_right_checksum());
    eeprom[3] ^= 1;
    let sii = Sii::new(&eeprom).expect("64 words");
    assert!(!sii.has_right_checksum());
    assert_eq!(sii.checksums(), (expected, crc8(&eeprom[..14])));
    assert_eq!(crc8(b"123456789"), 0xFB);
}

fn managers() -> [SiiSyncManager; 2] {
    let manager = |start, len, control, kind| SiiSyncManager {
        start,
        len,
        control,
        status: 0,
        enable: SiiSmEnable::ENABLE,
        kind,
    };
    [
        manager(0x1000, 0x80, SmControl::MAILBOX_OUT, SiiSmType::MailboxOut),
        manager(0x1100, 6, SmControl::OUTPUTS, SiiSmType::Outputs),
    ]
}

fn general() -> SiiGeneral {
    SiiGeneral {
        group: 1,
        order: 2,
        name: 3,
        coe: CoeDetails::SDO | CoeDetails::SDO_INFO,
        flags: SiiGeneralFlags::SAFEOP,
        ebus_current_ma: -2000,
        ports: [1, 1, 0, 3],
        id_address: 0x0134,
        ..SiiGeneral::default()
    }
}

/// ECAT-3.3, ECAT-3.4 Categories follow the fixed words, each with a type and a length in words; 0xFFFF ends them. Their
/// bytes are those of ETG.2010.
#[test]
fn categories_byte_by_byte() {
    let mut eeprom = [0xA5; 1024];
    let mut sii = SiiWriter::new(&mut eeprom, &info()).expect("room");
    sii.category(CategoryKind::Unknown(2048), &[1, 2, 3]).expect("room");
    sii.strings(&["Drv", "", "DRV1"]).expect("room");
    sii.general(&general()).expect("room");
    sii.fmmus(&[FmmuUsage::Outputs, FmmuUsage::Inputs, FmmuUsage::MailboxState]).expect("room");
    sii.sync_managers(&managers()).expect("room");
    let entries = [SiiPdoEntry { index: 0x6040, sub: 0, name: 1, data_type: 6, bits: 16, flags: 0 }];
    sii.pdos(CategoryKind::RxPdos, &[(SiiPdo::new(0x1600, 2, 1), &entries)]).expect("room");
    let mode = SiiDcMode { cycle0_ns: 1_000_000, shift0_ns: -1, assign_activate: 0x0300, ..SiiDcMode::default() };
    sii.dc_modes(&[mode]).expect("room");
    sii.finish();

    let mut expected: Vec<u8> = vec![0x00, 0x08, 2, 0, 1, 2, 3, 0];
    expected.extend([10, 0, 6, 0, 3, 3, b'D', b'r', b'v', 0, 4, b'D', b'R', b'V', b'1', 0]);
    expected.extend([30, 0, 16, 0, 1, 0, 2, 3, 0, 0x03, 0, 0, 0, 0, 0, 0x01, 0x30, 0xF8, 1, 0, 0x11, 0x30, 0x34, 0x01]);
    expected.extend([0; 12]);
    expected.extend([40, 0, 2, 0, 1, 2, 3, 0]);
    expected.extend([41, 0, 8, 0, 0x00, 0x10, 0x80, 0x00, 0x26, 0, 1, 1, 0x00, 0x11, 6, 0, 0x64, 0, 1, 3]);
    expected.extend([51, 0, 8, 0, 0x00, 0x16, 1, 2, 0, 1, 0, 0, 0x40, 0x60, 0, 1, 6, 16, 0, 0]);
    expected.extend([60, 0, 12, 0, 0x40, 0x42, 0x0F, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0, 0, 0, 0x00, 0x03]);
    expected.extend([0; 8]);
    expected.extend([0xFF; 64]);
    assert_eq!(eeprom[128..128 + expected.len()], expected);
    assert!(eeprom[128 + expected.len()..].iter().all(|byte| *byte == 0xFF));

    let sii = Sii::new(&eeprom).expect("64 words");
    let categories: Vec<Category<'_>> = sii.categories().map(|category| category.expect("whole")).collect();
    let kinds: Vec<u16> = categories.iter().map(|category| category.kind.code()).collect();
    assert_eq!(kinds, [2048, 10, 30, 40, 41, 51, 60]);
    let strings = categories[1].strings();
    assert_eq!([0, 1, 2, 3, 4].map(|n| strings.get(n)), [None, Some(&b"Drv"[..]), Some(b""), Some(b"DRV1"), None]);
    assert_eq!(categories[2].general(), Ok(general()));
    assert_eq!(categories[3].fmmus().collect::<Vec<_>>().len(), 4, "with the padding");
    assert_eq!(categories[4].sync_managers().collect::<Vec<_>>(), managers());
    let (pdo, rest) = SiiPdo::split(categories[5].data).expect("whole");
    assert_eq!(
        (pdo.index, pdo.sync_manager, pdo.entries.iter().collect::<Vec<_>>(), rest),
        (0x1600, 2, entries.to_vec(), &[][..])
    );
    assert_eq!(categories[6].dc_modes().collect::<Vec<_>>(), [mode]);
    assert_eq!(sii.category(CategoryKind::RxPdos), Some(categories[5]));
    assert_eq!(sii.category(CategoryKind::TxPdos), None);
}

/// ECAT-3.5 A category that is longer than the EEPROM, and a list without an end, are errors behind what was whole.
#[test]
fn categories_that_end_early_are_errors() {
    let mut eeprom = info().encode().to_vec();
    assert!(matches!(Sii::new(&eeprom).expect("words").categories().next(), Some(Err(WireError::Short { .. }))));
    eeprom.extend([40, 0, 1, 0, 1, 2, 50, 0, 4, 0, 1, 2]);
    let categories: Vec<_> = Sii::new(&eeprom).expect("words").categories().collect();
    let short = Err(WireError::Short { part: "category", needed: 8, found: 2 });
    assert_eq!(categories, [Ok(Category { kind: CategoryKind::Fmmus, data: &[1, 2] }), short]);
    let pdo = Category { kind: CategoryKind::TxPdos, data: &[0, 0x1A, 2, 3, 0, 0, 0, 0, 1, 2] };
    let short = WireError::Short { part: "entries of a PDO", needed: 16, found: 2 };
    assert_eq!(pdo.pdos().collect::<Vec<_>>(), [Err(short)]);
    assert_eq!(SiiGeneral::decode(&[0; 17]), Err(WireError::Short { part: "general category", needed: 18, found: 17 }));
    assert!(SiiGeneral::decode(&[0; 18]).is_ok());
}

/// ECAT-3.5 Content that does not fit into an EEPROM is an error, and the EEPROM still has a valid end.
#[test]
fn an_eeprom_that_is_too_small() {
    let mut eeprom = [0; 140];
    let mut sii = SiiWriter::new(&mut eeprom, &info()).expect("room");
    let full = WireError::NoRoom { part: "category", needed: 38, room: 12 };
    assert_eq!(sii.general(&general()), Err(full));
    sii.fmmus(&[FmmuUsage::Outputs; 6]).expect("room");
    assert!(sii.fmmus(&[]).is_err());
    sii.finish();
    let kinds: Vec<_> = Sii::new(&eeprom).expect("words").categories().map(|one| one.map(|one| one.kind)).collect();
    assert_eq!(kinds, [Ok(CategoryKind::Fmmus)]);
    assert!(SiiWriter::new(&mut [0; 129], &info()).is_err());
}

fn category() -> impl Strategy<Value = (CategoryKind, Vec<u8>)> {
    let kind = prop_oneof![Just(10u16), Just(30), Just(40), Just(41), Just(50), Just(51), Just(60), 0u16..0xFFFF];
    let data = proptest::collection::vec(any::<u8>(), 0..80);
    (kind, data).prop_map(|(code, data)| (CategoryKind::from_code(code), data))
}

/// Reads a category in every way.
fn read_in_every_way(category: &Category<'_>) {
    let len = category.data.len();
    assert!(category.strings().iter().map(|text| 1 + text.len()).sum::<usize>() <= len);
    if let Ok(general) = category.general() {
        assert_eq!(SiiGeneral::decode(&general.encode()), Ok(general));
    }
    assert!(category.fmmus().zip(category.data).all(|(usage, byte)| usage.code() == *byte));
    for (manager, bytes) in category.sync_managers().zip(category.data.as_chunks().0) {
        assert_eq!(&manager.encode(), bytes);
    }
    for (mode, bytes) in category.dc_modes().zip(category.data.as_chunks::<24>().0) {
        assert_eq!(mode.encode()[..20], bytes[..20]);
    }
    let mut rest = category.data;
    for pdo in category.pdos().map_while(Result::ok) {
        let entries: Vec<SiiPdoEntry> = pdo.entries.iter().collect();
        let mut again = [0xA5; 4096];
        let len = pdo.encode(&entries, &mut again).expect("room");
        assert_eq!(again[..len], rest[..len]);
        rest = &rest[len..];
    }
}

proptest! {
    /// ECAT-3.1 The fixed words come back.
    #[test]
    fn fixed_words_come_back(bytes in proptest::collection::vec(any::<u8>(), 128)) {
        let info = Sii::new(&bytes).expect("64 words").info();
        let again = info.encode();
        prop_assert_eq!(SiiInfo::decode(&again), info);
        prop_assert!(Sii::new(&again).expect("64 words").has_right_checksum());
        prop_assert_eq!(&again[..14], &bytes[..14]);
        prop_assert_eq!(&again[16..38], &bytes[16..38]);
    }

    /// ECAT-3.3, ECAT-3.4 Categories come back, padded to an even length, and each can be read in every way.
    #[test]
    fn categories_come_back(wanted in proptest::collection::vec(category(), 0..8)) {
        let mut eeprom = [0; 2048];
        let mut sii = SiiWriter::new(&mut eeprom, &info()).expect("room");
        for (kind, data) in &wanted {
            sii.category(*kind, data).expect("room");
        }
        sii.finish();
        let read: Result<Vec<Category<'_>>, _> = Sii::new(&eeprom).expect("64 words").categories().collect();
        let read = read.expect("whole");
        prop_assert_eq!(read.len(), wanted.len());
        for (category, (kind, data)) in read.iter().zip(&wanted) {
            prop_assert_eq!(category.kind, *kind);
            prop_assert_eq!(&category.data[..data.len()], &data[..]);
            prop_assert_eq!(category.data.len(), data.len().next_multiple_of(2));
            read_in_every_way(category);
        }
    }
}
