//! Stopping the axes when their writer has vanished, when a client asks for it, and when a lost board is back.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::Instant;

use super::OnVanish;
use super::board::Board;
use super::client::Client;
use super::hub::{Hub, LeftMoving, TRIES_MAX};
use super::report_queue::ReportQueue;
use super::server_link::ServerLink;
use super::session::Left;
use crate::link::Link;
use crate::port::standstill::{LeftBoard, Standstill};
use crate::tcp::wire::StopEnd;

/// Called when a client has left. If it was the writer and has not closed its link, the server brings the axes to a
/// standstill; if the board is lost, when it is back. Until this attempt has ended, no other client can become the
/// writer.
pub(super) fn client_left(hub: &Arc<Hub>, board: &Arc<Board>, client: &Arc<Client>, left: &Left) {
    if let Some(queue) = hub.leave(client, matches!(left, Left::Closed)) {
        let on_vanish = client.overruled().map_or(hub.options.on_vanish, |stop| on_stop(hub, stop.off));
        brake(hub, board, Some(queue), LeftMoving::new(client.name.clone(), on_vanish));
    }
}

/// Brings the axes to a standstill for the client `by`, while there is no writer. `queue` has the reports since the
/// server itself has become the writer.
pub(super) fn stop_for(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<ReportQueue>, by: &str, off: bool) {
    brake(hub, board, Some(queue), LeftMoving::new(format!("the stop of {by}"), on_stop(hub, off)));
}

/// Brings axes to a standstill that were not stopped before the board was lost. Called by the thread of the board, before
/// it reads reports, and before a client can become the writer.
pub(super) fn board_is_back(hub: &Arc<Hub>, board: &Arc<Board>, left: LeftMoving) {
    hub.tell(&format!("{} had not stopped its axes when the board went away", left.who));
    brake(hub, board, None, LeftMoving::new(left.who, left.on_vanish));
}

/// Repeats a stop of axes that has failed, if the next attempt is due. Called by the thread of the board; on the real
/// clock only after a report. An attempt without reports would only keep clients from becoming the writer.
pub(super) fn try_again(hub: &Arc<Hub>, board: &Arc<Board>) {
    if let Some(left) = hub.begin_retry() {
        brake(hub, board, None, left);
    }
}

/// What happens to the axes when a client asks for a stop: they are stopped, even if the server was started with
/// [`OnVanish::Leave`].
fn on_stop(hub: &Hub, off: bool) -> OnVanish {
    if off || hub.options.on_vanish == OnVanish::ServoOff { OnVanish::ServoOff } else { OnVanish::Ramp }
}

/// Brings the axes of `left` to a standstill, and ends the time in which the server is the writer. If the stop fails,
/// it is repeated later; if the board is lost or gets lost, when it is back.
fn brake(hub: &Arc<Hub>, board: &Arc<Board>, queue: Option<Arc<ReportQueue>>, left: LeftMoving) {
    let ended = if hub.has(board) { bring_to_standstill(hub, board, queue, &left) } else { None };
    let has_failed = match &ended {
        Some(ended) => ended.end == StopEnd::Failed,
        None => !hub.has(board),
    };
    let (tries, failed_at) = (left.tries + 1, Some(Instant::now()));
    if has_failed && left.tries == 0 && hub.has(board) {
        hub.tell(&format!("it tries to stop them again while there is no writer, {} times", TRIES_MAX - 1));
    }
    hub.end_standstill(ended, has_failed.then_some(LeftMoving { tries, failed_at, ..left }));
}

fn bring_to_standstill(
    hub: &Arc<Hub>,
    board: &Arc<Board>,
    queue: Option<Arc<ReportQueue>>,
    left: &LeftMoving,
) -> Option<Standstill> {
    let server_link = ServerLink { hub: Arc::clone(hub), board: Arc::clone(board), queue };
    let link: Arc<dyn Link> = Arc::new(server_link);
    // Of all failed attempts, only the first and the last are logged. The lines of the others are logged only if the
    // attempt succeeds.
    let (lines, is_retry) = (RefCell::new(Vec::new()), (1..TRIES_MAX - 1).contains(&left.tries));
    let tell = |line: &str| if is_retry { lines.borrow_mut().push(line.to_owned()) } else { hub.tell(line) };
    let board = LeftBoard { link, watch: &|| board.watch(), who: &left.who, tell: &tell };
    let ended = board.bring_to_standstill(left.on_vanish);
    if ended.as_ref().is_some_and(|ended| ended.end != StopEnd::Failed) {
        lines.take().iter().for_each(|line| hub.tell(line));
    }
    ended
}
