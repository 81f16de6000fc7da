//! Bootstrap, and files by FoE, in it and outside.

use ecmsk::ethercat::foe::{FoeError, FoeMessage};
use ecmsk::ethercat::mailbox::{MailboxCounter, MailboxFault, MailboxHeader, MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{self, RequestedState, SmControl, SyncManager};
use ecmsk::ethercat::sii::{MailboxArea, MailboxProtocols, Sii};
use ecmsk::ethercat::{AlState, AlStatus, Command};
use ecmsk::slave::esc::EscSettings;
use ecmsk::slave::files::{FILE_BYTES_MAX, FILE_NAME_BYTES_MAX, FILES_MAX};
use ecmsk::slave::{Dp3cl, Dp3clConfig, Io};

use super::rig::{FIRST, MAILBOX, Rig, slave};

const BOOT: u16 = 3;
/// Bytes of a file in a packet of the mailboxes in bootstrap, which have 256 bytes.
const PACKET: usize = 244;

/// A master of single FoE messages, with mailboxes of that length.
struct Files {
    rig: Rig,
    boxes: [MailboxArea; 2],
}

impl Files {
    /// A drive in bootstrap.
    fn in_bootstrap() -> Self {
        let mut files = Self { rig: Rig::drives(1), boxes: [MailboxArea::default(); 2] };
        files.enter();
        files
    }

    /// A drive in PreOP.
    fn in_preop() -> Self {
        Self { rig: Rig::in_preop(), boxes: [0x1000, 0x1080].map(|start| MailboxArea { start, len: MAILBOX }) }
    }

    /// Goes from Init to bootstrap, with the mailboxes of the EEPROM's words 0x14 to 0x17.
    fn enter(&mut self) {
        self.boxes = boot_boxes(&self.rig);
        set_boxes(&mut self.rig, self.boxes);
        assert_eq!(self.rig.request(FIRST, BOOT), (BOOT, AlStatus::NONE));
    }

    /// Sends a message of any protocol; returns the answer's protocol and data, if there is one.
    fn send(&mut self, protocol: MailboxProtocol, data: &[u8]) -> Option<(MailboxProtocol, Vec<u8>)> {
        let [out, back] = self.boxes;
        let mut mailbox = vec![0; out.len.into()];
        let header = MailboxHeader::new(protocol, MailboxCounter::NONE);
        MailboxMessage { header, data }.encode(&mut mailbox).expect("room");
        assert_eq!(self.rig.one(Command::Fpwr, FIRST, out.start, &mailbox).wkc, 1, "the mailbox is empty");
        let answer = self.rig.one(Command::Fprd, FIRST, back.start, &vec![0; back.len.into()]);
        let message = MailboxMessage::decode(&answer.data).expect("a message");
        (answer.wkc == 1).then(|| (message.header.protocol, message.data.to_vec()))
    }

    /// Sends an FoE message; returns the data of the answer.
    fn foe(&mut self, message: &FoeMessage<'_>) -> Option<Vec<u8>> {
        let mut room = [0; 300];
        let len = message.encode(&mut room).expect("room");
        let (protocol, data) = self.send(MailboxProtocol::Foe, &room[..len])?;
        assert_eq!(protocol, MailboxProtocol::Foe);
        Some(data)
    }

    /// The code with which a message is refused.
    #[track_caller]
    fn refused(&mut self, message: &FoeMessage<'_>) -> FoeError {
        let answer = self.foe(message).expect("an answer");
        match FoeMessage::decode(&answer) {
            Ok(FoeMessage::Error { code, text }) => {
                assert_eq!(code.text().unwrap_or_default().as_bytes(), text);
                code
            }
            other => panic!("{other:?}"),
        }
    }

    /// Writes a file; returns the error if it is refused.
    fn write(&mut self, name: &str, bytes: &[u8]) -> Result<(), FoeError> {
        let packet = usize::from(self.boxes[0].len) - 12;
        let mut message = FoeMessage::Write { password: 0, name: name.as_bytes() };
        let mut packets = (1..).zip(bytes.chunks(packet).chain(std::iter::repeat_n(&[][..], 1)));
        for expected in 0.. {
            let answer = self.foe(&message).expect("an answer");
            match FoeMessage::decode(&answer).expect("a message") {
                FoeMessage::Ack { packet } => assert_eq!(packet, expected),
                FoeMessage::Error { code, .. } => return Err(code),
                other => panic!("{other:?}"),
            }
            if matches!(message, FoeMessage::Data { data, .. } if data.len() < packet) {
                break;
            }
            let (packet, data) = packets.next().expect("an empty one ends a file of whole packets");
            message = FoeMessage::Data { packet, data };
        }
        Ok(())
    }

    /// Reads a file; returns the error if it is refused.
    fn read(&mut self, name: &str) -> Result<Vec<u8>, FoeError> {
        let room = usize::from(self.boxes[1].len) - 12;
        let mut bytes = Vec::new();
        let mut message = FoeMessage::Read { password: 0, name: name.as_bytes() };
        for expected in 1.. {
            let answer = self.foe(&message).expect("an answer");
            match FoeMessage::decode(&answer).expect("a message") {
                FoeMessage::Data { packet, data } => {
                    assert_eq!(packet, expected);
                    bytes.extend_from_slice(data);
                    message = FoeMessage::Ack { packet };
                    if data.len() < room {
                        assert_eq!(self.foe(&message), None, "the last packet is acknowledged without an answer");
                        break;
                    }
                }
                FoeMessage::Error { code, .. } => return Err(code),
                other => panic!("{other:?}"),
            }
        }
        Ok(bytes)
    }
}

/// The mailboxes in bootstrap by the EEPROM.
fn boot_boxes(rig: &Rig) -> [MailboxArea; 2] {
    let info = Sii::new(rig.chain.slave(0).controller().eeprom()).expect("an EEPROM").info();
    [info.boot_mailbox.receive, info.boot_mailbox.send]
}

fn set_boxes(rig: &mut Rig, boxes: [MailboxArea; 2]) {
    for (n, (area, control)) in (0..).zip(boxes.into_iter().zip([SmControl::MAILBOX_OUT, SmControl::MAILBOX_IN])) {
        rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
        rig.set_manager(FIRST, n, SyncManager::enabled(area.start, area.len, control));
    }
}

fn bytes(len: usize) -> Vec<u8> {
    (0..len).map(|n| (n * 11 + 5) as u8).collect()
}

/// ECAT-11.11 Bootstrap is entered from Init with the mailboxes of words 0x14 to 0x17 alone, and left to Init alone;
/// the device is in Init meanwhile.
#[test]
fn bootstrap_is_entered_from_init() {
    let mut rig = Rig::drives(1);
    let boxes = boot_boxes(&rig);
    let [out, back] = boxes;
    assert_eq!([(out.start, out.len), (back.start, back.len)], [(0x1000, 256), (0x1100, 256)]);
    assert_eq!(rig.request(FIRST, BOOT), (0x11, AlStatus::INVALID_BOOT_MAILBOX), "without a mailbox");
    for wrong in [
        [MailboxArea { len: 255, ..out }, back],
        [out, MailboxArea { start: 0x1102, ..back }],
        [back, out],
        [MailboxArea { start: 0x1000, len: 128 }, MailboxArea { start: 0x1080, len: 128 }],
    ] {
        set_boxes(&mut rig, wrong);
        assert_eq!(rig.request(FIRST, 0x10 | BOOT), (0x11, AlStatus::INVALID_BOOT_MAILBOX), "{wrong:?}");
    }
    set_boxes(&mut rig, boxes);
    assert_eq!(rig.request(FIRST, 0x10 | BOOT), (BOOT, AlStatus::NONE));
    assert_eq!(rig.chain.slave(0).shown_state(), RequestedState::Boot);
    assert_eq!((rig.chain.slave(0).state(), rig.chain.slave(0).device().state()), (AlState::Init, AlState::Init));
    assert_eq!(rig.request(FIRST, BOOT), (BOOT, AlStatus::NONE), "the same state");
    for (control, code) in [
        (2, AlStatus::INVALID_CHANGE),
        (4, AlStatus::INVALID_CHANGE),
        (8, AlStatus::INVALID_CHANGE),
        (7, AlStatus::UNKNOWN_STATE),
    ] {
        assert_eq!(rig.request(FIRST, 0x10 | control), (0x10 | BOOT, code));
        assert_eq!(rig.request(FIRST, 2), (0x10 | BOOT, code), "it has to be acknowledged");
    }
    assert_eq!(rig.request(FIRST, 0x10 | BOOT), (BOOT, AlStatus::NONE));
    assert_eq!(rig.request(FIRST, 1), (1, AlStatus::NONE));
    // A changed mailbox: back to Init.
    assert_eq!(rig.request(FIRST, BOOT), (BOOT, AlStatus::NONE));
    rig.write(FIRST, registers::sync_manager_activate(1), &[0]);
    assert_eq!(rig.al_status(FIRST), (0x11, AlStatus::INVALID_BOOT_MAILBOX));
    // From PreOP it is not reached.
    assert_eq!(rig.request(FIRST, 0x11), (1, AlStatus::NONE));
    for n in 0..2 {
        rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
    }
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.request(FIRST, BOOT), (0x12, AlStatus::INVALID_CHANGE));
}

