//! Files by FoE, with a file server of this test at the mailboxes of a simulated slave.

use std::cell::RefCell;
use std::rc::Rc;

use ecmsk::ethercat::foe::{FoeError, FoeMessage};
use ecmsk::ethercat::mailbox::{MailboxCounter, MailboxHeader, MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{SmStatus, sync_manager_status};
use ecmsk::ethercat::sii::{MailboxProtocols, SII_INFO_LEN, SiiInfo};
use ecmsk::ethercat::{AlState, Command, each_datagram};
use ecmsk::master::{FileError, MailboxError};
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, eeprom_of};
use support::blob::bytes;

use super::rig::{Rig, SECOND, device};

/// The mailboxes of the simulated slave.
const REQUESTS: u16 = 0x1000;
const ANSWERS: u16 = 0x1080;
const PACKET: usize = 128 - 12;

/// A slave with one file.
#[derive(Default)]
struct Server {
    file: Vec<u8>,
    /// The next packet of the file that is read or written.
    packet: u32,
    is_busy: bool,
    counter: MailboxCounter,
    answer: Option<Vec<u8>>,
}

impl Server {
    fn put(&mut self, message: FoeMessage<'_>) {
        let mut data = [0; 122];
        let len = message.encode(&mut data).expect("room");
        let mut mailbox = vec![0; 128];
        self.counter = self.counter.next();
        let header = MailboxHeader::new(MailboxProtocol::Foe, self.counter);
        MailboxMessage { header, data: &data[..len] }.encode(&mut mailbox).expect("room");
        self.answer = Some(mailbox);
    }

    fn send_packet(&mut self) {
        let from = (self.packet as usize - 1) * PACKET;
        if from <= self.file.len() {
            let data = self.file[from..].iter().copied().take(PACKET).collect::<Vec<u8>>();
            self.put(FoeMessage::Data { packet: self.packet, data: &data });
        }
    }

    fn take(&mut self, message: &FoeMessage<'_>) {
        match *message {
            FoeMessage::Read { name: b"file", password: 7 } => {
                self.packet = 1;
                self.send_packet();
            }
            FoeMessage::Read { .. } => self.put(FoeMessage::Error { code: FoeError::NOT_FOUND, text: b"no" }),
            FoeMessage::Write { .. } => {
                (self.packet, self.file) = (1, Vec::new());
                self.put(FoeMessage::Ack { packet: 0 });
            }
            FoeMessage::Data { .. }
                if !std::mem::replace(&mut self.is_busy, false) && self.packet.is_multiple_of(2) =>
            {
                self.is_busy = true;
                self.put(FoeMessage::Busy { done: 1, entire: 2, text: b"" });
            }
            FoeMessage::Data { packet, data } => {
                assert_eq!(packet, self.packet);
                self.file.extend_from_slice(data);
                self.packet += 1;
                self.put(FoeMessage::Ack { packet });
            }
            FoeMessage::Ack { packet } => {
                self.packet = packet + 1;
                self.send_packet();
            }
            _ => {}
        }
    }

    /// Processes a frame that has passed the simulated slave.
    fn pass(&mut self, frame: &mut [u8]) {
        let passed = each_datagram(frame, |mut datagram| {
            let header = datagram.header();
            match (header.command, header.ado()) {
                (Command::Fpwr, REQUESTS) => {
                    let message = MailboxMessage::decode(datagram.data).expect("a message");
                    assert_eq!(message.header.protocol, MailboxProtocol::Foe);
                    self.take(&FoeMessage::decode(message.data).expect("a message"));
                }
                (Command::Fprd, ado) if ado == sync_manager_status(1) => {
                    datagram.data[0] = if self.answer.is_some() { SmStatus::FULL.0 } else { 0 };
                }
                (Command::Fprd, ANSWERS) => {
                    let answer = self.answer.take().expect("it is full");
                    datagram.data.copy_from_slice(&answer);
                    let missing = 1 - datagram.working_counter();
                    datagram.count(missing);
                }
                _ => {}
            }
        });
        assert!(passed.is_ok());
    }
}

/// A slave with a file, in PreOP.
fn rig(file: Vec<u8>) -> (Rig, Rc<RefCell<Server>>) {
    let (mut device, settings) = (device("io"), EscSettings::default());
    let mut eeprom = eeprom_of(&mut *device, &settings).expect("it can be described");
    let fixed = eeprom.first_chunk_mut::<SII_INFO_LEN>().expect("an EEPROM");
    *fixed = SiiInfo { protocols: MailboxProtocols::FOE, ..SiiInfo::decode(fixed) }.encode();
    let mut rig = Rig::of(Chain::line([EscSlave::new(device, settings, eeprom, 0)]));
    rig.scan();
    rig.reach(AlState::PreOp);
    let server = Rc::new(RefCell::new(Server { file, ..Server::default() }));
    let shared = Rc::clone(&server);
    rig.net.hostile = Some(Box::new(move |frame| shared.borrow_mut().pass(frame)));
    (rig, server)
}

/// MASTER-5.9 A file of any length is read, in packets of which the last one is shorter; a slave's error ends it.
#[test]
fn files_are_read() {
    for len in [0, 1, PACKET - 1, PACKET, PACKET + 1, 5 * PACKET, 5000] {
        let (mut rig, _) = rig(bytes(len));
        let id = rig.master.read_file(1, b"file", 7, SECOND);
        assert_eq!(rig.wait(id), Ok(bytes(len)), "{len}");
    }
    let (mut rig, _) = rig(Vec::new());
    let id = rig.master.read_file(1, b"other", 7, SECOND);
    assert_eq!(rig.wait(id), Err(FileError::File(FoeError::NOT_FOUND)));
    let id = rig.master.read_file(1, &[b'x'; 200], 7, SECOND);
    assert_eq!(rig.wait(id), Err(MailboxError::TooLong.into()));
}

/// MASTER-5.9 A file of any length is written, and a packet for which the slave is too busy is sent again.
#[test]
fn files_are_written() {
    for len in [0, 1, PACKET - 1, PACKET, PACKET + 1, 5 * PACKET, 5000] {
        let (mut rig, server) = rig(Vec::new());
        let id = rig.master.write_file(1, b"file", 7, &bytes(len), SECOND);
        assert_eq!(rig.wait(id), Ok(()), "{len}");
        assert_eq!(server.borrow().file, bytes(len));
    }
}
