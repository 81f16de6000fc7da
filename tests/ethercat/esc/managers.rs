//! Sync managers: mailboxes, and three buffers.

use ecmsk::ethercat::Command;
use ecmsk::ethercat::mailbox::MailboxProtocol;
use ecmsk::ethercat::registers::{self, Fmmu, FmmuDirections, SmControl, SmStatus, SyncManager};

use ecmsk::slave::esc::EscSettings;
use ecmsk::slave::{Io, IoConfig};

use super::rig::{FIRST, INPUTS, MS, OUTPUTS, Rig};

const UPLOAD_VENDOR: [u8; 10] = [0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0];
const UPLOAD_PRODUCT: [u8; 10] = [0, 0x20, 0x40, 0x18, 0x10, 2, 0, 0, 0, 0];

/// Whether the mailbox of that sync manager is full.
fn is_full(rig: &mut Rig, n: u8) -> bool {
    SmStatus(rig.read_u8(FIRST, registers::sync_manager_status(n))).contains(SmStatus::FULL)
}

/// ECAT-10.4 Start and length of an enabled sync manager stay; once it is disabled they change, and its status is cleared.
#[test]
fn s21_an_enabled_sync_manager_keeps_its_area() {
    let mut rig = Rig::drives(1);
    rig.set_manager(FIRST, 0, SyncManager::enabled(0x1000, 8, SmControl::MAILBOX_OUT));
    rig.write(FIRST, 0x1000, &[1; 8]);
    assert!(is_full(&mut rig, 0));
    rig.write(FIRST, registers::sync_manager(0), &[0x00, 0x18, 99, 0]);
    assert_eq!(rig.read(FIRST, registers::sync_manager(0), 5), [0x00, 0x10, 8, 0, 0x26]);
    rig.write(FIRST, registers::sync_manager_activate(0), &[0]);
    assert!(!is_full(&mut rig, 0));
    rig.write(FIRST, registers::sync_manager(0), &[0x00, 0x18, 99, 0]);
    assert_eq!(rig.read(FIRST, registers::sync_manager(0), 8), [0x00, 0x18, 99, 0, 0x26, 0, 0, 0]);
    // Status and the slave's own byte cannot be written.
    rig.write(FIRST, registers::sync_manager(0), &[0, 0x18, 9, 0, 0x26, 0xFF, 0, 0xFF]);
    assert_eq!(rig.read(FIRST, registers::sync_manager(0), 8), [0, 0x18, 9, 0, 0x26, 0, 0, 0]);
}

/// ECAT-10.5 A full mailbox takes nothing and keeps its content; it is full once its last byte was written.
#[test]
fn s22_a_full_mailbox_takes_nothing() {
    let mut rig = Rig::drives(1);
    rig.set_manager(FIRST, 0, SyncManager::enabled(0x1000, 8, SmControl::MAILBOX_OUT));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1000, &[1, 2, 3]).wkc, 1);
    assert!(!is_full(&mut rig, 0));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1007, &[8]).wkc, 1);
    assert!(is_full(&mut rig, 0));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1000, &[9; 8]).wkc, 0);
    let memory = rig.chain.slave(0).controller().peek(0x1000, 8);
    assert_eq!(memory, [1, 2, 3, 0, 0, 0, 0, 8]);
    assert_eq!(rig.one(Command::Fprd, FIRST, 0x1000, &[0; 8]).wkc, 0, "the other direction");
    // A buffer is opened by its first byte.
    rig.set_manager(FIRST, 2, SyncManager::enabled(0x1400, 8, SmControl::MAILBOX_OUT));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1407, &[8]).wkc, 0);
    // Behind the area there is plain memory again.
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1408, &[8]).wkc, 1);
}

/// ECAT-10.6 An empty mailbox returns nothing. Reading its last byte empties it, and the next message appears.
#[test]
fn s23_an_empty_mailbox_gives_nothing() {
    let mut rig = Rig::in_preop();
    assert_eq!(rig.collect(FIRST), None);
    let [vendor, product] = [UPLOAD_VENDOR, UPLOAD_PRODUCT].map(|data| rig.message(MailboxProtocol::Coe, &data));
    assert_eq!((rig.post(FIRST, &vendor), rig.post(FIRST, &product)), (1, 1));
    assert!(is_full(&mut rig, 1));
    assert_eq!(rig.one(Command::Fprd, FIRST, 0x1080, &[0; 16]).wkc, 1, "a part of it");
    assert!(is_full(&mut rig, 1));
    let first = rig.collect(FIRST).expect("the first answer");
    assert!(is_full(&mut rig, 1), "the next one is there");
    let second = rig.collect(FIRST).expect("the second answer");
    assert_eq!((first[11], second[11]), (1, 2));
    assert!(!is_full(&mut rig, 1));
    assert_eq!(rig.collect(FIRST), None);
}

