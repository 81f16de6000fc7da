//! Announces the duration of a long move before it begins; at a terminal the user has to confirm it.

use std::fmt;

use super::super::profile::Profile;
use super::path::Path;
use super::{WHAT, refused};
use crate::board::{Board, BoardError};

/// \[OURS] A move longer than this is announced, in seconds. A mistyped number should not start a move of more than a minute.
const TOLD_FROM_S: f64 = 60.0;

/// A duration in seconds that is displayed as text for users: `8 min 20 s`, `3 h 5 min`.
struct Long(f64);

impl fmt::Display for Long {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.0.round() as u64;
        let (minutes, hours, days) = (seconds / 60, seconds / 3600, seconds / 86_400);
        match (days, hours) {
            (1.., _) => write!(f, "{days} d {} h", hours % 24),
            (_, 1..) => write!(f, "{hours} h {} min", minutes % 60),
            _ => write!(f, "{minutes} min {} s", seconds % 60),
        }
    }
}

/// Announces the duration of a long move. At a terminal the user is asked whether to continue, unless `yes` is set.
/// \[OURS] Without a terminal the move continues, so that older scripts still run.
///
/// # Errors
/// [`BoardError::Refused`] if the user does not answer yes, [`BoardError::Stopped`], and errors of reading reports.
pub fn announce(board: &Board, path: &Path, yes: bool) -> Result<Asked, BoardError> {
    let seconds = path.profile.as_ref().map_or(0.0, Profile::seconds);
    if seconds <= TOLD_FROM_S {
        return Ok(Asked::No);
    }
    let takes = Long(seconds);
    let furthest = path.axes.iter().max_by_key(|axis| axis.end.abs_diff(axis.start));
    let way = furthest.map_or_else(String::new, |axis| {
        format!(", for {}", board.distance_in_units(axis.slave, axis.end.abs_diff(axis.start)))
    });
    board.reporter.note(format_args!("this move takes {takes}{way}; --velocity makes it shorter"));
    if yes || !board.can_ask() {
        return Ok(Asked::No);
    }
    if board.ask(&format!("{WHAT} for {takes}?"))? {
        return Ok(Asked::Yes);
    }
    Err(refused(format!("nobody has said yes to {takes}"), "give a higher --velocity, or --yes"))
}

/// Whether the user was asked. If so, the axes may have been moved by hand before the answer, so the path must be
/// planned again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    No,
    Yes,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_times_are_told_in_their_units() {
        let said = [60.4, 61.0, 500.0, 3599.4, 3600.0, 11_100.0, 86_400.0, 90_000.0].map(|s| Long(s).to_string());
        let expected =
            ["1 min 0 s", "1 min 1 s", "8 min 20 s", "59 min 59 s", "1 h 0 min", "3 h 5 min", "1 d 0 h", "1 d 1 h"];
        assert_eq!(said, expected);
    }
}
