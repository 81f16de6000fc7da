//! Slaves as their makers have made them: EEPROMs that say less, or say it otherwise, and controllers without a device behind them.

use ecmsk::ethercat::mailbox::MailboxProtocol;
use ecmsk::ethercat::registers::{AlStatusRegister, RequestedState, SmControl};
use ecmsk::ethercat::sii::{
    CategoryKind, CoeDetails, FmmuUsage, MailboxArea, MailboxAreas, MailboxProtocols, Sii, SiiGeneral, SiiIdentity,
    SiiInfo, SiiPdo, SiiPdoEntry, SiiSmEnable, SiiSmType, SiiSyncManager, SiiWriter, UNCHECKED, checksum,
};
use ecmsk::ethercat::{AlState, Command, each_datagram};
use ecmsk::master::{Event, SiiError};
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave};

use super::rig::{CYCLE, MS, Rig, SECOND, device, slave};

/// A controller whose AL status copies AL control.
const DEVICE_EMULATION: u16 = 0x0105;

/// MASTER-3.7 ECAT-11.12 Slaves without a state machine, which show the acknowledgement of a request as an error, are brought to every state beside
/// others, and back, and are never taken for failed; so are those that were without power.
#[test]
fn slaves_that_copy_the_acknowledgement_come_to_op() {
    let emulated = || {
        let identity = SiiIdentity { vendor: 2, product: 4, revision: 1, serial: 0 };
        let info = SiiInfo { pdi_control: DEVICE_EMULATION, identity, ..SiiInfo::default() };
        let mut eeprom = vec![0; 256];
        SiiWriter::new(&mut eeprom, &info).expect("room").finish();
        EscSlave::new(device("io"), EscSettings::default(), eeprom, 0)
    };
    let drive = || slave("drive", EscSettings::default());
    let mut rig = Rig::of(Chain::line([emulated(), drive(), emulated()]));
    assert_eq!(rig.scan(), 3);
    rig.run_for(100 * MS);
    assert_eq!(rig.master.take_event(), None);
    let copied = |rig: &Rig, n: usize| {
        let bytes = rig.net.chain.slave(n).controller().peek(0x0130, 2);
        AlStatusRegister(u16::from_le_bytes([bytes[0], bytes[1]]))
    };
    rig.master.configure_as_described(2).expect("it is described");
    for target in [AlState::PreOp, AlState::SafeOp, AlState::Op, AlState::PreOp, AlState::Init, AlState::PreOp] {
        rig.next_cycle = (target >= AlState::SafeOp).then_some(rig.net.now);
        rig.reach(target);
        for n in [0, 2] {
            assert_eq!(copied(&rig, n), AlStatusRegister::of(RequestedState::State(target)), "{target:?}");
        }
    }
    assert_eq!(rig.master.take_event(), None);
    // Whatever a master has left: an acknowledgement that was never taken back.
    for n in [0, 2] {
        let station = 0x1001 + n as u32;
        let id = rig.master.datagram(Command::Fpwr, station | 0x0120 << 16, &[0x12, 0]);
        assert!(rig.wait(id).is_ok());
        assert_eq!(copied(&rig, n).0, 0x12);
    }
    rig.reach(AlState::SafeOp);
    let now = rig.net.now;
    rig.net.chain.power(2, false, now);
    rig.run_for(100 * MS);
    let now = rig.net.now;
    rig.net.chain.power(2, true, now);
    rig.run_for(200 * MS);
    let events: Vec<_> = std::iter::from_fn(|| rig.master.take_event()).collect();
    assert!(events.contains(&Event::PowerCycled { slave: 3 }), "{events:?}");
    assert_eq!(copied(&rig, 2), AlStatusRegister::of(RequestedState::State(AlState::Init)));
    rig.reach(AlState::SafeOp);
}

const MAILBOX: MailboxAreas =
    MailboxAreas { receive: MailboxArea { start: 0x1000, len: 128 }, send: MailboxArea { start: 0x1080, len: 128 } };

/// A sync manager with a type, or with the type 0.
fn manager(start: u16, len: u16, control: SmControl, kind: SiiSmType) -> SiiSyncManager {
    SiiSyncManager { start, len, control, status: 0, enable: SiiSmEnable::ENABLE, kind }
}

