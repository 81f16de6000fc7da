//! Tests of [`Host`], event by event, with a controller in memory. The host has to get the same answers as over USB/IP.

use std::time::Duration;

use proptest::prelude::*;

use super::host::{Answer, Change, Controller, Gone, Host, Why, Written};
use super::{function_part, ids};
use crate::io::gadget::wire::{self, Event};
use crate::port::usb_board::descriptors::{Descriptors, Identity};
use crate::port::usb_board::setup::descriptor;
use crate::sk::{FRAME_LEN, Frame};

/// The endpoints of a controller without a host and a clock: a transfer completes only when a test says so.
#[derive(Default)]
struct Endpoints {
    report: Option<u8>,
    is_receiving: bool,
    taken_back: u32,
}

impl Controller for Endpoints {
    fn is_sending(&self) -> bool {
        self.report.is_some()
    }

    fn is_receiving(&self) -> bool {
        self.is_receiving
    }

    fn send(&mut self, report: &[u8; FRAME_LEN]) {
        assert!(self.report.replace(report[0]).is_none(), "it has one already");
    }

    fn take_back(&mut self) {
        self.taken_back += 1;
    }

    fn receive(&mut self) {
        assert!(!std::mem::replace(&mut self.is_receiving, true), "it takes one already");
    }
}

struct Board {
    host: Host,
    ends: Endpoints,
    now: Duration,
    writing: Option<u64>,
}

impl Board {
    fn new() -> Self {
        let descriptors = Descriptors::new(&Identity::default()).expect("a valid identity");
        Self { host: Host::new(descriptors), ends: Endpoints::default(), now: Duration::ZERO, writing: None }
    }

    fn attached() -> Self {
        let mut board = Self::new();
        assert_eq!(board.event(Event::Enabled), Some(Change::Came));
        board
    }

    fn event(&mut self, event: Event) -> Option<Change> {
        self.host.event(event, self.now, &mut self.ends)
    }

    /// The host is gone: as the kernel does, first ends the pending transfers, then reports the event.
    fn gone(&mut self, event: Event) -> Option<Change> {
        (self.ends.report, self.ends.is_receiving) = (None, false);
        self.event(event)
    }

    /// The board makes a report, 1 ms later.
    fn report(&mut self, fill: u8) {
        self.now += Duration::from_millis(1);
        self.host.report(&Frame::from_bytes([fill; FRAME_LEN]), self.now, &mut self.ends);
    }

    /// The host fetches the report that the controller holds. Returns the first byte of the report; `None`: the
    /// controller holds none.
    fn fetch(&mut self) -> Option<u8> {
        let report = self.ends.report.take();
        if report.is_some() {
            self.host.sent(true, self.now, &mut self.ends);
        }
        report
    }

    /// Sends a packet as the host. Returns whether the controller accepts it.
    fn put(&mut self, packet: &[u8]) -> bool {
        let takes = std::mem::take(&mut self.ends.is_receiving);
        if takes {
            self.host.received(packet, self.now, &mut self.ends);
        }
        takes
    }

    /// The first byte of the next frame for the board; `None`: there is no frame.
    fn next_frame(&mut self) -> Option<u8> {
        let mut frame = Frame::new();
        self.writing = self.host.begin_write(&mut frame);
        self.writing.map(|_| frame.bytes()[0])
    }

    fn written(&mut self, taken: bool) {
        let generation = self.writing.take().expect("a frame is being written");
        let written = if taken { Written::Taken } else { Written::Not };
        self.host.write_ended(generation, written, self.now, &mut self.ends);
    }
}

/// SK-9.8, SK-9.5 Before the board has made a report, the host gets NAK. The host fetches each report once. Of several
/// reports that it has not fetched, only the newest one is kept.
#[test]
fn a_report_is_fetched_once_and_the_newest_is_kept() {
    let mut board = Board::attached();
    assert_eq!(board.fetch(), None);
    board.report(1);
    assert_eq!((board.fetch(), board.fetch()), (Some(1), None));
    for fill in 2..6 {
        board.report(fill);
    }
    assert_eq!((board.fetch(), board.fetch(), board.fetch()), (Some(2), Some(5), None));
}

/// A host that begins to read gets no old report: a report that the controller has held for 20 ms is replaced by the
/// newest one.
#[test]
fn a_report_that_nobody_fetches_is_replaced() {
    let mut board = Board::attached();
    for fill in 1..=20 {
        board.report(fill);
    }
    assert_eq!(board.ends.taken_back, 0, "19 ms");
    for fill in 21..=30 {
        board.report(fill);
    }
    assert_eq!((board.ends.taken_back, board.ends.report), (1, Some(1)), "once, until the kernel answers");
    board.ends.report = None;
    board.host.sent(false, board.now, &mut board.ends);
    assert_eq!(board.fetch(), Some(30));
    // If the host fetches the report before the controller gives it back, no report is lost either.
    (31..=60).for_each(|fill| board.report(fill));
    assert_eq!((board.ends.taken_back, board.fetch(), board.fetch()), (2, Some(31), Some(60)));
}

