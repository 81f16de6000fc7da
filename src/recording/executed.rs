//! Finds the command that the board had executed last when it made a report.
//!
//! A command waits in the FIFO until the board executes it, and reports do not say which command that was. But they
//! have the free count of the FIFO: a command that was sent and no longer waits in the FIFO has been executed (SK-5).

use crate::sk::{FIFO_ENTRIES, MasterResponse};

/// The command that the board had executed last when it made a report, as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LastExecuted {
    /// None of the commands sent in OP was executed yet.
    Nothing,
    /// The number of the command among those sent in OP, from 0.
    Command(u64),
    /// The free count does not match the cycles that have passed: a command and the report were in flight at the same
    /// time, so it is unknown whether the command was in the FIFO when the report was made. A later report shows it.
    Ambiguous,
    /// Commands were lost (FIFO full or CRC error), and no command that was sent later has been executed yet.
    Unknown,
}

/// Follows the command FIFO of a board in OP, by the commands sent and the reports received.
#[derive(Clone, Debug)]
pub struct Executed {
    /// The cycle time in nanoseconds.
    cycle_ns: i64,
    /// The number of commands sent so far.
    count: u64,
    /// The number of the first command whose fate is known. A loss (FIFO full or CRC error) leaves open which of the
    /// earlier commands the board has refused; a command that clears the FIFO removes the earlier ones.
    known_from: u64,
    /// The FIFO-full count and the CRC error count of the last report, to notice losses. `None`: no report has come
    /// yet.
    losses: Option<(u16, u8)>,
    /// The last report: its time in nanoseconds, the number of commands executed by then, and the number that waited in
    /// the FIFO. `None`: no report has come since OP began.
    previous: Option<(i64, u64, u64)>,
    /// The last report whose result is certain: its time in nanoseconds, and the number of commands executed by then.
    /// `None`: no result was certain yet.
    last_certain: Option<(i64, u64)>,
}

impl Executed {
    /// A tracker for a board with this cycle time in nanoseconds.
    pub fn new(cycle_ns: i64) -> Self {
        Self { cycle_ns: cycle_ns.max(1), count: 0, known_from: 0, losses: None, previous: None, last_certain: None }
    }

    /// The number of commands sent so far.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The number of the first command whose fate is known: the first one after the last loss, or the last one that
    /// cleared the FIFO. It is unknown whether earlier commands were executed.
    pub const fn known_from(&self) -> u64 {
        self.known_from
    }

    /// Takes a command frame sent in OP and returns its number. `clears`: whether it clears the FIFO. It then removes
    /// the earlier entries and becomes the first entry itself (SK-5).
    pub const fn command(&mut self, clears: bool) -> u64 {
        if clears {
            self.known_from = self.count;
        }
        self.count += 1;
        self.count - 1
    }

    /// Takes a report of OP. After a loss the result is [`LastExecuted::Unknown`] until a command sent later was
    /// executed.
    pub fn report(&mut self, at_ns: i64, board: &MasterResponse) -> LastExecuted {
        let losses = (board.full_count, board.error);
        if self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.known_from = self.count;
        }
        let waiting = u64::from(FIFO_ENTRIES.saturating_sub(board.fifo_free));
        let executed = self.count.saturating_sub(waiting);
        let is_certain = self
            .previous
            .replace((at_ns, executed, waiting))
            .is_none_or(|before| self.matches_previous(before, at_ns, executed))
            || self.last_certain.is_some_and(|known| self.matches_last_certain(known, at_ns, executed));
        if is_certain {
            self.last_certain = Some((at_ns, executed));
        }
        match executed.checked_sub(1) {
            None if self.known_from == 0 => LastExecuted::Nothing,
            Some(last) if last >= self.known_from && is_certain => LastExecuted::Command(last),
            Some(last) if last >= self.known_from => LastExecuted::Ambiguous,
            _ => LastExecuted::Unknown,
        }
    }

    /// Whether one command was executed in each cycle since the previous report. If fewer commands waited than cycles
    /// have passed, the FIFO ran empty meanwhile; then the numbers cannot contradict each other, and the result is
    /// true.
    fn matches_previous(&self, (then_ns, executed_then, waited): (i64, u64, u64), at_ns: i64, executed: u64) -> bool {
        let cycles = self.cycles(then_ns, at_ns);
        waited < cycles || executed.checked_sub(executed_then) == Some(cycles)
    }

    /// Whether one command was executed in each cycle since the last report with a certain result. If so, the result of
    /// this report is certain, too. The results of the reports between the two did not fit only because commands were
    /// in flight when the board made those reports.
    fn matches_last_certain(&self, (then_ns, executed_then): (i64, u64), at_ns: i64, executed: u64) -> bool {
        executed.checked_sub(executed_then) == Some(self.cycles(then_ns, at_ns))
    }

    /// The number of cycles between two times in nanoseconds, rounded.
    fn cycles(&self, then_ns: i64, at_ns: i64) -> u64 {
        let passed = at_ns.saturating_sub(then_ns).max(0);
        (passed.saturating_add(self.cycle_ns / 2) / self.cycle_ns).unsigned_abs()
    }

    /// Notes that frames are missing before the next one. It is unknown which of the earlier commands were executed.
    pub const fn lost(&mut self) {
        (self.known_from, self.previous, self.last_certain) = (self.count, None, None);
    }

    /// Forgets all commands when OP is left, since the FIFO is empty then. `cycle_ns` is the cycle time from now on.
    pub fn reset(&mut self, cycle_ns: i64) {
        *self = Self { losses: self.losses, ..Self::new(cycle_ns) };
    }
}
