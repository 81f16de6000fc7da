//! Boards of this process that outlive their links: a simulated board stays switched on when its link is closed, as a
//! real one does.
//!
//! A board that is not open is parked: plain state and the moment it was parked, no thread.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::LinkError;
use super::options::SimOptions;
use crate::engine::Board;
use crate::fieldbus::sim::SimHandle;

/// How a board is found again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// By its `name=`.
    Name(String),
    /// By what it is.
    Options(Box<SimOptions>),
}

enum Place {
    /// A link has it.
    Open,
    /// Nobody has it.
    Parked { board: Box<Board>, network: SimHandle, since: Instant },
}

struct Entry {
    key: Key,
    options: SimOptions,
    place: Place,
}

static BOARDS: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

fn boards() -> MutexGuard<'static, Vec<Entry>> {
    BOARDS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A board that was parked, its network, and since when.
pub(super) type Parked = (Board, SimHandle, Instant);

/// Takes the board of that key out of its place; or keeps the place for a new one (`None`). `uri` is what messages call
/// it.
pub(super) fn claim(key: &Key, options: &SimOptions, uri: &str) -> Result<Option<Parked>, LinkError> {
    let mut boards = boards();
    let Some(entry) = boards.iter_mut().find(|entry| entry.key == *key) else {
        boards.push(Entry { key: key.clone(), options: options.clone(), place: Place::Open });
        return Ok(None);
    };
    if entry.options != *options {
        return Err(LinkError::NoBoard {
            name: uri.into(),
            reason: "this process has a board of that name already, with other options; \
                     use the same options, or another `name=`"
                .into(),
        });
    }
    match std::mem::replace(&mut entry.place, Place::Open) {
        Place::Open => Err(LinkError::InUse {
            name: uri.into(),
            by: " by this process".into(),
            instead: "give this board a `name=` of its own",
        }),
        Place::Parked { board, network, since } => Ok(Some((*board, network, since))),
    }
}

/// Puts a board (back) to its place.
pub(super) fn park(key: &Key, board: Board, network: SimHandle) {
    if let Some(entry) = boards().iter_mut().find(|entry| entry.key == *key) {
        entry.place = Place::Parked { board: Box::new(board), network, since: Instant::now() };
    }
}

/// Gives a claimed place up without a board.
pub(super) fn forget(key: &Key) {
    boards().retain(|entry| entry.key != *key);
}

/// Throws the boards of this process away that nobody has open: the next link finds a new one. Says how many are open.
#[doc(hidden)]
pub fn forget_parked() -> usize {
    let mut boards = boards();
    boards.retain(|entry| matches!(entry.place, Place::Open));
    boards.len()
}