/// ECAT-10.7 A master that has lost an answer toggles the repeat bit and gets it again; an answer that came meanwhile follows.
#[test]
fn s24_a_lost_answer_is_repeated() {
    let mut rig = Rig::in_preop();
    let [vendor, product] = [UPLOAD_VENDOR, UPLOAD_PRODUCT].map(|data| rig.message(MailboxProtocol::Coe, &data));
    rig.post(FIRST, &vendor);
    rig.post(FIRST, &product);
    let lost = rig.collect(FIRST).expect("an answer");
    for toggle in [3, 1, 3] {
        rig.write(FIRST, registers::sync_manager_activate(1), &[toggle]);
        assert_eq!(rig.read_u8(FIRST, registers::sync_manager_pdi_control(1)), toggle & 2);
        assert_eq!(rig.collect(FIRST).as_ref(), Some(&lost));
    }
    let second = rig.collect(FIRST).expect("the newer answer");
    assert_eq!((lost[11], second[11]), (1, 2));
    rig.write(FIRST, registers::sync_manager_activate(1), &[1]);
    assert_eq!(rig.collect(FIRST), Some(second));
    assert_eq!(rig.collect(FIRST), None);
    assert_eq!(rig.read_u16(FIRST, registers::AL_STATUS), 2, "the state stays");
}

/// ECAT-10.7 A repeat before anything was read is acknowledged, and returns nothing.
#[test]
fn s24_nothing_to_repeat() {
    let mut rig = Rig::in_preop();
    rig.write(FIRST, registers::sync_manager_activate(1), &[3]);
    assert_eq!(rig.read_u8(FIRST, registers::sync_manager_pdi_control(1)), 2);
    assert_eq!(rig.collect(FIRST), None);
}

/// ECAT-10.8 With three buffers neither side ever waits, and the reader gets the newest whole buffer.
#[test]
fn s25_three_buffers_never_refuse() {
    let mut rig = Rig::drives(1);
    let len = rig.bring_to_op(FIRST, 0);
    let (outputs, inputs) = rig.lens(FIRST);
    rig.set_fmmu(FIRST, 0, Fmmu::bytes(0, outputs, 0x1100, FmmuDirections::WRITE));
    for n in 0..100 {
        // Outputs twice, inputs once.
        for _ in 0..2 {
            assert_eq!(rig.logical(Command::Lwr, 0, &vec![n; outputs.into()]).wkc, 1);
        }
        assert_eq!(rig.logical(Command::Lrd, outputs.into(), &vec![0; inputs.into()]).wkc, 1);
        assert_eq!(rig.logical(Command::Lrd, outputs.into(), &vec![0; inputs.into()]).wkc, 1, "the same ones again");
    }
    assert_eq!(len, usize::from(outputs + inputs));
    // A buffer that was begun and not completed does not count.
    let status = |rig: &mut Rig| rig.read_u8(FIRST, registers::sync_manager_status(2));
    let before = SmStatus(status(&mut rig)).last_buffer();
    rig.write(FIRST, 0x1100, &[0x77]);
    let begun = SmStatus(status(&mut rig));
    assert_eq!((begun.last_buffer(), begun.contains(SmStatus::WRITING)), (before, true));
    rig.write(FIRST, 0x1100, &vec![0x66; outputs.into()]);
    let ended = SmStatus(status(&mut rig));
    assert!(ended.last_buffer() != before && !ended.contains(SmStatus::WRITING));
}

/// ECAT-10.8 A reader gets the newest whole buffer, also while the next buffer is being written; the outputs of an IO
/// module come back as its inputs.
#[test]
fn s25_a_reader_gets_the_newest_whole_buffer() {
    let io = super::rig::slave(Box::new(Io::new(IoConfig::default())), EscSettings::default());
    let mut rig = Rig::with_stations([io]);
    rig.bring_to_op(FIRST, 0);
    let inputs = |rig: &mut Rig| rig.read(FIRST, INPUTS, 2);
    for n in 1..100 {
        // Two writes, the second one in two parts, of which the first makes no difference yet.
        rig.write(FIRST, OUTPUTS, &[n, n]);
        rig.now += 25 * MS;
        assert_eq!(inputs(&mut rig), [n, n]);
        rig.write(FIRST, OUTPUTS, &[!n]);
        rig.now += 25 * MS;
        assert_eq!(inputs(&mut rig), [n, n]);
        rig.write(FIRST, OUTPUTS + 1, &[!n]);
        rig.now += 25 * MS;
        assert_eq!(inputs(&mut rig), [!n, !n]);
    }
}

/// ECAT-10.8 Before anything was written a reader gets the content of the memory.
#[test]
fn s25_reading_before_writing_is_no_error() {
    let mut rig = Rig::drives(1);
    rig.set_manager(FIRST, 3, SyncManager::enabled(0x1200, 4, SmControl::INPUTS));
    let answer = rig.one(Command::Fprd, FIRST, 0x1200, &[0xEE; 4]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0; 4]));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1200, &[1; 4]).wkc, 0, "the other direction");
    assert_eq!(u16::from(SmStatus(rig.read_u8(FIRST, registers::sync_manager_status(3))).last_buffer()), 3);
}