/// ECAT-11.11 A device without files has no bootstrap, and its EEPROM neither FoE nor mailboxes for it.
/// DP3CL-5.4 That of a DP3CL is refused.
#[test]
fn a_device_without_files_has_no_bootstrap() {
    for device in 0..2 {
        let mut rig = match device {
            0 => Rig::new([slave(Box::new(Io::default()), EscSettings::default())]),
            _ => Rig::new([slave(Box::new(Dp3cl::new(Dp3clConfig::default())), EscSettings::default())]),
        };
        rig.give_stations();
        assert_eq!(boot_boxes(&rig), [MailboxArea::default(); 2]);
        set_boxes(&mut rig, boot_boxes(&Rig::drives(1)));
        assert_eq!(rig.request(FIRST, BOOT), (0x11, AlStatus::BOOT_UNSUPPORTED));
        assert_eq!(rig.request(FIRST, 0x11).0, 1);
        for n in 0..2 {
            rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
        }
        rig.bring_to_preop(FIRST);
        let mut files = Files { rig, boxes: [0x1000, 0x1080].map(|start| MailboxArea { start, len: MAILBOX }) };
        let (protocol, data) = files.send(MailboxProtocol::Foe, &[1, 0, 0, 0, 0, 0, b'a']).expect("an answer");
        assert_eq!(protocol, MailboxProtocol::Error);
        assert_eq!(MailboxFault::decode(&data), Ok(MailboxFault::UNSUPPORTED_PROTOCOL));
    }
    let rig = Rig::drives(1);
    let info = Sii::new(rig.chain.slave(0).controller().eeprom()).expect("an EEPROM").info();
    assert!(info.protocols.contains(MailboxProtocols::FOE));
}

