//! CANopen over EtherCAT: SDO, SDO information, emergencies.

use ecmsk::coe::{
    AbortCode, CoeMessage, Emergency, EntryDescription, EntryRequest, InformationFragment, InformationKind,
    ObjectAccess, ObjectAddress, ObjectCode, ObjectDescription, ObjectListType, SdoRequest, SdoResponse, SdoScope,
    SdoValuePart, ValueInfo, decode_abort, decode_u16,
};
use ecmsk::ethercat::WireError;
use proptest::prelude::*;

const STATUSWORD: ObjectAddress = ObjectAddress::new(0x6041, 0);

/// Checks that the message is encoded to the bytes, and that these are decoded to it.
#[track_caller]
fn check(message: CoeMessage<'_>, bytes: &[u8]) {
    let mut room = [0xA5; 64];
    let len = message.encode(&mut room).expect("room");
    assert_eq!(room[..len], *bytes, "{message:?}");
    assert_eq!(CoeMessage::decode(bytes), Ok(message));
    assert!(matches!(message.encode(&mut room[..len - 1]), Err(WireError::NoRoom { .. })));
}

fn download(scope: SdoScope, value: SdoValuePart<'_>) -> CoeMessage<'_> {
    CoeMessage::SdoRequest(SdoRequest::Download { object: STATUSWORD, scope, value })
}

fn uploaded(scope: SdoScope, value: SdoValuePart<'_>) -> CoeMessage<'_> {
    CoeMessage::SdoResponse(SdoResponse::Upload { object: STATUSWORD, scope, value })
}

/// ECAT-5.1 Requests and answers of at most 4 bytes: 2F, 2B, 27 and 23 write 1 to 4 bytes, 4F, 4B, 47 and 43 answer them.
#[test]
fn expedited_values() {
    use SdoValuePart::Expedited;
    for (len, written, read) in [(1, 0x2F, 0x4F), (2, 0x2B, 0x4B), (3, 0x27, 0x47), (4, 0x23, 0x43)] {
        let mut bytes = [0, 0x20, written, 0x41, 0x60, 0, 0, 0, 0, 0];
        bytes[6..6 + len].copy_from_slice(&[1, 2, 3, 4][..len]);
        check(download(SdoScope::Entry, Expedited(&[1, 2, 3, 4][..len])), &bytes);
        (bytes[1], bytes[2]) = (0x30, read);
        check(uploaded(SdoScope::Entry, Expedited(&[1, 2, 3, 4][..len])), &bytes);
    }
    check(download(SdoScope::Complete, Expedited(&[1, 0, 0, 0])), &[0, 0x20, 0x33, 0x41, 0x60, 0, 1, 0, 0, 0]);
    check(download(SdoScope::Entry, SdoValuePart::Unsized(&[1, 2, 3, 4])), &[0, 0x20, 0x22, 0x41, 0x60, 0, 1, 2, 3, 4]);
    for wrong in [&[][..], &[1, 2, 3, 4, 5]] {
        let error = download(SdoScope::Entry, Expedited(wrong)).encode(&mut [0; 20]);
        assert!(matches!(error, Err(WireError::Field { allowed: "1 to 4", .. })), "{error:?}");
    }
}

/// ECAT-5.2 Longer values: 21 and 41 with the whole length and the first bytes; complete access adds 10.
#[test]
fn the_first_part_of_longer_values() {
    let value = SdoValuePart::First { size: 300, data: &[7, 8, 9] };
    let bytes = [0, 0x20, 0x21, 0x41, 0x60, 0, 0x2C, 0x01, 0, 0, 7, 8, 9];
    check(download(SdoScope::Entry, value), &bytes);
    check(download(SdoScope::Complete, value), &[&[0, 0x20, 0x31][..], &bytes[3..]].concat());
    check(uploaded(SdoScope::Entry, value), &[&[0, 0x30, 0x41][..], &bytes[3..]].concat());
    check(uploaded(SdoScope::Complete, value), &[&[0, 0x30, 0x51][..], &bytes[3..]].concat());
    for scope in [SdoScope::Entry, SdoScope::Complete] {
        let command = if scope == SdoScope::Entry { [0x40, 0x60] } else { [0x50, 0x70] };
        let object = STATUSWORD;
        let upload = [0, 0x20, command[0], 0x41, 0x60, 0, 0, 0, 0, 0];
        check(CoeMessage::SdoRequest(SdoRequest::Upload { object, scope }), &upload);
        let written = [0, 0x30, command[1], 0x41, 0x60, 0, 0, 0, 0, 0];
        check(CoeMessage::SdoResponse(SdoResponse::Download { object, scope }), &written);
    }
}

/// ECAT-5.3 Segments: the toggle bit, how many of 7 bytes count, and whether it is the last one.
#[test]
fn segments_of_longer_values() {
    let segment = |toggle, last, data| CoeMessage::SdoRequest(SdoRequest::DownloadSegment { toggle, last, data });
    check(segment(false, false, &[1, 2, 3, 4, 5, 6, 7]), &[0, 0x20, 0x00, 1, 2, 3, 4, 5, 6, 7]);
    check(segment(true, true, &[1, 2, 3]), &[0, 0x20, 0x19, 1, 2, 3, 0, 0, 0, 0]);
    check(segment(true, false, &[1, 2, 3, 4, 5, 6, 7, 8, 9]), &[0, 0x20, 0x10, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    let segment = |toggle, last, data| CoeMessage::SdoResponse(SdoResponse::UploadSegment { toggle, last, data });
    check(segment(false, true, &[]), &[0, 0x30, 0x0F, 0, 0, 0, 0, 0, 0, 0]);
    check(segment(true, false, &[1, 2, 3, 4, 5, 6, 7, 8]), &[0, 0x30, 0x10, 1, 2, 3, 4, 5, 6, 7, 8]);
    for (toggle, request, response) in [(false, 0x60, 0x20), (true, 0x70, 0x30)] {
        let bytes = [0, 0x20, request, 0, 0, 0, 0, 0, 0, 0];
        check(CoeMessage::SdoRequest(SdoRequest::UploadSegment { toggle }), &bytes);
        let bytes = [0, 0x30, response, 0, 0, 0, 0, 0, 0, 0];
        check(CoeMessage::SdoResponse(SdoResponse::DownloadSegment { toggle }), &bytes);
    }
    let short = CoeMessage::decode(&[0, 0x20, 0x00, 1, 2, 3]);
    assert_eq!(short, Err(WireError::Short { part: "data of a segment", needed: 7, found: 3 }));
}

/// ECAT-5.4 An abort is 80 with its code, service 2 in both directions; codes have their texts, and others survive.
#[test]
fn aborts() {
    let abort = SdoRequest::Abort { object: STATUSWORD, code: AbortCode::READ_ONLY };
    check(CoeMessage::SdoRequest(abort), &[0, 0x20, 0x80, 0x41, 0x60, 0, 0x02, 0x00, 0x01, 0x06]);
    for (code, text) in [
        (AbortCode::TOGGLE_BIT, "0x05030000 (toggle bit not changed)"),
        (AbortCode::NO_DATA, "0x08000024 (no data available)"),
        (AbortCode::MODULE_LIST, "0x06090033 (configured module list does not match the detected one)"),
        (AbortCode(0x1234_5678), "0x12345678"),
    ] {
        assert_eq!(code.to_string(), text);
    }
}

/// ECAT-5.5 Commands and services that the standard does not have survive decoding.
#[test]
fn what_is_unknown_survives() {
    check(CoeMessage::SdoRequest(SdoRequest::Unknown(0xA0, &[1, 2])), &[0, 0x20, 0xA0, 1, 2]);
    check(CoeMessage::SdoRequest(SdoRequest::Unknown(0x20, &[0; 7])), &[0, 0x20, 0x20, 0, 0, 0, 0, 0, 0, 0]);
    check(CoeMessage::SdoResponse(SdoResponse::Unknown(0x80, &[1, 2])), &[0, 0x30, 0x80, 1, 2]);
    check(CoeMessage::Unknown(4, &[1, 2, 3]), &[0, 0x40, 1, 2, 3]);
    assert!(matches!(CoeMessage::decode(&[0]), Err(WireError::Short { part: "CoE header", .. })));
    assert!(matches!(CoeMessage::decode(&[0, 0x20, 0x40, 0, 0, 0]), Err(WireError::Short { .. })));
}

/// ECAT-5.6 An emergency: error code, error register, 5 bytes of the maker's own.
#[test]
fn an_emergency() {
    let emergency = Emergency { code: 0x8611, register: 0x21, data: [1, 2, 3, 4, 5] };
    check(CoeMessage::Emergency(emergency), &[0, 0x10, 0x11, 0x86, 0x21, 1, 2, 3, 4, 5]);
}

/// ECAT-5.7 SDO information: the kind with the bit for incomplete answers, how many fragments follow, the data.
#[test]
fn fragments_of_information() {
    let list =
        InformationFragment { kind: InformationKind::ListResponse, incomplete: true, left: 2, data: &[1, 0, 0, 0x10] };
    check(CoeMessage::Information(list), &[0, 0x80, 0x82, 0, 2, 0, 1, 0, 0, 0x10]);
    let request = InformationFragment::whole(InformationKind::ListRequest, &[1, 0]);
    check(CoeMessage::Information(request), &[0, 0x80, 1, 0, 0, 0, 1, 0]);
    check(
        CoeMessage::Information(InformationFragment::whole(InformationKind::Unknown(9), &[])),
        &[0, 0x80, 9, 0, 0, 0],
    );
    for (code, list) in [(0, ObjectListType::Lengths), (1, ObjectListType::All), (9, ObjectListType::Unknown(9))] {
        assert_eq!((ObjectListType::from_code(code), list.code()), (list, code));
    }
    assert_eq!(ObjectListType::LISTS.map(ObjectListType::code), [1, 2, 3, 4, 5]);
    assert_eq!((decode_u16(&[0x18, 0x10, 9]), decode_abort(&[0, 0, 2, 6])), (Ok(0x1018), Ok(AbortCode::NO_OBJECT)));
}

/// ECAT-5.8 Descriptions of objects and sub-indices, byte by byte.
#[test]
fn descriptions() {
    let object =
        ObjectDescription { index: 0x1018, data_type: 0x23, max_sub: 4, code: ObjectCode::Record, name: b"Identity" };
    let bytes = b"\x18\x10\x23\x00\x04\x09Identity";
    let mut room = [0xA5; 40];
    assert_eq!(object.encode(&mut room), Ok(14));
    assert_eq!((&room[..14], ObjectDescription::decode(bytes)), (&bytes[..], Ok(object)));

    let request = EntryRequest { object: ObjectAddress::new(0x1018, 1), wanted: ValueInfo(7) };
    assert_eq!((request.encode(), EntryRequest::decode(&[0x18, 0x10, 1, 7])), ([0x18, 0x10, 1, 7], Ok(request)));

    let access = ObjectAccess::READ | ObjectAccess::WRITE | ObjectAccess::RX_MAPPABLE;
    assert_eq!((ObjectAccess::READ | ObjectAccess::WRITE).0, 0x3F);
    let object = ObjectAddress::new(0x607A, 0);
    let entry = EntryDescription { object, info: ValueInfo(7), data_type: 4, bits: 32, access, data: b"Target" };
    let bytes = b"\x7A\x60\x00\x07\x04\x00\x20\x00\x7F\x00Target";
    assert_eq!(entry.encode(&mut room), Ok(16));
    assert_eq!((&room[..16], EntryDescription::decode(bytes)), (&bytes[..], Ok(entry)));
    assert!(EntryDescription::decode(&bytes[..9]).is_err() && ObjectDescription::decode(&bytes[..5]).is_err());
    for (code, kind) in
        [(7, ObjectCode::Variable), (8, ObjectCode::Array), (9, ObjectCode::Record), (3, ObjectCode::Unknown(3))]
    {
        assert_eq!((ObjectCode::from_code(code), kind.code()), (kind, code));
    }
}

/// Bytes of a message, often with a valid service and command.
fn message() -> impl Strategy<Value = Vec<u8>> {
    let service = prop_oneof![Just(1u8), 2u8..=3, Just(8), 0u8..16];
    (service, proptest::collection::vec(any::<u8>(), 0..40)).prop_map(|(service, mut body)| {
        body.splice(0..0, [0, service << 4]);
        body
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2048))]

    /// ECAT-5.1, ECAT-5.2, ECAT-5.3, ECAT-5.7 Whatever is decoded is the same once it was encoded and decoded again.
    #[test]
    fn messages_come_back(bytes in message()) {
        let Ok(message) = CoeMessage::decode(&bytes) else { return Ok(()) };
        let mut again = [0xA5; 60];
        let len = message.encode(&mut again).expect("what was decoded can be encoded");
        prop_assert_eq!(CoeMessage::decode(&again[..len]), Ok(message));
    }

    /// ECAT-5.8 Descriptions come back, whatever they are.
    #[test]
    fn descriptions_come_back(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
        let mut again = [0xA5; 60];
        if let Ok(object) = ObjectDescription::decode(&bytes) {
            let len = object.encode(&mut again).expect("room");
            prop_assert_eq!(&again[..len], &bytes[..]);
        }
        if let Ok(entry) = EntryDescription::decode(&bytes) {
            let len = entry.encode(&mut again).expect("room");
            prop_assert_eq!(&again[..len], &bytes[..]);
        }
        if let Ok(entry) = EntryRequest::decode(&bytes) {
            prop_assert_eq!(&entry.encode()[..], &bytes[..4]);
        }
    }
}
