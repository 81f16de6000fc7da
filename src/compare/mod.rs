//! Compares two runs of the same program: on two boards, on a board and on the model, before and after a change.
//!
//! Runs are aligned by the program's commands and not by time: command frame 214 of one run is compared with command frame
//! 214 of the other, and the answer that one board had given to it when the program sent its next command with that of the
//! other. Differences of timing alone are ignored: frames of nothing but GET_STATUS, the number of reports and their times.
//! The rules stand at [`Step`]. A board that answers some cycles later, as one over an ECM-XF, shows the same some cycles later:
//! that is found, told as a number, and no difference ([`Options::latency_cycles`]).
//!
//! How to read it:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | the options, and [`files`], which compares two recordings |
//! | `recorded_run.rs` | [`RecordedRun`]: a recording as a run |
//! | `steps.rs`, `cycles.rs` | [`Step`]: a command with the board's answer to it, and [`Steps`], which finds them in a run |
//! | `report.rs` | [`Answer`]: a report with what is known beside its bytes |
//! | `answers.rs` | what differs between two answers |
//! | `timing.rs` | what of that is but timing |
//! | `latency.rs`, `gaps.rs` | by how many cycles one run answers later: [`Latency`]; cycles that one has more: [`Gaps`] |
//! | `difference.rs` | [`Difference`] and its text |
//! | `runs.rs`, `counts.rs` | [`compare`]: two runs side by side; how long they are |
//!
//! ```
//! use ecmsk::compare::{Options, TimedFrame, compare};
//! use ecmsk::link::Dir;
//! use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize};
//!
//! let run = |state: MasterState| {
//!     let mut command = Frame::new();
//!     command.put_master(SlotSize::Bytes12, &MasterCommand::SetState(state));
//!     [TimedFrame { number: 1, at_ns: 0, dir: Dir::Write, frame: command }]
//! };
//! let [a, b] = [MasterState::SafeOp, MasterState::Op].map(run);
//! let options = Options::default();
//! assert!(compare(a.clone(), a.clone(), SlotSize::Bytes12, &options).is_equal());
//! let found = compare(a, b, SlotSize::Bytes12, &options).first.unwrap();
//! assert_eq!(found.command, 1);
//! assert!(found.to_string().ends_with("SET_STATE SafeOP in A, SET_STATE OP in B"), "{found}");
//! ```

mod answers;
mod counts;
mod cycles;
mod difference;
mod gaps;
mod latency;
mod recorded_run;
mod report;
mod runs;
mod steps;
mod timing;

use std::path::Path;

pub use counts::Counts;
pub use difference::{Deviation, Difference};
pub use gaps::Gaps;
pub use latency::{Latency, LatencyStretch};
pub use recorded_run::{CompareError, RecordedRun};
pub use report::Answer;
pub use runs::{Comparison, Context, compare, compare_steps};
pub use steps::{Step, Steps};

use crate::link::Dir;
use crate::sk::{Frame, SlotSize};

/// By so many cycles of the board at most what two runs answer to the same command may be apart, if no smaller number is given:
/// with its slaves behind an ECM-XF a board answers up to 8 cycles later, and takes up to 12 for SET_FIFO 1. \[OURS]
pub const WINDOW_CYCLES: usize = 24;

/// An axis stands whose positions have not changed for so many reports. \[OURS]
pub(crate) const STANDS_REPORTS: u16 = 8;

/// For so long, in nanoseconds, it may be unsure which cycle a report is of: a host writes while a report is on its way, which
/// takes an ECM-XF two exchanges. \[OURS]
const UNSURE_NS: i64 = 2_000_000;

/// By so many cycles of that length a report may be taken for another one.
fn unsure_cycles(cycle_ns: i64) -> u64 {
    (UNSURE_NS / cycle_ns.max(1)).unsigned_abs().max(1)
}

/// One of the two runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The first run.
    A,
    /// The second run.
    B,
}

impl Side {
    /// The place of what is about this run in an array of both.
    pub(crate) const fn index(self) -> usize {
        self as usize
    }

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

/// A frame of a run with its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimedFrame {
    /// Its number in the run, from 1.
    pub number: u64,
    /// When it was sent or received, in nanoseconds from any zero. The frames of a run are in the order of their times.
    pub at_ns: i64,
    /// Whether it is a command ([`Dir::Write`]) or a report ([`Dir::Read`]).
    pub dir: Dir,
    /// The frame's bytes.
    pub frame: Frame,
}

/// What counts as equal. By default everything has to be the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// By how many counts positions may differ. Default: 0.
    pub tolerance_counts: u32,
    /// The bits of a statusword that are compared. Default: all. 0x006F are those of the CiA 402 state.
    pub statusword_mask: u16,
    /// Whether the same frame sent several times in a row counts as one. For programs that send a state or a target until
    /// it is reached, which may be more or less often. Default: no.
    pub ignore_repeats: bool,
    /// By how many cycles of the board answers may come later in one run than in the other. 0: what one board had answered when
    /// the program moved on, the other has to have answered, too. Default: `None`, any number, and what answers show may be
    /// [`WINDOW_CYCLES`] apart.
    pub latency_cycles: Option<u32>,
    /// The slot size; `None` for that of the recordings.
    pub slot: Option<SlotSize>,
    /// Whether two recordings count as equal if one of them is cut off, was not ended or lacks frames, and they are equal as
    /// far as both go. Default: no, which is [`CompareError::Incomplete`].
    pub allow_incomplete: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tolerance_counts: 0,
            statusword_mask: u16::MAX,
            ignore_repeats: false,
            latency_cycles: None,
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
/// [`CompareError`] if a recording cannot be read, if the two have slots of different sizes, or if no difference was found
/// and one of them is incomplete.
pub fn files(a: &Path, b: &Path, options: &Options) -> Result<Comparison, CompareError> {
    let [mut a, mut b] = [RecordedRun::open(a, options.slot, None)?, RecordedRun::open(b, options.slot, None)?];
    let size = RecordedRun::common_size(&a, &b)?;
    let found = compare(&mut a, &mut b, size, options);
    for (side, source) in [(Side::A, &a), (Side::B, &b)] {
        source.check()?;
        if let Some(why) = source.shortcoming().filter(|_| found.is_equal() && !options.allow_incomplete) {
            return Err(CompareError::Incomplete { side, why });
        }
    }
    Ok(found)
}
