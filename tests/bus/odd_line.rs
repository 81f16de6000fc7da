//! Slaves with an implementation of their own, independent of the models: `support::odd_line`.

use std::iter;
use std::time::Duration;

use ecmsk::bus::{self, BusError, FoundSlave, Network, clocks, dictionary};
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::Settings;
use support::odd_line::{Beyond, Device, OddLine, OddSlave, coupler, drive, drive_of, sii, terminal};

use crate::refused;

fn scanned(line: &OddLine) -> (Box<dyn Network>, Vec<FoundSlave>) {
    let mut network = bus::over(line.clone(), Settings::default());
    let slaves = network.scan().expect("slaves");
    (network, slaves)
}

/// Clocks whose crystals drift by 5, 20 and 50 ppm are judged good after they have converged, however long they had no
/// time of the reference before.
#[test]
fn drifting_clocks_raise_no_false_alarm() {
    const FOR_LONG: u64 = 2_000_000_000;
    for (ppm, busy_ns, pause_ns) in
        [(5.0, 0, FOR_LONG), (20.0, 0, FOR_LONG), (50.0, 0, FOR_LONG), (-50.0, 20_000_000, 0)]
    {
        let drifting = |ppm: f64| {
            drive().with(|slave| {
                slave.clock.as_mut().expect("it has one").ppm = ppm;
                slave.eeprom.busy_ns = busy_ns;
            })
        };
        let line = OddLine::new([drifting(0.0), drifting(ppm), coupler(), drifting(-ppm)]);
        let (mut network, slaves) = scanned(&line);
        let mut idle = line.clone();
        idle.wait(idle.now() + pause_ns);
        let measured = clocks::measure(&mut *network, &slaves, Duration::from_secs(1)).expect("it is measured");
        let shown: Vec<_> = measured.iter().map(|clock| (clock.slave, clock.delay_ns)).collect();
        assert_eq!(shown, [(1, 0), (2, 300), (4, 900)]);
        for clock in &measured[1..] {
            let ahead = clock.ahead.expect("it is measured");
            assert!(ahead.is_good() && ahead.count == 100, "{ppm} ppm, {pause_ns} ns: {clock:?}");
        }
    }
}

/// A slave that keeps its mailbox' counter over Init answers in consecutive inspections, for any value of the counter.
#[test]
fn one_look_after_another() {
    let line = OddLine::new([drive().with(|slave| slave.mailbox.keeps_counter = true)]);
    let vendor = ObjectAddress::new(0x1018, 1);
    for kept in 0..=7 {
        line.slave(1, |slave| slave.mailbox.heard = kept);
        for _ in 0..2 {
            let (mut network, _) = scanned(&line);
            for _ in 0..=kept {
                assert_eq!(network.upload(1, vendor, SdoScope::Entry).expect("a value"), [0x34, 0x12, 0, 0], "{kept}");
            }
        }
    }
}

/// BUS-2.3 Errors of an EEPROM are named, and nothing is reported about process data that it does not describe.
#[test]
fn what_is_wrong_with_an_eeprom_is_named() {
    let blank = |byte| OddSlave::new(vec![byte; 2048], Device::None);
    let mut wrong = sii::drive(Some(&sii::MANAGERS));
    wrong[14] ^= 0x10;
    let content = sii::Content::new(4).strings(&[b"DRV", b"cut"]).general(2).raw(&[60, 0, 0xFF, 0xFF]);
    let content = [content.bytes(), vec![0; 512]].concat()[..512].to_vec();
    let endless = drive_of(content).with(|slave| slave.eeprom.beyond = Beyond::Nobody);
    let slow = drive().with(|slave| slave.eeprom.busy_ns = 200_000_000);
    let line = OddLine::new([blank(0xFF), blank(0), drive_of(wrong), endless, slow, drive()]);
    let (_, slaves) = scanned(&line);
    let said: Vec<String> = slaves.iter().map(|slave| slave.eeprom_error.clone().unwrap_or_default()).collect();
    let expected = [
        "is empty: all of its first 64 words are 0xFFFF",
        "is empty: all of its first 64 words are 0x0000",
        "the checksum of the EEPROM's first words is 0x",
        "categories are not whole",
        "busy for more than 100 ms",
        "",
    ];
    for (said, expected) in said.iter().zip(expected) {
        assert!(said.contains(expected) && said.is_empty() == expected.is_empty(), "{said}");
    }
    assert_eq!(slaves[3].name, "cut");
    assert_eq!(slaves[0].process_bytes, (None, None));
    assert_eq!(slaves[5].process_bytes, (Some(6), Some(10)));
}

/// An EEPROM that does not acknowledge for some time after each word is written and read back; one whose commands take
/// 60 ms, too.
#[test]
fn slow_eeproms_are_written() {
    for (busy_ns, silent_ns) in [(0, 8_000_000), (60_000_000, 0), (2_000_000, 50_000_000)] {
        let slave = drive().with(|slave| (slave.eeprom.busy_ns, slave.eeprom.silent_ns) = (busy_ns, silent_ns));
        let line = OddLine::new([slave]);
        let (mut network, _) = scanned(&line);
        let mut content = network.read_eeprom(1).expect("an EEPROM");
        content[8] = 0x21;
        content[14] = sii::checksum(&content);
        let changes = bus::eeprom::changes(&mut *network, 1, &content).expect("they are read");
        assert_eq!(changes.len(), 2);
        bus::eeprom::write(&mut *network, 1, &changes, |_| ()).expect("it is written");
        assert_eq!(scanned(&line).1[0].eeprom_error, None);
    }
}

