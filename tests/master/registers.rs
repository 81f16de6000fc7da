//! Registers, EEPROM words and single datagrams.

use ecmsk::ethercat::mailbox::{MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{
    FMMUS, RX_ERRORS, SII_CONFIGURATION, STATION_ADDRESS, SiiControl, SmControl, SyncManager, TYPE,
};
use ecmsk::ethercat::{AlState, Command, DATA_LEN_MAX, SlaveSet};
use ecmsk::master::{DatagramAnswer, DatagramError, Event, MailboxError, ReferenceClock, SiiError, StateReason};
use ecmsk::slave::esc::{Chain, EscSettings};
use ecmsk::slave::{DeviceFault, Fault};

use super::rig::{MS, Rig, SECOND, slave};

fn read(rig: &mut Rig, slave: u8, address: u16, len: usize) -> Result<Vec<u8>, DatagramError> {
    let id = rig.master.read_registers(slave, address, len);
    rig.wait(id)
}

fn write(rig: &mut Rig, slave: u8, address: u16, data: &[u8]) -> Result<(), DatagramError> {
    let id = rig.master.write_registers(slave, address, data);
    rig.wait(id)
}

fn datagram(rig: &mut Rig, command: Command, address: u32, data: &[u8]) -> Result<DatagramAnswer, DatagramError> {
    let id = rig.master.datagram(command, address, data);
    rig.wait(id)
}

fn read_words(rig: &mut Rig, slave: u8, first: u16, count: usize) -> Result<Vec<u16>, SiiError> {
    let id = rig.master.read_eeprom(slave, first, count);
    rig.wait(id)
}

fn write_words(rig: &mut Rig, slave: u8, first: u16, words: &[u16]) -> Result<(), SiiError> {
    let id = rig.master.write_eeprom(slave, first, words);
    rig.wait(id)
}

const fn register(adp: u16, ado: u16) -> u32 {
    adp as u32 | (ado as u32) << 16
}

/// MASTER-9.1 Registers of a slave are read and written; a missing slave, and a read-only register, are errors.
#[test]
fn registers_are_read_and_written() {
    let mut rig = Rig::scanned(&["drive", "io"]);
    for (n, number) in [(0, 1), (1, 2)] {
        let shown = rig.net.chain.slave(n).controller().peek(FMMUS, 4).to_vec();
        assert_eq!(read(&mut rig, number, FMMUS, 4), Ok(shown));
    }
    assert_eq!(write(&mut rig, 2, 0x1F00, &[1, 2, 3]), Ok(()));
    assert_eq!(read(&mut rig, 2, 0x1F00, 4), Ok(vec![1, 2, 3, 0]));
    assert_eq!(write(&mut rig, 2, TYPE, &[1]), Err(DatagramError::WorkingCounter(0)));
    assert_eq!(read(&mut rig, 3, TYPE, 1), Err(DatagramError::NoSlave(3)));
    assert_eq!(write(&mut rig, 0, 0x1F00, &[1]), Err(DatagramError::NoSlave(0)));
    assert_eq!(read(&mut rig, 1, TYPE, DATA_LEN_MAX + 1), Err(DatagramError::TooLong(DATA_LEN_MAX + 1)));
    rig.net.chain.silence(1, true);
    assert_eq!(read(&mut rig, 2, TYPE, 1), Err(DatagramError::WorkingCounter(0)));
    rig.net.chain.connect(0, false);
    assert_eq!(read(&mut rig, 1, TYPE, 1), Err(DatagramError::Lost));
}

/// MASTER-9.1 Error counters are read and cleared while cycles go on.
#[test]
fn error_counters_are_read_and_cleared() {
    let mut rig = Rig::in_op(&["drive", "io"]);
    rig.net.chain.slave_mut(1).controller_mut().note_invalid_frame(0);
    assert_eq!(read(&mut rig, 2, RX_ERRORS, 8).map(|errors| errors[0]), Ok(1));
    assert_eq!(write(&mut rig, 2, RX_ERRORS, &[0; 8]), Ok(()));
    assert_eq!(read(&mut rig, 2, RX_ERRORS, 8), Ok(vec![0; 8]));
    assert_eq!(rig.last.working_counter, rig.last.expected_working_counter);
}

/// A datagram of any command is sent once, and returns its answer with the working counter.
#[test]
fn datagrams_of_any_command_go_out() {
    let mut rig = Rig::scanned(&["drive", "io", "drive"]);
    let answer = |data: &[u8], working_counter| Ok(DatagramAnswer { data: data.to_vec(), working_counter });
    let first = [0x01, 0x10];
    assert_eq!(datagram(&mut rig, Command::Aprd, register(0, STATION_ADDRESS), &[0; 2]), answer(&first, 1));
    let last = register(2_u16.wrapping_neg(), STATION_ADDRESS);
    assert_eq!(datagram(&mut rig, Command::Aprd, last, &[0; 2]), answer(&[0x03, 0x10], 1));
    assert_eq!(datagram(&mut rig, Command::Fprd, register(0x1002, STATION_ADDRESS), &[0; 2]), answer(&[2, 0x10], 1));
    assert_eq!(datagram(&mut rig, Command::Fprd, register(0x2002, TYPE), &[7]), answer(&[7], 0));
    assert_eq!(datagram(&mut rig, Command::Brd, register(0, TYPE), &[0]), answer(&[0x11], 3));
    assert_eq!(datagram(&mut rig, Command::Bwr, register(0, 0x1F00), &[9, 8]), answer(&[9, 8], 3));
    assert_eq!(datagram(&mut rig, Command::Frmw, register(0x1001, 0x1F00), &[0, 0]), answer(&[9, 8], 3));
    assert_eq!(datagram(&mut rig, Command::Lrw, 0x0700_0000, &[5; 4]), answer(&[5; 4], 0));
    assert_eq!(datagram(&mut rig, Command::Nop, 0, &[1]), answer(&[1], 0));
    let long = vec![0; DATA_LEN_MAX + 1];
    assert_eq!(datagram(&mut rig, Command::Brd, 0, &long), Err(DatagramError::TooLong(long.len())));
}

/// A datagram whose frame is lost is not sent again.
#[test]
fn a_lost_datagram_is_not_sent_again() {
    let mut rig = Rig::scanned(&["io"]);
    rig.net.faults.lost_back = 1;
    assert_eq!(datagram(&mut rig, Command::Fpwr, register(0x1001, 0x1F00), &[1]), Err(DatagramError::Lost));
    assert_eq!(rig.net.chain.slave(0).controller().peek(0x1F00, 1), [1]);
    rig.net.faults.lost_back = 0;
    assert_eq!(
        datagram(&mut rig, Command::Fpwr, register(0x1001, 0x1F00), &[2]).map(|sent| sent.working_counter),
        Ok(1)
    );
}

/// MASTER-9.3 Words of an EEPROM are read from any word on, whether a read gives 4 or 8 bytes and however slow it is.
#[test]
fn eeprom_words_are_read() {
    for (reads_8_bytes, eeprom_ns) in [(true, 0), (false, 0), (true, 3 * MS), (false, 15 * MS)] {
        let settings = EscSettings { reads_8_bytes, eeprom_ns, ..EscSettings::default() };
        let mut rig = Rig::of(Chain::line([slave("drive", settings)]));
        assert_eq!(rig.scan(), 1);
        let content = rig.net.chain.slave(0).controller().eeprom().to_vec();
        let words: Vec<u16> = content.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect();
        assert_eq!(read_words(&mut rig, 1, 0, words.len()), Ok(words.clone()));
        for (first, count) in [(0, 0), (8, 1), (9, 3), (10, 5)] {
            assert_eq!(read_words(&mut rig, 1, first, count), Ok(words[first.into()..][..count].to_vec()));
        }
    }
    let mut rig = Rig::scanned(&["io"]);
    assert_eq!(read_words(&mut rig, 1, 0xFFFF, 1), Ok(vec![0xFFFF]));
    assert_eq!(read_words(&mut rig, 1, 0xFFFF, 2), Err(SiiError::TooLong));
    assert_eq!(read_words(&mut rig, 2, 0, 1), Err(SiiError::NoSlave(2)));
    rig.net.chain.silence(0, true);
    assert_eq!(read_words(&mut rig, 1, 0, 1), Err(SiiError::NoAnswer));
}

/// MASTER-9.3 Words of an EEPROM are written, in every state, and the next scan reads them.
#[test]
fn eeprom_words_are_written() {
    for (state, eeprom_ns) in [(AlState::Init, 0), (AlState::PreOp, 4 * MS)] {
        let settings = EscSettings { eeprom_ns, ..EscSettings::default() };
        let mut rig = Rig::of(Chain::line([slave("io", settings)]));
        rig.scan();
        rig.reach(state);
        // The serial number, words 14 and 15, and the revision before it.
        assert_eq!(write_words(&mut rig, 1, 12, &[0x1111, 0x2222, 0x3333, 0x4444]), Ok(()));
        assert_eq!(read_words(&mut rig, 1, 12, 4), Ok(vec![0x1111, 0x2222, 0x3333, 0x4444]));
        assert_eq!(rig.scan(), 1);
        let identity = rig.master.slaves()[0].identity;
        assert_eq!((identity.revision, identity.serial), (0x2222_1111, 0x4444_3333));
    }
    let mut rig = Rig::in_op(&["io"]);
    assert_eq!(write_words(&mut rig, 1, 14, &[7, 8]), Ok(()));
    assert_eq!(read_words(&mut rig, 1, 14, 2), Ok(vec![7, 8]));
    assert_eq!(rig.last.working_counter, rig.last.expected_working_counter);
    let refused = write_words(&mut rig, 1, 0xFFFF, &[7]);
    assert!(matches!(refused, Err(SiiError::Command(status)) if status.contains(SiiControl::COMMAND_ERROR)));
    assert_eq!(write_words(&mut rig, 1, 0xFFFF, &[7, 8]), Err(SiiError::TooLong));
    assert_eq!(write_words(&mut rig, 0, 0, &[7]), Err(SiiError::NoSlave(0)));
}

/// Only one sequence uses an EEPROM at a time, and a change of state and an access to it exclude each other.
#[test]
fn an_eeprom_is_one_sequences_at_a_time() {
    let settings = EscSettings { eeprom_ns: 10 * MS, state_change_ns: 50 * MS, ..EscSettings::default() };
    let mut rig = Rig::of(Chain::line([slave("io", settings.clone()), slave("io", settings)]));
    rig.scan();
    let first = rig.master.read_eeprom(1, 0, 16);
    let second = rig.master.write_eeprom(1, 14, &[1]);
    assert_eq!(rig.wait(second), Err(SiiError::InUse(1)));
    let up = rig.master.request_state(SlaveSet::first(1), AlState::PreOp, SECOND);
    let error = rig.wait(up).expect_err("the EEPROM is in use");
    assert_eq!((error.slave, error.reason), (1, StateReason::Busy));
    // Another slave's EEPROM is free, and so is this one after its sequence was given up.
    rig.master.cancel(first);
    assert!(read_words(&mut rig, 2, 0, 1).is_ok());
    assert!(read_words(&mut rig, 1, 0, 1).is_ok());
    let up = rig.master.request_state(SlaveSet::first(1), AlState::PreOp, SECOND);
    rig.run_for(5 * MS);
    assert_eq!(read_words(&mut rig, 1, 0, 1), Err(SiiError::InUse(1)));
    assert_eq!(rig.wait(up), Ok(()));
}

/// An EEPROM that was left to the slave's own controller is taken back.
#[test]
fn an_eeprom_that_was_offered_is_taken() {
    let mut rig = Rig::scanned(&["io"]);
    assert_eq!(write(&mut rig, 1, SII_CONFIGURATION, &[1]), Ok(()));
    assert!(read_words(&mut rig, 1, 8, 2).is_ok());
    assert_eq!(read(&mut rig, 1, SII_CONFIGURATION, 1), Ok(vec![0]));
}

const ALARM: Fault = Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x3210, resettable: true } };

