//! Slaves of another descent than the models of this crate, each with something odd about it: `support::odd_line`.

use ecmsk::coe::{AbortCode, EntryDescription, EntryRequest, ObjectAddress, ObjectListType, SdoScope, ValueInfo};
use ecmsk::ethercat::{AlState, SlaveSet};
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::{Event, FileError, MailboxError, SdoError, SiiError, StateReason, SyncSignals};
use support::odd_line::{Beyond, Change, Device, OddSlave, coupler, drive, drive_of, number, sii, terminal};

use super::odd_rig::Rig;
use super::rig::{CYCLE, MS, SECOND};

/// A drive with an object of that many bytes at 0x2000.
fn with_long_object(len: usize) -> OddSlave {
    drive().with(|slave| {
        let coe = slave.mailbox.coe.as_mut().expect("it has objects");
        coe.objects.insert((0x2000, 0), (0..len).map(|n| n as u8).collect());
    })
}

/// MASTER-3.7 MASTER-4.1 Slaves with device emulation come to every state and back, beside a drive with a state machine; terminals exchange
/// single bits by the sync managers that their EEPROM has.
#[test]
fn device_emulation_beside_a_drive() {
    let mut rig = Rig::scanned([coupler(), drive(), terminal()]);
    for target in [AlState::PreOp, AlState::Init, AlState::PreOp] {
        rig.reach(target);
    }
    for slave in [2, 3] {
        rig.master.configure_as_described(slave).expect("it is described");
    }
    // A drive's objects, and not its EEPROM, define how many bytes it maps.
    rig.master.configure(2, 6, 10).expect("so many");
    rig.reach(AlState::SafeOp);
    rig.next_cycle = Some(rig.line.now());
    rig.reach(AlState::Op);
    for outputs in [0x05, 0x0A, 0x0F] {
        rig.master.outputs_mut(3).expect("a slave")[0] = outputs;
        rig.run_for(5 * CYCLE);
        assert_eq!(rig.master.inputs(3).expect("a slave")[0] & 0x0F, outputs);
        assert_eq!(rig.last.working_counter, rig.last.expected_working_counter);
    }
    let shown: Vec<u8> = (1..=3).map(|slave| rig.line.slave(slave, |slave| slave.memory[0x0130])).collect();
    assert_eq!(shown, [8; 3]);
    assert_eq!(rig.master.take_event(), None);
    rig.next_cycle = None;
    rig.reach(AlState::Init);
}

/// MASTER-2.9 Sync managers without a type are what their control bytes say.
#[test]
fn sync_managers_without_a_type() {
    let untyped = sii::MANAGERS.map(|(start, len, control, enable, _)| (start, len, control, enable, 0));
    let half = [sii::MANAGERS[0], sii::MANAGERS[1], untyped[2], untyped[3]];
    for managers in [untyped, half, sii::MANAGERS] {
        let mut rig = Rig::in_preop(drive_of(sii::drive(Some(&managers))));
        let info = rig.master.slave(1).expect("one");
        let place = |one: &ecmsk::master::ProcessManager| (one.number, one.registers.start);
        assert_eq!([place(&info.outputs[0]), place(&info.inputs[0])], [(2, 0x1100), (3, 0x1180)]);
        rig.master.configure_as_described(1).expect("it is described");
        rig.reach(AlState::SafeOp);
    }
}

