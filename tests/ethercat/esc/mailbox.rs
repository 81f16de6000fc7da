//! The mailbox of a slave: SDO, SDO information, emergencies.

use ecmsk::coe::{
    AbortCode, CoeMessage, Emergency, EntryDescription, InformationFragment, InformationKind, ObjectAccess,
    ObjectAddress, ObjectCode, ObjectDescription, SdoRequest, SdoResponse, SdoScope, SdoValuePart,
};
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::mailbox::{MailboxCounter, MailboxFault, MailboxHeader, MailboxMessage, MailboxProtocol};
use ecmsk::slave::esc::{EscSettings, VALUE_BYTES_MAX};
use ecmsk::slave::{DeviceFault, Fault};

use support::blob::{BLOB, Blob, bytes};

use super::rig::{FIRST, MS, Rig, drive};

/// A blob in PreOP, with the EEPROM of a drive.
fn blob(value: Vec<u8>) -> Rig {
    let mut rig = Rig::with_stations([Blob { value, ..Blob::default() }.slave()]);
    rig.bring_to_preop(FIRST);
    rig
}

/// Reads the blob as a master does, in segments if need be; returns the value and the commands of the answers.
fn upload(rig: &mut Rig) -> (Vec<u8>, Vec<u8>) {
    let answer = rig.sdo(FIRST, SdoRequest::Upload { object: BLOB, scope: SdoScope::Entry });
    let mut commands = vec![answer[2]];
    let Ok(CoeMessage::SdoResponse(SdoResponse::Upload { value, .. })) = CoeMessage::decode(&answer) else {
        panic!("{answer:X?}")
    };
    let (size, mut read) = match value {
        SdoValuePart::Expedited(data) => (data.len(), data.to_vec()),
        SdoValuePart::First { size, data } => (size as usize, data.to_vec()),
        SdoValuePart::Unsized(_) => panic!("a length is said"),
    };
    let mut toggle = false;
    while read.len() < size {
        let answer = rig.sdo(FIRST, SdoRequest::UploadSegment { toggle });
        commands.push(answer[2]);
        let Ok(CoeMessage::SdoResponse(SdoResponse::UploadSegment { toggle: same, last, data })) =
            CoeMessage::decode(&answer)
        else {
            panic!("{answer:X?}")
        };
        read.extend_from_slice(data);
        assert_eq!((same, last), (toggle, read.len() == size));
        toggle = !toggle;
    }
    (read, commands)
}

/// Writes the blob as a master does; returns the commands of the answers.
fn download(rig: &mut Rig, value: &[u8]) -> Vec<u8> {
    let first = value.len().min(128 - 16);
    let part = SdoValuePart::First { size: value.len() as u32, data: &value[..first] };
    let request = SdoRequest::Download { object: BLOB, scope: SdoScope::Entry, value: part };
    let mut commands = vec![rig.sdo(FIRST, request)[2]];
    let (mut rest, mut toggle) = (&value[first..], false);
    while !rest.is_empty() {
        let (data, behind) = rest.split_at(rest.len().min(128 - 9));
        let request = SdoRequest::DownloadSegment { toggle, last: behind.is_empty(), data };
        commands.push(rig.sdo(FIRST, request)[2]);
        (rest, toggle) = (behind, !toggle);
    }
    commands
}

fn aborted(answer: &[u8]) -> AbortCode {
    assert_eq!(answer[1], 0x20, "an abort is service 2");
    match CoeMessage::decode(answer) {
        Ok(CoeMessage::SdoRequest(SdoRequest::Abort { code, .. })) => code,
        other => panic!("{other:?}"),
    }
}

