//! The boards that this process has opened.

use crate::board::{OpenBoard, VendorBoard};
use crate::handles::{Handles, OF_BOARDS};

/// The board that the vendor's functions use.
pub static VENDOR_BOARD: VendorBoard = VendorBoard::new();

/// The boards that `ecmsk_open` has opened, by handle.
pub static HANDLES: Handles<OpenBoard> = Handles::new(OF_BOARDS);

/// Calls `look` with each open board.
#[cfg(target_os = "linux")]
pub fn each(mut look: impl FnMut(&OpenBoard)) {
    if let Ok(board) = VENDOR_BOARD.get() {
        look(&board);
    }
    HANDLES.all().iter().for_each(|board| look(board));
}

/// Ends the links of all boards that are still open when the process exits ([`VendorBoard::vanish`]).
#[cfg(unix)]
pub fn vanish_all() {
    VENDOR_BOARD.vanish();
    for board in HANDLES.drain() {
        board.vanish();
    }
}
