//! The network of an ECM-XF.

use std::time::Duration;

use ecmsk::bus::port_errors::{self, ProblemPlace};
use ecmsk::bus::{self, FoundSlave, Network, clocks, dictionary, eeprom};
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::{AL_CONTROL, AL_STATUS, STATION_ALIAS};
use ecmsk::ethercat::sii::checksum;

use crate::refused;

fn network(link: &str) -> (Box<dyn Network>, Vec<FoundSlave>) {
    let mut network = bus::open(link).expect("a network");
    let found = network.scan().expect("slaves");
    (network, found)
}

/// BUS-8.1 Slaves are numbered from 1, in virtual time, and their objects are read and written.
#[test]
fn a_chip_is_a_network() {
    let (mut network, slaves) = network("xf-sim:?slaves=drive,io");
    assert!(network.is_virtual() && !network.resets_slaves() && network.frames().is_none());
    let found: Vec<_> = slaves.iter().map(|slave| (slave.slave, slave.identity.vendor, slave.has_clock)).collect();
    assert_eq!(found, [(1, 0x4543_4D53, true), (2, 0x4543_4D53, false)]);
    assert_eq!(slaves[1].upstream.map(|up| (up.slave, up.port)), Some((1, 1)));
    let speed = ObjectAddress::new(0x6099, 1);
    network.download(1, speed, SdoScope::Entry, &[7, 0, 0, 0]).expect("it is written");
    assert_eq!(network.upload(1, speed, SdoScope::Entry).expect("it is read"), [7, 0, 0, 0]);
    let said = refused(network.upload(2, speed, SdoScope::Entry));
    assert!(said.contains("slave 2, object 0x6099:1") && said.contains("does not exist"), "{said}");
    for slave in [0, 3] {
        let said = refused(network.upload(slave, speed, SdoScope::Entry));
        assert!(said.contains(&format!("there is no slave {slave}, but 2 slaves")), "{said}");
    }
    let said = refused(bus::open("xf-sim:?slaves=none").expect("a network").scan());
    assert!(said.contains("no slave answers"), "{said}");
}

/// BUS-8.2 A slave's dictionary and files are read through its mailbox as over a network card; the chip's own SDOs go
/// on in between, and none is taken for a repeat.
#[test]
fn dictionaries_and_files_behind_a_chip() {
    let list = "drive,io,dp3cl";
    let [mut on_chip, mut on_card] =
        [format!("xf-sim:?slaves={list}"), format!("sim:?slaves={list}")].map(|link| network(&link).0);
    for slave in 1..=3 {
        let objects = dictionary::objects(&mut *on_chip, slave).expect("a dictionary");
        assert_eq!(objects, dictionary::objects(&mut *on_card, slave).expect("a dictionary"), "slave {slave}");
        assert!(objects.len() > 5);
        for object in &objects {
            let entries = dictionary::entries(&mut *on_chip, slave, object).expect("they are described");
            assert_eq!(entries, dictionary::entries(&mut *on_card, slave, object).expect("they are described"));
            // Each object by the chip's own SDO.
            for entry in &entries {
                dictionary::value(&mut *on_chip, slave, entry).expect("an answer");
            }
        }
    }
    // With the shortest packets a message takes eleven parts.
    let (mut short, _) = network("xf-sim:?slaves=drive&n=32&use_n=32");
    let object = &dictionary::objects(&mut *short, 1).expect("a dictionary")[0];
    assert_eq!(object, &dictionary::objects(&mut *on_card, 1).expect("a dictionary")[0]);
    for len in [0, 1, 116, 1000] {
        let content: Vec<u8> = (0..len).map(|n| n as u8).collect();
        on_chip.write_file(1, "table.csv", 0, &content).expect("it is written");
        assert_eq!(on_chip.read_file(1, "table.csv", 0).expect("it is read"), content, "{len}");
        let name = on_chip.upload(1, ObjectAddress::new(0x1008, 0), SdoScope::Entry).expect("its name");
        assert!(!name.is_empty());
    }
    let said = refused(on_chip.read_file(1, "none", 0));
    assert!(said.contains("not found"), "{said}");
    let said = refused(on_chip.read_file(3, "a", 0));
    assert!(said.contains("slave 3 has no files: its EEPROM declares no FoE"), "{said}");
    let said = refused(on_chip.object_list(4));
    assert!(said.contains("there is no slave 4"), "{said}");
}