/// When a host goes, the transfer of a report that is being taken back ends with another error than a cancellation. Old
/// reports are replaced for the next host all the same.
#[test]
fn a_report_that_is_taken_back_may_end_with_its_host() {
    let mut board = Board::attached();
    (1..=21).for_each(|fill| board.report(fill));
    assert_eq!(board.ends.taken_back, 1);
    board.ends.report = None;
    board.host.not_sent();
    board.gone(Event::Disabled);
    board.host.take_gone();
    board.host.open(board.now, &mut board.ends);
    board.event(Event::Enabled);
    (31..=52).for_each(|fill| board.report(fill));
    assert_eq!(board.ends.taken_back, 2);
}

/// A frame is held until the board has taken it, and the host gets NAK for the next one.
#[test]
fn a_frame_is_held_until_the_board_has_taken_it() {
    let mut board = Board::attached();
    assert!(board.put(&[1; FRAME_LEN]) && !board.put(&[2; FRAME_LEN]));
    assert_eq!((board.next_frame(), board.host.has_frame()), (Some(1), false));
    board.written(false);
    assert!(!board.put(&[2; FRAME_LEN]), "the board was busy");
    assert_eq!(board.next_frame(), Some(1));
    board.written(true);
    assert!(board.put(&[2; FRAME_LEN]));
    assert_eq!(board.next_frame(), Some(2));
    board.written(true);
    assert_eq!(board.next_frame(), None);
}

/// SK-9.7 A short packet hangs the board: no frame and no report passes any more, but endpoint 0 still answers. For the
/// next host the board runs again.
#[test]
fn a_short_packet_hangs_the_board() {
    for length in [0, 1, 504, 511] {
        let mut board = Board::attached();
        board.report(1);
        assert!(board.put(&vec![7; length]));
        assert_eq!((board.ends.taken_back, board.next_frame()), (1, None), "{length}");
        board.ends.report = None;
        board.host.sent(false, board.now, &mut board.ends);
        board.report(2);
        assert!(board.fetch().is_none() && !board.put(&[1; FRAME_LEN]), "{length}");
        assert_eq!(board.host.setup([0xA1, 2, 0, 0, 0, 0, 1, 0]), Answer::Data(vec![0]));
        board.gone(Event::Disabled);
        let gone = board.host.take_gone().expect("it had the board");
        assert_eq!(gone, Gone { why: Why::Detached, frames: 0, reports: 0, hung: true });
        board.host.open(board.now, &mut board.ends);
        board.event(Event::Enabled);
        board.report(3);
        assert!(board.fetch() == Some(3) && board.put(&[1; FRAME_LEN]), "{length}");
    }
}

/// SK-9.1, SK-9.3, SK-9.4 The kernel gets the same descriptors as a host over USB/IP, byte for byte: the configuration
/// descriptor without its first 9 bytes, and the same ids, attributes and texts of the device.
#[test]
fn the_descriptors_are_those_of_every_virtual_board() {
    let identity = Identity { serial: "7".into(), ..Identity::default() };
    let descriptors = Descriptors::new(&identity).expect("a valid identity");
    let interface = [9, 4, 0, 0, 2, 3, 0, 0, 0];
    let hid = [9, 0x21, 0x11, 0x01, 0, 1, 0x22, 26, 0];
    let endpoints = [[7, 5, 0x81, 3, 0, 2, 1], [7, 5, 0x02, 3, 0, 2, 1]].concat();
    let part = [&interface[..], &hid, &endpoints].concat();
    assert_eq!(function_part(&descriptors), part);
    let head = [3, 0, 0, 0, 48, 0, 0, 0, 2, 0, 0, 0, 4, 0, 0, 0];
    assert_eq!(wire::descriptors(function_part(&descriptors)), [&head[..], &part].concat());
    let ids = ids(identity, &descriptors).expect("short texts");
    assert_eq!(
        (ids.vendor, ids.product, ids.release, ids.attributes, ids.power_ma),
        (0x16C0, 0x05DF, 0x0100, 0x80, 500)
    );
    assert_eq!(ids.texts, ["ecmsk", "ECM-SK, virtual", "7"]);
    let long = Identity { name: "é".repeat(64), ..Identity::default() };
    let error = super::ids(long, &descriptors).expect_err("128 bytes").to_string();
    assert!(error.contains("128 bytes") && error.contains("126"), "{error}");
}

