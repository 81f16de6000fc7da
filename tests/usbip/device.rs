//! The board's endpoints, transfer by transfer.

use ecmsk::port::usbip::device::{TRANSFERS_AT_ONCE, TooMany};

use super::board::{Board, transfer};
use support::usbip_client::{IN, OUT, Reply};

#[test]
fn before_it_is_configured_its_endpoints_stall() {
    let mut board = Board::attached();
    board.read(1, 512);
    board.write(2, &[1; 512]);
    assert_eq!(board.replies(), [Reply::stalled(1), Reply::stalled(2)]);
    assert_eq!((board.device.wants_report(), board.next_frame()), (false, None));
}

#[test]
fn other_endpoints_stall() {
    let mut board = Board::new();
    for (endpoint, direction) in [(1, OUT), (2, IN), (3, IN), (15, OUT)] {
        board.device.submit(&transfer(endpoint, direction, endpoint, 0, [0; 8]), &[]).unwrap();
        assert_eq!(board.replies(), [Reply::stalled(endpoint)]);
    }
}

/// SK-9.3, SK-9.5 A read is held while there is no report, and gets all 512 bytes of the next one.
#[test]
fn a_read_waits_for_a_report() {
    let mut board = Board::new();
    assert!(!board.device.wants_report());
    board.read(1, 512);
    board.read(2, 512);
    assert!(board.device.wants_report());
    assert_eq!(board.reports(), []);
    board.report(0x11);
    assert_eq!(board.reports(), [(Reply::done(1, 512), vec![0x11; 512])]);
    board.report(0x22);
    assert_eq!(board.reports(), [(Reply::done(2, 512), vec![0x22; 512])]);
    assert!(!board.device.wants_report());
    assert_eq!(board.device.counters().reports, 2);
}

/// Only one read at a time requests a report of the board; otherwise reports could overtake each other.
#[test]
fn the_board_is_asked_once_at_a_time() {
    let mut board = Board::new();
    assert!(!board.device.begin_read(), "nobody wants one");
    board.read(1, 512);
    board.read(2, 512);
    board.read(3, 512);
    assert_eq!([board.device.begin_read(), board.device.begin_read()], [true, false]);
    board.report(1);
    assert_eq!([board.device.begin_read(), board.device.begin_read()], [true, false]);
    board.device.deliver();
    assert_eq!([board.device.begin_read(), board.device.begin_read()], [true, false]);
    board.report(2);
    board.report(3);
    assert!(!board.device.begin_read(), "nobody wants one any more");
    assert_eq!(board.reports().len(), 3);
}

#[test]
fn a_report_nobody_waits_for_any_more_is_kept_until_a_newer_one_comes() {
    let mut board = Board::new();
    board.report(1);
    assert!(board.device.report_waits());
    board.report(2);
    board.read(1, 512);
    assert_eq!(board.reports(), [], "whoever moves reports looks for a newer one first");
    board.device.deliver();
    assert_eq!(board.reports(), [(Reply::done(1, 512), vec![2; 512])]);
    assert!(!board.device.report_waits());
    let counters = board.device.counters();
    assert_eq!((counters.reports, counters.superseded), (1, 1));
}

#[test]
fn a_large_read_gets_several_reports_and_a_small_one_none() {
    let mut board = Board::new();
    board.read(1, 1024);
    board.report(1);
    assert_eq!(board.reports(), []);
    board.report(2);
    let both = [[1; 512], [2; 512]].concat();
    assert_eq!(board.reports(), [(Reply::done(1, 1024), both)]);

    // A packet of 512 bytes does not fit the rest: a host's controller reports that as babble.
    let overflow = |sequence, actual| Reply { status: -75, ..Reply::done(sequence, actual) };
    for (sequence, length) in [(2, 511), (3, 64), (4, 0)] {
        board.read(sequence, length);
        board.report(3);
        assert_eq!(board.reports(), [(overflow(sequence, 0), vec![])]);
    }
    board.read(5, 1000);
    board.report(4);
    board.report(5);
    assert_eq!(board.reports(), [(overflow(5, 512), vec![4; 512])]);
    let counters = board.device.counters();
    assert_eq!((counters.reports, counters.overflows), (3, 4));
}

