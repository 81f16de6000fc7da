//! Stopping the axes when their writer has vanished: the server brings them to a standstill, as the native API does
//! when a program closes it.

use std::sync::Arc;
use std::time::Duration;

use super::OnVanish;
use super::client::Client;
use super::hub::{Board, Hub};
use super::report_queue::ReportQueue;
use super::server_link::ServerLink;
use super::session::Left;
use crate::ecm::{Close, Ecm, EcmError, Options, Succeeded};
use crate::link::{Link, Wait};
use crate::sk::{FifoAction, Frame, MasterCommand};

/// The timeout for writing a frame to a board that makes no reports. \[OURS]
const CLEAR_WRITE_MAX: Duration = Duration::from_millis(200);

/// Called when a client has left. Unless it has closed its link or the board is lost, the axes that it has moved are
/// brought to a standstill. Then its place is free.
pub(super) fn client_left(hub: &Arc<Hub>, board: &Arc<Board>, client: &Arc<Client>, left: &Left) {
    let is_trusted = matches!(left, Left::Closed) || !hub.has(board);
    if let Some(queue) = hub.leave(client, is_trusted) {
        bring_to_standstill(hub, board, queue, &client.name);
        hub.end_standstill();
    }
}

/// Brings the axes to a standstill, within the time limits of [`Ecm::close`].
fn bring_to_standstill(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<ReportQueue>, who: &str) {
    let off = match hub.options.on_vanish {
        OnVanish::Leave => return hub.tell("axes are left as they are (on-vanish=leave)"),
        OnVanish::Ramp => false,
        OnVanish::ServoOff => true,
    };
    let server_link = Arc::new(ServerLink { hub: Arc::clone(hub), board: Arc::clone(board), queue });
    if server_link.check().is_err() {
        return;
    }
    let dropped = |entries: u16| match entries {
        0 => String::new(),
        1 => "; one command that waited in the FIFO was dropped".to_owned(),
        entries => format!("; {entries} commands that waited in the FIFO were dropped"),
    };
    match stop_axes(&server_link, off) {
        Ok(Succeeded::Stand { discarded: entries }) => {
            hub.tell(&format!("axes stand still after {who}{}", dropped(entries)));
        }
        Ok(Succeeded::NotInOp) => {}
        Ok(Succeeded::Unknown { discarded: entries }) => hub.tell(&format!(
            "the network was configured before this server came: what moves is not known to it and goes on{}; \
             use the emergency stop if axes move",
            dropped(entries)
        )),
        Err(error) => hub.tell(&format!("axes may still move after {who}: {error}; use the emergency stop")),
    }
}

fn stop_axes(server_link: &Arc<ServerLink>, off: bool) -> Result<Succeeded, EcmError> {
    let options = Options { close: Close::Leave, ..Options::default() };
    let watch = || server_link.board.watch();
    let begun = Ecm::over(Arc::clone(server_link) as Arc<dyn Link>, options)
        .and_then(|ecm| ecm.see_what_is_left(&watch).map(|()| ecm));
    match begun {
        Ok(ecm) => ecm.succeed(&watch(), off),
        Err(error) => {
            clear_fifo_unseen(server_link);
            Err(error)
        }
    }
}

/// Clears the FIFO of a board that makes no reports. It may take frames nevertheless, and the entries of its FIFO must
/// not be executed when its cable is plugged in again.
fn clear_fifo_unseen(server_link: &ServerLink) {
    let Some(size) = server_link.board.info.slot else { return };
    let mut clear = Frame::new();
    clear.put_master(size, &MasterCommand::SetFifo(FifoAction::Clear));
    clear.fill_crc(size);
    if let Err(error) = server_link.write(&clear, Wait::For(CLEAR_WRITE_MAX)) {
        server_link.hub.tell(&format!(
            "what waits in the board's FIFO stays there: {error}; use the emergency stop before its cable is plugged"
        ));
    }
}