/// An EEPROM of a drive with these sync managers. `more` writes what follows.
fn eeprom_with(managers: Option<&[SiiSyncManager]>, more: impl FnOnce(&mut SiiWriter<'_>)) -> Vec<u8> {
    let identity = SiiIdentity { vendor: 0x1234, product: 0x5678, revision: 1, serial: 0 };
    let protocols = MailboxProtocols::COE;
    let info = SiiInfo { identity, mailbox: MAILBOX, protocols, kbit_less_1: 15, version: 1, ..SiiInfo::default() };
    let mut eeprom = vec![0xFF; 2048];
    let mut sii = SiiWriter::new(&mut eeprom, &info).expect("room");
    sii.strings(&["DRV", "a drive"]).expect("room");
    let coe = CoeDetails::SDO | CoeDetails::PDO_ASSIGN | CoeDetails::PDO_CONFIG;
    sii.general(&SiiGeneral { order: 1, name: 2, coe, ..SiiGeneral::default() }).expect("room");
    sii.fmmus(&[FmmuUsage::Outputs, FmmuUsage::Inputs]).expect("room");
    if let Some(managers) = managers {
        sii.sync_managers(managers).expect("room");
    }
    more(&mut sii);
    sii.finish();
    eeprom
}

fn drive_with(eeprom: Vec<u8>) -> Rig {
    let mut rig = Rig::of(Chain::line([EscSlave::new(device("drive"), EscSettings::default(), eeprom, 0)]));
    assert_eq!(rig.scan(), 1);
    rig
}

/// Numbers and starts of the sync managers of outputs and of inputs.
fn found(rig: &Rig) -> [Vec<(u8, u16)>; 2] {
    let info = rig.master.slave(1).expect("one");
    [&info.outputs, &info.inputs].map(|all| all.iter().map(|one| (one.number, one.registers.start)).collect())
}

/// MASTER-2.9 Sync managers without a type are what their control bytes say, whether all are without one or those of process data are;
/// one that is off beside others with types is none.
#[test]
fn control_bytes_tell_what_sync_managers_are_for() {
    use SiiSmType::{Inputs, MailboxIn, MailboxOut, Outputs, Unused};
    let four = |[a, b, c, d]: [SiiSmType; 4]| {
        [
            manager(0x1000, 128, SmControl::MAILBOX_OUT, a),
            manager(0x1080, 128, SmControl::MAILBOX_IN, b),
            manager(0x1100, 6, SmControl::OUTPUTS, c),
            manager(0x1200, 10, SmControl::INPUTS, d),
        ]
    };
    let expected = [vec![(2, 0x1100)], vec![(3, 0x1200)]];
    for kinds in [
        [Unused; 4],
        [MailboxOut, MailboxIn, Unused, Unused],
        [MailboxOut, MailboxIn, Outputs, Unused],
        [MailboxOut, MailboxIn, Outputs, Inputs],
    ] {
        let mut rig = drive_with(eeprom_with(Some(&four(kinds)), |_| ()));
        assert_eq!(found(&rig), expected, "{kinds:?}");
        rig.bring_to_op(&["drive"]);
        assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (3, 3), "{kinds:?}");
    }
    // Without the enable bit either.
    let off = four([Unused; 4]).map(|one| SiiSyncManager { enable: SiiSmEnable::NONE, ..one });
    assert_eq!(found(&drive_with(eeprom_with(Some(&off), |_| ()))), expected);
    let mut five = four([MailboxOut, MailboxIn, Outputs, Inputs]).to_vec();
    five.push(SiiSyncManager { enable: SiiSmEnable::NONE, ..manager(0x1300, 1, SmControl::INPUTS, Unused) });
    five.push(manager(0, 0, SmControl::INPUTS, Unused));
    assert_eq!(found(&drive_with(eeprom_with(Some(&five), |_| ()))), expected);
}