/// ECAT-12.1 Values of 1 to 4 bytes are answered by 4F, 4B, 47 and 43, a write by 60.
#[test]
fn s31_short_values() {
    for (len, command) in [(1, 0x4F), (2, 0x4B), (3, 0x47), (4, 0x43)] {
        let mut rig = blob(bytes(len));
        assert_eq!(upload(&mut rig), (bytes(len), vec![command]));
        let value = SdoValuePart::Expedited(&[9, 8, 7, 6][..len]);
        let answer = rig.sdo(FIRST, SdoRequest::Download { object: BLOB, scope: SdoScope::Entry, value });
        assert_eq!(answer[1..4], [0x30, 0x60, 0x00]);
        assert_eq!(upload(&mut rig).0, [9, 8, 7, 6][..len]);
        // Without a length the object's own number of bytes counts.
        let value = SdoValuePart::Unsized(&[1, 2, 3, 4]);
        let answer = rig.sdo(FIRST, SdoRequest::Download { object: BLOB, scope: SdoScope::Entry, value });
        assert_eq!((answer[2], upload(&mut rig).0), (0x60, vec![1, 2, 3, 4][..len].to_vec()));
    }
    assert_eq!(upload(&mut blob(Vec::new())), (Vec::new(), vec![0x41]));
}

/// ECAT-12.1 Aborts have the right code, as service 2.
#[test]
fn s31_aborts_have_their_codes() {
    let mut rig = Rig::in_preop();
    for (index, sub, code) in [(0x2FFF, 0, AbortCode::NO_OBJECT), (0x1018, 9, AbortCode::NO_SUB_INDEX)] {
        let object = ObjectAddress::new(index, sub);
        let answer = rig.sdo(FIRST, SdoRequest::Upload { object, scope: SdoScope::Entry });
        assert_eq!(aborted(&answer), code);
    }
    let long = AbortCode::TOO_LONG;
    for (index, data, code) in [
        (0x6041, &[0, 0][..], AbortCode::READ_ONLY),
        (0x6040, &[0], AbortCode::TOO_SHORT),
        (0x6040, &[0, 0, 0], long),
        (0x6060, &[99], AbortCode::VALUE_RANGE),
    ] {
        let value = SdoValuePart::Expedited(data);
        let request = SdoRequest::Download { object: ObjectAddress::new(index, 0), scope: SdoScope::Entry, value };
        let answer = rig.sdo(FIRST, request);
        assert_eq!((aborted(&answer), &answer[3..6]), (code, &[index as u8, (index >> 8) as u8, 0][..]));
    }
    assert_eq!(aborted(&rig.coe(FIRST, &[0, 0x20, 0xE0, 0, 0, 0, 0, 0, 0, 0])), AbortCode::COMMAND);
}

/// ECAT-12.2 Longer values take segments with alternating toggle bits, both ways, whatever their length.
#[test]
fn s32_long_values_in_segments() {
    let mut rig = blob(bytes(140));
    assert_eq!(upload(&mut rig), (bytes(140), vec![0x41, 0x01]));
    assert_eq!(download(&mut rig, &bytes(200)), [0x60, 0x20]);
    assert_eq!(upload(&mut rig).0, bytes(200));
    assert_eq!(download(&mut rig, &bytes(400)), [0x60, 0x20, 0x30, 0x20]);
    assert_eq!(upload(&mut rig), (bytes(400), vec![0x41, 0x00, 0x10, 0x01]));
    for len in [5, 111, 112, 113, 119, 231, 232, 350, 1000, 5000] {
        download(&mut rig, &bytes(len));
        assert_eq!(upload(&mut rig).0, bytes(len), "{len}");
    }
}

