//! Switches a board off after its drives were brought to a standstill.

use super::Board;
use crate::fieldbus::{Ns, SlaveSet};
use crate::sk::{FifoAction, Frame, MasterCommand, MasterState, SlaveCommand};

/// How long all axes together may take to come to a standstill. After that the network leaves OP in any case. \[OURS]
const STANDSTILL_NS: Ns = 3_000_000_000;
/// How long the network may take to reach PreOP; then the board is switched off all the same. \[OURS]
const PRE_OP_NS: Ns = 5_000_000_000;

impl Board {
    /// Brings the network to a safe state before the board is switched off. The FIFO is cleared. Every axis is switched
    /// off as by SV_OFF, which makes it brake (0x605C of the drive). Then the network goes to PreOP, so that digital
    /// outputs go off, too. This takes some seconds of board time at most. Returns the slaves with an axis that still
    /// had torque at the end of the wait for the standstill; they have left OP all the same, unless the bus is down.
    pub fn switch_off(&mut self) -> SlaveSet {
        if !self.engine().network().in_op() {
            return SlaveSet::EMPTY;
        }
        let size = self.engine().config().slot;
        let with_axes: SlaveSet =
            (1..=self.engine().slaves_found()).filter(|slave| self.engine().axes((*slave).into()) > 0).collect();
        let mut frame = Frame::new();
        frame.put_master(size, &MasterCommand::SetFifo(FifoAction::Clear));
        for slave in with_axes.iter() {
            frame.put_slave(size, slave.into(), &SlaveCommand::ServoOff.into());
        }
        self.tell(&mut frame);
        self.pass_until(STANDSTILL_NS, |board| board.still_on(with_axes).is_empty());
        let still_on = self.still_on(with_axes);
        let mut frame = Frame::new();
        frame.put_master(size, &MasterCommand::SetState(MasterState::PreOp));
        self.tell(&mut frame);
        self.pass_until(PRE_OP_NS, |board| !board.engine().network().in_op());
        still_on
    }

    fn tell(&mut self, frame: &mut Frame) {
        frame.fill_crc(self.engine().config().slot);
        let now = self.now();
        self.host(frame, now, &mut |_, _| {});
    }

    fn pass_until(&mut self, limit_ns: Ns, done: impl Fn(&Self) -> bool) {
        let end = self.now().saturating_add(limit_ns);
        let is_gone = |board: &Self| board.cards_gone().is_some_and(|gone| gone.is_all);
        while !done(self) && self.now() < end && !is_gone(self) {
            // Before each cycle the bus gets all the time until the cycle is due. No runner, which could be late, is
            // involved here, so the board never is late.
            self.work_until(self.now(), self.next_cycle());
            self.cycle(&mut |_, _| {});
        }
    }

    fn still_on(&self, slaves: SlaveSet) -> SlaveSet {
        slaves.difference(self.engine().lost()).iter().filter(|slave| self.engine().has_torque(*slave)).collect()
    }
}