/// Mail that a user keeps stays in the mailbox, is seen there, and is read with its header; an emergency in it is an
/// event then. Another request reads it, too.
#[test]
fn mail_is_kept_for_a_user() {
    let mut rig = Rig::in_op(&["drive", "drive"]);
    rig.master.keep_mail(1, true);
    let alarm = |rig: &mut Rig| {
        assert!(rig.net.chain.slave_mut(0).device_mut().apply_fault(ALARM));
        rig.run_for(50 * MS);
    };
    alarm(&mut rig);
    assert!(rig.master.has_mail(1) && !rig.master.has_mail(2));
    assert_eq!(rig.master.take_event(), None);
    let id = rig.master.receive_mail(1);
    let Ok(Some(mail)) = rig.wait(id) else { panic!("there is mail") };
    let message = MailboxMessage::decode(&mail).expect("a message");
    assert_eq!(message.header.protocol, MailboxProtocol::Coe);
    assert!(
        matches!(rig.master.take_event(), Some(Event::Emergency { slave: 1, emergency }) if emergency.code == 0x3210)
    );
    assert!(!rig.master.has_mail(1));
    let id = rig.master.receive_mail(1);
    assert_eq!(rig.wait(id), Ok(None));
    let id = rig.master.receive_mail(3);
    assert_eq!(rig.wait(id), Err(MailboxError::NoMailbox));
}

