//! Sends the command frames of a recording or a USB capture to the model of the board, to find out whether the model
//! answers as the recorded board did.
//!
//! A [`Replay`] supplies two runs for [`crate::compare`]: the recorded run, and the run of the model, which gets the
//! same command frames at the same times. The model's time is virtual, so that each frame reaches it at exactly its
//! time.
//!
//! ```no_run
//! use std::path::Path;
//!
//! use ecmsk::compare::{CompareOptions, Steps, compare_steps};
//! use ecmsk::link::uri::LinkUri;
//! use ecmsk::replay::{FilesInLink, Replay};
//!
//! let options = CompareOptions::default();
//! let model = LinkUri::parse("sim:?slaves=drive*2")?;
//! let replay = Replay::open(Path::new("board.pcapng"), Some(&model), &options, None, FilesInLink::Refused)?;
//! let (mut board, mut model) = replay.runs()?;
//! let found = compare_steps(
//!     Steps::new(&mut board, replay.size(), options.ignore_repeats),
//!     Steps::new(&mut model, replay.size(), options.ignore_repeats),
//!     &options,
//! );
//! assert!(found.is_equal(), "{found}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod model_run;
mod observed_board;
mod start;
mod waiting_run;

use std::path::{Path, PathBuf};

pub use model_run::ModelRun;
pub use start::ReplayStart;
pub use waiting_run::WaitingRun;

use crate::address::keys::{Key, Syntax};
use crate::address::slaves::{self, ManufacturerObjectsSpec, SlaveSpec};
use crate::address::uri::{self, LinkUri, UriError};
use crate::compare::{CompareError, CompareOptions, RecordedRun};
use crate::link::LinkError;
use crate::open;
use crate::recording::{Address, RecordError, RecordMeta};
use crate::sk::{SlotSize, StateByte};

/// Why a recording cannot be replayed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// The recording has no frames, or its slots cannot be compared with those of the model.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The model cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The URI of the model is invalid.
    #[error(transparent)]
    Uri(#[from] UriError),
    /// Neither the caller nor the recording gives the link of a model.
    #[error(
        "{name} does not say which slaves the board has; name the model, for example --link 'sim:?slaves=drive*2,io'"
    )]
    NoModel {
        /// The name of the recording's file.
        name: String,
    },
    /// The link in the recording refers to a file, which the caller has not allowed.
    #[error(
        "the link in {name} names a file ({key}={file}); a recording may come from anybody, and files that it names \
         are opened only with --allow-files; add that, or name the model yourself with --link"
    )]
    NamesFile {
        /// The name of the recording's file.
        name: String,
        /// The key of the link whose value is the file.
        key: String,
        /// The name of the file in the link.
        file: String,
    },
    /// The link is not one of a model (`sim:`, `xf-sim:`).
    #[error("`{link}` is no model, and the time of a real board cannot be set; name one with --link 'sim:?slaves=..'")]
    NotAModel {
        /// The URI of the link.
        link: String,
    },
    /// The link has the key `record=`, but a replay makes no recording.
    #[error(
        "`{link}` asks for a recording (record={file}), and a replay makes none: it compares the model's answers at \
         once. Leave record= out; `ecmsk exec --record FILE` records a program that runs on the model"
    )]
    Records {
        /// The URI of the link.
        link: String,
        /// The file that the recording would have.
        file: String,
    },
    /// The recording has no report of the board.
    #[error(
        "{name} holds {commands} command frames of board {board} and no report: there is nothing to compare the model \
         with; capture both directions, whole packets (snap length 0)"
    )]
    NoReport {
        /// The name of the recording's file.
        name: String,
        /// The USB address of the board.
        board: Address,
        /// The number of command frames in the recording.
        commands: u64,
    },
    /// The recording begins in SafeOP or OP, and the model cannot be brought into the same state.
    #[error(
        "{name} begins with the network in {state}, and never goes below SafeOP: commands before that are missing; \
         begin the capture before the program starts, with the board just switched on"
    )]
    NoStart {
        /// The name of the recording's file.
        name: String,
        /// The state in the first report of the recording.
        state: StateByte,
    },
    /// The slot sizes of the recording and of the model differ.
    #[error("{name} has slots of {} bytes, the model {link} of {}; leave slot= out of the link, or give --slot-size if the capture is misread", .capture.bytes(), .model.bytes())]
    SlotSizes {
        /// The name of the recording's file.
        name: String,
        /// The URI of the model.
        link: String,
        /// The recording's slot size.
        capture: SlotSize,
        /// The model's slot size.
        model: SlotSize,
    },
}

