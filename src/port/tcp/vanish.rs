//! Stopping the axes when their writer has vanished, when a client asks for it, and when a lost board is back.

use std::sync::Arc;

use super::OnVanish;
use super::board::Board;
use super::client::Client;
use super::hub::{Hub, LeftMoving};
use super::report_queue::ReportQueue;
use super::server_link::ServerLink;
use super::session::Left;
use crate::link::Link;
use crate::port::standstill::{LeftBoard, Standstill};
use crate::tcp::wire::StopEnd;

/// Called when a client has left. If it was the writer and has not closed its link, the server brings the axes to a
/// standstill; if the board is lost, when it is back. Only then can another client become the writer.
pub(super) fn client_left(hub: &Arc<Hub>, board: &Arc<Board>, client: &Arc<Client>, left: &Left) {
    if let Some(queue) = hub.leave(client, matches!(left, Left::Closed)) {
        let on_vanish = client.overruled().map_or(hub.options.on_vanish, |stop| on_stop(hub, stop.off));
        brake(hub, board, Some(queue), LeftMoving { who: client.name.clone(), on_vanish });
    }
}

/// Brings the axes to a standstill for the client `by`, while there is no writer. `queue` has the reports since the
/// server itself has become the writer.
pub(super) fn stop_for(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<ReportQueue>, by: &str, off: bool) {
    brake(hub, board, Some(queue), LeftMoving { who: format!("the stop of {by}"), on_vanish: on_stop(hub, off) });
}

/// Brings axes to a standstill that were not stopped before the board was lost. Called by the thread of the board, before
/// it reads reports, and before a client can become the writer.
pub(super) fn board_is_back(hub: &Arc<Hub>, board: &Arc<Board>, left: LeftMoving) {
    hub.tell(&format!("{} had not stopped its axes when the board went away", left.who));
    brake(hub, board, None, left);
}

/// What happens to the axes when a client asks for a stop: they are stopped, whatever the server was started with.
fn on_stop(hub: &Hub, off: bool) -> OnVanish {
    if off || hub.options.on_vanish == OnVanish::ServoOff { OnVanish::ServoOff } else { OnVanish::Ramp }
}

/// Brings the axes of `left` to a standstill, and ends the time in which the server is the writer. If that fails, and the
/// board is or gets lost, it is tried again when the board is back.
fn brake(hub: &Arc<Hub>, board: &Arc<Board>, queue: Option<Arc<ReportQueue>>, left: LeftMoving) {
    let ended = if hub.has(board) { bring_to_standstill(hub, board, queue, &left) } else { None };
    let has_failed = match &ended {
        Some(ended) => ended.end == StopEnd::Failed,
        None => !hub.has(board),
    };
    hub.end_standstill(ended, has_failed.then_some(left));
}

fn bring_to_standstill(
    hub: &Arc<Hub>,
    board: &Arc<Board>,
    queue: Option<Arc<ReportQueue>>,
    left: &LeftMoving,
) -> Option<Standstill> {
    let server_link = ServerLink { hub: Arc::clone(hub), board: Arc::clone(board), queue };
    let link: Arc<dyn Link> = Arc::new(server_link);
    let board = LeftBoard { link, watch: &|| board.watch(), who: &left.who, tell: &|line| hub.tell(line) };
    board.bring_to_standstill(left.on_vanish)
}
