//! Slaves behind controllers: registers, EEPROMs, files and mailboxes by the commands that reach them.

use ecmsk::coe::AbortCode;
use ecmsk::ethercat::foe::FoeError;
use ecmsk::ethercat::mailbox::{MailboxHeader, MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{self, sync_manager};
use ecmsk::ethercat::sii::VENDOR_WORD;
use ecmsk::slave::{DeviceFault, Dp3cl, Dp3clConfig, Fault, Io, Slave};
use ecmsk::xf::EtherCatState;
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{HostConfig, ProcessRequest};
use ecmsk::xf::request::*;

use super::{INIT, MS, OVER_CONTROLLERS, Pair, drive, drives_and_io, sdo, to_all};
use crate::slave;

/// Two servo drives and an IO module behind controllers, in a state.
pub fn in_state(state: EtherCatState) -> Pair {
    let mut pair = of(drives_and_io());
    pair.bring_to(state);
    pair
}

pub fn of(slaves: Vec<Box<dyn Slave>>) -> Pair {
    let before = OVER_CONTROLLERS.replace(true);
    let pair = Pair::running_with(Profile::NEW, HostConfig::DEFAULT, slaves);
    OVER_CONTROLLERS.set(before);
    pair
}

const fn raw(operation: RawOperation, adp: u16, ado: u16, data: &[u8]) -> RawRequest<'_> {
    RawRequest { operation, adp, ado, logical: 0, timeout_us: 20_000, data }
}

/// Sends a datagram; returns the working counter and data of its answer.
fn sent(pair: &mut Pair, request: &RawRequest<'_>) -> (i32, Vec<u8>) {
    let look = |answer: ecmsk::xf::response::RawAnswer<'_>| {
        assert_eq!((answer.operation(), answer.adp, answer.ado), (Some(request.operation), request.adp, request.ado));
        assert_eq!((answer.logical, answer.timeout_us), (request.logical, request.timeout_us));
        (answer.working_counter, answer.data.to_vec())
    };
    pair.read(request, &RawGet, look).expect("it came back")
}

/// Reads the memory of a controller.
pub fn peek(pair: &mut Pair, n: usize, address: u16, len: usize) -> Vec<u8> {
    pair.controllers().chain().slave(n).controller().peek(address, len).to_vec()
}

/// XF-11.62 RAW_ECAT_FUNC_REQ sends any datagram, RAW_ECAT_FUNC_GET returns the answer (XF EN 1560, 1580): it reads and
/// writes the controllers' registers, and the working counter is that of the frame.
#[test]
pub fn datagrams() {
    let mut pair = in_state(EtherCatState::PreOp);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Brd, 0, registers::AL_STATUS, &[0; 2])), (3, vec![2, 0]));
    for n in 0..3 {
        let shown = peek(&mut pair, n, registers::TYPE, 10);
        let request = raw(RawOperation::Fprd, 0x1001 + n as u16, registers::TYPE, &[0; 10]);
        assert_eq!(sent(&mut pair, &request), (1, shown.clone()));
        let request = raw(RawOperation::Aprd, (n as u16).wrapping_neg(), registers::TYPE, &[0; 10]);
        assert_eq!(sent(&mut pair, &request), (1, shown));
    }
    let most: Vec<u8> = (0..=255).collect();
    assert_eq!(sent(&mut pair, &raw(RawOperation::Fpwr, 0x1002, 0x1E00, &most)), (1, most.clone()));
    assert_eq!((peek(&mut pair, 1, 0x1E00, 256), peek(&mut pair, 0, 0x1E00, 256)), (most, vec![0; 256]));
    assert_eq!(sent(&mut pair, &raw(RawOperation::Bwr, 0, 0x1F00, &[7])).0, 3);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Apwr, 0, 0x1F00, &[8])).0, 1);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Frmw, 0x1001, 0x1F00, &[0])), (3, vec![8]));
    assert_eq!([0, 1, 2].map(|n| peek(&mut pair, n, 0x1F00, 1)), [vec![8], vec![8], vec![8]]);
    // No slave maps that logical address.
    let logical = RawRequest { logical: 0x0700_0000, ..raw(RawOperation::Lrw, 0, 0, &[1, 2]) };
    assert_eq!(sent(&mut pair, &logical), (0, vec![1, 2]));
    pair.silence(1, true);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Brd, 0, registers::TYPE, &[0])).0, 2);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Fprd, 0x1002, registers::TYPE, &[9])), (0, vec![9]));
}