/// ECAT-12.2 A wrong toggle bit, a wrong length, and an abort end a transfer without a write.
#[test]
fn s32_a_transfer_that_goes_wrong_is_over() {
    let mut rig = blob(bytes(400));
    let upload = SdoRequest::Upload { object: BLOB, scope: SdoScope::Entry };
    let segment = |toggle| SdoRequest::UploadSegment { toggle };
    rig.sdo(FIRST, upload);
    assert_eq!(aborted(&rig.sdo(FIRST, segment(true))), AbortCode::TOGGLE_BIT);
    assert_eq!(aborted(&rig.sdo(FIRST, segment(false))), AbortCode::COMMAND, "there is no transfer");

    let part = |size, data| SdoValuePart::First { size, data };
    let begin = |value| SdoRequest::Download { object: BLOB, scope: SdoScope::Entry, value };
    let next = |toggle, last, data| SdoRequest::DownloadSegment { toggle, last, data };
    for (request, code) in [
        (next(true, true, &[1; 10]), AbortCode::TOGGLE_BIT),
        (next(false, true, &[1; 9]), AbortCode::TOO_SHORT),
        (next(false, false, &[1; 11]), AbortCode::TOO_LONG),
        (segment(false), AbortCode::COMMAND),
    ] {
        assert_eq!(rig.sdo(FIRST, begin(part(20, &[0; 10])))[2], 0x60);
        assert_eq!(aborted(&rig.sdo(FIRST, request)), code);
        assert_eq!(aborted(&rig.sdo(FIRST, next(false, true, &[1; 10]))), AbortCode::COMMAND);
    }
    assert_eq!(aborted(&rig.sdo(FIRST, begin(part(VALUE_BYTES_MAX + 1, &[0; 10])))), AbortCode::OUT_OF_MEMORY);

    // An abort of the master gets no answer.
    rig.sdo(FIRST, upload);
    let mut room = [0; 20];
    let abort = CoeMessage::SdoRequest(SdoRequest::Abort { object: BLOB, code: AbortCode::GENERAL });
    let len = abort.encode(&mut room).expect("room");
    let message = rig.message(MailboxProtocol::Coe, &room[..len]);
    assert_eq!((rig.post(FIRST, &message), rig.collect(FIRST)), (1, None));
    assert_eq!(aborted(&rig.sdo(FIRST, segment(false))), AbortCode::COMMAND);
    assert_eq!(self::upload(&mut rig).0, bytes(400));
}

/// ECAT-12.3 A request with the counter of the last one is not processed again; with 0 every request is.
#[test]
fn s33_a_request_is_worked_on_once() {
    let mut rig = blob(bytes(2));
    let write = [0, 0x20, 0x2B, 0x00, 0x20, 0, 1, 2, 0, 0];
    for (value, answers) in [(5, [true, false, false]), (6, [true, false, false]), (0, [true, true, true])] {
        let counter = MailboxCounter::new(value).expect("0 to 7");
        let message = rig.message_with(MailboxHeader::new(MailboxProtocol::Coe, counter), &write);
        for answered in answers {
            assert_eq!(rig.post(FIRST, &message), 1);
            assert_eq!(rig.collect(FIRST).is_some(), answered, "{value}");
        }
    }
    // Answers have a counter of their own, from 1 to 7.
    let message = rig.message_with(MailboxHeader::new(MailboxProtocol::Coe, MailboxCounter::NONE), &write);
    let counters: Vec<u8> = (0..9)
        .map(|_| {
            rig.post(FIRST, &message);
            let answer = rig.collect(FIRST).expect("an answer");
            MailboxMessage::decode(&answer).expect("a message").header.counter.get()
        })
        .collect();
    assert!(counters.windows(2).all(|pair| pair[1] == pair[0] % 7 + 1), "{counters:?}");
}

