//! Boards that are detached and attached again.

use std::time::Duration;

use ecmsk::sk::{Frame, MasterCommand, SlotSize};

use super::hidraw::Hidraw;
use support::served::{Board, PATIENCE, Served, attach, detach_all, until};

/// Reads until the board is gone.
fn until_gone(board: &Hidraw) {
    until("reads end with an error", || board.get(Duration::from_millis(100)).err());
    until("the kernel has removed it", || Board::all().is_empty().then_some(()));
}

/// WIRE-7
#[test]
fn a_host_attaches_and_detaches_as_often_as_it_likes() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    for _ in 0..10 {
        let board = Hidraw::open(&attach("1-1"));
        assert!(board.get(PATIENCE).expect("it is there").is_some());
        drop(board);
        detach_all();
    }
}

#[test]
fn a_server_that_is_killed_takes_its_boards_away() {
    let served = Served::start(&["sim:?slaves=io"], &[]);
    let board = Hidraw::open(&attach("1-1"));
    assert!(board.get(PATIENCE).expect("it is there").is_some());
    served.kill();
    until_gone(&board);
    assert!(board.put(&[0; 512]).is_err());
    // Another server, another attach.
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    let board = Hidraw::open(&attach("1-1"));
    assert!(board.get(PATIENCE).expect("it is there").is_some());
    detach_all();
}

#[test]
fn a_board_that_is_reset_goes_and_can_be_attached_again() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    let board = Hidraw::open(&attach("1-1"));
    let mut reset = Frame::new();
    reset.put_master(SlotSize::Bytes12, &MasterCommand::SoftReset);
    // It may be detached before it has answered.
    let _ = board.put(reset.bytes());
    until_gone(&board);
    let shown = until("it is back", || {
        let done = support::served::usbip(&["attach", "-r", "127.0.0.1", "-b", "1-1"]);
        done.status.success().then(|| until("the kernel shows it", || Board::all().pop()))
    });
    assert!(Hidraw::open(&shown).get(PATIENCE).expect("it is there").is_some());
    detach_all();
}
