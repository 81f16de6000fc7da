//! The host's half of a recording or a capture, played to the model: what would it have answered?
//!
//! A [`Replay`] gives both halves as runs for [`crate::compare`]: what the board said, and what the model says to the
//! same command frames at the same times. Time is virtual, so that each frame reaches the model at the very nanosecond.
//!
//! ```no_run
//! use std::path::Path;
//!
//! use ecmsk::compare::{Options, Steps, compare_steps};
//! use ecmsk::link::uri::LinkUri;
//! use ecmsk::replay::{Files, Replay};
//!
//! let options = Options::default();
//! let model = LinkUri::parse("sim:?slaves=drive*2")?;
//! let replay = Replay::open(Path::new("board.pcapng"), Some(&model), &options, None, Files::Refused)?;
//! let (mut board, mut model) = replay.halves()?;
//! let found = compare_steps(
//!     Steps::new(&mut board, replay.size(), options.ignore_repeats),
//!     Steps::new(&mut model, replay.size(), options.ignore_repeats),
//!     &options,
//! );
//! assert!(found.is_equal(), "{found}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod model;
mod start;

use std::path::{Path, PathBuf};

pub use model::Model;
pub use start::Start;

use crate::compare::{CompareError, Options, Source};
use crate::link::keys::{Key, Scheme, Syntax};
use crate::link::uri::{LinkUri, UriError};
use crate::link::{self, LinkError};
use crate::recording::{Address, RecordError, RecordMeta};
use crate::sk::{SlotSize, StateByte};

/// Why a recording cannot be replayed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReplayError {
    /// It cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// It holds no frame.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The model cannot be made.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The link is none.
    #[error(transparent)]
    Uri(#[from] UriError),
    /// Neither the user nor the recording names a model.
    #[error(
        "{name} does not say which slaves the board has; name the model, for example --link 'sim:?slaves=drive*2,io'"
    )]
    NoModel {
        /// The recording.
        name: String,
    },
    /// The model that the recording names has a file, and that was not allowed.
    #[error(
        "the link in {name} names a file ({key}={file}); a recording may come from anybody, and what it names is opened only \
         with --allow-files; or name the model yourself with --link"
    )]
    NamesFile {
        /// The recording.
        name: String,
        /// The link's key.
        key: String,
        /// The value.
        file: String,
    },
    /// The link is no model.
    #[error(
        "`{link}` is no model, and a real board cannot be told what time it is; name one with --link 'sim:?slaves=..'"
    )]
    NotAModel {
        /// The link.
        link: String,
    },
    /// The board never said anything.
    #[error(
        "{name} holds {commands} command frames of board {board} and no report: there is nothing to hold the model against; capture both directions, whole packets (snap length 0)"
    )]
    NoReport {
        /// The capture.
        name: String,
        /// Which board.
        board: Address,
        /// Commands it holds.
        commands: u64,
    },
    /// It begins in the middle.
    #[error(
        "{name} begins with the network in {state}, and never goes below SafeOP: what the board was told before is not in it; begin the capture before the program starts, with the board just switched on"
    )]
    NoStart {
        /// The capture.
        name: String,
        /// State in its first report.
        state: StateByte,
    },
    /// The frames of the one do not fit the other.
    #[error("{name} has slots of {} bytes, the model {link} of {}; leave slot= out of the link, or give --slot-size if the capture is misread", .capture.bytes(), .model.bytes())]
    SlotSizes {
        /// The capture.
        name: String,
        /// The link.
        link: String,
        /// Of the capture.
        capture: SlotSize,
        /// Of the model.
        model: SlotSize,
    },
}

/// Whether files are opened that the link in a recording names. A link that the caller names may have any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Files {
    /// None is: a recording may come from anybody, and may name any file of this machine.
    Refused,
    /// They are.
    Allowed,
}

/// A recording and the model that its host's half is played to.
#[derive(Clone, Debug)]
pub struct Replay {
    path: PathBuf,
    link: LinkUri,
    board: Address,
    slot: Option<SlotSize>,
    size: SlotSize,
    start: Start,
}