/// Whether the link in a recording may open files of this machine. A link that the caller gives may always open files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilesInLink {
    /// A link in the recording that names a file is refused: the recording may come from anyone, and its link may name
    /// any file.
    Refused,
    /// A link in the recording may open files.
    Allowed,
}

/// A recording, and the model that gets its command frames.
#[derive(Clone, Debug)]
pub struct Replay {
    path: PathBuf,
    link: LinkUri,
    /// Whether both the recorded board and the model reach their slaves over an ECM-XF, or neither does, see
    /// [`Self::is_alike`].
    is_alike: bool,
    board: Address,
    slot: Option<SlotSize>,
    size: SlotSize,
    start: ReplayStart,
}

impl Replay {
    /// Opens a recording and finds where the replay begins.
    ///
    /// `link` is the link of the model; without it the link in the recording is used, if a model was recorded. Only the
    /// slot size of `options` is used. `device` is the USB address of the board in a capture; with `None` the board is
    /// searched for. `files` decides whether the link in the recording may open files.
    ///
    /// # Errors
    /// [`ReplayError`]: the recording cannot be read or has no report, there is no usable link of a model, the slot
    /// sizes differ, or the recording never goes below SafeOP.
    pub fn open(
        path: &Path,
        link: Option<&LinkUri>,
        options: &CompareOptions,
        device: Option<Address>,
        files: FilesInLink,
    ) -> Result<Self, ReplayError> {
        let name = path.display().to_string();
        let mut source = RecordedRun::open(path, options.slot, device)?;
        let recorded = source.meta().and_then(|meta| LinkUri::parse(&meta.link).ok());
        let link = match (link, source.meta().and_then(recorded_link)) {
            (Some(link), _) => {
                if let Some(file) = link.value("record") {
                    return Err(ReplayError::Records { link: link.to_string(), file: file.to_owned() });
                }
                link.clone()
            }
            (None, Some(recorded)) => {
                if let (FilesInLink::Refused, Some((key, file))) = (files, named_file(&recorded)) {
                    return Err(ReplayError::NamesFile { name, key, file });
                }
                recorded
            }
            (None, None) => return Err(ReplayError::NoModel { name }),
        };
        if !link.scheme().is_model() {
            return Err(ReplayError::NotAModel { link: link.to_string() });
        }
        let is_behind_chip = |link: &LinkUri| link.scheme().has_chip();
        let is_alike = recorded.as_ref().is_some_and(is_behind_chip) == is_behind_chip(&link);
        let (size, link) = with_slot_size(&name, &source, &link)?;
        let (board, model_clock_ns) = (source.board(), model_time(&source));
        let start = ReplayStart::find(&mut source, &name, size)?;
        source.check()?;
        Ok(Self {
            path: path.to_owned(),
            link,
            is_alike,
            board,
            slot: options.slot,
            size,
            start: ReplayStart { model_clock_ns, ..start },
        })
    }

    /// The slot size of both runs.
    pub const fn size(&self) -> SlotSize {
        self.size
    }

    /// The URI of the model.
    pub const fn link(&self) -> &LinkUri {
        &self.link
    }

    /// Whether both the recorded board and the model reach their slaves over an ECM-XF, or neither does. If they
    /// differ, the model needs other times than the recorded board, and the two are compared by [`Self::waiting_runs`].
    pub const fn is_alike(&self) -> bool {
        self.is_alike
    }

