//! Links of any kind: opening them, and how their waits end.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use ecmsk::link::{self, Dir, Link, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, SlotSize, StateByte};

/// Slot size of the boards used by [`frame`] and [`state`].
const SIZE: SlotSize = SlotSize::Bytes12;

#[track_caller]
pub fn open(uri: &str) -> Arc<dyn Link> {
    link::open(uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

#[track_caller]
pub fn refused(uri: &str) -> LinkError {
    link::open(uri, Share::ByName).map(|_| ()).unwrap_err()
}

pub fn frame(command: MasterCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(SIZE, &command);
    frame
}

pub fn state(report: &Frame) -> StateByte {
    MasterResponse::decode(&report.slot(SIZE, 0)).state
}

/// Reads of a board that sends no report end by their limit, by cancelling and by closing, and leave the frame
/// unchanged.
#[track_caller]
pub fn reads_end(board: &Arc<dyn Link>) {
    let mut untouched = Frame::from_bytes([0xA5; 512]);
    for wait in [Wait::Now, Wait::For(Duration::from_millis(50))] {
        let error = board.read(&mut untouched, wait).unwrap_err();
        assert!(matches!(error, LinkError::Timeout { dir: Dir::Read, .. }), "{error}");
    }
    assert_eq!(untouched, Frame::from_bytes([0xA5; 512]));
    let waiting = || {
        let board = board.clone();
        thread::spawn(move || board.read(&mut Frame::new(), Wait::Forever))
    };
    let reader = waiting();
    while !reader.is_finished() {
        board.cancel(Dir::Read);
        thread::sleep(Duration::from_millis(5));
    }
    assert!(matches!(reader.join().expect("it ends"), Err(LinkError::Cancelled { .. })));
    let reader = waiting();
    board.close();
    assert!(matches!(reader.join().expect("it ends"), Err(LinkError::Closed)));
}
