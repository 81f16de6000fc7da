//! The thread that owns the board: it reads every report, and opens the board again after a loss.

use std::sync::Arc;
use std::time::Duration;

use super::board::Board;
use super::hub::{Hub, LeftMoving};
use super::vanish;
use crate::link::{Link, LinkError, Wait};
use crate::sk::Frame;

/// How often a waiting read checks whether the server is being stopped. \[OURS]
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(100);
/// The pause between two attempts to open a lost board. \[OURS]
const RETRY_INTERVAL: Duration = Duration::from_millis(100);

/// How often the server checks whether the clients of a lost board have left. \[OURS]
const LEAVE_CHECK_INTERVAL: Duration = Duration::from_millis(5);

type Open<'a> = &'a mut (dyn FnMut() -> Result<Arc<dyn Link>, LinkError> + Send);

pub(super) fn run(hub: &Arc<Hub>, first: Arc<Board>, open: Open<'_>) {
    let mut board = first;
    loop {
        serve(hub, &board);
        board.link.close();
        let Some((next, left)) = reopen(hub, &board, open) else { return };
        hub.tell("the board is back");
        board = next;
        if let Some(left) = left {
            vanish::board_is_back(hub, &board, left);
        }
    }
}

/// Reads the board's reports and passes them to the clients, until the board is lost or the server ends.
fn serve(hub: &Arc<Hub>, board: &Arc<Board>) {
    let mut frame = Frame::new();
    while !hub.is_over() && hub.has(board) {
        if board.info.virtual_time {
            // On virtual time this thread reads no reports: the writer's requests read them.
            hub.wait(STOP_CHECK_INTERVAL);
            vanish::try_again(hub, board);
            continue;
        }
        match board.link.read(&mut frame, Wait::For(STOP_CHECK_INTERVAL)) {
            Ok(meta) => {
                hub.publish(board, &frame, meta);
                vanish::try_again(hub, board);
            }
            Err(LinkError::Timeout { .. } | LinkError::Silent { .. } | LinkError::Cancelled { .. }) => {}
            Err(error) => hub.lose(board, &error),
        }
    }
}

/// Opens the board again, however many attempts it takes. Returns it, and the axes that have to be stopped; `None`: the
/// server ends.
fn reopen(hub: &Hub, lost: &Board, open: Open<'_>) -> Option<(Arc<Board>, Option<LeftMoving>)> {
    // The clients of the lost board leave first: then it is known whether its writer has closed its link.
    while !hub.is_quiet() && !hub.is_over() {
        hub.wait(LEAVE_CHECK_INTERVAL);
    }
    let mut told = String::new();
    loop {
        if hub.is_over() {
            return None;
        }
        match open() {
            Ok(link) => return Some(hub.attach_again(link, lost)),
            Err(error) => {
                // The same reason is logged only once, however often opening fails for it.
                let line = format!("the board cannot be opened yet: {error}");
                if line != told {
                    hub.tell(&line);
                    told = line;
                }
            }
        }
        hub.wait(RETRY_INTERVAL);
    }
}
