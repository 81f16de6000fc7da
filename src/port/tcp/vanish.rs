//! Stopping the axes when their writer has vanished.

use std::sync::Arc;

use super::client::Client;
use super::hub::{Board, Hub};
use super::report_queue::ReportQueue;
use super::server_link::ServerLink;
use super::session::Left;
use crate::link::Link;
use crate::port::standstill::LeftBoard;

/// Called when a client has left. If it was the writer, has not closed its link, and the board is not lost, the server
/// brings the axes to a standstill. Only then can another client become the writer.
pub(super) fn client_left(hub: &Arc<Hub>, board: &Arc<Board>, client: &Arc<Client>, left: &Left) {
    let is_trusted = matches!(left, Left::Closed) || !hub.has(board);
    if let Some(queue) = hub.leave(client, is_trusted) {
        bring_to_standstill(hub, board, queue, &client.name);
        hub.end_standstill();
    }
}

fn bring_to_standstill(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<ReportQueue>, who: &str) {
    let server_link = ServerLink { hub: Arc::clone(hub), board: Arc::clone(board), queue };
    let link: Arc<dyn Link> = Arc::new(server_link);
    LeftBoard { link, watch: &|| board.watch(), who, tell: &|line| hub.tell(line) }
        .bring_to_standstill(hub.options.on_vanish);
}
