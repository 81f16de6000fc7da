//! Endpoint 0: answered and refused requests of a HID device (USB 2.0 9.4, HID 1.11 7.2).

use super::board::{Board, SET_CONFIGURATION};
use support::usbip_client::{IN, OUT, Reply};

const STALL: Result<Vec<u8>, i32> = Err(-32);

fn ok(bytes: &[u8]) -> Result<Vec<u8>, i32> {
    Ok(bytes.to_vec())
}

#[test]
fn descriptors_come_as_long_as_the_host_wants_them() {
    let mut board = Board::attached();
    let get = |kind: u8, index: u8, length: u16| {
        let [low, high] = length.to_le_bytes();
        [0x80, 6, index, kind, 0, 0, low, high]
    };
    assert_eq!(board.control(get(1, 0, 8), &[]).unwrap()[..], [18, 1, 0, 2, 0, 0, 0, 64]);
    assert_eq!(board.control(get(1, 0, 64), &[]).unwrap().len(), 18);
    assert_eq!(board.control(get(2, 0, 9), &[]).unwrap().len(), 9);
    assert_eq!(board.control(get(2, 0, 0xFFFF), &[]).unwrap().len(), 41);
    assert_eq!(board.control(get(3, 0, 255), &[]).unwrap(), [4, 3, 9, 4]);
    // A high-speed device without a full-speed mode has no qualifier, and no descriptor of Microsoft's.
    for kind in [6, 7, 0x0F] {
        assert_eq!(board.control(get(kind, 0, 10), &[]), STALL, "{kind:#x}");
    }
    assert_eq!(board.control(get(3, 0xEE, 18), &[]), STALL);
    // The host's buffer may be smaller than the requested length.
    assert_eq!(board.control_as(IN, 4, get(1, 0, 64), &[]).unwrap(), [18, 1, 0, 2]);
}

#[test]
fn the_interface_has_its_own_descriptors() {
    let mut board = Board::attached();
    assert_eq!(board.control([0x81, 6, 0, 0x22, 0, 0, 0x5A, 0], &[]).unwrap().len(), 26);
    assert_eq!(board.control([0x81, 6, 0, 0x21, 0, 0, 9, 0], &[]).unwrap()[..2], [9, 0x21]);
    assert_eq!(board.control([0x81, 6, 0, 0x22, 1, 0, 0x5A, 0], &[]), STALL, "of interface 1");
}

#[test]
fn the_configuration_is_chosen_and_told() {
    let mut board = Board::attached();
    let get = [0x80, 8, 0, 0, 0, 0, 1, 0];
    assert_eq!(board.control(get, &[]), ok(&[0]));
    assert_eq!(board.control(SET_CONFIGURATION, &[]), ok(&[]));
    assert!(board.device.configured());
    assert_eq!(board.control(get, &[]), ok(&[1]));
    assert_eq!(board.control([0, 9, 2, 0, 0, 0, 0, 0], &[]), STALL);
    assert_eq!(board.control(get, &[]), ok(&[1]), "as before");
    assert_eq!(board.control([0, 9, 0, 0, 0, 0, 0, 0], &[]), ok(&[]));
    assert!(!board.device.configured());
}

#[test]
fn states_of_device_and_interface() {
    let mut board = Board::new();
    assert_eq!(board.control([0x80, 0, 0, 0, 0, 0, 2, 0], &[]), ok(&[0, 0]));
    assert_eq!(board.control([0x81, 0, 0, 0, 0, 0, 2, 0], &[]), ok(&[0, 0]));
    assert_eq!(board.control([0x81, 10, 0, 0, 0, 0, 1, 0], &[]), ok(&[0]));
    assert_eq!(board.control([0x01, 11, 0, 0, 0, 0, 0, 0], &[]), ok(&[]));
    assert_eq!(board.control([0x01, 11, 1, 0, 0, 0, 0, 0], &[]), STALL, "there is no other setting");
    assert_eq!(board.control([0x00, 5, 7, 0, 0, 0, 0, 0], &[]), ok(&[]), "SET_ADDRESS");
}

#[test]
fn idle_is_kept() {
    let mut board = Board::new();
    assert_eq!(board.control([0xA1, 2, 0, 0, 0, 0, 1, 0], &[]), ok(&[0]));
    assert_eq!(board.control([0x21, 10, 0, 125, 0, 0, 0, 0], &[]), ok(&[]));
    assert_eq!(board.control([0xA1, 2, 0, 0, 0, 0, 1, 0], &[]), ok(&[125]));
}