/// ECAT-12.8 Firmware of any length is written and read in bootstrap: a packet that is not full ends it, an empty one if need be.
#[test]
fn firmware_is_written_in_bootstrap() {
    let mut files = Files::in_bootstrap();
    assert!(!files.read("firmware").expect("that of the factory").is_empty());
    for len in [0, 1, PACKET - 1, PACKET, PACKET + 1, 3 * PACKET, 10_000] {
        assert_eq!(files.write("firmware.bin", &bytes(len)), Ok(()), "{len}");
        assert_eq!(files.read("firmware.bin"), Ok(bytes(len)), "{len}");
    }
    // It is kept without power, and read in PreOP, too.
    files.rig.power_cycle(0);
    files.rig.give_stations();
    files.rig.bring_to_preop(FIRST);
    files.boxes = [0x1000, 0x1080].map(|start| MailboxArea { start, len: MAILBOX });
    assert_eq!(files.read("firmware"), Ok(bytes(10_000)));
}

/// ECAT-12.8 In bootstrap there is no CANopen, and a message that is no FoE is answered by a fault of the mailbox.
#[test]
fn bootstrap_has_files_alone() {
    let mut files = Files::in_bootstrap();
    for (protocol, data, fault) in [
        (MailboxProtocol::Coe, &[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0][..], MailboxFault::UNSUPPORTED_PROTOCOL),
        (MailboxProtocol::Foe, &[1, 0, 0, 0][..], MailboxFault::TOO_SHORT),
    ] {
        let (answered, data) = files.send(protocol, data).expect("an answer");
        assert_eq!((answered, MailboxFault::decode(&data)), (MailboxProtocol::Error, Ok(fault)));
    }
    // Nothing of bootstrap is left in PreOP.
    files.rig.reach(FIRST, AlState::Init);
    for n in 0..2 {
        files.rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
    }
    files.rig.bring_to_preop(FIRST);
    assert_eq!(files.rig.coe(FIRST, &[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0])[2], 0x43);
}

