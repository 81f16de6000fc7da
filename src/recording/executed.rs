//! Which command was executed last when a report was made.
//!
//! A command waits in the FIFO until its cycle, and reports do not say which one that was. But they give the free
//! entries: what was sent and does not wait any more has been executed (SK-5).

use crate::sk::{FIFO_ENTRIES, MasterResponse};

/// What is known of the command executed last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LastExecuted {
    /// None was yet, of those sent in OP.
    Nothing,
    /// This one: its number among those sent in OP, from 0.
    Command(u64),
    /// The count of commands does not fit the cycles that have passed: a command and the report crossed each other.
    Doubtful,
    /// Commands were lost, and none sent later was executed yet.
    Unknown,
}

/// Follows the command FIFO of a board in OP by its reports.
#[derive(Clone, Debug)]
pub struct Executed {
    /// Nanoseconds of a cycle.
    cycle_ns: i64,
    /// Commands sent so far.
    count: u64,
    /// Of commands before this one it is not known which were taken.
    known_from: u64,
    /// Full count and CRC errors of the last report.
    losses: Option<(u16, u8)>,
    /// The last report: when it was made, commands executed by then, commands that waited.
    before: Option<(i64, u64, u64)>,
    /// The last report of which it was known: when it was made, commands executed by then.
    known: Option<(i64, u64)>,
}

impl Executed {
    /// Of a board with that cycle, in nanoseconds.
    pub fn new(cycle_ns: i64) -> Self {
        Self { cycle_ns: cycle_ns.max(1), count: 0, known_from: 0, losses: None, before: None, known: None }
    }

    /// Commands sent so far.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The first command that may have been executed, of those sent since a loss or a clear: of earlier ones it is not known.
    pub const fn known_from(&self) -> u64 {
        self.known_from
    }

    /// A command frame is sent in OP; gives its number. `clears`: whether it clears the FIFO; it is the first entry itself
    /// then, and those before it are gone (SK-5).
    pub const fn command(&mut self, clears: bool) -> u64 {
        if clears {
            self.known_from = self.count;
        }
        self.count += 1;
        self.count - 1
    }

    /// A report of OP goes by. After a loss nothing is known until a command sent later has been executed.
    pub fn report(&mut self, at_ns: i64, board: &MasterResponse) -> LastExecuted {
        let losses = (board.full_count, board.error);
        if self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.known_from = self.count;
        }
        let waiting = u64::from(FIFO_ENTRIES.saturating_sub(board.fifo_free));
        let executed = self.count.saturating_sub(waiting);
        let fits =
            self.before.replace((at_ns, executed, waiting)).is_none_or(|before| self.fits(before, at_ns, executed))
                || self.known.is_some_and(|known| self.goes_on(known, at_ns, executed));
        if fits {
            self.known = Some((at_ns, executed));
        }
        match executed.checked_sub(1) {
            None if self.known_from == 0 => LastExecuted::Nothing,
            Some(last) if last >= self.known_from && fits => LastExecuted::Command(last),
            Some(last) if last >= self.known_from => LastExecuted::Doubtful,
            _ => LastExecuted::Unknown,
        }
    }

    /// Whether one command was executed in each cycle since the report before, if enough of them waited.
    fn fits(&self, (then_ns, executed_then, waited): (i64, u64, u64), at_ns: i64, executed: u64) -> bool {
        let cycles = self.cycles(then_ns, at_ns);
        waited < cycles || executed.checked_sub(executed_then) == Some(cycles)
    }

    /// Whether one command was executed in each cycle since the last report of which it was known: those between crossed
    /// commands, and this one does not.
    fn goes_on(&self, (then_ns, executed_then): (i64, u64), at_ns: i64, executed: u64) -> bool {
        executed.checked_sub(executed_then) == Some(self.cycles(then_ns, at_ns))
    }

    /// The cycles between two times, in nanoseconds.
    fn cycles(&self, then_ns: i64, at_ns: i64) -> u64 {
        let passed = at_ns.saturating_sub(then_ns).max(0);
        (passed.saturating_add(self.cycle_ns / 2) / self.cycle_ns).unsigned_abs()
    }

    /// OP was left: the FIFO is empty. `cycle_ns`: what it will be in OP again.
    pub fn reset(&mut self, cycle_ns: i64) {
        *self = Self { losses: self.losses, ..Self::new(cycle_ns) };
    }
}
