//! What becomes of moving axes when their writer is gone: the server brings them to a standstill, as the native API does
//! when a program closes it.

use std::sync::Arc;
use std::time::Duration;

use super::OnVanish;
use super::client::Client;
use super::hub::{Board, Hub};
use super::seat::{Queue, Seat};
use super::session::Left;
use crate::ecm::{Close, Ecm, EcmError, Options, Succeeded};
use crate::link::{Link, Wait};
use crate::sk::{FifoAction, Frame, MasterCommand};

/// How long a board that makes no reports may take for a frame. \[OURS]
const LAST_FRAME: Duration = Duration::from_millis(200);

/// A client is gone: what it has moved comes to a standstill, unless it has closed its link or the board is lost, and its place
/// is free.
pub(super) fn part(hub: &Arc<Hub>, board: &Arc<Board>, client: &Arc<Client>, left: &Left) {
    let is_trusted = matches!(left, Left::Closed) || !hub.has(board);
    if let Some(queue) = hub.leave(client, is_trusted) {
        settle(hub, board, queue, &client.who);
        hub.leave_seat();
    }
}

/// Brings axes to a standstill; within the limits of [`Ecm::close`].
fn settle(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<Queue>, who: &str) {
    let off = match hub.options.on_vanish {
        OnVanish::Leave => return hub.tell("axes are left as they are (on-vanish=leave)"),
        OnVanish::Ramp => false,
        OnVanish::ServoOff => true,
    };
    let seat = Arc::new(Seat { hub: Arc::clone(hub), board: Arc::clone(board), queue });
    if seat.check().is_err() {
        return;
    }
    let dropped = |entries: u16| match entries {
        0 => String::new(),
        1 => "; one command that waited in the FIFO was dropped".to_owned(),
        entries => format!("; {entries} commands that waited in the FIFO were dropped"),
    };
    match stop(&seat, off) {
        Ok(Succeeded::Stand { dropped: entries }) => {
            hub.tell(&format!("axes stand still after {who}{}", dropped(entries)));
        }
        Ok(Succeeded::NotInOp) => {}
        Ok(Succeeded::Unknown { dropped: entries }) => hub.tell(&format!(
            "the network was configured before this server came: what moves is not known to it and goes on{}; \
             use the emergency stop if axes move",
            dropped(entries)
        )),
        Err(error) => hub.tell(&format!("axes may still move after {who}: {error}; use the emergency stop")),
    }
}

fn stop(seat: &Arc<Seat>, off: bool) -> Result<Succeeded, EcmError> {
    let options = Options { close: Close::Leave, ..Options::default() };
    let watch = || seat.board.watch();
    let begun = Ecm::over(Arc::clone(seat) as Arc<dyn Link>, options)
        .and_then(|ecm| ecm.see_what_is_left(&watch).map(|()| ecm));
    match begun {
        Ok(ecm) => ecm.succeed(&watch(), off),
        Err(error) => {
            drop_unseen(seat);
            Err(error)
        }
    }
}

/// A board that makes no reports may take frames all the same: what waits in its FIFO is not executed once its cable is
/// plugged again.
fn drop_unseen(seat: &Seat) {
    let Some(size) = seat.board.info.slot else { return };
    let mut clear = Frame::new();
    clear.put_master(size, &MasterCommand::SetFifo(FifoAction::Clear));
    clear.fill_crc(size);
    if let Err(error) = seat.write(&clear, Wait::For(LAST_FRAME)) {
        seat.hub.tell(&format!(
            "what waits in the board's FIFO stays there: {error}; use the emergency stop before its cable is plugged"
        ));
    }
}
