//! Two runs of the same program, compared: on two boards, on a board and a model, before and after a change.
//!
//! The program's commands are the common thread, and not the time: command frame 214 of one run is held against command
//! frame 214 of the other, and what the one board had answered to it, when the program moved on, against what the other
//! had. What differs from run to run by timing alone counts for nothing: frames of nothing but GET_STATUS, the number of
//! reports, and when they came. See [`Step`] for the rules.
//!
//! ```
//! use ecmsk::compare::{Observed, Options, compare};
//! use ecmsk::link::Dir;
//! use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize};
//!
//! let run = |state: MasterState| {
//!     let mut command = Frame::new();
//!     command.put_master(SlotSize::Bytes12, &MasterCommand::SetState(state));
//!     [Observed { number: 1, at_ns: 0, dir: Dir::Write, frame: command }]
//! };
//! let [a, b] = [MasterState::SafeOp, MasterState::Op].map(run);
//! let options = Options::default();
//! assert!(compare(a.clone(), a.clone(), SlotSize::Bytes12, &options).is_equal());
//! let found = compare(a, b, SlotSize::Bytes12, &options).first.unwrap();
//! assert_eq!(found.command, 1);
//! assert!(found.to_string().ends_with("SET_STATE SafeOP in A, SET_STATE OP in B"), "{found}");
//! ```

mod answers;
mod difference;
mod runs;
mod source;
mod steps;

use std::path::Path;

pub use difference::{Difference, What};
pub use runs::{Comparison, Context, Counts, compare, compare_steps};
pub use source::{CompareError, Source};
pub use steps::{Answer, Step, Steps};

use crate::link::Dir;
use crate::sk::{Frame, SlotSize};

/// One of two runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The first.
    A,
    /// The second.
    B,
}

impl Side {
    /// The other run.
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::A => "A",
            Self::B => "B",
        })
    }
}

/// A frame of a run, as a recording has it or a link moved it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Observed {
    /// Its number in the run, from 1.
    pub number: u64,
    /// When it passed, nanoseconds from any zero. Frames are in the order of their times.
    pub at_ns: i64,
    /// To the board or from it.
    pub dir: Dir,
    /// Its bytes.
    pub frame: Frame,
}

/// What counts as equal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Positions may differ by so many counts: 0.
    pub tolerance_counts: u32,
    /// Bits of a statusword that are looked at: all. 0x006F are those of the CiA 402 state.
    pub statusword_mask: u16,
    /// Whether a frame sent again and again counts as one: no. For programs that send a state or a target until it is
    /// reached, and so more or less often.
    pub ignore_repeats: bool,
    /// The slot size, where the recordings do not say it.
    pub slot: Option<SlotSize>,
    /// Whether recordings that are equal as far as they go are equal, though one is cut off, was not ended or lacks frames:
    /// no.
    pub allow_incomplete: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tolerance_counts: 0,
            statusword_mask: u16::MAX,
            ignore_repeats: false,
            slot: None,
            allow_incomplete: false,
        }
    }
}

/// Compares two recordings.
///
/// ```no_run
/// use std::path::Path;
///
/// use ecmsk::compare::{Options, files};
///
/// let found = files(Path::new("board.pcapng"), Path::new("model.pcapng"), &Options::default())?;
/// assert!(found.is_equal(), "{found}");
/// # Ok::<(), ecmsk::compare::CompareError>(())
/// ```
///
/// # Errors
/// [`CompareError`] if one cannot be read, the two have slots of different sizes, or no difference was found and one of them
/// is not whole.
pub fn files(a: &Path, b: &Path, options: &Options) -> Result<Comparison, CompareError> {
    let [mut a, mut b] = [Source::open(a, options.slot, None)?, Source::open(b, options.slot, None)?];
    let size = Source::common_size(&a, &b)?;
    let found = compare(&mut a, &mut b, size, options);
    for (side, source) in [(Side::A, &a), (Side::B, &b)] {
        source.check()?;
        if let Some(why) = source.shortcoming().filter(|_| found.is_equal() && !options.allow_incomplete) {
            return Err(CompareError::Incomplete { side, why });
        }
    }
    Ok(found)
}
