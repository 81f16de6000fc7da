//! The host cancels a transfer (unlink): either the transfer gets its own answer, before that to the unlink, or the
//! answer to the unlink says that it was cancelled; never both, never neither.

use super::board::Board;
use support::usbip_client::Reply;

#[test]
fn a_read_that_waits_is_taken_back() {
    let mut board = Board::new();
    for sequence in 1..=3 {
        board.read(sequence, 512);
    }
    assert!(!board.device.unlink(10, 2));
    assert_eq!(board.replies(), [Reply::unlinked(10)]);
    board.report(1);
    board.report(2);
    let got: Vec<u32> = board.reports().into_iter().map(|(reply, _)| reply.sequence).collect();
    assert_eq!((got, board.device.wants_report()), (vec![1, 3], false));
}

#[test]
fn a_read_that_has_its_report_comes_first() {
    let mut board = Board::new();
    board.read(1, 512);
    board.report(7);
    assert!(!board.device.unlink(2, 1));
    let replies = board.reports();
    assert_eq!(replies[0], (Reply::done(1, 512), vec![7; 512]));
    assert_eq!(replies[1].0, Reply::too_late(2));
}

#[test]
fn an_unknown_transfer_is_gone_already() {
    let mut board = Board::new();
    assert!(!board.device.unlink(2, 77));
    assert_eq!(board.replies(), [Reply::too_late(2)]);
}

#[test]
fn a_frame_in_the_queue_is_taken_back() {
    let mut board = Board::new();
    board.write(1, &[1; 512]);
    board.write(2, &[2; 512]);
    board.write(3, &[3; 512]);
    assert_eq!(board.next_frame(), Some(1));
    assert!(!board.device.unlink(10, 2), "not the one under way");
    assert_eq!(board.replies(), [Reply::unlinked(10)]);
    board.device.written();
    assert_eq!(board.next_frame(), Some(3));
    assert_eq!(board.device.counters().writes_unlinked, 1);
}

#[test]
fn a_frame_that_the_board_is_being_given_is_taken_back_if_it_does_not_take_it() {
    let mut board = Board::new();
    board.write(1, &[1; 512]);
    board.write(2, &[2; 512]);
    assert_eq!(board.next_frame(), Some(1));
    assert!(board.device.unlink(10, 1), "the attempt is to end soon");
    assert_eq!(board.replies(), [], "nobody knows yet");
    board.device.not_written();
    assert_eq!(board.replies(), [Reply::unlinked(10)]);
    assert_eq!((board.next_frame(), board.device.counters().writes_unlinked), (Some(2), 1));
}

#[test]
fn a_frame_that_the_board_took_after_all_was_not_taken_back() {
    let mut board = Board::new();
    board.write(1, &[1; 512]);
    assert_eq!(board.next_frame(), Some(1));
    assert!(board.device.unlink(10, 1));
    board.device.written();
    assert_eq!(board.replies(), [Reply::done(1, 512), Reply::too_late(10)]);
    let counters = board.device.counters();
    assert_eq!((counters.frames, counters.writes_unlinked), (1, 0));
}

/// A second unlink of it while the result is open cancels nothing.
#[test]
fn a_frame_under_way_is_not_taken_from_the_board() {
    let mut board = Board::new();
    board.write(1, &[1; 512]);
    board.write(2, &[2; 512]);
    assert_eq!(board.next_frame(), Some(1));
    assert!(board.device.unlink(10, 1));
    assert!(!board.device.unlink(11, 1));
    assert_eq!(board.replies(), [Reply::too_late(11)]);
    board.device.written();
    assert_eq!(board.replies(), [Reply::done(1, 512), Reply::too_late(10)]);
    assert_eq!(board.next_frame(), Some(2));
}

#[test]
fn of_a_transfer_of_several_frames_the_rest_is_taken_back() {
    let mut board = Board::new();
    board.write(1, &[[1; 512], [2; 512]].concat());
    board.write(2, &[3; 512]);
    assert_eq!(board.next_frame(), Some(1));
    assert!(board.device.unlink(10, 1));
    board.device.written();
    assert_eq!(board.replies(), [Reply::unlinked(10)]);
    assert_eq!(board.next_frame(), Some(3));
}

/// SK-9.7 A short packet behind a cancelled frame is processed.
#[test]
fn what_comes_after_a_frame_that_was_taken_back_goes_on() {
    let mut board = Board::new();
    board.write(1, &[1; 512]);
    board.write(2, &[2; 5]);
    assert!(!board.device.unlink(10, 1), "the board has not been given it yet");
    assert_eq!(board.replies(), [Reply::unlinked(10), Reply::done(2, 5)]);
    assert!(board.device.hangs());
}