/// XF-11.62 In OP a datagram goes out beside the process data, and an LRD of theirs reads the inputs.
#[test]
fn datagrams_beside_process_data() {
    let mut pair = in_state(EtherCatState::Op);
    let bytes = pair.get(&FifoPackSizeGet { fifo: Fifo::Rx }, usize::from);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Brd, 0, registers::AL_STATUS, &[0; 2])), (3, vec![8, 0]));
    // The statusword of the first drive is behind its outputs.
    let outputs = bytes / 2 - 1;
    let (counter, data) = sent(&mut pair, &raw(RawOperation::Lrd, 0, 0, &vec![0; outputs + 2]));
    let status = pair.object(0, 0x6041, 0);
    assert_eq!((counter, u32::from(u16::from_le_bytes([data[outputs], data[outputs + 1]]))), (1, status));
    assert_eq!(pair.header().wkc_errors, 0);
}

/// XF-11.62 A datagram that does not come back fails, and its answer has the working counter -1; one before the network is
/// initialised and a time limit below 0 are refused, and so is RAW_ECAT_FUNC_GET before a datagram.
#[test]
fn datagrams_that_do_not_come_back() {
    let mut pair = of(vec![drive()]);
    pair.is_refused(&raw(RawOperation::Brd, 0, 0, &[0]));
    pair.is_refused(&RawGet);
    pair.run(&INIT);
    pair.is_refused(&RawRequest { timeout_us: -1, ..raw(RawOperation::Brd, 0, 0, &[0]) });
    pair.is_refused(&RawGet);
    pair.chip().network().handle().cut_after(0);
    for timeout_us in [0, 1000, 20_000] {
        pair.ends_in_failure(&RawRequest { timeout_us, ..raw(RawOperation::Brd, 0, 0, &[5]) });
        assert_eq!(pair.get(&RawGet, |answer| (answer.working_counter, answer.data.to_vec())), (-1, vec![5]));
    }
}

fn eeprom(slave_number: u8, position: u16, operation: EepromOperation) -> EepromRequest {
    EepromRequest { slave: slave(slave_number), position, timeout_us: 100_000, operation }
}

/// XF-11.63 EEPROM_REQ reads 4 words from a position on, EEPROM_GET returns them (XF ZH 1096, XF EN 1168); a written
/// word is in the EEPROM, and the next ECAT_INIT_OP reads it.
#[test]
pub fn eeproms() {
    let mut pair = in_state(EtherCatState::PreOp);
    pair.is_refused(&EepromGet);
    for n in 0..3 {
        let content = pair.controllers().chain().slave(n).controller().eeprom().to_vec();
        for position in [0, VENDOR_WORD, 0x40, content.len() as u16 / 2 - 4] {
            let request = eeprom(n as u8, position, EepromOperation::Read);
            let read = pair.read(&request, &EepromGet, |answer| (answer.error, answer.data.to_vec()));
            assert_eq!(read, Ok((0, content[usize::from(2 * position)..][..8].to_vec())), "{n} {position}");
        }
    }
    // Vendor and product are before the revision.
    for (position, value) in [(VENDOR_WORD + 4, 0x5678), (VENDOR_WORD + 5, 0x1234)] {
        pair.run(&eeprom(1, position, EepromOperation::Write(value)));
        assert_eq!(pair.get(&EepromGet, |answer| (answer.error, answer.data.len())), (0, 0));
    }
    let revision = SlaveInfoGet { slave: slave(1), item: SlaveInfoItem::Revision };
    assert_ne!(pair.get(&revision, |info| info.number()), Some(0x1234_5678), "until it is read");
    pair.run(&INIT);
    assert_eq!(pair.get(&revision, |info| info.number()), Some(0x1234_5678));
}

