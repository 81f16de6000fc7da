//! The simulated boards of this process that outlive their links. Like a real board, a simulated one stays powered when
//! its link is closed.
//!
//! A board without a link is parked: its state and the time of parking are kept, and no thread runs for it. The next
//! link advances the board by the time that has passed since then, at most by `catch_up_ms=`. On a virtual clock, time
//! passes only if the program's waits take virtual time.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use super::options::SimOptions;
use crate::engine::Board;
use crate::fieldbus::sim::SimHandle;
use crate::link::LinkError;
use crate::recording::Clock;

/// The key of a board that can be parked: a later link with the same key gets the parked board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Key {
    /// The value of the link's key `name=`.
    Name(String),
    /// All options of a link without a name.
    Options(Box<SimOptions>),
}

struct Entry {
    key: Key,
    options: SimOptions,
    /// The parked board; `None` while a link uses the board.
    parked: Option<Box<Parked>>,
}

static BOARDS: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

fn boards() -> MutexGuard<'static, Vec<Entry>> {
    BOARDS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A parked board, the handle of its network, and the time of parking.
pub(crate) type Parked = (Board, SimHandle, Since);

/// The clock of a program whose waits take virtual time, in nanoseconds.
static PROGRAM_CLOCK: OnceLock<fn() -> u64> = OnceLock::new();

/// Sets the clock of a program whose waits take virtual time. It measures how long boards are parked. The C library
/// calls this; only the first call has an effect.
#[doc(hidden)]
pub fn use_program_clock(clock: fn() -> u64) {
    let _ = PROGRAM_CLOCK.set(clock);
}

/// The time at which a board was parked, on the real clock and on the clock of the program.
pub(crate) struct Since {
    real: Instant,
    /// The time of [`PROGRAM_CLOCK`], ns; 0 if no such clock is set.
    program_ns: u64,
}

impl Since {
    fn now() -> Self {
        Self { real: Instant::now(), program_ns: program_ns() }
    }

    /// The time for which a board on this clock has been parked. On a virtual clock it is 0 if no [`PROGRAM_CLOCK`] is
    /// set.
    pub(crate) fn elapsed(&self, clock: Clock) -> Duration {
        match clock {
            Clock::Real => self.real.elapsed(),
            Clock::Virtual => Duration::from_nanos(program_ns().saturating_sub(self.program_ns)),
        }
    }
}

fn program_ns() -> u64 {
    PROGRAM_CLOCK.get().map_or(0, |clock| clock())
}

/// Reserves the board with the key `key` for a link, until [`park`] or [`forget`]. Returns the parked board, or `None`
/// if there is none yet and the caller has to make one. Fails if another link uses the board, or if the board has other
/// options. `uri` is the name of the link in error messages.
pub(crate) fn claim(key: &Key, options: &SimOptions, uri: &str) -> Result<Option<Box<Parked>>, LinkError> {
    let mut boards = boards();
    let Some(entry) = boards.iter_mut().find(|entry| entry.key == *key) else {
        boards.push(Entry { key: key.clone(), options: options.clone(), parked: None });
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
    entry.parked.take().map(Some).ok_or_else(|| LinkError::InUse {
        name: uri.into(),
        by: " by this process".into(),
        instead: "give this board a `name=` of its own",
    })
}

/// Parks the board of a link that was closed, with the present time, so that the next link can let it catch up.
pub(crate) fn park(key: &Key, board: Board, network: SimHandle) {
    park_since(key, board, network, Since::now());
}

/// Parks a board again with its former time of parking, because the link that has claimed it does not open.
pub(crate) fn park_since(key: &Key, board: Board, network: SimHandle, since: Since) {
    if let Some(entry) = boards().iter_mut().find(|entry| entry.key == *key) {
        entry.parked = Some(Box::new((board, network, since)));
    }
}

/// Cancels the reservation made by [`claim`], for a caller that could not make a board.
pub(crate) fn forget(key: &Key) {
    boards().retain(|entry| entry.key != *key);
}

/// Discards all parked boards of this process, so that the next link makes a new one. For tests. Returns the number of boards
/// that links still use and that stay.
#[doc(hidden)]
pub fn forget_parked() -> usize {
    let mut boards = boards();
    boards.retain(|entry| entry.parked.is_none());
    boards.len()
}