/// States that a slave has left by itself are known once they were read.
#[test]
fn states_are_read_when_they_are_wanted() {
    let mut rig = Rig::scanned(&["io", "io"]);
    rig.reach(AlState::PreOp);
    rig.net.chain.silence(1, true);
    let id = rig.master.read_states();
    rig.wait(id);
    let present = [1, 2].map(|slave| rig.master.status(slave).is_some_and(|status| status.is_present));
    assert_eq!(present, [true, false]);
}

/// Process data and mailboxes work at addresses that a user chooses.
#[test]
fn sync_managers_lie_where_a_user_says() {
    let mut rig = Rig::scanned(&["io", "io"]);
    let outputs = SyncManager::enabled(0x1A00, 2, SmControl::OUTPUTS);
    assert_eq!(rig.master.set_manager(2, 2, outputs), Ok(()));
    assert_eq!(rig.master.set_manager(2, 0, SyncManager::enabled(0x1C00, 128, SmControl::MAILBOX_OUT)), Ok(()));
    assert_eq!(rig.master.set_manager(2, 1, SyncManager::enabled(0x1C80, 128, SmControl::MAILBOX_IN)), Ok(()));
    assert!(rig.master.set_manager(2, 1, SyncManager::enabled(0x1C80, 8, SmControl::MAILBOX_IN)).is_err());
    assert!(rig.master.set_manager(2, 40, outputs).is_err());
    assert!(rig.master.set_manager(3, 2, outputs).is_err());
    rig.bring_to_op(&["io", "io"]);
    rig.master.outputs_mut(2).expect("a slave").copy_from_slice(&[0x5A, 0xA5]);
    rig.run_for(5 * MS);
    assert_eq!(rig.net.chain.slave(1).controller().peek(0x1A00, 2), [0x5A, 0xA5]);
    assert_eq!(rig.upload(2, 0x7000, 1), Ok(vec![0x5A, 0xA5]));
    assert_eq!(rig.last.working_counter, rig.last.expected_working_counter);
}