/// XF-11.63 A slave that does not answer is error code 1, an EEPROM that refuses 3; both fail. Words after the last one
/// are not read, and a slave that was not found is refused.
#[test]
fn eeproms_that_are_not_read() {
    let mut pair = in_state(EtherCatState::Init);
    let read = pair.read(&eeprom(0, 0xFFFE, EepromOperation::Read), &EepromGet, |answer| answer.data.to_vec());
    assert_eq!(read, Ok(vec![0xFF; 4]));
    // An EEPROM that does not acknowledge may be busy for 100 ms.
    pair.ends_in_failure(&EepromRequest { timeout_us: 300_000, ..eeprom(0, 0xFFFE, EepromOperation::Write(1)) });
    assert_eq!(pair.get(&EepromGet, |answer| (answer.error, answer.data.len())), (3, 0));
    pair.is_refused(&eeprom(3, 0, EepromOperation::Read));
    pair.ends_in_failure(&EepromRequest { timeout_us: 0, ..eeprom(0, 0, EepromOperation::Read) });
    assert_eq!(pair.get(&EepromGet, |answer| answer.error), 2);
    pair.silence(0, true);
    pair.ends_in_failure(&eeprom(0, 0, EepromOperation::Read));
    assert_eq!(pair.get(&EepromGet, |answer| (answer.error, answer.data.len())), (1, 0));
}

/// XF-11.64 CONFIG_SM sets a sync manager in the slave at once and on each way to SafeOP, and process data go there (XF ZH
/// 1297).
#[test]
pub fn sync_managers() {
    let mut pair = in_state(EtherCatState::PreOp);
    let set = ConfigSyncManager { slave: slave(2), number: 2, start: 0x1A00, length: 2, control: 0x64, activate: 1 };
    pair.run(&set);
    assert_eq!(peek(&mut pair, 2, sync_manager(2), 5), [0x00, 0x1A, 2, 0, 0x64]);
    pair.run(&Reconfig);
    pair.run(&to_all(EtherCatState::Op));
    assert_eq!(peek(&mut pair, 2, sync_manager(2), 5), [0x00, 0x1A, 2, 0, 0x64]);
    let bytes = pair.get(&FifoPackSizeGet { fifo: Fifo::Rx }, usize::from);
    let mut outputs = vec![0; bytes];
    outputs[bytes - 2..].copy_from_slice(&[0x5A, 0xA5]);
    pair.run(&FifoEnable { on: true });
    pair.process(ProcessRequest::Write { count: 1, outputs: &outputs });
    pair.pass(10 * MS);
    assert_eq!(pair.io_outputs(), 0xA55A);
    assert_eq!(peek(&mut pair, 2, 0x1A00, 2), [0x5A, 0xA5]);
    assert_eq!(pair.header().wkc_errors, 0);
}

/// XF-11.64 A length that does not fit the mapping is laid out and refused by the slave, with AL status 0x1D, until it is right
/// again; a missing sync manager is a failure, and a slave that was not found is refused.
#[test]
fn sync_managers_that_do_not_fit() {
    let mut pair = in_state(EtherCatState::PreOp);
    let right = ConfigSyncManager { slave: slave(2), number: 2, start: 0x1A00, length: 2, control: 0x64, activate: 1 };
    let sizes = |pair: &mut Pair| pair.get(&FifoPackSizeGet { fifo: Fifo::Rx }, usize::from);
    pair.run(&Reconfig);
    let bytes = sizes(&mut pair);
    pair.run(&ConfigSyncManager { length: 6, ..right });
    pair.run(&Reconfig);
    assert_eq!(sizes(&mut pair), bytes + 4);
    pair.ends_in_failure(&to_all(EtherCatState::SafeOp));
    let status = SlaveInfoGet { slave: slave(2), item: SlaveInfoItem::AlStatus };
    assert_eq!(pair.get(&status, |info| info.number()), Some(0x1D));
    pair.run(&right);
    pair.run(&to_all(EtherCatState::PreOp));
    pair.run(&Reconfig);
    assert_eq!(sizes(&mut pair), bytes);
    pair.run(&to_all(EtherCatState::Op));
    pair.ends_in_failure(&ConfigSyncManager { number: 16, ..right });
    pair.is_refused(&ConfigSyncManager { slave: slave(3), ..right });
}

