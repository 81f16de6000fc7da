//! The number of frames of a run, and its duration.

use std::fmt::{self, Display, Formatter};

/// How many frames of each sort a run has, and how long the run is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunCounts {
    /// Command frames in which some slot requests something.
    pub commands: u64,
    /// Command frames in which all slots are GET_STATUS.
    pub polls: u64,
    /// Repeated command frames that were skipped ([`CompareOptions::ignore_repeats`](super::CompareOptions::ignore_repeats)).
    pub repeats: u64,
    /// Reports of the board.
    pub reports: u64,
    /// The time of the last frame, in nanoseconds, as in [`TimedFrame::at_ns`](super::TimedFrame::at_ns). If the first
    /// frame has time 0, it is the duration of the run.
    pub last_ns: i64,
}

impl Display for RunCounts {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { commands, polls, repeats, reports, last_ns } = *self;
        write!(f, "{commands} commands, {polls} polls, ")?;
        if repeats > 0 {
            write!(f, "{repeats} repeats, ")?;
        }
        write!(f, "{reports} reports, {}", seconds(last_ns))
    }
}

/// Nanoseconds as a text in seconds with three decimals.
pub(super) fn seconds(at_ns: i64) -> String {
    let (sign, us) = (if at_ns < 0 { "-" } else { "" }, (at_ns.unsigned_abs() + 500) / 1000);
    format!("{sign}{}.{:03} s", us / 1_000_000, us % 1_000_000 / 1000)
}