/// Requests on endpoint 0 that the kernel passes on are answered or refused as over USB/IP: descriptors of the
/// interface, reports, the idle rate.
#[test]
fn requests_on_endpoint_0() {
    let mut board = Board::attached();
    let descriptors = Descriptors::new(&Identity::default()).expect("a valid identity");
    let get = |kind: u8, length: u8| [0x81, 6, 0, kind, 0, 0, length, 0];
    let report = descriptors.get(descriptor::REPORT, 0).expect("it has one").to_vec();
    let hid = descriptors.get(descriptor::HID, 0).expect("it has one").to_vec();
    assert_eq!(board.host.setup(get(0x22, 0x5A)), Answer::Data(report.clone()));
    assert_eq!(board.host.setup(get(0x22, 10)), Answer::Data(report[..10].to_vec()));
    assert_eq!(board.host.setup(get(0x21, 9)), Answer::Data(hid));

    // GET_REPORT returns the newest report, cut to the wanted length. SET_IDLE stores the idle rate, GET_IDLE returns
    // it.
    board.report(0x77);
    assert_eq!(board.host.setup([0xA1, 1, 0, 1, 0, 0, 0, 2]), Answer::Data(vec![0x77; FRAME_LEN]));
    assert_eq!(board.host.setup([0xA1, 1, 0, 1, 0, 0, 4, 0]), Answer::Data(vec![0x77; 4]));
    assert_eq!(board.host.setup([0x21, 10, 0, 125, 0, 0, 0, 0]), Answer::Acknowledge);
    assert_eq!(board.host.setup([0xA1, 2, 0, 0, 0, 0, 1, 0]), Answer::Data(vec![125]));

    for (refused, to_host) in [
        // GET_REPORT with a report id, GET_REPORT of a feature report, GET_DESCRIPTOR of a type that does not exist.
        ([0xA1, 1, 1, 1, 0, 0, 0, 2], true),
        ([0xA1, 1, 0, 3, 0, 0, 0, 2], true),
        (get(0x23, 9), true),
        // GET_PROTOCOL and SET_PROTOCOL: the board is no boot device.
        ([0xA1, 3, 0, 0, 0, 0, 1, 0], true),
        ([0x21, 11, 0, 0, 0, 0, 0, 0], false),
        // SET_REPORT with wrong lengths, with a report id, of a feature report, without data.
        ([0x21, 9, 0, 2, 0, 0, 0xFF, 1], false),
        ([0x21, 9, 0, 2, 0, 0, 1, 2], false),
        ([0x21, 9, 1, 2, 0, 0, 0, 2], false),
        ([0x21, 9, 0, 3, 0, 0, 0, 2], false),
        ([0x21, 9, 0, 2, 0, 0, 0, 0], false),
    ] {
        assert_eq!(board.host.setup(refused), Answer::Stall { to_host }, "{refused:x?}");
    }
}

/// SK-9.7 A whole report by SET_REPORT is a command frame. The board gets it in the order of arrival, between frames of
/// the OUT endpoint.
#[test]
fn a_report_may_come_by_endpoint_0() {
    let mut board = Board::attached();
    let set_report = [0x21, 9, 0, 2, 0, 0, 0, 2];
    assert!(board.put(&[1; FRAME_LEN]));
    assert_eq!(board.host.setup(set_report), Answer::Take(FRAME_LEN));
    board.host.control_data(set_report, &[2; FRAME_LEN]);
    assert_eq!(board.next_frame(), Some(1));
    board.written(true);
    assert!(board.put(&[3; FRAME_LEN]));
    for fill in [2, 3] {
        assert_eq!(board.next_frame(), Some(fill));
        board.written(true);
    }
    // While the board accepts no frame, SET_REPORT is refused once the queue is full (fewer than 256 frames).
    let taken = (0..1000).take_while(|_| {
        let takes = board.host.setup(set_report) == Answer::Take(FRAME_LEN);
        if takes {
            board.host.control_data(set_report, &[4; FRAME_LEN]);
        }
        takes
    });
    let taken = taken.count();
    assert!((1..256).contains(&taken), "{taken}");
    let frames = std::iter::from_fn(|| {
        let frame = board.next_frame();
        if frame.is_some() {
            board.written(true);
        }
        frame
    });
    assert_eq!(frames.count(), taken, "none is lost");
}