/// XF-11.64 CONFIG_FMMU takes time and sets nothing, since the chip sets FMMUs itself (XF ZH 1314); a slave that was not found is
/// refused.
#[test]
pub fn fmmus() {
    let mut pair = in_state(EtherCatState::Op);
    let before = peek(&mut pair, 0, registers::FMMU, 64);
    pair.run(&ConfigFmmu { slave: slave(0), functions: [2, 1, 3, 0] });
    assert_eq!(peek(&mut pair, 0, registers::FMMU, 64), before);
    pair.is_refused(&ConfigFmmu { slave: slave(3), functions: [0; 4] });
}

/// XF-11.65 DIRECT_ASSIGN gives a slave's process data another length from the next layout on, while it is on (XF EN 1472).
#[test]
pub fn direct_assign() {
    for network in [of as fn(_) -> _, |slaves| Pair::running_with(Profile::NEW, HostConfig::DEFAULT, slaves)] {
        let mut pair: Pair = network(vec![drive(), Box::new(Io::default())]);
        pair.bring_to(EtherCatState::PreOp);
        let sizes = |pair: &mut Pair| {
            pair.run(&Reconfig);
            [Fifo::Rx, Fifo::Tx].map(|fifo| pair.get(&FifoPackSizeGet { fifo }, usize::from))
        };
        let [rx, tx] = sizes(&mut pair);
        let assign = |direction, bytes| DirectAssign::Length { slave: slave(0), direction, bytes };
        pair.run(&assign(Direction::Input, 20));
        assert_eq!(sizes(&mut pair), [rx, tx], "it is off");
        pair.run(&DirectAssign::Switch { slave: slave(0), on: true });
        assert_eq!(sizes(&mut pair), [rx, tx - 10 + 20]);
        pair.run(&assign(Direction::Output, 0));
        assert_eq!(sizes(&mut pair), [rx - 6, tx - 10 + 20]);
        // The slave maps other lengths, and refuses.
        pair.ends_in_failure(&to_all(EtherCatState::SafeOp));
        pair.run(&DirectAssign::Switch { slave: slave(0), on: false });
        pair.run(&to_all(EtherCatState::PreOp));
        assert_eq!(sizes(&mut pair), [rx, tx]);
        pair.run(&to_all(EtherCatState::Op));
        pair.is_refused(&assign(Direction::Input, 1409));
        pair.is_refused(&DirectAssign::Switch { slave: slave(2), on: true });
    }
}

const ALARM: Fault = Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x3210, resettable: true } };

fn polled(pair: &mut Pair, polling: MailboxStatus) -> Vec<bool> {
    pair.get(&polling, |bits| (0..3).map(|n| bits.contains(slave(n))).collect())
}

/// XF-11.66 An emergency stays in a mailbox that is polled (MBX_STAT, XF EN 1663), from RECONFIG_OP on; its flag is
/// valid in OP, and RECV_MAILBOX fetches it and returns it in parts (XF EN 1646).
#[test]
pub fn mailboxes() {
    let mut pair = in_state(EtherCatState::PreOp);
    assert_eq!(polled(&mut pair, MailboxStatus::ReadPolling), [false; 3]);
    pair.run(&MailboxStatus::SetPolling(SlaveBits::for_slaves(3).with(slave(1)).with(slave(100))));
    assert_eq!(polled(&mut pair, MailboxStatus::ReadPolling), [false, true, false]);
    pair.run(&Reconfig);
    pair.run(&to_all(EtherCatState::Op));
    pair.is_refused(&ReceiveMailbox::Read(MailboxPart::new(0, 1).expect("below 64")));
    assert_eq!(polled(&mut pair, MailboxStatus::ReadFlags), [false; 3]);
    for n in [0, 1] {
        assert!(pair.device(n).apply_fault(ALARM));
    }
    pair.pass(100 * MS);
    assert_eq!(polled(&mut pair, MailboxStatus::ReadFlags), [false, true, false]);
    let listed = |pair: &mut Pair| {
        let call = CoeEmergency { count: EmergencyCount::new(8).expect("8") };
        pair.get(&call, |list| list.iter().map(|one| (one.slave, one.code)).collect::<Vec<_>>())
    };
    assert_eq!(listed(&mut pair), [(0, 0x3210)]);
    pair.run(&ReceiveMailbox::Request { slave: slave(1) });
    let part = |start, len| ReceiveMailbox::Read(MailboxPart::new(start, len).expect("below 64"));
    let mail = pair.get(&part(0, 16), <[u8]>::to_vec);
    let message = MailboxMessage::decode(&mail).expect("a message");
    assert_eq!((message.header.protocol, message.data.len()), (MailboxProtocol::Coe, 10));
    // CoE service 1 is an emergency; its error code follows.
    assert_eq!((message.data[1] >> 4, &message.data[2..4]), (1, &[0x10, 0x32][..]));
    let behind = pair.get(&part(8, 4), <[u8]>::to_vec);
    assert_eq!(behind, mail[8..12]);
    assert_eq!(listed(&mut pair), [(1, 0x3210), (0, 0x3210)], "the newest first");
    assert_eq!(polled(&mut pair, MailboxStatus::ReadFlags), [false; 3]);
    // The mailbox is empty now; the fetched message stays.
    pair.ends_in_failure(&ReceiveMailbox::Request { slave: slave(1) });
    assert_eq!(pair.get(&part(0, 16), <[u8]>::to_vec), mail);
    let MailboxHeader { protocol, .. } = message.header;
    assert_eq!(protocol, MailboxProtocol::Coe);
    pair.is_refused(&ReceiveMailbox::Request { slave: slave(3) });
}

