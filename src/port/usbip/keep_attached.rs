//! Boards of the server that are attached to this machine itself (`--attach`), and attached again whenever their links
//! are back.

use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use super::attach::{self, AttachError};
use super::board::{Board, Event};
use super::stream::Stream;
use crate::threads;

/// Attaches board `index` to this machine. The returned thread ends when the kernel detaches the board. Fails if the
/// kernel does not attach the board, or a host has attached it already.
pub(super) fn attach(boards: &Arc<[Board]>, index: usize, vhci: &Path) -> Result<JoinHandle<()>, AttachError> {
    let board = &boards[index];
    let (stream, port) = attach::attach(vhci, board.device_id())?;
    let session = board.take(Stream::Local(stream)).map_err(|_| AttachError::Taken)?;
    let boards = boards.clone();
    let serve = move || boards[index].serve(&session, &format!("this machine, port {port}"));
    threads::spawn("usbip-here", serve).map_err(AttachError::Refused)
}

/// Watches board `index` until the server stops. A lost link is opened again, with an attempt every `retry`; with
/// `vhci`, the board is then attached to this machine again. `attached`: the thread that serves the board's first
/// attachment, if there is one. Before the function returns, it waits for the ends of all such threads.
pub(super) fn keep(
    boards: &Arc<[Board]>,
    index: usize,
    retry: Duration,
    vhci: Option<&Path>,
    attached: Option<JoinHandle<()>>,
) {
    let board = &boards[index];
    let mut threads: Vec<JoinHandle<()>> = attached.into_iter().collect();
    board.keep(retry, &mut || {
        threads.retain(|thread| !thread.is_finished());
        let Some(vhci) = vhci else { return };
        match attach(boards, index, vhci) {
            Ok(thread) => threads.push(thread),
            Err(error) => {
                board.tell(Event::NotAttached { bus_id: board.bus_id().to_owned(), why: error.to_string() });
            }
        }
    });
    for thread in threads {
        let _ = thread.join();
    }
}