#[test]
fn the_newest_report_can_be_asked_for() {
    let mut board = Board::new();
    let get = |kind: u8, id: u8, length: u16| {
        let [low, high] = length.to_le_bytes();
        [0xA1, 1, id, kind, 0, 0, low, high]
    };
    assert_eq!(board.control(get(1, 0, 512), &[]), ok(&[0; 512]));
    board.read(1, 512);
    board.report(0x77);
    board.reports();
    assert_eq!(board.control(get(1, 0, 512), &[]), ok(&[0x77; 512]));
    assert_eq!(board.control(get(1, 0, 4), &[]), ok(&[0x77; 4]));
    assert_eq!(board.control(get(1, 1, 512), &[]), STALL, "there is no report 1");
    assert_eq!(board.control(get(3, 0, 512), &[]), STALL, "nor a feature report");
}

/// SK-9.7 A whole report by SET_REPORT is a command frame; a shorter one is refused and does not hang the board.
#[test]
fn a_report_may_come_by_endpoint_0() {
    let mut board = Board::new();
    let set = |kind: u8, length: u16| {
        let [low, high] = length.to_le_bytes();
        [0x21, 9, 0, kind, 0, 0, low, high]
    };
    assert_eq!(board.control(set(2, 504), &[1; 504]), STALL);
    assert_eq!(board.control(set(3, 512), &[1; 512]), STALL);
    assert!(!board.device.hangs());

    let frame = super::board::transfer(5, OUT, 0, 512, set(2, 512));
    board.device.submit(&frame, &[9; 512]).unwrap();
    assert_eq!(board.replies(), [], "held until the board has it");
    assert_eq!(board.next_frame(), Some(9));
    board.device.written();
    assert_eq!(board.replies(), [Reply::done(5, 512)]);

    let mut unconfigured = Board::attached();
    assert_eq!(unconfigured.control(set(2, 512), &[1; 512]), STALL);
}

#[test]
fn an_endpoint_is_halted_and_freed() {
    let mut board = Board::new();
    let status = |endpoint: u8| [0x82, 0, 0, 0, endpoint, 0, 2, 0];
    let set = |request: u8, endpoint: u8| [0x02, request, 0, 0, endpoint, 0, 0, 0];
    for endpoint in [0x81, 0x02] {
        assert_eq!(board.control(status(endpoint), &[]), ok(&[0, 0]));
        assert_eq!(board.control(set(3, endpoint), &[]), ok(&[]));
        assert_eq!(board.control(status(endpoint), &[]), ok(&[1, 0]));
    }
    board.read(1, 512);
    board.write(2, &[1; 512]);
    assert_eq!(board.replies(), [Reply::stalled(1), Reply::stalled(2)]);
    for endpoint in [0x81, 0x02] {
        assert_eq!(board.control(set(1, endpoint), &[]), ok(&[]));
        assert_eq!(board.control(status(endpoint), &[]), ok(&[0, 0]));
    }
    board.read(3, 512);
    board.write(4, &[7; 512]);
    assert_eq!((board.replies(), board.next_frame()), (vec![], Some(7)));
    // Setting the configuration again clears them too (USB 2.0 9.4.5).
    for endpoint in [0x81, 0x02] {
        assert_eq!(board.control(set(3, endpoint), &[]), ok(&[]));
    }
    assert_eq!(board.control(SET_CONFIGURATION, &[]), ok(&[]));
    for endpoint in [0x81, 0x02] {
        assert_eq!(board.control(status(endpoint), &[]), ok(&[0, 0]));
    }
    // There are no other endpoints, and no other feature.
    for endpoint in [0x01, 0x82, 0x83] {
        assert_eq!(board.control(set(3, endpoint), &[]), STALL);
        assert_eq!(board.control(status(endpoint), &[]), STALL);
    }
    assert_eq!(board.control([0x02, 3, 1, 0, 0x81, 0, 0, 0], &[]), STALL);
}

#[test]
fn what_is_unknown_is_refused_and_counted() {
    let mut board = Board::new();
    let requests = [
        [0x40, 1, 0, 0, 0, 0, 0, 0],
        [0xC0, 1, 0, 0, 0, 0, 4, 0],
        [0x00, 7, 0, 1, 0, 0, 0, 0],
        [0x00, 3, 1, 0, 0, 0, 0, 0],
        [0xA1, 3, 0, 0, 0, 0, 1, 0],
        [0x21, 11, 0, 0, 0, 0, 0, 0],
        [0x21, 10, 0, 0, 1, 0, 0, 0],
    ];
    for setup in requests {
        assert_eq!(board.control(setup, &[]), STALL, "{setup:x?}");
    }
    // A request to the host that comes as one to the device, and the other way round.
    assert_eq!(board.control_as(OUT, 0, [0x80, 6, 0, 1, 0, 0, 18, 0], &[]), STALL);
    assert_eq!(board.control_as(IN, 8, SET_CONFIGURATION, &[]), STALL);
    assert_eq!(board.device.counters().refused, requests.len() as u64 + 2);
}