/// MASTER-4.7 While LRW is off, the same process data go in LWR and LRD, in any cycle.
#[test]
fn lrw_is_switched_off_and_on() {
    let mut rig = Rig::in_op(&["io", "drive"]);
    for (lrw, counter) in [(false, 4), (true, 6), (false, 4)] {
        rig.master.set_lrw(lrw);
        let value = [counter as u8, 0x11];
        rig.master.outputs_mut(1).expect("a slave").copy_from_slice(&value);
        rig.run_for(5 * MS);
        assert_eq!((rig.last.working_counter, rig.last.expected_working_counter, rig.last.lost), (counter, counter, 0));
        assert_eq!(rig.upload(1, 0x7000, 1), Ok(value.to_vec()));
        // The inputs of the module are its outputs.
        assert_eq!(rig.master.inputs(1), Some(&value[..]));
    }
}

/// The clocks of slaves whose crystals are wrong follow the master's clock if that leads, and do not if a slave's does.
#[test]
fn clocks_follow_the_master_if_it_leads() {
    let away = |reference| {
        let settings = |drift_ppb| EscSettings { drift_ppb, ..EscSettings::default() };
        let mut rig = Rig::of(Chain::line([100_000, -50_000].map(|drift| slave("drive", settings(drift)))));
        rig.master.set_reference(reference);
        rig.scan();
        rig.next_cycle = Some(rig.net.now);
        rig.run_for(3 * SECOND);
        let now = rig.net.now;
        [0, 1].map(|n| rig.net.chain.slave(n).controller().system_time_ns().abs_diff(now))
    };
    assert!(away(ReferenceClock::Master).iter().all(|away| *away < 2_000), "{:?}", away(ReferenceClock::Master));
    assert!(away(ReferenceClock::FirstSlave).iter().all(|away| *away > 200_000));
}
