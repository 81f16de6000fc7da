//! Which targets were in force when a report was made.

use std::collections::VecDeque;

use ecmsk::recording::{Executed, LastExecuted};
use ecmsk::sk::{FIFO_ENTRIES, MasterResponse};

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
    /// See [`LastExecuted::Doubtful`].
    Doubtful,
    /// Nothing: nothing was executed yet, or commands were lost.
    Unknown,
}

/// The commands sent in OP, as far as they may still wait.
#[derive(Debug)]
pub struct Follow {
    cycle_ns: i64,
    executed: Executed,
    /// The targets in force once a command has been executed; the oldest command first.
    sent: VecDeque<Targets>,
}

impl Follow {
    /// Of a board with that cycle, in nanoseconds.
    pub fn new(cycle_ns: i64) -> Self {
        Self { cycle_ns, executed: Executed::new(cycle_ns), sent: VecDeque::new() }
    }

    /// A command goes by: its targets, and whether it clears the FIFO.
    pub fn command(&mut self, targets: &Targets, clears: bool) {
        let mut in_force = self.sent.back().copied().unwrap_or_default();
        if clears {
            // What the commands before it would have left in force is gone too.
            in_force = Targets::default();
        }
        for (old, new) in in_force.iter_mut().zip(targets) {
            *old = new.or(*old);
        }
        if self.sent.len() == KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back(in_force);
        self.executed.command(clears);
    }

    /// A report of OP goes by. After a loss the targets are not known until a command sent later has been executed.
    pub fn report(&mut self, at_ns: i64, board: &MasterResponse) -> InForce<'_> {
        let last = match self.executed.report(at_ns, board) {
            LastExecuted::Command(last) => last,
            LastExecuted::Doubtful => return InForce::Doubtful,
            LastExecuted::Nothing | LastExecuted::Unknown => return InForce::Unknown,
        };
        let oldest = self.executed.count() - self.sent.len() as u64;
        for _ in oldest..last {
            self.sent.pop_front();
        }
        self.sent.front().map_or(InForce::Doubtful, InForce::Known)
    }

    /// OP was left: the FIFO is empty and targets are void.
    pub fn reset(&mut self) {
        self.executed.reset(self.cycle_ns);
        self.sent.clear();
    }
}