/// MASTER-2.9 Every category of a kind counts, in whatever order they stand.
#[test]
fn every_category_of_a_kind() {
    let (mailboxes, process) = sii::MANAGERS.split_at(2);
    let eeprom = sii::Content::new(4)
        .pdos(51, &[(0x1600, 2, &[(0x6040, 0, 16)])])
        .category(2048, &[1, 2, 3, 4])
        .strings(&[b"one"])
        .managers(mailboxes)
        .pdos(51, &[(0x1601, 2, &[(0x607A, 0, 32)])])
        .category(0x0003, &[])
        .strings(&[b"two", b"three"])
        .pdos(50, &[(0x1A00, 3, &[(0x6041, 0, 16), (0, 0, 3)])])
        .general(3)
        .managers(process)
        .pdos(50, &[(0x1A01, 3, &[(0x6064, 0, 32), (0x60FD, 0, 1)])])
        .end();
    for reads_8 in [false, true] {
        let rig = Rig::scanned([drive_of(eeprom.clone()).with(|slave| slave.eeprom.reads_8 = reads_8)]);
        let info = rig.master.slave(1).expect("one");
        assert_eq!(info.name, "three");
        assert_eq!(info.assigned_pdos(), [vec![0x1600, 0x1601], vec![0x1A00, 0x1A01]]);
        assert_eq!(info.described_bytes(), [Some(6), Some(7)]);
        assert_eq!(info.eeprom_fault(), None);
    }
}

/// MASTER-2.9 A name in ISO-8859-1, by itself and in front of others.
#[test]
fn a_name_in_iso_8859_1() {
    let content = sii::Content::new(4).strings(&[b"\xB5-Achse", b"Gr\xF6\xDFe 25\xB0"]).general(2).end();
    assert_eq!(Rig::scanned([drive_of(content)]).master.slave(1).expect("one").name, "Größe 25°");
}

/// MASTER-2.10 Unwritten EEPROMs, EEPROMs with a wrong checksum, and those whose last category has no end, with any
/// bytes behind them; the categories before are used.
#[test]
fn eeproms_with_something_wrong() {
    let found = |slave: OddSlave| {
        let rig = Rig::scanned([slave]);
        let info = rig.master.slave(1).expect("one");
        (info.eeprom_fault(), info.name.clone(), info.identity.product)
    };
    for byte in [0x00, 0xFF] {
        for reads_8 in [false, true] {
            let blank = OddSlave::new(vec![byte; 2048], Device::None).with(|slave| slave.eeprom.reads_8 = reads_8);
            assert_eq!(found(blank), (Some(SiiError::Empty(byte)), String::new(), 0));
        }
    }
    let good = sii::drive(Some(&sii::MANAGERS));
    let mut wrong = good.clone();
    wrong[14] ^= 0x41;
    let (expected, name) = (good[14], "an odd drive".to_owned());
    let fault = SiiError::Checksum { found: expected ^ 0x41, expected };
    assert_eq!(found(drive_of(wrong)), (Some(fault), name.clone(), 0x5678));
    let beyond = [Beyond::Byte(0), Beyond::Byte(0xFF), Beyond::Byte(0x3C), Beyond::Nobody, Beyond::Again];
    for (beyond, kind) in beyond.into_iter().flat_map(|beyond| [60, 50, 2048].map(|kind| (beyond, kind))) {
        let content = sii::Content::new(4).strings(&[b"ODD", b"an odd drive"]).general(2).managers(&sii::MANAGERS);
        let before = content.bytes();
        let [low, high] = u16::to_le_bytes(kind);
        let endless = [&before[..], &[low, high, 0xFF, 0xFF, 1, 0, 2, 0]].concat();
        let slave = drive_of(endless).with(|slave| slave.eeprom.beyond = beyond);
        let fault = SiiError::NoEnd { word: (before.len() / 2) as u16 };
        assert_eq!(found(slave), (Some(fault), name.clone(), 0x5678), "{beyond:?}, {kind}");
    }
}

