//! Counts the reports and cycles that a host has missed because this machine is too slow for the cycle of its board.
//! The numbers come from the counters of the link.

use std::fmt;

use crate::link::LinkStats;

/// Counters of a link that rise when this machine is too slow to read every report or to run every cycle in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Lateness {
    /// The number of reports that a newer one has replaced before the server read them.
    reports: u64,
    /// The number of cycles that the engine has skipped, because its thread ran too late (NIC-2.4).
    cycles: u64,
}

impl Lateness {
    pub(super) fn of(stats: &LinkStats) -> Self {
        let cycles = stats.board.as_ref().map_or(0, |board| board.cycles_left_out);
        Self { reports: stats.reports_dropped, cycles }
    }

    /// The increase since `before`. Counters that are lower than before belong to a board that was opened again: the
    /// increase is then 0.
    pub(super) const fn since(self, before: Self) -> Self {
        Self { reports: self.reports.saturating_sub(before.reports), cycles: self.cycles.saturating_sub(before.cycles) }
    }
}

/// Writes both counts as the end of the log line about a session; writes nothing if both are 0.
impl fmt::Display for Lateness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self { reports: 0, cycles: 0 } => Ok(()),
            Self { reports, cycles } => write!(
                f,
                "; this machine was late: reports replaced before they were read: {reports}, cycles left out: {cycles}"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The log line about the end of a session counts only what has happened since the host came; without any delay it
    /// says nothing.
    #[test]
    fn lateness_is_counted_from_the_host_on() {
        let counted = |reports, cycles| {
            let board = crate::engine::Counters { cycles_left_out: cycles, ..Default::default() };
            Lateness::of(&LinkStats { reports_dropped: reports, board: Some(board), ..LinkStats::default() })
        };
        let came = counted(5, 7);
        assert_eq!(came.since(came).to_string(), "");
        let line = counted(6, 9).since(came).to_string();
        assert!(line.ends_with("before they were read: 1, cycles left out: 2"), "{line}");
        assert_eq!(Lateness::of(&LinkStats::default()).since(came), Lateness::default(), "the board was opened anew");
    }
}
