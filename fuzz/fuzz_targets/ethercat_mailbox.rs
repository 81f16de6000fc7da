//! Any bytes as a mailbox: what is decoded of it is the same once it was encoded and decoded again.

#![no_main]

use ecmsk::coe::{
    CoeMessage, EntryDescription, EntryRequest, InformationFragment, InformationKind, ObjectDescription, decode_abort,
    decode_u16,
};
use ecmsk::ethercat::foe::FoeMessage;
use ecmsk::ethercat::mailbox::{MailboxFault, MailboxMessage, MailboxProtocol};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(message) = MailboxMessage::decode(bytes) else { return };
    let mut mailbox = vec![0xA5; bytes.len()];
    message.encode(&mut mailbox).expect("it was in a box of that size");
    assert_eq!(MailboxMessage::decode(&mailbox), Ok(message));
    match message.header.protocol {
        MailboxProtocol::Error => {
            if let Ok(fault) = MailboxFault::decode(message.data) {
                assert_eq!(fault.encode(), message.data[..4]);
            }
        }
        MailboxProtocol::Coe => coe(message.data),
        MailboxProtocol::Foe => {
            if let Ok(file) = FoeMessage::decode(message.data) {
                let mut room = vec![0xA5; message.data.len()];
                let len = file.encode(&mut room).expect("it is not longer");
                assert_eq!(FoeMessage::decode(&room[..len]), Ok(file));
            }
        }
        _ => {}
    }
});

fn coe(data: &[u8]) {
    let Ok(message) = CoeMessage::decode(data) else { return };
    // A request that is shorter than an SDO is written in full.
    let mut room = vec![0xA5; data.len() + 8];
    let len = message.encode(&mut room).expect("room");
    assert_eq!(CoeMessage::decode(&room[..len]), Ok(message));
    if let CoeMessage::Information(fragment) = message {
        information(&fragment);
    }
}

fn information(fragment: &InformationFragment<'_>) {
    let data = fragment.data;
    let mut room = vec![0xA5; data.len()];
    match fragment.kind {
        InformationKind::ObjectResponse => {
            if let Ok(object) = ObjectDescription::decode(data) {
                assert_eq!((object.encode(&mut room), &room[..]), (Ok(data.len()), data));
            }
        }
        InformationKind::EntryResponse => {
            if let Ok(entry) = EntryDescription::decode(data) {
                assert_eq!((entry.encode(&mut room), &room[..]), (Ok(data.len()), data));
            }
        }
        InformationKind::EntryRequest => {
            if let Ok(entry) = EntryRequest::decode(data) {
                assert_eq!(entry.encode(), data[..4]);
            }
        }
        InformationKind::Error => assert_eq!(decode_abort(data).is_ok(), data.len() >= 4),
        _ => assert_eq!(decode_u16(data).is_ok(), data.len() >= 2),
    }
}