/// ECAT-12.9 A forbidden message is answered with the right code, and ends a transfer.
#[test]
fn what_is_wrong_with_files_has_its_code() {
    let data = |packet, data| FoeMessage::Data { packet, data };
    let write = |name| FoeMessage::Write { password: 0, name };
    let mut files = Files::in_preop();
    assert_eq!(files.read("parameters"), Err(FoeError::NOT_FOUND));
    assert_eq!(files.write("firmware", b"new"), Err(FoeError::BOOTSTRAP_ONLY));
    for wrong in [&[][..], &[b'a'; FILE_NAME_BYTES_MAX + 1]] {
        assert_eq!(files.refused(&write(wrong)), FoeError::ILLEGAL);
    }
    assert_eq!(files.refused(&data(1, b"x")), FoeError::ILLEGAL, "nobody has announced a file");
    assert_eq!(files.refused(&FoeMessage::Ack { packet: 1 }), FoeError::ILLEGAL);
    assert_eq!(files.refused(&FoeMessage::Unknown(9, &[0; 4])), FoeError::ILLEGAL);
    assert_eq!(files.refused(&FoeMessage::Busy { done: 1, entire: 2, text: &[] }), FoeError::ILLEGAL);
    // A wrong number of a packet.
    assert_eq!(files.write("parameters", b"old"), Ok(()));
    assert!(files.foe(&write(b"parameters")).is_some());
    assert_eq!(files.refused(&data(2, b"new")), FoeError::PACKET_NUMBER);
    assert_eq!(files.refused(&data(1, b"new")), FoeError::ILLEGAL, "the transfer is over");
    assert!(files.foe(&FoeMessage::Read { password: 0, name: b"parameters" }).is_some());
    assert_eq!(files.refused(&FoeMessage::Ack { packet: 7 }), FoeError::PACKET_NUMBER);
    // The master's own error ends it without an answer.
    assert!(files.foe(&write(b"parameters")).is_some());
    assert_eq!(files.foe(&FoeMessage::Error { code: FoeError::UNDEFINED, text: &[] }), None);
    assert_eq!(files.refused(&data(1, b"new")), FoeError::ILLEGAL);
    assert_eq!(files.read("parameters"), Ok(b"old".to_vec()));
    // As many files as there may be, and one that is too long.
    for n in 2..FILES_MAX {
        assert_eq!(files.write(&format!("file {n}"), b"x"), Ok(()));
    }
    assert_eq!(files.write("one more", b"x"), Err(FoeError::DISK_FULL));
    assert_eq!(files.write("parameters", &vec![0; FILE_BYTES_MAX + 1]), Err(FoeError::DISK_FULL));
    assert_eq!(files.read("parameters"), Ok(b"old".to_vec()));

    let mut files = Files::in_bootstrap();
    assert_eq!(files.read("parameters"), Err(FoeError::NOT_BOOTSTRAP));
    assert_eq!(files.write("parameters", b"x"), Err(FoeError::NOT_BOOTSTRAP));
}