/// MASTER-2.3 MASTER-9.3 An EEPROM whose commands take 60 to 99 ms is read and written, with 4 or 8 bytes a read, and one that acknowledges
/// nothing for some time after a word was written; one that takes longer is busy.
#[test]
fn eeproms_that_take_their_time() {
    let slave = |busy_ns, silent_ns, reads_8| {
        drive().with(|slave| {
            slave.eeprom.busy_ns = busy_ns;
            slave.eeprom.silent_ns = silent_ns;
            slave.eeprom.reads_8 = reads_8;
        })
    };
    for (busy_ms, reads_8) in [(60, true), (60, false), (99, true)] {
        let rig = Rig::scanned([slave(busy_ms * MS, 0, reads_8)]);
        let info = rig.master.slave(1).expect("one");
        assert_eq!((info.name.as_str(), info.identity.vendor), ("an odd drive", 0x1234), "{busy_ms}");
    }
    let rig = Rig::scanned([slave(130 * MS, 0, true)]);
    assert_eq!(rig.master.slave(1).expect("one").eeprom, Err(SiiError::Busy));
    for (busy_ms, silent_ms) in [(0, 3), (2, 10), (5, 60), (0, 90), (60, 0), (90, 5)] {
        let mut rig = Rig::scanned([slave(busy_ms * MS, silent_ms * MS, true)]);
        let id = rig.master.write_eeprom(1, 0x04, &[0x0777, 0, 0]);
        assert_eq!(rig.wait(id), Ok(()), "{busy_ms}, {silent_ms}");
        assert_eq!(rig.line.slave(1, |slave| slave.eeprom.word(4)), 0x0777);
        let id = rig.master.read_eeprom(1, 0x04, 2);
        assert_eq!(rig.wait(id), Ok(vec![0x0777, 0]), "{busy_ms}, {silent_ms}");
    }
}

/// MASTER-5.1 MASTER-5.7 MASTER-5.8 Values of many lengths both ways, the list of objects with what they are, and complete access.
#[test]
fn objects_of_another_server() {
    for len in [0, 1, 4, 5, 7, 112, 113, 119, 120, 121, 240, 1000] {
        let mut rig = Rig::in_preop(with_long_object(len));
        let value: Vec<u8> = (0..len).map(|n| n as u8).collect();
        assert_eq!(rig.upload(0x2000, 0), Ok(value.clone()), "{len}");
        let other: Vec<u8> = value.iter().rev().map(|byte| byte ^ 0x5A).collect();
        assert_eq!(rig.download(0x2000, 0, &other), Ok(()), "{len}");
        let held = rig
            .line
            .slave(1, |slave| slave.mailbox.coe.as_ref().and_then(|coe| coe.value(0x2000, 0).map(<[u8]>::to_vec)));
        assert_eq!(held.as_ref(), Some(&other), "{len}");
        assert_eq!(rig.upload(0x2000, 0), Ok(other), "{len}");
    }
    let many = drive().with(|slave| {
        let coe = slave.mailbox.coe.as_mut().expect("objects");
        (0x3000..0x3100).for_each(|index| drop(coe.objects.insert((index, 0), number(2, 7))));
    });
    let mut rig = Rig::in_preop(many);
    let id = rig.master.object_list(1, ObjectListType::All, SECOND);
    let Ok(list) = rig.wait(id) else { panic!("no list") };
    assert!(list.is_sorted() && list.len() > 256 && list.contains(&0x30FF), "{}", list.len());
    let request = EntryRequest { object: ObjectAddress::new(0x1018, 2), wanted: ValueInfo(7) };
    let id = rig.master.describe_entry(1, request, SECOND);
    let Ok(described) = rig.wait(id) else { panic!("no description") };
    assert_eq!(EntryDescription::decode(&described).expect("a description").bits, 32);
    let id = rig.master.upload(1, ObjectAddress::new(0x1018, 0), SdoScope::Complete, SECOND);
    let Ok(whole) = rig.wait(id) else { panic!("no value") };
    assert_eq!(whole, [&[4, 0][..], &number(4, 0x1234), &number(4, 0x5678), &number(4, 1), &number(4, 0)].concat());
    assert_eq!(rig.upload(0x5555, 0), Err(SdoError::Abort(AbortCode::NO_OBJECT)));
    assert_eq!(rig.upload(0x1018, 9), Err(SdoError::Abort(AbortCode::NO_SUB_INDEX)));
    assert_eq!(rig.download(0x1018, 1, &[0; 4]), Err(SdoError::Abort(AbortCode::READ_ONLY)));
}