    /// The USB address of the recorded board.
    pub const fn board(&self) -> Address {
        self.board
    }

    /// The point in the recording at which the replay begins.
    pub const fn start(&self) -> &ReplayStart {
        &self.start
    }

    /// The recorded run and the model's run, both from [`Self::start`] on and sorted by time. Each call opens the
    /// recording and a new model.
    ///
    /// # Errors
    /// [`ReplayError`]: the model cannot be opened, or the recording cannot be read again.
    pub fn runs(&self) -> Result<(RecordedRun, ModelRun), ReplayError> {
        let board = open::model(&self.link)?;
        let model = ModelRun::new(self.recorded()?, self.recorded()?, board, &self.start);
        Ok((self.recorded()?, model))
    }

    /// The recorded run, and a run of the model whose host waits for everything that the recorded program may have
    /// waited for. Both begin at [`Self::start`] and are sorted by time. This is for a model that needs more time than
    /// the recorded board, such as one over an ECM-XF.
    ///
    /// # Errors
    /// [`ReplayError`]: the model cannot be opened, or the recording cannot be read again.
    pub fn waiting_runs(&self) -> Result<(RecordedRun, WaitingRun), ReplayError> {
        let board = open::model(&self.link)?;
        Ok((self.recorded()?, WaitingRun::new(self.recorded()?, board, &self.start, self.size)))
    }

    /// The recorded run from [`Self::start`] on.
    fn recorded(&self) -> Result<RecordedRun, CompareError> {
        let mut source = RecordedRun::open(&self.path, self.slot, Some(self.board))?;
        for _ in 0..self.start.skipped {
            source.next();
        }
        Ok(source)
    }
}

/// The slot size of both runs, and the link of the model with that slot size. A link without `slot=` gets the
/// recording's slot size.
fn with_slot_size(name: &str, source: &RecordedRun, link: &LinkUri) -> Result<(SlotSize, LinkUri), ReplayError> {
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
    link.value("slot").and_then(uri::slot_size).unwrap_or_default()
}

/// The link in a recording, without the keys `record` and `fault.*`, which made the recording and its faults; `None` if
/// it is not the link of a model.
fn recorded_link(meta: &RecordMeta) -> Option<LinkUri> {
    let link = LinkUri::parse(&meta.link).ok().filter(|link| link.scheme().is_model())?;
    let kept = link.keys().filter(|(key, _)| *key != "record" && !key.starts_with("fault."));
    let encode = |text| percent_encoding::utf8_percent_encode(text, percent_encoding::NON_ALPHANUMERIC).to_string();
    let keys: Vec<String> = kept.map(|(key, value)| format!("{key}={}", encode(value))).collect();
    LinkUri::parse(format!("{}:?{}", link.scheme(), keys.join("&")).trim_end_matches('?')).ok()
}

/// The first key of a link whose value is a file, and that file.
fn named_file(link: &LinkUri) -> Option<(String, String)> {
    let is_file = |slave: &SlaveSpec| matches!(slave.manufacturer_objects, Some(ManufacturerObjectsSpec::File(_)));
    let names = |(key, value): &(&str, &str)| match *key {
        "slaves" => slaves::parse(value).is_ok_and(|slaves| slaves.iter().any(is_file)),
        key => Key::find(link.scheme(), key).is_none_or(|row| matches!(row.syntax, Syntax::File | Syntax::Folder)),
    };
    link.keys().find(names).map(|(key, value)| (key.to_owned(), value.to_owned()))
}

/// The time of the first frame on the recorded model's clock, in nanoseconds since it was powered on; `None` if no
/// model was recorded.
fn model_time(source: &RecordedRun) -> Option<i64> {
    let meta = source.meta()?;
    recorded_link(meta)?;
    i64::try_from(source.first_ns().checked_sub(meta.base_ns)?).ok()
}
