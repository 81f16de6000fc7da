//! Scripts: a text file of what happens to a simulated board when, named by `script=`.
//!
//! One line, one event: `at TIME VERB ..`, and for what lasts ` for TIME` behind it. Times are the board's, counted from
//! the moment the link was opened; without `at` it is that moment. `#` begins a comment. The lines may stand in any
//! order; of two at the same time the upper one is first.
//!
//! ```text
//! refuse 2 safeop for 4s       # slave 2 does not enter SafeOP in the first four seconds
//! at 2.5s alarm 1 0x7500       # drive 1 has a fault
//! at 3s   cut 2 for 1s         # the cable is cut before slave 2, and whole again at 4 s
//! ```
//!
//! `ecmsk link help` lists every verb. What a line does is what [`Cable`] and [`BoardHandle`] do for a test in Rust:
//! the file is read when the link is opened, and nothing moves if it is wrong. Each line is carried out at the beginning
//! of the first cycle at or after its time, on a virtual clock and on the real one alike, and logged with the board's
//! time.
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
//! \[OURS] Every opening of a link starts its script over, on a network that is whole: what the script did before is
//! taken back. An end (`for`, `end`) takes back whatever of its kind holds at that time. While a script has lines to come
//! no silence is for ever: a read on a virtual clock waits for them.

mod reader;
mod run;
mod verbs;
mod words;

use std::path::Path;

use super::keys::WHERE_TO_LOOK;
use super::slaves::SlaveSpec;
use super::uri::visible;
use crate::engine::BoardHandle;
use crate::fieldbus::Ns;
use crate::fieldbus::cable::Cable;
use crate::files::read_small;

pub use run::Run;
pub(super) use run::take_back;
pub(super) use verbs::help;

/// The longest file that is read \[OURS].
const LONGEST_BYTES: u64 = 1 << 20;

/// Why a script is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ScriptError {
    /// The file cannot be read.
    #[error("cannot read the script {file}: {message}; name another file with script= or leave it out")]
    Unreadable { file: String, message: String },
    /// A line that says nothing that could happen.
    #[error("{file}, line {line}, column {column}: {message}; {WHERE_TO_LOOK}")]
    Line {
        file: String,
        line: u32,
        /// The character in it, from 1.
        column: usize,
        /// What is wrong and what is allowed.
        message: String,
    },
}

/// What happens when.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    /// In the order of their times.
    steps: Vec<run::Step>,
}

impl Script {
    /// Reads the file at `path` for a network of these slaves.
    ///
    /// # Errors
    /// [`ScriptError`].
    pub fn load(path: &Path, slaves: &[SlaveSpec]) -> Result<Self, ScriptError> {
        let file = path.display().to_string();
        let unreadable = |message: String| ScriptError::Unreadable { file: file.clone(), message };
        let read = read_small(path, LONGEST_BYTES).map_err(|error| unreadable(error.to_string()))?;
        let text = String::from_utf8(read.bytes);
        let text = text.map_err(|_| unreadable("it is no text in UTF-8; save it as UTF-8".to_owned()))?;
        Self::parse(&file, &text, slaves)
    }

    /// Reads a text for a network of these slaves; `file` is what messages call it.
    ///
    /// # Errors
    /// [`ScriptError::Line`].
    pub fn parse(file: &str, text: &str, slaves: &[SlaveSpec]) -> Result<Self, ScriptError> {
        let mut steps = Vec::new();
        // Editors on Windows put a byte order mark in front.
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        for (line, text) in (1..).zip(text.lines()) {
            verbs::line(line, text, slaves, &mut steps).map_err(|(column, message)| {
                let (file, message) = (file.to_owned(), visible(&message));
                ScriptError::Line { file, line, column, message }
            })?;
        }
        // Stable: what stands first happens first.
        steps.sort_by_key(|step| step.at);
        Ok(Self { steps })
    }

    /// How many things happen, ends included.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether nothing happens.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Starts it on a board and its network: its times count from `now`, in board time.
    pub fn start(self, network: Cable, board: BoardHandle, now: Ns) -> Run {
        Run::new(self.steps, network, board, now)
    }
}