/// BUS-8.1 Registers and EEPROMs by the chip's datagrams and its own commands. Clocks, too.
#[test]
fn registers_eeproms_and_clocks() {
    let (mut network, slaves) = network("xf-sim:?slaves=drive*2");
    let mut alias = [0xEE; 2];
    network.read(2, STATION_ALIAS, &mut alias).expect("a register");
    assert_eq!(alias, [0; 2]);
    let mut content = network.read_eeprom(2).expect("an EEPROM");
    assert_eq!(content.len(), 354);
    eeprom::check(&content).expect("it is whole");
    content[8] = 5;
    content[14] = checksum(content.first_chunk().expect("14 bytes"));
    let changes = eeprom::changes(&mut *network, 2, &content).expect("they are read");
    assert_eq!(changes.len(), 2);
    eeprom::write(&mut *network, 2, &changes, |_| ()).expect("it is written");
    assert_eq!(network.read_eeprom(2).expect("an EEPROM"), content);
    let clocks = clocks::measure(&mut *network, &slaves, Duration::from_millis(100)).expect("clocks");
    assert_eq!(clocks.iter().map(|clock| (clock.slave, clock.delay_ns)).collect::<Vec<_>>(), [(1, 0), (2, 310)]);
    // In Init a slave refuses an invalid change of state with an error.
    network.write(1, AL_CONTROL, &[8, 0]).expect("a register");
    network.wait(Duration::from_millis(10)).expect("time");
    let mut status = [0; 2];
    network.read(1, AL_STATUS, &mut status).expect("a register");
    assert_eq!(status[0], 0x11);
}

/// A chip with these slaves and that script.
fn scripted(slaves: &str, script: &str) -> Box<dyn Network> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("a.ecmscript");
    std::fs::write(&file, script).expect("it is written");
    bus::open(&format!("xf-sim:?slaves={slaves}&script={}", file.display())).expect("a network")
}

/// BUS-8.1 Slaves that refuse a state, and mailboxes behind a cut cable, are reported by this network's numbers.
#[test]
fn what_fails_behind_a_chip_names_the_slave() {
    let mut refuses = scripted("io*2", "at 1ms refuse 2 preop\n");
    refuses.scan().expect("slaves");
    let said = refused(refuses.object_list(2));
    assert!(said.contains("slave 2 is in Init, AL status code 0x0011"), "{said}");
    let mut cut = scripted("drive*2", "at 30s cut 2\n");
    cut.scan().expect("slaves");
    assert!(dictionary::objects(&mut *cut, 2).expect("a dictionary").len() > 5);
    cut.wait(Duration::from_secs(30)).expect("time");
    let said = refused(cut.object_list(2));
    assert_eq!(said, "slave 2 does not answer any more; check its cable and its power");
    assert!(dictionary::objects(&mut *cut, 1).expect("a dictionary").len() > 5, "the other one does");
}

/// BUS-7.2 A bad cable is found by the chip's datagrams, too.
#[test]
fn a_bad_cable_behind_a_chip_is_found() {
    let mut network = scripted("io*3", "at 2s noise 2 20\n");
    let slaves = network.scan().expect("slaves");
    network.load(Duration::from_secs(3)).expect("time");
    let counted = port_errors::read(&mut *network, &slaves).expect("counters");
    let problems = port_errors::judge(&slaves, &counted);
    let [problem] = &problems[..] else { panic!("{problems:?} of {counted:?}") };
    let ProblemPlace::Cable { near: Some(near), far: Some(far) } = problem.place else { panic!("{problem:?}") };
    assert_eq!((near.slave, near.port, far.slave, far.port), (1, 1, 2, 0));
    port_errors::clear(&mut *network, &slaves).expect("they are cleared");
}