/// MASTER-2.9 A slave with CANopen whose EEPROM has no sync managers for process data has those of nearly all slaves, behind its
/// mailboxes, or those that its object 0x1C00 says. How many bytes it has is not known then.
#[test]
fn a_slave_without_described_sync_managers_is_used() {
    let mailboxes = [
        manager(0x1000, 128, SmControl::MAILBOX_OUT, SiiSmType::MailboxOut),
        manager(0x1080, 128, SmControl::MAILBOX_IN, SiiSmType::MailboxIn),
    ];
    for managers in [None, Some(&[][..]), Some(&mailboxes[..])] {
        let mut rig = drive_with(eeprom_with(managers, |_| ()));
        let info = rig.master.slave(1).expect("one");
        assert!(info.assumes_managers() && info.described_bytes() == [None; 2], "{info:?}");
        assert_eq!(found(&rig), [vec![(2, 0x1100)], vec![(3, 0x1280)]]);
        rig.bring_to_op(&["drive"]);
        assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (3, 3));
    }
    let mut rig = drive_with(eeprom_with(None, |_| ()));
    use SiiSmType::{Inputs, MailboxIn, MailboxOut, Outputs, Unused};
    rig.master.assume_managers(1, &[MailboxOut, MailboxIn, Inputs, Unused, Outputs]).expect("it may be others");
    assert_eq!(found(&rig), [vec![(4, 0x1280)], vec![(2, 0x1100)]]);
    let mut rig = Rig::scanned(&["drive"]);
    assert!(rig.master.assume_managers(1, &[Unused; 4]).is_err(), "its EEPROM says what they are");
}

/// MASTER-2.9 The content of several categories of a kind counts as if it were in one: texts go on with their numbers,
/// sync managers with theirs, and PDOs add up.
#[test]
fn every_category_of_a_kind_counts() {
    let entry = |bits| [SiiPdoEntry { index: 0x6041, sub: 0, name: 0, data_type: 6, bits, flags: 0 }];
    let mut eeprom = vec![0xFF; 2048];
    let info = SiiInfo { mailbox: MAILBOX, protocols: MailboxProtocols::COE, ..SiiInfo::default() };
    let mut sii = SiiWriter::new(&mut eeprom, &info).expect("room");
    sii.strings(&["one"]).expect("room");
    sii.general(&SiiGeneral { name: 3, ..SiiGeneral::default() }).expect("room");
    sii.sync_managers(&[
        manager(0x1000, 128, SmControl::MAILBOX_OUT, SiiSmType::MailboxOut),
        manager(0x1080, 128, SmControl::MAILBOX_IN, SiiSmType::MailboxIn),
    ])
    .expect("room");
    sii.pdos(CategoryKind::RxPdos, &[(SiiPdo::new(0x1600, 2, 0), &entry(16))]).expect("room");
    sii.pdos(CategoryKind::TxPdos, &[(SiiPdo::new(0x1A00, 3, 0), &entry(32))]).expect("room");
    sii.pdos(CategoryKind::RxPdos, &[(SiiPdo::new(0x1601, 2, 0), &entry(8))]).expect("room");
    sii.strings(&["two", "three"]).expect("room");
    sii.sync_managers(&[
        manager(0x1100, 0, SmControl::OUTPUTS, SiiSmType::Outputs),
        manager(0x1200, 0, SmControl::INPUTS, SiiSmType::Inputs),
    ])
    .expect("room");
    sii.pdos(CategoryKind::TxPdos, &[(SiiPdo::new(0x1A01, 3, 0), &entry(4))]).expect("room");
    sii.finish();
    let rig = drive_with(eeprom);
    let info = rig.master.slave(1).expect("one");
    assert_eq!(info.name, "three");
    assert_eq!(found(&rig), [vec![(2, 0x1100)], vec![(3, 0x1200)]]);
    assert_eq!(info.described_bytes(), [Some(3), Some(5)]);
    assert_eq!(info.assigned_pdos(), [vec![0x1600, 0x1601], vec![0x1A00, 0x1A01]]);
}

/// MASTER-2.9 Texts are ISO-8859-1, as the standard has it; UTF-8 is taken for what it is.
#[test]
fn texts_are_read_in_their_encoding() {
    for (bytes, shown) in [
        (&b"Antrieb f\xFCr Gr\xF6\xDFe"[..], "Antrieb für Größe"),
        ("Größe".as_bytes(), "Größe"),
        ("伺服".as_bytes(), "伺服"),
        (b"25\xB0C\x1B[2J\0", "25°C[2J"),
    ] {
        let mut text = vec![1, bytes.len() as u8];
        text.extend_from_slice(bytes);
        text.resize(text.len().next_multiple_of(2), 0);
        let mut eeprom = vec![0xFF; 1024];
        let mut sii = SiiWriter::new(&mut eeprom, &SiiInfo::default()).expect("room");
        sii.category(CategoryKind::Strings, &text).expect("room");
        sii.general(&SiiGeneral { name: 1, ..SiiGeneral::default() }).expect("room");
        sii.finish();
        assert_eq!(drive_with(eeprom).master.slave(1).expect("one").name, shown);
    }
}

