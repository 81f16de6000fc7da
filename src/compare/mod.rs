//! Compares two runs of the same program: on two boards, on a board and on the model, before and after a change.
//!
//! Runs are aligned by the program's commands and not by time: command frame 214 of one run is compared with command
//! frame 214 of the other, and the last answer that one board gave before the next command with the last answer of the
//! other. Differences in timing alone are ignored: frames in which all slots are GET_STATUS, the number of reports and
//! their times. [`Step`] has the rules. A board over an ECM-XF answers some cycles later: that latency is reported as a
//! number and is no difference ([`CompareOptions::latency_cycles`]).
//!
//! Files:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | the options, and [`files`], which compares two recordings |
//! | `recorded_run.rs` | [`RecordedRun`]: a recording as a run |
//! | `steps.rs`, `cycles.rs` | [`Step`]: a command with the board's answer to it, and [`Steps`], which finds them in a run |
//! | `report.rs` | [`BoardReport`]: a report, with the kinds of the slaves |
//! | `answers.rs` | the differences between two answers |
//! | `timing.rs` | which of these differences are timing alone |
//! | `latency.rs`, `gaps.rs` | how many cycles later one run answers: [`Latency`]; additional cycles of one run: [`Gaps`] |
//! | `difference.rs` | [`Difference`] and its text |
//! | `runs.rs`, `counts.rs` | [`compare`]: two runs side by side; their numbers of frames |
//!
//! ```
//! use ecmsk::compare::{CompareOptions, TimedFrame, compare};
//! use ecmsk::link::Dir;
//! use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize};
//!
//! let run = |state: MasterState| {
//!     let mut command = Frame::new();
//!     command.put_master(SlotSize::Bytes12, &MasterCommand::SetState(state));
//!     [TimedFrame { number: 1, at_ns: 0, dir: Dir::Write, frame: command }]
//! };
//! let [a, b] = [MasterState::SafeOp, MasterState::Op].map(run);
//! let options = CompareOptions::default();
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

pub use counts::RunCounts;
pub use difference::{Deviation, Difference};
pub use gaps::Gaps;
pub use latency::{Latency, LatencyStretch};
pub use recorded_run::{CompareError, RecordedRun};
pub use report::BoardReport;
pub use runs::{Comparison, Context, compare, compare_steps};
pub use steps::{Step, Steps};

use crate::link::Dir;
use crate::sk::{Frame, SlotSize};

/// How many cycles of the board earlier or later one run may show the other run's answer, so that the difference counts
/// as timing alone. A smaller [`CompareOptions::latency_cycles`] replaces this number. A board over an ECM-XF answers up
/// to 8 cycles later, and takes up to 12 for SET_FIFO 1. \[OURS]
pub const WINDOW_CYCLES: usize = 24;

/// An axis counts as at rest once its positions have not changed for this many reports. \[OURS]
pub(crate) const AT_REST_REPORTS: u16 = 8;

/// Uncertainty of the cycle that a report belongs to, in nanoseconds: the host may send a command while the report is in
/// flight. Over an ECM-XF a report is in flight while the host exchanges two packets with the chip. \[OURS]
const UNSURE_NS: i64 = 2_000_000;

/// The uncertainty of a report in cycles of this length, at least one.
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
    /// The index of this run's value in an array of both runs' values.
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
    /// The number of the frame in the run, from 1.
    pub number: u64,
    /// The time at which the frame was sent or received, in nanoseconds from any zero. The frames of a run are sorted
    /// by it.
    pub at_ns: i64,
    /// Whether the frame is a command ([`Dir::Write`]) or a report ([`Dir::Read`]).
    pub dir: Dir,
    /// The bytes of the frame.
    pub frame: Frame,
}

/// Which differences are ignored. By default none is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompareOptions {
    /// The largest difference of positions that is ignored, in counts. Default: 0.
    pub tolerance_counts: u32,
    /// The bits of a statusword that are compared. Default: all. 0x006F has the bits of the CiA 402 state.
    pub statusword_mask: u16,
    /// Whether the same frame sent several times in succession counts as one. For programs that repeat a command until
    /// a state or a target is reached: how often they repeat it depends on timing. Default: no.
    pub ignore_repeats: bool,
    /// The maximum number of the board's cycles by which one run may answer later than the other. With 0 both boards must
    /// have given the same answers before the program sent its next command. Default: `None`, which allows any latency; the
    /// same answers may then be [`WINDOW_CYCLES`] apart.
    pub latency_cycles: Option<u32>,
    /// The slot size; `None` for the one that the recordings state.
    pub slot: Option<SlotSize>,
    /// Whether two recordings count as equal if they match up to the end of the shorter one, although one is cut off,
    /// was not ended or lacks frames. Default: no, which returns [`CompareError::Incomplete`].
    pub allow_incomplete: bool,
}

impl Default for CompareOptions {
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
/// use ecmsk::compare::{CompareOptions, files};
///
/// let found = files(Path::new("board.pcapng"), Path::new("model.pcapng"), &CompareOptions::default())?;
/// assert!(found.is_equal(), "{found}");
/// # Ok::<(), ecmsk::compare::CompareError>(())
/// ```
///
/// # Errors
/// [`CompareError`] if a recording cannot be read, if the two have slots of different sizes, or if no difference was found
/// and one of them is incomplete.
pub fn files(a: &Path, b: &Path, options: &CompareOptions) -> Result<Comparison, CompareError> {
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
