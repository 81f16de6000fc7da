//! A report and a frame allocate nothing once their buffers exist.

use ecmsk::sk::Frame;

use super::board::{Board, transfer};
use support::usbip_client::{IN, OUT};

#[test]
fn after_the_first_rounds_a_report_and_a_frame_allocate_nothing() {
    let mut board = Board::new();
    let (read, write) = (transfer(1, IN, 1, 512, [0; 8]), transfer(2, OUT, 2, 512, [0; 8]));
    let (report, mut frame, mut replies) = (Frame::new(), Frame::new(), Vec::new());
    let mut round = || {
        // As usbhid does: two reads wait, a frame comes, one more behind it.
        board.device.submit(&read, &[]).unwrap();
        board.device.submit(&read, &[]).unwrap();
        board.device.submit(&write, report.bytes()).unwrap();
        board.device.submit(&write, report.bytes()).unwrap();
        board.device.report(&report);
        assert!(board.device.begin_write(&mut frame));
        board.device.written();
        board.device.unlink(3, 2);
        board.device.report(&report);
        board.device.take_replies(&mut replies);
        assert!(!replies.is_empty());
    };
    (0..4).for_each(|_| round());
    let used = allocation_counter::measure(|| (0..1000).for_each(|_| round()));
    assert_eq!(used.count_total, 0);
}