/// What a transfer ends with, and that it ends at once; the next one is none the worse for it.
#[track_caller]
fn ends_at_once<R>(rig: &mut Rig, change: Change, transfer: impl FnOnce(&mut Rig) -> Result<R, SdoError>) -> AbortCode {
    let begin = rig.line.now();
    rig.line.slave(1, |slave| slave.mailbox.change = Some(change));
    let code = transfer(rig).map(|_| ()).expect_err("it is wrong").abort_code();
    assert!(rig.line.now() - begin < 20 * MS, "{} ms", (rig.line.now() - begin) / MS);
    rig.line.slave(1, |slave| slave.mailbox.change = None);
    assert!(rig.upload(0x1018, 1).is_ok(), "the next one");
    code
}

/// MASTER-5.10 Wrong toggle bits of segments that are read and written, answers about another object or of another kind, and wrong lengths:
/// each ends the transfer at once with its code.
#[test]
fn wrong_answers_end_at_once() {
    // Behind the header of the mailbox and that of CoE.
    const COMMAND: usize = 8;
    let nth_segment = |nth: usize| -> Change {
        let mut seen = 0;
        Box::new(move |message| {
            if message[COMMAND] >> 5 < 2 {
                seen += 1;
                message[COMMAND] ^= if seen == nth { 1 << 4 } else { 0 };
            }
        })
    };
    for nth in 1..=4 {
        let mut rig = Rig::in_preop(with_long_object(700));
        rig.upload(0x1018, 1).expect("a value");
        assert_eq!(ends_at_once(&mut rig, nth_segment(nth), |rig| rig.upload(0x2000, 0)), AbortCode::TOGGLE_BIT);
        let value = vec![3; 700];
        let ended = ends_at_once(&mut rig, nth_segment(nth), |rig| rig.download(0x2000, 0, &value));
        assert_eq!(ended, AbortCode::TOGGLE_BIT);
    }
    type Wrong = fn(&mut Vec<u8>);
    let wrong: [(Wrong, AbortCode); 6] = [
        (|message| message[10] ^= 0x20, AbortCode::COMMAND),
        (|message| message[11] ^= 1, AbortCode::COMMAND),
        (|message| message[COMMAND] = 0x60, AbortCode::COMMAND),
        (|message| message[0] = 5, AbortCode::LENGTH),
        (|message| message[0] = 2, AbortCode::LENGTH),
        (|message| message[1] = 0x7F, AbortCode::COMMAND),
    ];
    for (change, code) in wrong {
        let mut rig = Rig::in_preop(drive());
        rig.upload(0x1018, 1).expect("a value");
        assert_eq!(ends_at_once(&mut rig, Box::new(change), |rig| rig.upload(0x1018, 2)), code);
    }
    // A segment that is longer than what was left, and a value that ends before it is whole.
    let mut rig = Rig::in_preop(with_long_object(300));
    rig.upload(0x1018, 1).expect("a value");
    let shorter: Change = Box::new(|message| {
        if message[COMMAND] == 0x41 {
            message[12..14].copy_from_slice(&200_u16.to_le_bytes());
        }
    });
    assert_eq!(ends_at_once(&mut rig, shorter, |rig| rig.upload(0x2000, 0)), AbortCode::TOO_LONG);
    let longer: Change = Box::new(|message| message[13] += u8::from(message[COMMAND] == 0x41));
    assert_eq!(ends_at_once(&mut rig, longer, |rig| rig.upload(0x2000, 0)), AbortCode::TOO_SHORT);
}