#[test]
fn a_frame_is_held_until_the_board_has_taken_it() {
    let mut board = Board::new();
    board.write(1, &[0x11; 512]);
    board.write(2, &[0x22; 512]);
    assert!(board.device.has_frame());
    assert_eq!(board.next_frame(), Some(0x11));
    assert_eq!((board.next_frame(), board.device.has_frame()), (None, false), "one at a time");
    assert_eq!(board.replies(), []);
    // The board was busy: the same frame again.
    board.device.not_written();
    assert_eq!((board.replies(), board.next_frame()), (vec![], Some(0x11)));
    board.device.written();
    assert_eq!(board.replies(), [Reply::done(1, 512)]);
    assert_eq!(board.next_frame(), Some(0x22));
    board.device.written();
    assert_eq!(board.replies(), [Reply::done(2, 512)]);
    assert_eq!((board.next_frame(), board.device.counters().frames), (None, 2));
}

#[test]
fn a_large_write_is_several_frames() {
    let mut board = Board::new();
    board.write(1, &[[1; 512], [2; 512], [3; 512]].concat());
    for fill in 1..=3 {
        assert_eq!((board.replies(), board.next_frame()), (vec![], Some(fill)));
        board.device.written();
    }
    assert_eq!((board.replies(), board.next_frame()), (vec![Reply::done(1, 1536)], None));
    assert!(!board.device.hangs());
}

/// SK-9.7 A short OUT packet hangs the board until it is powered off: the packet itself is taken, no frame and no report
/// moves after it; endpoint 0 goes on.
#[test]
fn a_short_packet_hangs_the_board() {
    for (length, whole) in [(511, 0), (504, 0), (1, 0), (0, 0), (1000, 1), (1023, 1)] {
        let mut board = Board::new();
        board.read(1, 512);
        board.write(2, &vec![7; length]);
        for _ in 0..whole {
            assert_eq!((board.next_frame(), board.device.hangs()), (Some(7), false), "{length}");
            board.device.written();
        }
        assert_eq!(board.replies(), [Reply::done(2, length as u32)]);
        assert!(board.device.hangs());

        board.write(3, &[1; 512]);
        board.report(1);
        assert_eq!((board.next_frame(), board.device.wants_report(), board.device.has_frame()), (None, false, false));
        assert_eq!(board.replies(), [], "both are held");
        let status = board.control([0x80, 0, 0, 0, 0, 0, 2, 0], &[]);
        assert_eq!(status, Ok(vec![0, 0]));
        // The host's timeouts cancel them.
        assert!(!board.device.unlink(10, 3));
        assert!(!board.device.unlink(11, 1));
        assert_eq!(board.replies(), [Reply::unlinked(10), Reply::unlinked(11)]);
        let counters = board.device.counters();
        assert_eq!((counters.short_packets, counters.frames, counters.reports), (1, whole, 0));
    }
}

/// SK-9.7 A short packet hangs the board when its turn comes: frames before it are taken.
#[test]
fn frames_before_a_short_packet_are_taken() {
    let mut board = Board::new();
    board.write(1, &[1; 512]);
    board.write(2, &[2; 100]);
    board.write(3, &[3; 512]);
    assert_eq!((board.replies(), board.next_frame()), (vec![], Some(1)));
    board.device.written();
    assert_eq!(board.replies(), [Reply::done(1, 512), Reply::done(2, 100)]);
    assert_eq!((board.device.hangs(), board.next_frame()), (true, None));
}

#[test]
fn a_host_has_so_many_transfers_at_a_time() {
    let mut board = Board::new();
    for sequence in 0..TRANSFERS_AT_ONCE as u32 {
        board.read(sequence, 512);
        board.write(1000 + sequence, &[0; 512]);
    }
    assert_eq!(board.device.submit(&transfer(1, IN, 1, 512, [0; 8]), &[]), Err(TooMany));
    assert_eq!(board.device.submit(&transfer(1, OUT, 2, 512, [0; 8]), &[0; 512]), Err(TooMany));
    board.report(1);
    board.read(1, 512);
}