/// BUS-3.1 The dictionary of a slave, in fragments.
#[test]
fn a_dictionary_in_fragments() {
    let line = OddLine::new([coupler(), drive()]);
    let (mut network, _) = scanned(&line);
    let objects = dictionary::objects(&mut *network, 2).expect("a dictionary");
    let identity = objects.iter().find(|object| object.index == 0x1018).expect("it is there");
    assert_eq!((identity.max_sub, &*identity.name), (4, "object 1018"));
    assert_eq!(dictionary::entries(&mut *network, 2, identity).expect("its entries").len(), 5);
}

/// A state with an error is reported with its code. A slave that refuses PreOP is named with the code's text, and not
/// as one that does not answer.
#[test]
fn states_and_refusals() {
    let line = OddLine::new([drive()]);
    line.slave(1, |slave| slave.fall(2, 0x001B));
    let (_, slaves) = scanned(&line);
    assert_eq!((slaves[0].found.status.0, slaves[0].found.code.0), (0x12, 0x001B));
    line.slave(1, |slave| slave.states.refuses.push((2, 0x0016)));
    let (mut network, _) = scanned(&line);
    let said = refused(network.upload(1, ObjectAddress::new(0x1018, 1), SdoScope::Entry));
    assert!(said.contains("0x0016 (") && !said.contains("does not answer"), "{said}");
}

/// A slave whose mailbox does not answer is not reported as lost.
#[test]
fn a_mute_mailbox_is_no_lost_slave() {
    let line = OddLine::new([drive().with(|slave| slave.mailbox.is_mute = true)]);
    let (mut network, _) = scanned(&line);
    let said = refused(network.upload(1, ObjectAddress::new(0x1018, 1), SdoScope::Entry));
    assert!(said.contains("did not answer before the timeout") && !said.contains("power"), "{said}");
}

/// BUS-2.3 Frames whose source address returns unchanged are reported as not processed by a slave.
#[test]
fn an_unchanged_source_is_told() {
    let line = OddLine::new([drive()]).keeping_the_source();
    let said = refused(bus::over(line, Settings::default()).scan());
    assert!(said.contains("came back as they were sent"), "{said}");
}

/// A controller without the register of differences, or with receive times alone, is left out when clocks are measured.
#[test]
fn clocks_that_cannot_be_measured_are_left_out() {
    for (lacks, more) in [(0x092C..0x0930, None), (0x0910..0x0918, Some(0x0920..0x0A00))] {
        let lacks: Vec<_> = iter::once(lacks).chain(more).collect();
        let line = OddLine::new([drive(), drive().with(|slave| slave.lacks_registers = lacks), drive()]);
        let (mut network, slaves) = scanned(&line);
        let measured = clocks::measure(&mut *network, &slaves, Duration::from_millis(100)).expect("it is measured");
        assert_eq!(measured.iter().map(|clock| (clock.slave, clock.delay_ns)).collect::<Vec<_>>(), [(1, 0), (3, 600)]);
    }
}

/// BUS-3.1 A slave whose EEPROM has no general category, and so does not give its CoE services, is asked for its objects.
/// If it refuses that, the error says that it does not list them.
#[test]
fn objects_of_a_slave_without_a_general_category() {
    let content = sii::Content::new(0x000C).strings(&[b"ODD"]).fmmus(&[1, 2, 3, 0]).managers(&sii::MANAGERS);
    let line = OddLine::new([drive_of(content.end())]);
    let (mut network, _) = scanned(&line);
    assert!(network.object_list(1).expect("a list").contains(&0x6041));
    let objects = dictionary::objects(&mut *network, 1).expect("a dictionary");
    assert!(objects.iter().any(|object| object.index == 0x1018));
    assert!(matches!(network.describe_object(1, 0x5555), Err(BusError::Information { .. })));
    for code in [0x0800_0023, 0x0601_0000] {
        line.slave(1, |slave| slave.mailbox.coe.as_mut().expect("objects").refuses_information = Some(code));
        let said = refused(network.object_list(1));
        assert!(said.contains("no SDO information") && said.contains("`ecmsk bus sdo read 1 OBJECT`"), "{said}");
    }
}

/// Slaves that cannot leave OP by themselves, as another master has left them, are scanned: nobody sends them outputs.
#[test]
fn slaves_that_stay_in_op_are_scanned() {
    let line = OddLine::new([coupler(), terminal(), drive()]);
    for slave in 1..=2 {
        line.slave(slave, |slave| slave.memory[0x0130] = 8);
    }
    // The sync manager of outputs, with the watchdog, which has expired.
    line.slave(2, |slave| slave.memory[0x0800..0x0808].copy_from_slice(&[0x00, 0x0F, 1, 0, 0x44, 0, 1, 0]));
    let (_, slaves) = scanned(&line);
    let states: Vec<u16> = slaves.iter().map(|slave| slave.found.status.0).collect();
    assert_eq!(states, [8, 8, 1]);
    assert_eq!([1, 2].map(|slave| line.slave(slave, |slave| slave.state())), [1, 1]);
}
