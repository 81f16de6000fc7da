//! Mailbox messages, and files in them.

use ecmsk::ethercat::WireError;
use ecmsk::ethercat::foe::{FOE_OVERHEAD, FoeError, FoeMessage};
use ecmsk::ethercat::mailbox::{MailboxCounter, MailboxFault, MailboxHeader, MailboxMessage, MailboxProtocol};
use proptest::prelude::*;

/// ECAT-4.1 The header: length, address, channel and priority, protocol and counter; what follows in the box has no meaning.
#[test]
fn a_message_byte_by_byte() {
    let counter = MailboxCounter::new(5).expect("0 to 7");
    let header =
        MailboxHeader { address: 0x1001, channel: 3, priority: 2, ..MailboxHeader::new(MailboxProtocol::Coe, counter) };
    let message = MailboxMessage { header, data: &[0xAA, 0xBB] };
    let mut mailbox = [0xA5; 12];
    message.encode(&mut mailbox).expect("room");
    assert_eq!(mailbox, [2, 0, 0x01, 0x10, 0x83, 0x53, 0xAA, 0xBB, 0, 0, 0, 0]);
    mailbox[8..].fill(0xEE);
    mailbox[5] |= 0x80;
    assert_eq!(MailboxMessage::decode(&mailbox), Ok(message));
    let room = WireError::NoRoom { part: "mailbox message", needed: 8, room: 7 };
    assert_eq!(message.encode(&mut [0; 7]), Err(room));
    for (code, protocol) in [
        (0, MailboxProtocol::Error),
        (1, MailboxProtocol::Aoe),
        (2, MailboxProtocol::Eoe),
        (4, MailboxProtocol::Foe),
        (5, MailboxProtocol::Soe),
        (15, MailboxProtocol::Voe),
        (9, MailboxProtocol::Unknown(9)),
    ] {
        assert_eq!((MailboxProtocol::from_code(code), protocol.code()), (protocol, code));
    }
}

/// ECAT-4.2 A message that is longer than its box is an error.
#[test]
fn a_message_that_claims_too_much() {
    let short = WireError::Short { part: "mailbox message", needed: 7, found: 6 };
    assert_eq!(MailboxMessage::decode(&[7, 0, 0, 0, 0, 3, 1, 2, 3, 4, 5, 6]), Err(short));
    let short = WireError::Short { part: "mailbox header", needed: 6, found: 5 };
    assert_eq!(MailboxMessage::decode(&[0; 5]), Err(short));
}

/// ECAT-4.3 The counter goes from 1 to 7 and leaves out 0; only one that is not 0 repeats another.
#[test]
fn the_counter_of_messages() {
    let mut counter = MailboxCounter::NONE;
    let values: Vec<u8> = (0..9)
        .map(|_| {
            counter = counter.next();
            counter.get()
        })
        .collect();
    assert_eq!(values, [1, 2, 3, 4, 5, 6, 7, 1, 2]);
    assert_eq!(MailboxCounter::FIRST.get(), 1);
    assert_eq!(MailboxCounter::new(8), None);
    assert!(counter.repeats(counter) && !counter.next().repeats(counter));
    assert!(!MailboxCounter::NONE.repeats(MailboxCounter::NONE));
}

/// ECAT-4.4 A message of type 0 reports an error of another one: the number 1 and a code.
#[test]
fn what_was_wrong_with_a_message() {
    assert_eq!(MailboxFault::UNSUPPORTED_PROTOCOL.encode(), [1, 0, 2, 0]);
    assert_eq!(MailboxFault::decode(&[1, 0, 6, 0, 9]), Ok(MailboxFault::TOO_SHORT));
    let wrong = WireError::Field { part: "type of a mailbox error", found: 2, allowed: "1" };
    assert_eq!(MailboxFault::decode(&[2, 0, 6, 0]), Err(wrong));
    assert!(matches!(MailboxFault::decode(&[1, 0, 6]), Err(WireError::Short { .. })));
    assert_eq!(MailboxFault::INVALID_SIZE.to_string(), "mailbox error 8 (invalid size)");
    assert_eq!(MailboxFault(99).to_string(), "mailbox error 99");
}

/// ECAT-6.1 Messages about files: operation, a reserved byte, a number of 32 bits, a name, data or a text.
#[test]
fn files_byte_by_byte() {
    let table: [(FoeMessage<'_>, &[u8]); 7] = [
        (FoeMessage::Read { password: 0x0403_0201, name: b"fw.efw" }, b"\x01\0\x01\x02\x03\x04fw.efw"),
        (FoeMessage::Write { password: 0, name: b"a" }, b"\x02\0\0\0\0\0a"),
        (FoeMessage::Data { packet: 1, data: &[9, 8] }, &[3, 0, 1, 0, 0, 0, 9, 8]),
        (FoeMessage::Ack { packet: 0x0100 }, &[4, 0, 0, 1, 0, 0]),
        (FoeMessage::Error { code: FoeError::NOT_FOUND, text: b"no" }, b"\x05\0\x01\x80\0\0no"),
        (FoeMessage::Busy { done: 3, entire: 100, text: b"" }, &[6, 0, 3, 0, 100, 0]),
        (FoeMessage::Unknown(7, &[1]), &[7, 0, 1]),
    ];
    for (message, bytes) in table {
        let mut room = [0xA5; 20];
        assert_eq!(message.encode(&mut room), Ok(bytes.len()));
        assert_eq!((&room[..bytes.len()], FoeMessage::decode(bytes)), (bytes, Ok(message)));
        assert!(message.encode(&mut room[..bytes.len() - 1]).is_err());
    }
    assert!(matches!(FoeMessage::decode(&[1, 0, 0, 0, 0]), Err(WireError::Short { .. })));
    assert_eq!(FoeError(0x8008).to_string(), "0x8008 (in bootstrap only)");
    assert_eq!((FoeError(1).to_string(), FOE_OVERHEAD), ("0x0001".to_owned(), 12));
}

proptest! {
    /// ECAT-4.1 The content of a mailbox survives decoding and encoding, whatever it is.
    #[test]
    fn messages_come_back(mut mailbox in proptest::collection::vec(any::<u8>(), 0..60)) {
        if let [len, high, ..] = &mut mailbox[..] {
            (*len, *high) = (*len % 60, 0);
        }
        if let Ok(message) = MailboxMessage::decode(&mailbox) {
            let mut again = vec![0xA5; mailbox.len()];
            message.encode(&mut again).expect("room");
            prop_assert_eq!(MailboxMessage::decode(&again), Ok(message));
        }
    }

    /// ECAT-6.1 Messages about files come back, whatever they are.
    #[test]
    fn files_come_back(data in proptest::collection::vec(any::<u8>(), 0..40)) {
        if let Ok(message) = FoeMessage::decode(&data) {
            let mut again = [0xA5; 60];
            let len = message.encode(&mut again).expect("room");
            prop_assert!(len <= data.len());
            prop_assert_eq!(FoeMessage::decode(&again[..len]), Ok(message));
        }
    }
}