/// MASTER-2.10 Errors of an EEPROM are named: an unwritten one, a wrong checksum, and categories without an end; the
/// categories before such a one count.
#[test]
fn what_is_wrong_with_an_eeprom_is_named() {
    let info = |eeprom| drive_with(eeprom).master.slave(1).expect("one").clone();
    for byte in [0, 0xFF] {
        let slave = info(vec![byte; 2048]);
        assert_eq!((&slave.eeprom, slave.eeprom_fault()), (&Err(SiiError::Empty(byte)), Some(SiiError::Empty(byte))));
        assert_eq!(slave.described_bytes(), [None; 2]);
    }
    let good = eeprom_with(None, |_| ());
    assert_eq!(info(good.clone()).eeprom_fault(), None);
    let mut wrong = good.clone();
    wrong[14] ^= 1;
    let expected = checksum(good.first_chunk().expect("14 bytes"));
    let fault = SiiError::Checksum { found: expected ^ 1, expected };
    let slave = info(wrong.clone());
    assert_eq!((slave.eeprom_fault(), slave.identity.vendor), (Some(fault), 0x1234));
    wrong[14..16].copy_from_slice(&UNCHECKED.to_le_bytes());
    assert_eq!(info(wrong).eeprom_fault(), None);
    // A category that is longer than any EEPROM, in place of the end.
    let mut endless = good.clone();
    let end = 2 * categories_len(&good);
    endless[end..end + 4].copy_from_slice(&[60, 0, 0xFF, 0xFF]);
    let slave = info(endless);
    assert_eq!((slave.name.as_str(), slave.identity.product), ("a drive", 0x5678));
    assert_eq!(slave.eeprom_fault(), Some(SiiError::NoEnd { word: (end / 2) as u16 }));
}

/// MASTER-2.10 The categories of an EEPROM without an end mark, whose content repeats behind its end, count once.
#[test]
fn an_eeprom_that_begins_anew_is_read_once() {
    let entry = [SiiPdoEntry { index: 0x6041, sub: 0, name: 0, data_type: 6, bits: 16, flags: 0 }];
    let pdo = |sii: &mut SiiWriter<'_>| {
        sii.pdos(CategoryKind::TxPdos, &[(SiiPdo::new(0x1A00, 3, 0), &entry)]).expect("room");
    };
    let left = 256 - 2 * categories_len(&eeprom_with(None, pdo));
    let once = eeprom_with(None, |sii| {
        pdo(sii);
        sii.category(CategoryKind::DataTypes, &vec![0; left - 4]).expect("room");
    });
    assert_eq!(categories_len(&once), 128);
    let slave = drive_with(once[..256].repeat(8)).master.slave(1).expect("one").clone();
    assert_eq!((slave.eeprom.as_ref().map(Vec::len), slave.eeprom_fault()), (Ok(256), None));
    assert_eq!(slave.described_bytes(), [None, Some(2)]);
}

/// The word at which the categories end.
fn categories_len(eeprom: &[u8]) -> usize {
    let sii = Sii::new(eeprom).expect("an EEPROM");
    64 + sii.categories().map_while(Result::ok).map(|one| 2 + one.data.len() / 2).sum::<usize>()
}

/// MASTER-2.3 Commands of an EEPROM may take up to 100 ms each. MASTER-9.3 While an EEPROM keeps a word it acknowledges nothing, which is
/// waited for, too.
#[test]
fn slow_and_silent_eeproms_are_read_and_written() {
    let settings =
        |eeprom_ns, eeprom_silence_ns| EscSettings { eeprom_ns, eeprom_silence_ns, ..EscSettings::default() };
    let quick = Rig::scanned(&["drive"]);
    for eeprom_ns in [60 * MS, 95 * MS] {
        let mut slow = Rig::of(Chain::line([slave("drive", settings(eeprom_ns, 0))]));
        assert_eq!(slow.scan(), 1);
        assert_eq!(slow.master.slaves(), quick.master.slaves(), "{eeprom_ns}");
    }
    let mut too_slow = Rig::of(Chain::line([slave("drive", settings(150 * MS, 0))]));
    assert_eq!(too_slow.scan(), 1);
    assert_eq!(too_slow.master.slaves()[0].eeprom, Err(SiiError::Busy));
    for silence_ns in [2 * MS, 12 * MS, 40 * MS] {
        let mut rig = Rig::of(Chain::line([slave("io", settings(MS, silence_ns))]));
        rig.scan();
        let id = rig.master.write_eeprom(1, 14, &[0x1111, 0x2222, 0x3333]);
        assert_eq!(rig.wait(id), Ok(()), "{silence_ns}");
        let id = rig.master.read_eeprom(1, 14, 3);
        assert_eq!(rig.wait(id), Ok(vec![0x1111, 0x2222, 0x3333]), "{silence_ns}");
    }
    let mut broken = Rig::of(Chain::line([slave("io", settings(0, SECOND))]));
    broken.scan();
    let id = broken.master.write_eeprom(1, 14, &[1, 2]);
    assert!(matches!(broken.wait(id), Err(SiiError::Command(_))));
}