/// ECAT-12.7 A request that waits in its mailbox area is processed once the mailbox is enabled, also if the change of
/// state takes its time.
#[test]
fn a_request_waits_for_preop() {
    let mut rig = Rig::with_stations([drive(EscSettings { state_change_ns: 5 * MS, ..EscSettings::default() })]);
    rig.set_mailbox(FIRST);
    let upload = rig.message(MailboxProtocol::Coe, &[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    assert_eq!(rig.post(FIRST, &upload), 1);
    rig.request(FIRST, 2);
    assert_eq!(rig.collect(FIRST), None);
    rig.now += 5 * MS;
    assert!(rig.collect(FIRST).is_some());
}

/// ECAT-12.3 Requests are taken while answers wait: the third one stays in its box until the first answer is read.
#[test]
fn s33_requests_queue_up() {
    let mut rig = blob(bytes(2));
    let upload = [0, 0x20, 0x40, 0, 0x20, 0, 0, 0, 0, 0];
    let messages: Vec<Vec<u8>> = (0..4).map(|_| rig.message(MailboxProtocol::Coe, &upload)).collect();
    assert_eq!([0, 1, 2, 3].map(|n| rig.post(FIRST, &messages[n])), [1, 1, 1, 0]);
    assert!((0..3).all(|_| rig.collect(FIRST).is_some()));
    assert_eq!(rig.collect(FIRST), None);
}

fn fault(answer: Option<Vec<u8>>) -> MailboxFault {
    let answer = answer.expect("an answer");
    let message = MailboxMessage::decode(&answer).expect("a message");
    assert_eq!(message.header.protocol, MailboxProtocol::Error);
    MailboxFault::decode(message.data).expect("a fault")
}

/// ECAT-12.4 A protocol that the slave does not speak, a message that is too long or too short, and a service that it
/// does not have are answered with the error.
#[test]
fn s34_wrong_messages_are_answered() {
    let mut rig = Rig::in_preop();
    for protocol in [MailboxProtocol::Eoe, MailboxProtocol::Soe, MailboxProtocol::Unknown(9)] {
        let message = rig.message(protocol, &[1, 2, 3]);
        rig.post(FIRST, &message);
        assert_eq!(fault(rig.collect(FIRST)), MailboxFault::UNSUPPORTED_PROTOCOL);
    }
    for (data, wrong) in [
        (&[0, 0x20, 0x40, 0, 0][..], MailboxFault::TOO_SHORT),
        (&[0], MailboxFault::TOO_SHORT),
        (&[0, 0x80, 1, 0, 0, 0], MailboxFault::TOO_SHORT),
        (&[0, 0x50, 0, 0, 0, 0, 0, 0, 0, 0], MailboxFault::SERVICE_UNSUPPORTED),
        (&[0, 0x30, 0x60, 0, 0, 0, 0, 0, 0, 0], MailboxFault::SERVICE_UNSUPPORTED),
    ] {
        let message = rig.message(MailboxProtocol::Coe, data);
        rig.post(FIRST, &message);
        assert_eq!(fault(rig.collect(FIRST)), wrong, "{data:X?}");
    }
    let mut message = rig.message(MailboxProtocol::Coe, &[0; 10]);
    message[0] = 123;
    rig.post(FIRST, &message);
    assert_eq!(fault(rig.collect(FIRST)), MailboxFault::INVALID_SIZE);
    let message = rig.message(MailboxProtocol::Error, &MailboxFault::SYNTAX.encode());
    assert_eq!((rig.post(FIRST, &message), rig.collect(FIRST)), (1, None));
}

/// Asks for information and puts the fragments together.
fn ask(rig: &mut Rig, kind: InformationKind, data: &[u8]) -> (InformationKind, Vec<u8>, Vec<u16>) {
    let mut room = [0; 40];
    let question = CoeMessage::Information(InformationFragment::whole(kind, data));
    let len = question.encode(&mut room).expect("room");
    let message = rig.message(MailboxProtocol::Coe, &room[..len]);
    assert_eq!(rig.post(FIRST, &message), 1);
    let (mut whole, mut lefts) = (Vec::new(), Vec::new());
    loop {
        let answer = rig.collect(FIRST).expect("a fragment");
        let data = MailboxMessage::decode(&answer).expect("a message").data;
        let Ok(CoeMessage::Information(fragment)) = CoeMessage::decode(data) else { panic!("{data:X?}") };
        whole.extend_from_slice(fragment.data);
        lefts.push(fragment.left);
        if !fragment.incomplete {
            assert_eq!((fragment.left, rig.collect(FIRST)), (0, None));
            return (fragment.kind, whole, lefts);
        }
    }
}

/// ECAT-12.5 The list of objects comes in fragments that count down; its length can be read beforehand.
#[test]
fn s35_objects_are_listed() {
    let mut rig = Rig::in_preop();
    let words = |data: &[u8]| data.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect::<Vec<u16>>();
    let (kind, lengths, _) = ask(&mut rig, InformationKind::ListRequest, &[0, 0]);
    assert_eq!(kind, InformationKind::ListResponse);
    let lengths = words(&lengths);
    assert_eq!((lengths[0], lengths.len()), (0, 6));
    for list in 1..=5u16 {
        let (_, data, lefts) = ask(&mut rig, InformationKind::ListRequest, &list.to_le_bytes());
        let indices = words(&data);
        assert_eq!((indices[0], indices.len()), (list, usize::from(lengths[usize::from(list)]) + 1));
        assert!(indices[1..].is_sorted() && lefts.iter().rev().copied().eq(0..lefts.len() as u16), "{lefts:?}");
        let has = |index| indices[1..].contains(&index);
        match list {
            1 => assert!([0x1000, 0x1018, 0x1600, 0x1A00, 0x1C00, 0x1C12, 0x1C13, 0x6040, 0x6041].into_iter().all(has)),
            2 => assert!(has(0x6040) && !has(0x6041)),
            3 => assert!(has(0x6041) && !has(0x6040)),
            _ => assert_eq!(indices.len(), 1),
        }
    }
    assert_eq!(ask(&mut rig, InformationKind::ListRequest, &[9, 0]).0, InformationKind::Error);
}

/// ECAT-12.5 Objects and sub-indices are described: names, types, lengths, access.
#[test]
fn s35_objects_are_described() {
    let mut rig = Rig::in_preop();
    for (index, max_sub, code, data_type) in [
        (0x1018u16, 4, ObjectCode::Record, 0x23),
        (0x6040, 0, ObjectCode::Variable, 0x06),
        (0x1600, 2, ObjectCode::Record, 0x21),
        (0x1C00, 4, ObjectCode::Array, 0x05),
        (0x607D, 2, ObjectCode::Array, 0x04),
    ] {
        let (kind, data, _) = ask(&mut rig, InformationKind::ObjectRequest, &index.to_le_bytes());
        let object = ObjectDescription::decode(&data).expect("a description");
        assert_eq!(kind, InformationKind::ObjectResponse);
        let found = (object.index, object.code, object.data_type, !object.name.is_empty());
        assert_eq!(found, (index, code, data_type, true), "0x{index:04X}");
        if index != 0x1600 {
            assert_eq!(object.max_sub, max_sub, "0x{index:04X}");
        }
    }
    let rw = ObjectAccess::READ | ObjectAccess::WRITE;
    for (index, sub, bits, data_type, access, name) in [
        (0x6040u16, 0, 16, 0x06, rw | ObjectAccess::RX_MAPPABLE, "Controlword"),
        (0x6041, 0, 16, 0x06, ObjectAccess::READ | ObjectAccess::TX_MAPPABLE, "Statusword"),
        (0x607D, 1, 32, 0x04, rw | ObjectAccess::RX_MAPPABLE, "Min position limit"),
        (0x1018, 1, 32, 0x07, ObjectAccess::READ, "Vendor ID"),
        (0x60C2, 1, 8, 0x05, ObjectAccess::READ | ObjectAccess::WRITE_PREOP, "Period"),
        (0x1C12, 1, 16, 0x06, ObjectAccess::READ | ObjectAccess::WRITE_PREOP, "PDO"),
    ] {
        let [low, high] = index.to_le_bytes();
        let (kind, data, _) = ask(&mut rig, InformationKind::EntryRequest, &[low, high, sub, 7]);
        assert_eq!(kind, InformationKind::EntryResponse, "0x{index:04X}");
        let entry = EntryDescription::decode(&data).expect("a description");
        let found = (entry.object, entry.bits, entry.data_type, entry.access, entry.data, entry.info.0);
        assert_eq!(found, (ObjectAddress::new(index, sub), bits, data_type, access, name.as_bytes(), 7));
    }
    assert_eq!(rw.0, 0x3F);
    // Default, least and greatest value, in front of the name.
    let (_, data, _) = ask(&mut rig, InformationKind::EntryRequest, &[0x7D, 0x60, 2, 0x7F]);
    let entry = EntryDescription::decode(&data).expect("a description");
    assert_eq!((entry.info.0, entry.bits, &entry.data[12..]), (0x77, 32, &b"Max position limit"[..]));
    let values: Vec<i32> = entry.data[..12].as_chunks().0.iter().map(|value| i32::from_le_bytes(*value)).collect();
    assert_eq!(values, [i32::MAX, i32::MIN, i32::MAX]);
    for (kind, question, code) in [
        (InformationKind::ObjectRequest, &[0xFF, 0x2F][..], AbortCode::NO_OBJECT),
        (InformationKind::EntryRequest, &[0x18, 0x10, 9, 7], AbortCode::NO_SUB_INDEX),
        (InformationKind::Unknown(9), &[], AbortCode::COMMAND),
    ] {
        let (kind, data, _) = ask(&mut rig, kind, question);
        assert_eq!((kind, data), (InformationKind::Error, code.0.to_le_bytes().to_vec()));
    }
    let mut rig = blob(bytes(2));
    let (kind, data, _) = ask(&mut rig, InformationKind::ListRequest, &[1, 0]);
    assert_eq!((kind, data), (InformationKind::Error, AbortCode::NO_DICTIONARY.0.to_le_bytes().to_vec()));
}

fn alarm(rig: &mut Rig) {
    let fault = DeviceFault { code: 0x8611, resettable: true };
    assert!(rig.chain.slave_mut(0).device_mut().apply_fault(Fault::Alarm { axis: 0, fault }));
    rig.now += 30 * MS;
}

fn emergency(mailbox: &[u8]) -> Option<Emergency> {
    let message = MailboxMessage::decode(mailbox).expect("a message");
    match CoeMessage::decode(message.data) {
        Ok(CoeMessage::Emergency(emergency)) => Some(emergency),
        _ => None,
    }
}

/// ECAT-12.6 An error of the device comes as an emergency, in front of the answer to an SDO; and so does the end of the
/// error.
#[test]
fn s36_errors_come_as_emergencies() {
    let mut rig = Rig::in_preop();
    alarm(&mut rig);
    let upload = rig.message(MailboxProtocol::Coe, &[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    assert_eq!(rig.post(FIRST, &upload), 1);
    let first = rig.collect(FIRST).expect("an emergency");
    assert_eq!(emergency(&first), Some(Emergency { code: 0x8611, register: 0x21, data: [0; 5] }));
    let second = rig.collect(FIRST).expect("the answer");
    assert_eq!((emergency(&second), second[8]), (None, 0x43));
    assert_eq!(rig.collect(FIRST), None);
}

/// ECAT-12.6 A slave can be set to send no emergencies.
#[test]
fn s36_a_slave_without_emergencies() {
    let mut rig = Rig::with_stations([drive(EscSettings { emergencies: false, ..EscSettings::default() })]);
    rig.bring_to_preop(FIRST);
    alarm(&mut rig);
    assert_eq!(rig.collect(FIRST), None);
    // A program can send one nevertheless.
    rig.chain.slave_mut(0).send_emergency(Emergency { code: 0x1000, ..Emergency::default() });
    let sent = rig.collect(FIRST).expect("an emergency");
    assert_eq!(emergency(&sent).map(|emergency| emergency.code), Some(0x1000));
}

/// ECAT-12.7 In Init there is no mailbox, and it restarts afterwards.
#[test]
fn a_mailbox_begins_anew() {
    let mut rig = Rig::drives(1);
    rig.set_mailbox(FIRST);
    let upload = rig.message(MailboxProtocol::Coe, &[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    assert_eq!((rig.post(FIRST, &upload), rig.collect(FIRST)), (1, None));
    rig.reach(FIRST, AlState::PreOp);
    assert!(rig.collect(FIRST).is_some(), "what lies in the box is worked on from PreOP on");
    rig.post(FIRST, &upload);
    rig.reach(FIRST, AlState::Init);
    for n in 0..2 {
        rig.write(FIRST, ecmsk::ethercat::registers::sync_manager_activate(n), &[0]);
    }
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.collect(FIRST), None);
    assert_eq!(rig.post(FIRST, &upload), 1);
    assert!(rig.collect(FIRST).is_some(), "the counter of the last request is forgotten");
}
