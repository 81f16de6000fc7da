//! The board's descriptors, byte by byte as in USB 2.0 (9.6) and HID 1.11 (6).

use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::port::usbip::{Identity, IdentityError};

fn board() -> Descriptors {
    Descriptors::new(&Identity::default()).unwrap()
}

fn with(change: impl FnOnce(&mut Identity)) -> Result<Descriptors, IdentityError> {
    let mut identity = Identity::default();
    change(&mut identity);
    Descriptors::new(&identity)
}

/// SK-9.1 The device: USB 2.0, class by interface, VID 0x16C0, PID 0x05DF.
#[test]
fn the_device_has_the_boards_pair() {
    let expected = [18, 1, 0x00, 0x02, 0, 0, 0, 64, 0xC0, 0x16, 0xDF, 0x05, 0x00, 0x01, 1, 2, 0, 1];
    assert_eq!(board().get(1, 0), Some(&expected[..]), "without a serial number it names none");
}

/// SK-9.1, SK-9.3, SK-9.4 One HID interface, interrupt IN 0x81 and OUT 0x02 of 512 bytes, bInterval 1.
#[test]
fn the_configuration_has_one_interface_with_two_endpoints() {
    let expected = [
        [9, 2, 41, 0, 1, 1, 0, 0x80, 250].as_slice(),
        &[9, 4, 0, 0, 2, 3, 0, 0, 0],
        &[9, 0x21, 0x11, 0x01, 0, 1, 0x22, 26, 0],
        &[7, 5, 0x81, 3, 0x00, 0x02, 1],
        &[7, 5, 0x02, 3, 0x00, 0x02, 1],
    ]
    .concat();
    assert_eq!(board().get(2, 0), Some(&expected[..]));
    assert_eq!(board().get(0x21, 0), Some(&expected[18..27]));
}

/// SK-9.5 One input and one output report of 512 bytes, no report id: read as a host does, item by item (HID 1.11
/// 6.2.2.2).
#[test]
fn the_reports_are_512_bytes_without_an_id() {
    let descriptors = board();
    let mut items = descriptors.get(0x22, 0).unwrap();
    assert_eq!(items.len(), 26, "what the HID descriptor says");
    let (mut size, mut count, mut depth) = (0, 0, 0);
    let mut main = Vec::new();
    while let [prefix, rest @ ..] = items {
        let len = [0, 1, 2, 4][usize::from(prefix & 3)];
        let (data, after) = rest.split_at(len);
        let value = data.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte));
        match prefix & 0xFC {
            0x74 => size = value,
            0x94 => count = value,
            0x84 => panic!("a report id"),
            // Input, output: data, variable, absolute.
            0x80 => main.push(("input", size * count, value)),
            0x90 => main.push(("output", size * count, value)),
            0xB0 => panic!("a feature report"),
            0xA0 => depth += 1,
            0xC0 => depth -= 1,
            _ => {}
        }
        items = after;
    }
    assert_eq!((main, depth), (vec![("input", 512 * 8, 2), ("output", 512 * 8, 2)], 0));
}

#[test]
fn texts_are_utf_16_and_what_is_empty_is_not_there() {
    let named = with(|identity| {
        (identity.manufacturer, identity.name, identity.serial) = ("é".into(), String::new(), "A1".into());
    })
    .unwrap();
    assert_eq!(named.get(3, 0), Some(&[4, 3, 0x09, 0x04][..]), "English");
    assert_eq!(named.get(3, 1), Some(&[4, 3, 0xE9, 0][..]));
    assert_eq!(named.get(3, 2), None);
    assert_eq!(named.get(3, 3), Some(&[6, 3, b'A', 0, b'1', 0][..]));
    assert_eq!(named.get(3, 4), None);
    assert_eq!(named.get(1, 0).unwrap()[14..17], [1, 0, 3]);
}

#[test]
fn what_is_not_known_of_the_board_can_be_set() {
    let other = with(|identity| {
        identity.vendor = 0x1234;
        identity.product = 0x5678;
        identity.release = 0x9ABC;
        identity.interval = 4;
        identity.power_ma = 100;
        identity.usage_page = 0xFFA0;
    })
    .unwrap();
    assert_eq!(other.get(1, 0).unwrap()[8..14], [0x34, 0x12, 0x78, 0x56, 0xBC, 0x9A]);
    let configuration = other.get(2, 0).unwrap();
    assert_eq!((configuration[8], configuration[33], configuration[40]), (50, 4, 4));
    assert_eq!(other.get(0x22, 0).unwrap()[..3], [0x06, 0xA0, 0xFF]);
}

#[test]
fn what_no_board_can_be_is_refused() {
    assert_eq!(with(|identity| identity.interval = 0), Err(IdentityError::Interval { found: 0 }));
    assert_eq!(with(|identity| identity.interval = 17), Err(IdentityError::Interval { found: 17 }));
    assert_eq!(with(|identity| identity.power_ma = 501), Err(IdentityError::Power { found: 501 }));
    let text = "x".repeat(127);
    assert_eq!(with(|identity| identity.name.clone_from(&text)), Err(IdentityError::Text { text }));
    let longest = with(|identity| identity.serial = "x".repeat(126)).unwrap();
    assert_eq!(longest.get(3, 3).map(|text| (text.len(), text[0])), Some((254, 254)));
}

#[test]
fn other_kinds_and_indices_are_not_there() {
    for (kind, index) in [(1, 1), (2, 1), (0x21, 1), (0x22, 1), (4, 0), (5, 0), (6, 0), (0x0F, 0), (3, 0xEE), (0x23, 0)]
    {
        assert_eq!(board().get(kind, index), None, "{kind:#x} {index}");
    }
}