/// MASTER-5.10 A slave that aborts by the service of answers, and one whose own messages all have the same counter, or none, are understood.
#[test]
fn counters_and_services_of_answers() {
    let aborting = drive().with(|slave| slave.mailbox.coe.as_mut().expect("objects").aborts_as_answer = true);
    assert_eq!(Rig::in_preop(aborting).upload(0x5555, 0), Err(SdoError::Abort(AbortCode::NO_OBJECT)));
    for counter in [0, 1, 5] {
        let mut rig = Rig::in_preop(with_long_object(600).with(|slave| slave.mailbox.counts = Some(counter)));
        for _ in 0..10 {
            let begin = rig.line.now();
            assert_eq!(rig.upload(0x2000, 0).map(|value| value.len()), Ok(600), "{counter}");
            assert!(rig.line.now() - begin < 100 * MS, "{counter}");
        }
    }
}

/// A slave that takes requests and answers none is not reported as lost: the error is a timeout.
#[test]
fn a_mute_mailbox_is_no_lost_slave() {
    let mut rig = Rig::in_preop(drive().with(|slave| slave.mailbox.is_mute = true));
    assert_eq!(rig.upload(0x1018, 1), Err(MailboxError::TimeUp.into()));
    rig.line.slave(1, |slave| slave.mailbox.is_mute = false);
    assert_eq!(rig.upload(0x1018, 1), Ok(number(4, 0x1234)));
}

/// MASTER-5.10 A packet with a wrong number ends the transfer of a file at once, with an error to the slave; other
/// files are read and written, of lengths around that of a packet.
#[test]
fn files_and_packets_with_a_wrong_number() {
    use ecmsk::ethercat::foe::FoeError;
    let mut rig = Rig::in_preop(drive());
    for len in [0, 1, 115, 116, 117, 232, 1000] {
        let content: Vec<u8> = (0..len).map(|n| n as u8).collect();
        let id = rig.master.write_file(1, b"table", 0, &content, SECOND);
        assert_eq!(rig.wait(id), Ok(()), "{len}");
        assert_eq!(rig.read_file("table"), Ok(content), "{len}");
    }
    for packet in [0, 1, 2, 3] {
        let foe = |rig: &Rig, wrong| {
            rig.line.slave(1, |slave| {
                let foe = slave.mailbox.foe.as_mut().expect("files");
                foe.wrong_packet = wrong;
                foe.ended_with.take()
            })
        };
        foe(&rig, Some(packet));
        let begin = rig.line.now();
        if packet > 0 {
            assert_eq!(rig.read_file("table"), Err(FileError::File(FoeError::PACKET_NUMBER)), "{packet}");
            rig.run_for(5 * MS);
            assert_eq!(foe(&rig, Some(packet)), Some(FoeError::PACKET_NUMBER.0));
        }
        let id = rig.master.write_file(1, b"table", 0, &[1; 1000], SECOND);
        let ended = rig.wait(id);
        assert_eq!(ended, Err(FileError::File(FoeError::PACKET_NUMBER)), "{packet}");
        assert!(rig.line.now() - begin < 100 * MS);
        rig.run_for(5 * MS);
        foe(&rig, None);
    }
    assert_eq!(rig.read_file("table").map(|content| content.len()), Ok(1000));
}

