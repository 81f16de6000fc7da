//! Boards whose EC01M is a model that runs in this process: the engine as a link, and the boards over real hardware.
//!
//! - `engine.rs`: the link to such a board, on the real clock or in virtual time
//! - `options.rs`: the keys of links to such boards, as Rust types
//! - `rejections.rs`, `episodes.rs`: log lines about commands that the board did not execute
//! - `nic/`: the link `nic:`, to slaves on a network card
//! - `chip.rs`: a board that reaches its slaves over an ECM-XF
//!
//! A board over real hardware ends with this process. Closing its link stops the axes and brings the network to PreOP
//! ([`Board::switch_off`]), which takes some seconds at most. A process that is killed cannot do that.

pub mod chip;
pub mod engine;
mod episodes;
#[cfg(all(feature = "nic", target_os = "linux"))]
pub(crate) mod nic;
pub mod options;
mod rejections;

use crate::engine::Board;
use crate::fieldbus::Ns;
use engine::Keeper;

/// How long the board may take to find its slaves and to bring them to PreOP. \[OURS]
const BOOT_LIMIT_NS: Ns = 60_000_000_000;
/// The time between two checks whether the start has failed, ns. A network without slaves is scanned for this time.
/// \[OURS]
const SCAN_NS: Ns = 3_000_000_000;

/// Starts the board. Returns whether it has found slaves and brought them to PreOP.
pub(crate) fn boots(board: &mut Board) -> bool {
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

/// The callback for the closing of a link: it switches the board off, and logs the axes that are still on.
pub(crate) fn switching_off() -> Keeper {
    Box::new(|board| {
        let Some(mut board) = board else { return };
        let still_on = board.switch_off();
        if board.cards_gone().is_some_and(|gone| gone.is_all) {
            // All network cards are gone, so no frame reaches the slaves any more. Their watchdogs stop the axes.
            return;
        }
        for slave in still_on.iter() {
            log::error!("the axis of slave {slave} was still on when its board was closed: stop it by hand");
        }
    })
}