impl Replay {
    /// Looks at a recording. `link`: the model; without it that of the recording itself, if it is of one. Of `options`
    /// the slot size counts. `device`: the board of a capture, if it is not to be looked for. `files`: those that the
    /// recording's own link names.
    ///
    /// # Errors
    /// [`ReplayError`].
    pub fn open(
        path: &Path,
        link: Option<&LinkUri>,
        options: &Options,
        device: Option<Address>,
        files: Files,
    ) -> Result<Self, ReplayError> {
        let name = path.display().to_string();
        let mut source = Source::open(path, options.slot, device)?;
        let link = match (link, source.meta().and_then(own_link)) {
            (Some(link), _) => link.clone(),
            (None, Some(own)) => {
                if let (Files::Refused, Some((key, file))) = (files, named_file(&own)) {
                    return Err(ReplayError::NamesFile { name, key, file });
                }
                own
            }
            (None, None) => return Err(ReplayError::NoModel { name }),
        };
        if link.scheme() != Scheme::Sim {
            return Err(ReplayError::NotAModel { link: link.to_string() });
        }
        let (size, link) = agree(&name, &source, &link)?;
        let (board, began) = (source.board(), model_time(&source));
        let start = Start::find(&mut source, &name, size)?;
        source.check()?;
        Ok(Self { path: path.to_owned(), link, board, slot: options.slot, size, start: Start { began, ..start } })
    }

    /// Bytes of a slot.
    pub const fn size(&self) -> SlotSize {
        self.size
    }

    /// The model.
    pub const fn link(&self) -> &LinkUri {
        &self.link
    }

    /// The board of a capture.
    pub const fn board(&self) -> Address {
        self.board
    }

    /// Where it begins.
    pub const fn start(&self) -> &Start {
        &self.start
    }

    /// Both halves, from the start on, in the order of their times: what the board said to the host, and what the model
    /// says to it.
    ///
    /// # Errors
    /// [`ReplayError`].
    pub fn halves(&self) -> Result<(Source, Model), ReplayError> {
        let open = || {
            let mut source = Source::open(&self.path, self.slot, Some(self.board))?;
            for _ in 0..self.start.skipped {
                source.next();
            }
            Ok::<_, CompareError>(source)
        };
        let board = link::model(&self.link)?;
        Ok((open()?, Model::new(open()?, board, &self.start)))
    }
}

/// The slot size of both. That of the link is the capture's, unless the link says 16 bytes itself.
fn agree(name: &str, source: &Source, link: &LinkUri) -> Result<(SlotSize, LinkUri), ReplayError> {
    let (capture, model) = (source.size(), model_size(link));
    match (capture, model) {
        (capture, model) if capture == model => Ok((capture, link.clone())),
        (SlotSize::Bytes16, _) => {
            let text = link.to_string();
            let sign = if text.contains('?') { '&' } else { '?' };
            Ok((capture, LinkUri::parse(&format!("{text}{sign}slot=16"))?))
        }
        _ => Err(ReplayError::SlotSizes { name: name.to_owned(), link: link.to_string(), capture, model }),
    }
}

fn model_size(link: &LinkUri) -> SlotSize {
    link.value("slot").and_then(link::uri::slot_size).unwrap_or_default()
}

/// The link of a recording, if it is a model: without what only mattered to the program that ran on it.
fn own_link(meta: &RecordMeta) -> Option<LinkUri> {
    let link = LinkUri::parse(&meta.link).ok().filter(|link| link.scheme() == Scheme::Sim)?;
    let kept = link.keys().filter(|(key, _)| *key != "record" && !key.starts_with("fault."));
    let encode = |text| percent_encoding::utf8_percent_encode(text, percent_encoding::NON_ALPHANUMERIC).to_string();
    let keys: Vec<String> = kept.map(|(key, value)| format!("{key}={}", encode(value))).collect();
    LinkUri::parse(format!("sim:?{}", keys.join("&")).trim_end_matches('?')).ok()
}

/// The first file that a link names, with its key. \[OURS] Of a list of slaves everything that stands behind `objects@`
/// and is not the word `any` counts as one.
fn named_file(link: &LinkUri) -> Option<(String, String)> {
    let names = |(key, value): &(&str, &str)| match *key {
        "slaves" => value.split("objects@").skip(1).any(|rest| !is_any(rest)),
        key => Key::find(link.scheme(), key).is_none_or(|row| row.syntax == Syntax::File),
    };
    link.keys().find(names).map(|(key, value)| (key.to_owned(), value.to_owned()))
}

/// Whether what follows is the word `any`, at the end of a slave's traits.
fn is_any(rest: &str) -> bool {
    rest.strip_prefix("any").is_some_and(|rest| rest.is_empty() || rest.starts_with([',', ':', '*']))
}

/// When the first frame passed on the clock of a model that was recorded, nanoseconds since it was switched on.
fn model_time(source: &Source) -> Option<i64> {
    let meta = source.meta()?;
    own_link(meta)?;
    i64::try_from(source.first_ns().checked_sub(meta.base_ns)?).ok()
}