/// MASTER-3.2 A refusal has its AL status code, after which the slave reaches the state when it no longer refuses. A
/// slave that falls to SafeOP is reported with the code, such as the watchdog's when outputs no longer come.
#[test]
fn refusals_and_the_watchdog() {
    for code in [0x001A, 0x002C, 0x002D, 0x0032, 0x0070, 0x8123] {
        let mut rig = Rig::in_preop(drive().with(|slave| slave.states.refuses.push((4, code))));
        rig.master.configure(1, 6, 10).expect("so many");
        let id = rig.master.request_state(SlaveSet::first(1), AlState::SafeOp, SECOND);
        let Err(error) = rig.wait(id) else { panic!("it refuses") };
        assert!(matches!(error.reason, StateReason::Refused { code: refused, .. } if refused.0 == code), "{error}");
        rig.line.slave(1, |slave| slave.states.refuses.clear());
        rig.reach(AlState::SafeOp);
    }
    let mut rig = Rig::in_preop(drive());
    rig.master.configure(1, 6, 10).expect("so many");
    rig.reach(AlState::SafeOp);
    rig.next_cycle = Some(rig.line.now());
    rig.reach(AlState::Op);
    rig.next_cycle = None;
    rig.run_for(300 * MS);
    let events: Vec<_> = std::iter::from_fn(|| rig.master.take_event()).collect();
    assert!(
        events.iter().any(|event| matches!(event, Event::Status { slave: 1, code, .. } if code.0 == 0x001B)),
        "{events:?}"
    );
}

/// MASTER-6.1 Clocks whose crystals drift by 5 to 50 ppm are set to each other, with the delays of the line, and keep together;
/// a drive that wants SYNC0 gets it before SafeOP.
#[test]
fn clocks_of_another_kind_keep_together() {
    for ppm in [5.0, 20.0, 50.0] {
        let drifting = |ppm: f64| drive().with(|slave| slave.clock.as_mut().expect("one").ppm = ppm);
        let mut rig = Rig::scanned([drifting(0.0), drifting(ppm), coupler(), drifting(-ppm)]);
        assert_eq!(rig.master.reference_clock(), Some(1));
        let delays: Vec<u32> = [2, 4].map(|slave| rig.line.slave(slave, |slave| delay(slave))).to_vec();
        assert_eq!(delays, [300, 900]);
        rig.reach(AlState::PreOp);
        let id = rig.master.download(2, ObjectAddress::new(0x1C32, 1), SdoScope::Entry, &[2, 0], SECOND);
        assert_eq!(rig.wait(id), Ok(()));
        for slave in [1, 2, 4] {
            rig.master.set_sync(slave, Some(SyncSignals::sync0(CYCLE as u32, 0))).expect("a slave");
            rig.master.configure(slave, 6, 10).expect("so many");
        }
        rig.next_cycle = Some(rig.line.now());
        rig.reach(AlState::SafeOp);
        rig.reach(AlState::Op);
        rig.run_for(5 * SECOND);
        for slave in [2, 4] {
            let difference =
                rig.line.slave(slave, |slave| u32::from_le_bytes(*slave.memory[0x092C..].first_chunk().expect("4")));
            assert!(difference & 0x7FFF_FFFF < 500, "{ppm}: {}", difference & 0x7FFF_FFFF);
        }
    }
}

fn delay(slave: &OddSlave) -> u32 {
    u32::from_le_bytes(*slave.memory[0x0928..].first_chunk().expect("4 bytes"))
}

/// MASTER-6.8 A slave whose IN and OUT are swapped gets frames by port 1 and works on them behind those that follow it: it is known by its
/// times, or by port 0 without a link, its port 1 is not taken for the end of a ring, and all slaves come to PreOP.
#[test]
fn swapped_slaves_are_known_and_used() {
    for (swapped, found) in [(0, 3), (1, 3), (2, 3)] {
        let slaves = (0..3).map(|n| drive().with(|slave| slave.is_swapped = n == swapped));
        let mut rig = Rig::scanned(slaves);
        let entries: Vec<u8> = rig.master.slaves().iter().map(|slave| slave.entry_port).collect();
        // Of those that are swapped the first one is the last to work on a frame.
        let expected: Vec<u8> = (1..=3).map(|n| u8::from(n == found)).collect();
        assert_eq!(entries, expected, "{swapped}");
        let closed = (1..=3).any(|slave| rig.line.slave(slave, |slave| slave.has_closed_ports));
        assert!(!closed, "{swapped}");
        rig.reach(AlState::PreOp);
    }
}
