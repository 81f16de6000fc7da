//! The messages, byte by byte. Source: Documentation/usb/usbip_protocol.rst of Linux.

use ecmsk::port::usbip::wire::{self, Command, DeviceEntry, Direction, Op, Refusal, Status, Submit, WireError};

use support::usbip_client::{self as client, be16, be32};

const DEVICE_ENTRY: DeviceEntry = DeviceEntry {
    path: "/sys/devices/somewhere/usb1/1-1",
    bus_id: "1-1",
    bus: 1,
    number: 7,
    vendor: 0x16C0,
    product: 0x05DF,
    release: 0x0123,
    configuration: 1,
    interface: [3, 0, 0],
};

#[test]
fn a_request_is_told_by_its_version_and_code() {
    assert_eq!(Op::parse(&[0x01, 0x11, 0x80, 0x05, 0, 0, 0, 0]), Ok(Op::DeviceList));
    assert_eq!(Op::parse(&[0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0]), Ok(Op::Import));
    assert_eq!(Op::parse(&[0x01, 0x06, 0x80, 0x03, 0, 0, 0, 0]), Err(WireError::Version { found: 0x0106 }));
    assert_eq!(Op::parse(&[0x01, 0x11, 0x00, 0x03, 0, 0, 0, 0]), Err(WireError::Code { found: 3 }));
    assert_eq!(Op::parse(b"GET / HT"), Err(WireError::Version { found: 0x4745 }));
}

#[test]
fn a_bus_id_ends_at_the_first_zero() {
    let mut field = [b'x'; 32];
    assert_eq!(wire::bus_id(&field), Ok("x".repeat(32).as_str()));
    field[3] = 0;
    assert_eq!(wire::bus_id(&field), Ok("xxx"));
    field[0] = 0xFF;
    assert_eq!(wire::bus_id(&field), Err(WireError::BusId));
}

#[test]
fn a_submission_says_what_and_where_to() {
    let setup = [0x80, 6, 0, 1, 0, 0, 18, 0];
    let header = client::submit(0x0102_0304, client::IN, 15, 65_536, setup);
    let expected = Submit {
        sequence: 0x0102_0304,
        device: client::DEVICE_ID,
        direction: Direction::In,
        endpoint: 15,
        length: 65_536,
        setup,
    };
    assert_eq!(Command::parse(&header), Ok(Command::Submit(expected)));
    // Linux sends 0 where the document has all ones.
    let mut header = header;
    header[32..36].fill(0);
    assert_eq!(Command::parse(&header), Ok(Command::Submit(expected)));
}

#[test]
fn an_unlink_names_its_victim() {
    let expected = Command::Unlink { sequence: 9, device: client::DEVICE_ID, victim: 8 };
    assert_eq!(Command::parse(&client::unlink(9, 8)), Ok(expected));
}

#[test]
fn what_no_client_sends_is_named() {
    let with = |at: usize, value: u32| {
        let mut header = client::submit(1, client::OUT, 2, 512, [0; 8]);
        header[at..at + 4].copy_from_slice(&value.to_be_bytes());
        Command::parse(&header).unwrap_err()
    };
    assert_eq!(with(0, 3), WireError::Command { found: 3 });
    assert_eq!(with(12, 2), WireError::Direction { found: 2 });
    assert_eq!(with(16, 16), WireError::Endpoint { found: 16 });
    assert_eq!(with(16, 0x102), WireError::Endpoint { found: 0x102 });
    assert_eq!(with(24, 65_537), WireError::Length { found: 65_537 });
    assert_eq!(with(32, 1), WireError::Isochronous { packets: 1 });
}

#[test]
fn an_answer_has_its_place_for_each_number() {
    let mut bytes = vec![0xA5];
    wire::ret_submit(&mut bytes, 0x0A0B_0C0D, Status::Overflow, 3, b"abc");
    wire::ret_unlink(&mut bytes, 0x0E0F_1011, Status::Unlinked);
    assert_eq!((bytes[0], bytes.len()), (0xA5, 1 + 48 + 3 + 48));
    let submit = &bytes[1..];
    assert_eq!((be32(submit, 0), be32(submit, 4)), (3, 0x0A0B_0C0D));
    assert_eq!((be32(submit, 20) as i32, be32(submit, 24)), (-75, 3));
    assert!(submit[8..20].iter().chain(&submit[28..48]).all(|byte| *byte == 0));
    assert_eq!(&submit[48..51], b"abc");
    let unlink = &submit[51..];
    assert_eq!((be32(unlink, 0), be32(unlink, 4), be32(unlink, 20) as i32), (4, 0x0E0F_1011, -104));
    assert!(unlink[8..20].iter().chain(&unlink[24..48]).all(|byte| *byte == 0));
}

/// SK-9.1 High speed, and the pair of ids.
#[test]
fn a_list_shows_each_device_with_its_interface() {
    let mut bytes = Vec::new();
    wire::device_list(&mut bytes, &[DEVICE_ENTRY, DEVICE_ENTRY]);
    assert_eq!(bytes[..12], [0x01, 0x11, 0x00, 0x05, 0, 0, 0, 0, 0, 0, 0, 2]);
    assert_eq!(bytes.len(), 12 + 2 * (312 + 4));
    let device = &bytes[12..];
    assert!(device.starts_with(b"/sys/devices/somewhere/usb1/1-1\0"));
    assert!(device[256..].starts_with(b"1-1\0"));
    assert_eq!([be32(device, 288), be32(device, 292)], [1, 7], "bus and number");
    assert_eq!(be32(device, 296), 3, "USB_SPEED_HIGH");
    assert_eq!([be16(device, 300), be16(device, 302), be16(device, 304)], [0x16C0, 0x05DF, 0x0123]);
    assert_eq!(device[306..312], [0, 0, 0, 1, 1, 1], "class by interface, configuration 1 of 1, 1 interface");
    assert_eq!(device[312..316], [3, 0, 0, 0], "HID");
    assert_eq!(device[..316], device[316..632]);
}

#[test]
fn an_import_gives_the_device_or_the_reason() {
    let mut bytes = Vec::new();
    wire::import(&mut bytes, Ok(&DEVICE_ENTRY));
    assert_eq!(bytes[..8], [0x01, 0x11, 0x00, 0x03, 0, 0, 0, 0]);
    assert_eq!(bytes.len(), 8 + 312, "without interfaces");
    assert_eq!(be32(&bytes, 8 + 292), 7);
    assert_eq!(wire::device_id(1, 7), 0x0001_0007, "what commands call it");

    for (refusal, status) in [(Refusal::Busy, 2), (Refusal::Away, 3), (Refusal::NoDevice, 4)] {
        let mut bytes = Vec::new();
        wire::import(&mut bytes, Err(refusal));
        assert_eq!(bytes, [0x01, 0x11, 0x00, 0x03, 0, 0, 0, status], "{refusal:?}");
    }
}

#[test]
fn a_text_that_is_too_long_is_cut_with_its_zero() {
    let long = "x".repeat(300);
    let mut bytes = Vec::new();
    wire::import(&mut bytes, Ok(&DeviceEntry { path: &long, bus_id: &long, ..DEVICE_ENTRY }));
    let device = &bytes[8..];
    assert_eq!((device[254], device[255], device[256 + 30], device[256 + 31]), (b'x', 0, b'x', 0));
}