/// Changes each message that a slave sends, once: what it has of the mailbox.
fn change_answer(rig: &mut Rig, mut change: impl FnMut(&mut [u8]) -> bool + 'static) {
    rig.net.hostile = Some(Box::new(move |frame| {
        let done = each_datagram(frame, |datagram| {
            let header = datagram.header();
            let is_answer = header.command == Command::Fprd && header.ado() == MAILBOX.send.start;
            if is_answer && datagram.data[5] & 0x0F == MailboxProtocol::Coe.code() {
                change(datagram.data);
            }
        });
        assert!(done.is_ok());
    }));
}

mod wrong_answers {
    use ecmsk::coe::{AbortCode, ObjectAddress, ObjectListType, SdoScope};
    use ecmsk::ethercat::AlState;
    use ecmsk::master::{MailboxError, SdoError};
    use ecmsk::slave::esc::Chain;
    use support::blob::{BLOB, Blob, bytes};

    use super::super::rig::{Faults, MS, Rig, SECOND};
    use super::change_answer;

    fn blob(len: usize) -> Rig {
        let mut rig = Rig::of(Chain::line([Blob::of(len).slave()]));
        rig.scan();
        rig.reach(AlState::PreOp);
        // The mailbox begins with a request of its own.
        assert_eq!(rig.upload(1, BLOB.index, 0).map(|value| value.len()), Ok(len));
        rig
    }

    /// What a transfer ends with, at once.
    #[track_caller]
    fn ends_at_once(rig: &mut Rig, transfer: impl FnOnce(&mut Rig) -> Result<(), SdoError>, code: AbortCode) {
        let begin = rig.net.now;
        let error = transfer(rig).expect_err("it is wrong");
        assert_eq!(error.abort_code(), code, "{error}");
        assert!(rig.net.now - begin < 20 * MS, "{} ms", (rig.net.now - begin) / MS);
        rig.net.hostile = None;
        assert!(rig.upload(1, BLOB.index, 0).is_ok(), "the next one is none the worse for it");
    }

    /// MASTER-5.10 A segment with the wrong toggle bit, of a value that is read and of one that is written, ends the transfer at once.
    #[test]
    fn wrong_toggle_bits() {
        const COMMAND: usize = 8;
        for n in [1, 3] {
            let mut rig = blob(1000);
            let mut seen = 0;
            change_answer(&mut rig, move |bytes| {
                let is_segment = bytes[COMMAND] >> 5 < 2;
                seen += usize::from(is_segment);
                if is_segment && seen == n {
                    bytes[COMMAND] ^= 1 << 4;
                }
                is_segment
            });
            if n == 1 {
                ends_at_once(&mut rig, |rig| rig.upload(1, BLOB.index, 0).map(drop), AbortCode::TOGGLE_BIT);
            } else {
                let value = bytes(900);
                ends_at_once(&mut rig, |rig| rig.download(1, BLOB.index, 0, &value), AbortCode::TOGGLE_BIT);
            }
        }
    }

    /// MASTER-5.10 So do an answer to another object, one of another kind, one that is too short, and one that is longer than its box.
    #[test]
    fn other_wrong_answers() {
        type Change = fn(&mut [u8]);
        let wrong: [(Change, AbortCode); 5] = [
            (|bytes| bytes[9] ^= 1, AbortCode::COMMAND),
            (|bytes| bytes[8] = 0x60, AbortCode::COMMAND),
            (|bytes| bytes[8] = 0xE0, AbortCode::COMMAND),
            (|bytes| bytes[0] = 3, AbortCode::LENGTH),
            (|bytes| bytes[..2].copy_from_slice(&[0xFF, 0x7F]), AbortCode::COMMAND),
        ];
        for (change, code) in wrong {
            let mut rig = blob(3);
            change_answer(&mut rig, move |bytes| {
                change(bytes);
                true
            });
            ends_at_once(&mut rig, |rig| rig.upload(1, BLOB.index, 0).map(drop), code);
        }
    }

