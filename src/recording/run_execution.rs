//! Follows the frames of a run (all frames that pass between a program and a board): the kinds of the slaves, and which
//! commands the board has executed in OP.

use super::execution::{Execution, ExecutionReport, Orders};
use super::slave_kinds::Kinds;
use crate::sk::{
    CommandId, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotCommand, SlotSize,
};

/// The cycle time of a board to which no SET_DC was sent (UG 1.7), in nanoseconds.
const DEFAULT_CYCLE_NS: i64 = 1_000_000;

/// Follows the frames of a run: all frames that pass between a program and a board. They have to be sorted by time.
#[derive(Debug)]
pub struct RunExecution {
    kinds: Kinds,
    execution: Execution,
    cycle_ns: i64,
    in_op: bool,
    /// The most commands that a frame had so far: the room for those of the next one.
    orders_most: usize,
    damage_before: u64,
}

impl Default for RunExecution {
    fn default() -> Self {
        Self {
            kinds: Kinds::new(None),
            execution: Execution::new(DEFAULT_CYCLE_NS),
            cycle_ns: DEFAULT_CYCLE_NS,
            in_op: false,
            orders_most: 0,
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
        let command = |slave: usize| {
            let slot = frame.slot(size, slave);
            // GET_STATUS is no new request, so the slave goes on with its last command. Most slots have it, since most boards
            // have few slaves.
            let is_order = slot.id != CommandId::GetStatus.code();
            let order = || SlotCommand::decode(&slot, size).ok().map(|decoded| (slave, decoded.command));
            is_order.then(order).flatten()
        };
        let mut orders = Orders::with_capacity(self.orders_most);
        orders.extend((1..=size.max_slaves()).filter_map(command));
        self.orders_most = self.orders_most.max(orders.len());
        self.execution.command(at_ns, orders, master == Ok(MasterCommand::SetFifo(FifoAction::Clear)));
    }

    /// Adds the next report. Returns what it shows about the execution of commands, whose
    /// [`orders`](super::Entry::orders) have the numbers of their slaves, from 1. Returns `None` outside OP, and in state
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
