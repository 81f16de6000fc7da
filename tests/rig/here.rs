//! `ecmsk serve usbip --attach`: without `usbip`, and attached again by itself.

use std::time::Duration;

use ecmsk::sk::{Frame, MasterCommand, SlotSize};

use super::hidraw::Hidraw;
use support::served::{Board, PATIENCE, Served, until};

#[test]
fn a_board_is_attached_at_once_and_again_after_a_reset() {
    let served = Served::start(&["sim:?slaves=io"], &["--attach"]);
    let shown = until("the kernel shows it", || Board::all().pop());
    let board = Hidraw::open(&shown);
    assert!(board.get(PATIENCE).expect("it is there").is_some());
    let mut reset = Frame::new();
    reset.put_master(SlotSize::Bytes12, &MasterCommand::SoftReset);
    // It may be detached before it has answered.
    let _ = board.put(reset.bytes());
    until("reads end with an error", || board.get(Duration::from_millis(100)).err());
    drop(board);
    let again = until("it is back", || Board::all().into_iter().find(|board| board.hid != shown.hid));
    assert!(Hidraw::open(&again).get(PATIENCE).expect("it is there").is_some());
    served.stop();
    until("it is detached", || Board::all().is_empty().then_some(()));
}
