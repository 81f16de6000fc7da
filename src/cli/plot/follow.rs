//! Which targets were in force when a report was made.
//!
//! A command waits in the FIFO until its cycle, and reports do not say which one that was. But they give the free
//! entries: what was sent and does not wait any more has been executed (SK-5).

use std::collections::VecDeque;

use ecmsk::sk::FIFO_ENTRIES;

use super::MAX_AXES;

/// Target positions, one for each axis of the plot, where there was one.
pub type Targets = [Option<i32>; MAX_AXES];

/// Commands that may wait, and the one executed last.
const KEPT: usize = FIFO_ENTRIES as usize + 1;

/// What is known of the targets in force in a cycle.
#[derive(Debug, PartialEq, Eq)]
pub enum InForce<'a> {
    /// These.
    Known(&'a Targets),
    /// The count of commands does not fit the cycles that have passed: a command and the report crossed each other.
    Doubtful,
    /// Nothing: nothing was executed yet, or commands were lost.
    Unknown,
}

/// The commands sent in OP, as far as they may still wait.
#[derive(Debug, Default)]
pub struct Follow {
    /// Nanoseconds of a cycle.
    cycle_ns: i64,
    /// The targets in force once a command has been executed; the oldest command first.
    sent: VecDeque<Targets>,
    /// Commands sent so far.
    count: u64,
    /// Of commands before this one it is not known which were taken.
    known_from: u64,
    /// Full count and CRC errors of the last report.
    losses: Option<(u16, u8)>,
    /// The last report: when it was made, commands executed by then, commands that waited.
    before: Option<(i64, u64, u64)>,
}

impl Follow {
    /// Of a board with that cycle.
    pub fn new(cycle_ns: i64) -> Self {
        Self { cycle_ns: cycle_ns.max(1), ..Self::default() }
    }

    /// A command goes by: its targets, and whether it clears the FIFO.
    pub fn command(&mut self, targets: &Targets, clears: bool) {
        let mut in_force = self.sent.back().copied().unwrap_or_default();
        if clears {
            // It is the first entry itself; those before it are gone (SK-5), and what they would have left in force too.
            self.known_from = self.count;
            in_force = Targets::default();
        }
        for (old, new) in in_force.iter_mut().zip(targets) {
            *old = new.or(*old);
        }
        if self.sent.len() == KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back(in_force);
        self.count += 1;
    }

    /// A report of OP goes by, with its free entries, full count and count of CRC errors. After a loss the targets are
    /// not known until a command sent later has been executed.
    pub fn report(&mut self, at_ns: i64, free: u16, full_count: u16, crc_errors: u8) -> InForce<'_> {
        let losses = (full_count, crc_errors);
        if self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.known_from = self.count;
        }
        let waiting = u64::from(FIFO_ENTRIES.saturating_sub(free));
        let executed = self.count.saturating_sub(waiting);
        let fits =
            self.before.replace((at_ns, executed, waiting)).is_none_or(|before| self.fits(before, at_ns, executed));
        let Some(last) = executed.checked_sub(1).filter(|last| *last >= self.known_from) else {
            return InForce::Unknown;
        };
        let oldest = self.count - self.sent.len() as u64;
        for _ in oldest..last {
            self.sent.pop_front();
        }
        match self.sent.front() {
            Some(targets) if fits => InForce::Known(targets),
            _ => InForce::Doubtful,
        }
    }

    /// Whether one command was executed in each cycle since the report before, if enough of them waited.
    fn fits(&self, (then_ns, executed_then, waited): (i64, u64, u64), at_ns: i64, executed: u64) -> bool {
        let passed = at_ns.saturating_sub(then_ns).max(0);
        let cycles = (passed.saturating_add(self.cycle_ns / 2) / self.cycle_ns).unsigned_abs();
        waited < cycles || executed.checked_sub(executed_then) == Some(cycles)
    }

    /// OP was left: the FIFO is empty and targets are void.
    pub fn reset(&mut self) {
        *self = Self { cycle_ns: self.cycle_ns, losses: self.losses, ..Self::default() };
    }
}
