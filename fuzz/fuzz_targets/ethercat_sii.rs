//! Any bytes as the EEPROM of a slave: its categories are read in every way, and written again they are the same.

#![no_main]

use ecmsk::ethercat::sii::{Category, CategoryKind, Sii, SiiGeneral, SiiPdoEntry, SiiWriter};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(sii) = Sii::new(bytes) else {
        assert!(bytes.len() < 128);
        return;
    };
    let categories: Vec<Category<'_>> = sii.categories().map_while(Result::ok).collect();
    categories.iter().for_each(read);
    let mut again = vec![0xA5; bytes.len() + 2];
    let mut writer = SiiWriter::new(&mut again, &sii.info()).expect("room");
    for category in &categories {
        writer.category(category.kind, category.data).expect("it was in an EEPROM of that size");
    }
    writer.finish();
    let again = Sii::new(&again).expect("64 words");
    assert!(again.has_right_checksum());
    assert_eq!(again.info().identity, sii.info().identity);
    assert!(again.categories().eq(categories.iter().copied().map(Ok)));
});

fn read(category: &Category<'_>) {
    match category.kind {
        CategoryKind::Strings => {
            let strings = category.strings();
            for (n, text) in (1..=u8::MAX).zip(strings.iter()) {
                assert_eq!(strings.get(n), Some(text));
            }
        }
        CategoryKind::General => {
            if let Ok(general) = category.general() {
                assert_eq!(SiiGeneral::decode(&general.encode()), Ok(general));
            }
        }
        CategoryKind::Fmmus => assert_eq!(category.fmmus().count(), category.data.len()),
        CategoryKind::SyncManagers => assert_eq!(category.sync_managers().count(), category.data.len() / 8),
        CategoryKind::DcModes => assert_eq!(category.dc_modes().count(), category.data.len() / 24),
        CategoryKind::TxPdos | CategoryKind::RxPdos => {
            let mut rest = category.data;
            for pdo in category.pdos().map_while(Result::ok) {
                let entries: Vec<SiiPdoEntry> = pdo.entries.iter().collect();
                let mut room = vec![0xA5; rest.len()];
                let len = pdo.encode(&entries, &mut room).expect("it is not longer");
                assert_eq!(room[..len], rest[..len]);
                rest = &rest[len..];
            }
        }
        _ => {}
    }
}
