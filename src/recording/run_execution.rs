//! Follows the frames of a run (all frames that pass between a program and a board): the kinds of the slaves, and which
//! commands the board has executed in OP.

use super::execution::{Execution, ExecutionReport, NO_ORDERS};
use super::slave_kinds::Kinds;
use crate::sk::{FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotCommand, SlotSize};

/// The cycle time of a board to which no SET_DC was sent (UG 1.7), in nanoseconds.
const DEFAULT_CYCLE_NS: i64 = 1_000_000;

/// Follows the frames of a run: all frames that pass between a program and a board. They have to be sorted by time.
#[derive(Debug)]
pub struct RunExecution {
    kinds: Kinds,
    execution: Execution,
    cycle_ns: i64,
    in_op: bool,
    damage_before: u64,
}

impl Default for RunExecution {
    fn default() -> Self {
        Self {
            kinds: Kinds::new(None),
            execution: Execution::new(DEFAULT_CYCLE_NS),
            cycle_ns: DEFAULT_CYCLE_NS,
            in_op: false,
            damage_before: 0,
        }
    }
}

impl RunExecution {
    /// Starts without frames. The cycle time is 1 ms until a SET_DC command sets another one.
    pub fn new() -> Self {
        Self::default()
    }

    /// To be called before each frame of a recording that may be damaged, with its
    /// [`damage_before`](super::Recorded::damage_before). Returns whether frames are missing since the frame before. It is
    /// then unknown which commands were executed.
    pub fn damage(&mut self, damage_before: u64) -> bool {
        let is_lost = damage_before > self.damage_before;
        if is_lost {
            self.damage_before = damage_before;
            self.execution.lost();
        }
        is_lost
    }

    /// Adds the next command frame.
    pub fn command(&mut self, at_ns: i64, frame: &Frame, size: SlotSize) {
        self.kinds.command(frame, size);
        let master = MasterCommand::decode(&frame.slot(size, 0), size);
        if !self.in_op {
            if let Ok(MasterCommand::SetDc { cycle, .. }) = master {
                self.cycle_ns = i64::from(cycle.us()).max(1) * 1000;
                self.execution = Execution::new(self.cycle_ns);
            }
            return;
        }
        let mut orders = NO_ORDERS;
        for (slave, order) in (1..=size.max_slaves()).zip(&mut orders) {
            *order = SlotCommand::decode(&frame.slot(size, slave), size).ok().map(|slot| slot.command);
        }
        self.execution.command(at_ns, orders, master == Ok(MasterCommand::SetFifo(FifoAction::Clear)));
    }

    /// Adds the next report. Returns what it shows about the execution of commands, whose
    /// [`orders`](super::Entry::orders) are those of slaves 1, 2 and so on. Returns `None` outside OP, and in state
    /// 0x18 (a slave is lost), in which slots of lost slaves repeat their last values: commands executed before have no
    /// effect any more.
    pub fn report(&mut self, at_ns: i64, frame: &Frame, size: SlotSize) -> Option<ExecutionReport> {
        self.kinds.response(frame, size);
        let board = MasterResponse::decode(&frame.slot(size, 0));
        self.in_op = board.state.state() == Some(MasterState::Op);
        if !self.in_op || board.state.is_failed() {
            self.execution.reset();
            return None;
        }
        Some(self.execution.report(at_ns, &board))
    }

    /// The kind of a slave, from 1; `None`: it is not known.
    pub fn kind(&self, slave: usize) -> Option<SlaveKind> {
        self.kinds.of(slave)
    }

    /// The cycle time that the last SET_DC has set, or else the default of 1 ms, in nanoseconds.
    pub const fn cycle_ns(&self) -> i64 {
        self.cycle_ns
    }
}