/// XF-11.66 A slave's answer to a request that the host has written by a datagram waits for the host, which fetches it
/// by RECV_MAILBOX; a second later the chip uses the mailbox again.
#[test]
fn the_answer_to_a_datagram_is_the_hosts() {
    let mut pair = in_state(EtherCatState::PreOp);
    // The upload of 0x1000, with the counter 0.
    let mut request = [0; 128];
    request[..16].copy_from_slice(&[10, 0, 0, 0, 0, 3, 0, 0x20, 0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
    assert_eq!(sent(&mut pair, &raw(RawOperation::Fpwr, 0x1002, 0x1000, &request)).0, 1);
    pair.pass(500 * MS);
    pair.run(&ReceiveMailbox::Request { slave: slave(1) });
    let mail = pair.get(&ReceiveMailbox::Read(MailboxPart::new(0, 16).expect("below 64")), <[u8]>::to_vec);
    assert_eq!(mail[8..12], [0x43, 0x00, 0x10, 0], "{mail:?}");
    assert_eq!(sent(&mut pair, &raw(RawOperation::Fpwr, 0x1002, 0x1000, &request)).0, 1);
    pair.pass(1_100 * MS);
    pair.ends_in_failure(&ReceiveMailbox::Request { slave: slave(1) });
}

/// XF-11.66 Without a network there is no mail and no polling, and parts beyond the end of a mailbox are refused.
#[test]
fn mailboxes_that_there_are_not() {
    let mut pair = of(vec![drive()]);
    pair.is_refused(&MailboxStatus::ReadFlags);
    pair.is_refused(&MailboxStatus::SetPolling(SlaveBits::for_slaves(1)));
    pair.is_refused(&MailboxStatus::ReadPolling);
    pair.run(&INIT);
    pair.ends_in_failure(&ReceiveMailbox::Request { slave: slave(0) });
    pair.is_refused(&ReceiveMailbox::Read(MailboxPart::new(0, 1).expect("below 64")));
}

/// XF-11.67 Emergencies of slaves are listed, the newest first, with running numbers since the start (XF EN 1490).
#[test]
pub fn emergencies() {
    let mut pair = in_state(EtherCatState::Op);
    for (n, code) in [(0, 0x3210), (1, 0x4310), (0, 0x7305)] {
        let fault = DeviceFault { code, resettable: true };
        assert!(pair.device(n).apply_fault(Fault::Alarm { axis: 0, fault }));
        pair.pass(50 * MS);
    }
    for count in [2, 8] {
        let call = CoeEmergency { count: EmergencyCount::new(count).expect("1 to 8") };
        let list = pair.get(&call, |list| list);
        assert_eq!(list.places().len(), usize::from(count));
        let found: Vec<_> = list.iter().map(|one| (one.number, one.slave, one.running_number, one.code)).collect();
        let all = [(0, 0, 3, 0x7305), (1, 1, 2, 0x4310), (2, 0, 1, 0x3210)];
        assert_eq!(found, all[..usize::from(count).min(3)]);
    }
}

fn file(name: &[u8], bytes: u32, start: FlashAddress) -> FoeFile<'_> {
    FoeFile { slave: slave(0), password: 0, bytes, timeout_us: 100_000, start, name }
}

fn at(place: u32) -> FlashAddress {
    FlashAddress::new(place).expect("below 0x40000")
}

/// XF-11.68 FOE_FUNC_REQ writes a file from the flash memory to a slave and reads it back (XF EN 1598).
#[test]
pub fn files() {
    let mut pair = of(vec![drive(), Box::new(Dp3cl::new(Dp3clConfig::default()))]);
    pair.bring_to(EtherCatState::PreOp);
    let data: Vec<u8> = (0..600_u32).map(|n| (n * 7) as u8).collect();
    for (start, part) in (0..).step_by(256).zip(data.chunks(256)) {
        pair.run(&FoeRequest::WriteFlash { start: at(0x100 + start), data: part });
    }
    pair.run(&FoeRequest::Download(file(b"table.bin", 600, at(0x100))));
    assert_eq!(pair.device(0).files().expect("it has files").read(b"table.bin", false), Ok(&data[..]));
    pair.run(&FoeRequest::Upload(file(b"table.bin", 0, at(0x2000))));
    assert_eq!(pair.chip().flash()[0x2000..][..600], data);
    assert_eq!(pair.chip().flash()[0x2000 + 600], 0xFF, "behind the file nothing is written");
    let request = FoeRequest::ReadFlash { start: at(0x2000), bytes: FlashBytes::new(256).expect("256") };
    assert_eq!(pair.read(&request, &FoeGet, <[u8]>::to_vec), Ok(data[..256].to_vec()));
    assert_eq!(pair.get(&SdoAbortCodeGet, |code| code), AbortCode(0));
}

/// XF-11.68 A missing file, a file that is longer than announced or than the flash memory, and a silent slave fail,
/// with FoE's error code or that of a timeout; a range beyond the flash memory and a file without a name are refused.
#[test]
fn files_that_are_not_moved() {
    let mut pair = of(vec![drive()]);
    pair.bring_to(EtherCatState::PreOp);
    let error = |pair: &mut Pair, request: FoeRequest<'_>| {
        pair.ends_in_failure(&request);
        pair.get(&SdoAbortCodeGet, |code| code.0)
    };
    let firmware = b"firmware".as_slice();
    let length = pair.device(0).files().expect("it has files").read(firmware, false).expect("firmware").len() as u32;
    assert_eq!(error(&mut pair, FoeRequest::Upload(file(b"other", 0, at(0)))), FoeError::NOT_FOUND.0);
    assert_eq!(error(&mut pair, FoeRequest::Upload(file(firmware, length - 1, at(0)))), FoeError::DISK_FULL.0);
    assert_eq!(error(&mut pair, FoeRequest::Upload(file(firmware, 0, at(0x3_FFFF)))), FoeError::DISK_FULL.0);
    assert!(pair.chip().flash().iter().all(|byte| *byte == 0xFF), "nothing is written");
    pair.run(&FoeRequest::Upload(file(firmware, length, at(0x3_FFFF + 1 - length))));
    let last = *pair.chip().flash().last().expect("memory");
    assert_ne!(last, 0xFF);
    pair.is_refused(&FoeRequest::Download(file(b"a", 2, at(0x3_FFFF))));
    pair.is_refused(&FoeRequest::Upload(FoeFile { slave: slave(1), ..file(firmware, 0, at(0)) }));
    pair.is_refused(&FoeRequest::Upload(file(b"", 0, at(0))));
    pair.silence(0, true);
    assert_eq!(error(&mut pair, FoeRequest::Upload(file(firmware, 0, at(0)))), AbortCode::TIMEOUT.0);
    // A successful SDO has no error code.
    pair.silence(0, false);
    pair.run(&sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }));
    assert_eq!(pair.get(&SdoAbortCodeGet, |code| code), AbortCode(0));
}
