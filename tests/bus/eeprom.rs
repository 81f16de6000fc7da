//! Writing EEPROMs.

use ecmsk::bus::eeprom::{self, WordChange};
use ecmsk::ethercat::sii::{Sii, checksum};

use crate::{network, refused};

/// Changed words are found, written, and read back; a scan shows them.
#[test]
fn changed_words_are_written_and_read_back() {
    let (mut network, _) = network("drive*2");
    let mut content = network.read_eeprom(2).expect("an EEPROM");
    assert_eq!(eeprom::changes(&mut *network, 2, &content).expect("they are read"), []);
    content[8] = 42;
    content[14] = checksum(content.first_chunk().expect("14 bytes"));
    eeprom::check(&content).expect("it is whole");
    eeprom::check_for(&content, &network.read_eeprom(2).expect("an EEPROM")).expect("it is for this slave");
    let changes = eeprom::changes(&mut *network, 2, &content).expect("they are read");
    let words: Vec<(u16, u16)> = changes.iter().map(|WordChange { word, to, .. }| (*word, *to)).collect();
    assert_eq!(words, [(4, 42), (7, u16::from(content[14]))]);
    let mut written = Vec::new();
    eeprom::write(&mut *network, 2, &changes, |n| written.push(n)).expect("it is written");
    assert_eq!(written, [1, 2]);
    network.scan().expect("slaves");
    let read = network.read_eeprom(2).expect("an EEPROM");
    assert_eq!(read, content);
    assert!(Sii::new(&read).expect("whole").has_right_checksum());
    assert_ne!(network.read_eeprom(1).expect("an EEPROM"), content, "that of the other slave is as it was");
}

/// An EEPROM refuses words beyond its end.
#[test]
fn behind_its_end_nothing_is_written() {
    let (mut network, _) = network("io");
    let change = WordChange { word: 0x4000, from: 0xFFFF, to: 1 };
    let said = refused(eeprom::write(&mut *network, 1, &[change], |_| ()));
    assert!(said.contains("slave 1: the EEPROM reports an error"), "{said}");
}
