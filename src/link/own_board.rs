//! Boards over real hardware whose EC01M is the model in this process: how they are opened, and what closing them does.
//!
//! Such a board is gone with this process. When its link is closed, its axes are brought to a standstill and the network to
//! PreOP ([`Board::switch_off`]), which takes some seconds at most. A process that is killed cannot do that.

use super::engine::Keeper;
use crate::engine::Board;
use crate::fieldbus::Ns;

/// How long the board may take to find its slaves and to bring them to PreOP. \[OURS]
const BOOT_LIMIT_NS: Ns = 60_000_000_000;
/// For so long a network without a slave is scanned. \[OURS]
const SCAN_NS: Ns = 3_000_000_000;

/// Whether the board comes up: it has found slaves, and they have come to PreOP.
pub(super) fn boots(board: &mut Board) -> bool {
    let end = board.now() + BOOT_LIMIT_NS;
    while board.now() < end {
        if board.boot(SCAN_NS) {
            return true;
        }
        if board.engine().state().is_failed() || board.cards_gone().is_some_and(|gone| gone.is_all) {
            break;
        }
    }
    false
}

/// What becomes of a board whose link is closed.
pub(super) fn switching_off() -> Keeper {
    Box::new(|board| {
        let Some(mut board) = board else { return };
        let still_on = board.switch_off();
        if board.cards_gone().is_some_and(|gone| gone.is_all) {
            // No frame reaches them any more, and their watchdogs stop them.
            return;
        }
        for slave in still_on.iter() {
            log::error!("the axis of slave {slave} was still on when its board was closed: stop it by hand");
        }
    })
}