/// After a host is gone, no frame of it reaches the board. Reports and frames of the next host are blocked until the
/// axes are stopped.
#[test]
fn between_two_hosts_nothing_passes() {
    for (leaves, why) in [
        (Event::Disabled, Why::Detached),
        (Event::Unbound, Why::Detached),
        (Event::Suspended, Why::Asleep),
        (Event::Enabled, Why::Configured),
    ] {
        let mut board = Board::attached();
        board.report(1);
        board.fetch();
        board.put(&[1; FRAME_LEN]);
        assert_eq!(board.next_frame(), Some(1));
        board.written(true);
        board.put(&[2; FRAME_LEN]);
        assert_eq!(board.next_frame(), Some(2), "it is on its way");
        assert_eq!(board.gone(leaves), Some(Change::Went), "{leaves:?}");
        // The write of the previous host's frame ends now. The new device model must not count it.
        board.written(true);
        assert!(board.host.take_has_written() && !board.host.take_has_written());
        let comes = if leaves == Event::Suspended { Event::Resumed } else { Event::Enabled };
        if leaves != Event::Enabled {
            let change = if leaves == Event::Suspended { Change::Woke } else { Change::Came };
            assert_eq!(board.event(comes), Some(change));
        }
        board.report(3);
        assert!(board.fetch().is_none() && !board.put(&[3; FRAME_LEN]), "{leaves:?}");
        let gone = board.host.take_gone().expect("it had the board");
        assert_eq!(gone, Gone { why, frames: 1, reports: 1, hung: false });
        board.host.open(board.now, &mut board.ends);
        assert_eq!(board.fetch(), None, "what was made meanwhile is old");
        board.report(4);
        assert_eq!(board.fetch(), Some(4));
        assert!(board.put(&[5; FRAME_LEN]));
        assert_eq!(board.next_frame(), Some(5), "{leaves:?}");
    }
}

/// A host that comes and goes while the axes are being stopped is a session of its own: its end is reported too. No
/// frame or report passes until that end was reported and `Host::open` was called after it.
#[test]
fn a_host_may_go_while_axes_are_stopped() {
    let mut board = Board::attached();
    board.gone(Event::Disabled);
    assert!(board.host.take_gone().is_some());
    board.event(Event::Enabled);
    board.gone(Event::Disabled);
    board.host.open(board.now, &mut board.ends);
    board.event(Event::Enabled);
    board.report(1);
    assert_eq!(board.fetch(), None, "its end was not asked for yet");
    assert!(board.host.take_gone().is_some());
    board.host.open(board.now, &mut board.ends);
    board.report(2);
    assert_eq!(board.fetch(), Some(2));
}

/// Events while no host is connected, and events that repeat the present state, change nothing.
#[test]
fn events_that_change_nothing() {
    let mut board = Board::new();
    for event in [Event::Bound, Event::Suspended, Event::Resumed, Event::Disabled, Event::Unbound, Event::Unknown(9)] {
        assert_eq!(board.event(event), None, "{event:?}");
    }
    board.report(1);
    assert!(!board.ends.is_receiving && board.ends.report.is_none());
    board.event(Event::Enabled);
    for event in [Event::Bound, Event::Resumed, Event::Unknown(9)] {
        assert_eq!(board.event(event), None, "{event:?}");
    }
    assert_eq!(board.host.take_gone(), None);
    board.report(2);
    assert_eq!(board.fetch(), Some(2), "it waits for the next report");
}

proptest! {
    /// With events and transfers in any order, the controller holds at most one report and receives at most one packet,
    /// and a closed board gets no frame. The asserts in `Endpoints` check the first two.
    #[test]
    fn any_order(steps in proptest::collection::vec(0..13_u8, 0..200)) {
        let mut board = Board::new();
        let mut closed = false;
        for step in steps {
            match step {
                0 => {
 let _ = board.event(Event::Enabled);
}
                1 => {
 let _ = board.gone(Event::Disabled);
}
                2 => {
 let _ = board.event(Event::Suspended);
}
                3 => {
 let _ = board.event(Event::Resumed);
}
                4 | 5 => board.report(step),
                6 => {
 let _ = board.fetch();
}
                7 => {
 let _ = board.put(&[7; FRAME_LEN]);
}
                8 => {
 let _ = board.put(&[8; 5]);
}
                9 => {
                    board.host.close();
                    closed = true;
                }
                10 => {
                    let _ = board.host.take_gone();
                    board.host.open(board.now, &mut board.ends);
                    closed = false;
                }
                11 if board.writing.is_none() => {
                    let frame = board.next_frame();
                    prop_assert!(frame.is_none() || !closed);
                }
                12 if board.writing.is_some() => board.written(true),
                _ => {}
            }
        }
    }
}
