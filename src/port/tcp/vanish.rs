//! Stopping the axes when their writer has vanished, and when a client asks for it.

use std::sync::Arc;

use super::OnVanish;
use super::board::Board;
use super::client::Client;
use super::hub::Hub;
use super::report_queue::ReportQueue;
use super::server_link::ServerLink;
use super::session::Left;
use crate::link::Link;
use crate::port::standstill::{LeftBoard, Standstill};

/// Called when a client has left. If it was the writer, has not closed its link, and the board is not lost, the server
/// brings the axes to a standstill. Only then can another client become the writer.
pub(super) fn client_left(hub: &Arc<Hub>, board: &Arc<Board>, client: &Arc<Client>, left: &Left) {
    let is_trusted = matches!(left, Left::Closed) || !hub.has(board);
    if let Some(queue) = hub.leave(client, is_trusted) {
        let on_vanish = client.overruled().map_or(hub.options.on_vanish, |stop| on_stop(hub, stop.off));
        hub.end_standstill(bring_to_standstill(hub, board, queue, &client.name, on_vanish));
    }
}

/// Brings the axes to a standstill for the client `by`, while there is no writer. `queue` has the reports since the
/// server itself has become the writer.
pub(super) fn stop_for(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<ReportQueue>, by: &str, off: bool) {
    let who = format!("the stop of {by}");
    hub.end_standstill(bring_to_standstill(hub, board, queue, &who, on_stop(hub, off)));
}

/// What happens to the axes when a client asks for a stop: they are stopped, whatever the server was started with.
fn on_stop(hub: &Hub, off: bool) -> OnVanish {
    if off || hub.options.on_vanish == OnVanish::ServoOff { OnVanish::ServoOff } else { OnVanish::Ramp }
}

fn bring_to_standstill(
    hub: &Arc<Hub>,
    board: &Arc<Board>,
    queue: Arc<ReportQueue>,
    who: &str,
    on_vanish: OnVanish,
) -> Option<Standstill> {
    let server_link = ServerLink { hub: Arc::clone(hub), board: Arc::clone(board), queue };
    let link: Arc<dyn Link> = Arc::new(server_link);
    LeftBoard { link, watch: &|| board.watch(), who, tell: &|line| hub.tell(line) }.bring_to_standstill(on_vanish)
}
