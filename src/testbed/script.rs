//! Scripts (`script=`): text files that make events happen to a simulated board and its slaves at given times.
//!
//! A line is one event, `at TIME VERB ..`; the same line can also end an event that lasts, `at TIME VERB .. for TIME`.
//! Times are in the board's time and count from the opening of the link. A line without `at` applies from the opening
//! on. `#` begins a comment. Lines may be in any order; of two lines with the same time the upper one is carried out
//! first.
//!
//! ```text
//! refuse 2 safeop for 4s       # slave 2 does not enter SafeOP in the first four seconds
//! at 2.5s alarm 1 0x7500       # drive 1 has a fault
//! at 3s   cut 2 for 1s         # the cable is cut before slave 2, and whole again at 4 s
//! ```
//!
//! For slaves on a network interface, without a board, times count from the start of the server. Lines below `from
//! frame` count from the first frame of a master, and lines below `from op` from the moment at which the first slave
//! reaches OP ([`ScriptOrigin`]).
//!
//! `ecmsk link help` lists every verb. Each line calls a function of [`Cable`] or [`BoardHandle`], which tests in Rust
//! can call as well. The file is read when the link is opened; if it is invalid, the link does not open. Each line is
//! carried out at the beginning of the first cycle at or after its time, on the virtual clock and on the real one, and
//! logged with the board's time.
//!
//! ```
//! use std::time::Duration;
//! use ecmsk::link::{self, Share, Wait};
//! use ecmsk::sk::{Frame, MasterResponse, SlotSize};
//!
//! let file = std::env::temp_dir().join(format!("inputs-{}.ecmscript", std::process::id()));
//! std::fs::write(&file, "at 1.5s silent for 20ms\n")?;
//! let board = link::open(&format!("sim:?clock=virtual&script={}", file.display()), Share::ByName)?;
//! let mut report = Frame::new();
//! let mut before = board.read(&mut report, Wait::Forever)?.at.0;
//! let gap = loop {
//!     let at = board.read(&mut report, Wait::Forever)?.at.0;
//!     if at > before + 1_000_000 {
//!         break at - before;
//!     }
//!     before = at;
//! };
//! assert_eq!(gap, 21_000_000);
//! # std::fs::remove_file(file)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! \[OURS] Each time the link is opened, everything that the script did before is undone and the script starts again.
//! When an event ends (`for`, `end`), all events of the same kind that are in force for the slave end, also those that
//! other lines began. On a virtual clock, a read does not fail with
//! [`LinkError::Silent`](crate::link::LinkError::Silent) while lines remain, because one of them may end the silence.
//!
//! Files: `verbs.rs` is the table of all verbs, `reader.rs` and `words.rs` read their operands, `run.rs` carries the
//! lines out, `injected.rs` a verb that comes while the board runs ([`control`](super::control)).

#[cfg_attr(not(unix), allow(dead_code, reason = "events come by Unix sockets alone"))]
pub(super) mod injected;
mod reader;
mod run;
mod verbs;
mod words;

use std::path::Path;

use crate::address::slaves::SlaveSpec;
use crate::address::text::visible;
use crate::engine::BoardHandle;
use crate::fieldbus::Ns;
use crate::files::read_small;
pub use crate::link::machine_error::ScriptError;
use crate::slave::cable::Cable;

pub(crate) use run::undo_all;
pub use run::{RunningScript, ScriptOrigin};
pub(crate) use verbs::help;

/// The maximum size of a script file, bytes \[OURS].
const FILE_BYTES_MAX: u64 = 1 << 20;

/// A script whose lines were parsed and checked against the slaves of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    /// The steps, sorted by time.
    steps: Vec<run::Step>,
}

impl Script {
    /// Reads the script file `path` for a board with a network of these slaves. Its times count from the opening of the
    /// link; a line with another origin is an error.
    ///
    /// # Errors
    /// [`ScriptError`] if the file cannot be read or a line is invalid.
    pub fn load(path: &Path, slaves: &[SlaveSpec]) -> Result<Self, ScriptError> {
        let script = Self::load_for_network(path, slaves)?;
        match script.steps.iter().find(|step| step.from != ScriptOrigin::Start) {
            Some(step) => Err(ScriptError::Line {
                file: path.display().to_string(),
                line: step.line,
                column: 1,
                message:
                    "times of a board count from when the link was opened; `from` is for `ecmsk serve ethercat` alone"
                        .to_owned(),
            }),
            None => Ok(script),
        }
    }

    /// Reads the script file `path` for a network without a board. Unlike with [`Self::load`], the times of lines may
    /// count from an event that the caller reports by [`RunningScript::begin`].
    ///
    /// # Errors
    /// [`ScriptError`] if the file cannot be read or a line is invalid.
    pub(crate) fn load_for_network(path: &Path, slaves: &[SlaveSpec]) -> Result<Self, ScriptError> {
        let file = path.display().to_string();
        let unreadable = |message: String| ScriptError::Unreadable { file: file.clone(), message };
        let read = read_small(path, FILE_BYTES_MAX).map_err(|error| unreadable(error.to_string()))?;
        let text = String::from_utf8(read.bytes);
        let text = text.map_err(|_| unreadable("it is no text in UTF-8; save it as UTF-8".to_owned()))?;
        Self::parse(&file, &text, slaves)
    }

    /// Reads the script file `path` for simulated slaves. If the slaves are called directly, without EtherCAT frames
    /// (`has_frames` is false), a line that affects frames is an error.
    ///
    /// # Errors
    /// [`ScriptError`] if the file cannot be read or a line is invalid.
    pub(super) fn load_for(path: &Path, slaves: &[SlaveSpec], has_frames: bool) -> Result<Self, ScriptError> {
        let script = Self::load(path, slaves)?;
        match script.steps.iter().find(|step| !has_frames && step.action.is_of_frames()) {
            Some(step) => {
                let (file, line, verb) = (path.display().to_string(), step.line, step.verb);
                Err(ScriptError::NoFrames { file, line, verb })
            }
            None => Ok(script),
        }
    }

    /// Parses the text of a script for a network of these slaves; `file` is the name in error messages.
    ///
    /// # Errors
    /// [`ScriptError::Line`] for the first line that is invalid or names a slave that the network lacks.
    pub fn parse(file: &str, text: &str, slaves: &[SlaveSpec]) -> Result<Self, ScriptError> {
        let mut steps = Vec::new();
        let mut from = ScriptOrigin::Start;
        // Editors on Windows begin a file with a byte order mark.
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        for (line, text) in (1..).zip(text.lines()) {
            verbs::parse_line(line, text, slaves, &mut from, &mut steps).map_err(|(column, message)| {
                let (file, message) = (file.to_owned(), visible(&message));
                ScriptError::Line { file, line, column, message }
            })?;
        }
        // A stable sort: lines with the same time keep the order of the file.
        steps.sort_by_key(|step| step.at);
        Ok(Self { steps })
    }

    /// The number of steps; a line with `for` has two.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// The line number and the verb of the first step that affects the board itself; `None` if every step affects only the
    /// network. A network without a board cannot carry out such a step.
    pub fn of_board(&self) -> Option<(u32, &'static str)> {
        let of_board = self.steps.iter().find(|step| step.action.is_of_board());
        of_board.map(|step| (step.line, step.verb))
    }

    /// Whether the script has no steps.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Starts the script on a board and its network. The times of lines with the origin `start`, the default, count from
    /// `now`, the board's time.
    pub fn start(self, network: Cable, board: BoardHandle, now: Ns) -> RunningScript {
        RunningScript::new(&self.steps, network, board, now)
    }
}