    /// MASTER-5.10 An answer to a request that was given up is none of these: it is left out.
    #[test]
    fn late_answers_are_left_out() {
        let mut rig = blob(3);
        rig.net.chain.slave_mut(0).delay_sdo(100 * MS);
        let id = rig.master.upload(1, ObjectAddress::new(0x2000, 0), SdoScope::Entry, 50 * MS);
        assert_eq!(rig.wait(id), Err(MailboxError::TimeUp.into()));
        let id = rig.master.download(1, BLOB, SdoScope::Entry, &[7], SECOND);
        assert_eq!(rig.wait(id), Ok(()));
    }

    /// MASTER-5.10 A wrong counter in the header of an answer makes it no wrong answer: values are read and written in the same time
    /// as with right counters, whether they jump, go back, stand still or are not used. Frames may be lost meanwhile.
    #[test]
    fn wrong_counters_of_answers() {
        type Count = fn(u8) -> u8;
        let transfers = |rig: &mut Rig| {
            assert_eq!(rig.upload(1, BLOB.index, 0), Ok(bytes(1000)));
            assert_eq!(rig.download(1, BLOB.index, 0, &bytes(1000)), Ok(()));
        };
        let with = |count: Count| {
            let mut rig = blob(1000);
            change_answer(&mut rig, move |message| {
                message[5] = message[5] & 0x0F | count(message[5] >> 4 & 7) << 4;
                true
            });
            rig
        };
        let duration = |count: Count| {
            let mut rig = with(count);
            let begin = rig.net.now;
            (0..5).for_each(|_| transfers(&mut rig));
            rig.net.now - begin
        };
        let right = duration(|count| count);
        let wrong: [Count; 4] = [|count| count * 3 % 7 + 1, |count| 8 - count, |_| 5, |_| 0];
        for count in wrong {
            assert_eq!(duration(count), right);
            for seed in 0..10 {
                let mut rig = with(count);
                transfers(&mut rig);
                rig.net.faults = Faults { lost_out: 60, lost_back: 60, ..Faults::all(seed, 0) };
                (0..10).for_each(|_| transfers(&mut rig));
                assert!(rig.master.counters().lost > 10, "{seed}");
            }
        }
    }

    /// MASTER-5.10 SDO information with fragments that do not count down ends at once.
    #[test]
    fn wrong_fragments() {
        let mut rig = Rig::scanned(&["dp3cl"]);
        rig.reach(AlState::PreOp);
        assert!(rig.upload(1, 0x1000, 0).is_ok());
        change_answer(&mut rig, |bytes| {
            bytes[10] = bytes[10].wrapping_add(u8::from(bytes[10] == 0));
            true
        });
        let begin = rig.net.now;
        let id = rig.master.object_list(1, ObjectListType::All, SECOND);
        assert_eq!(rig.wait(id), Err(MailboxError::WrongAnswer.into()));
        assert!(rig.net.now - begin < 20 * MS);
    }
}

/// MASTER-6.8 A slave whose IN and OUT are swapped is known by its receive times: the frame has passed another port before port 0.
#[test]
fn swapped_ports_are_seen() {
    let mut rig = Rig::line(&["drive", "drive", "drive"]);
    rig.net.hostile = Some(Box::new(|frame| {
        let done = each_datagram(frame, |datagram| {
            let header = datagram.header();
            if header.command == Command::Fprd && header.ado() == 0x0900 && header.address as u16 == 0x1002 {
                datagram.data[..8].rotate_left(4);
            }
        });
        assert!(done.is_ok());
    }));
    assert_eq!(rig.scan(), 3);
    assert_eq!(rig.master.slaves().iter().map(|slave| slave.entry_port).collect::<Vec<_>>(), [0, 1, 0]);
    rig.net.hostile = None;
    assert_eq!(rig.scan(), 3);
    assert!(rig.master.slaves().iter().all(|slave| slave.entry_port == 0));
    rig.run_for(CYCLE);
}
