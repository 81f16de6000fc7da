//! Reports over a bus that takes outputs ahead: each shows the cycle that it answers.

use ecmsk::cia402::{Controlword, DriveState};
use ecmsk::fieldbus::{Ns, SlaveSet};
use ecmsk::sk::{CommandId, Frame, MasterResponse, MasterState, StateByte};

use super::Around;
use super::ledger::shown_mark;
use super::log::SLAVES;
use super::trace::Trace;
use crate::machine::{MARKER, Machine};
use crate::watch::{assert_legal_state, is_legal};

/// The last values of an axis in a report.
#[derive(Clone, Copy, Default)]
struct Last {
    state: Option<DriveState>,
    /// Shaft position minus position actual.
    offset: Option<i32>,
}

/// The checks of reports.
pub struct Answers {
    state: StateByte,
    boots: u64,
    last: [[Last; 2]; SLAVES],
    /// The cycle that the newest report of OP has answered.
    answered: Option<usize>,
    /// Slaves that were homing in the board's previous cycle.
    homing: SlaveSet,
    /// Steps of 0x6064 at a home event.
    pub homed: u64,
    /// Reports that were compared with the cycle that they answer.
    pub compared: u64,
}

impl Answers {
    pub fn new(machine: &Machine) -> Self {
        Self {
            state: machine.state(),
            boots: machine.board.engine().boots(),
            last: Default::default(),
            answered: None,
            homing: SlaveSet::EMPTY,
            homed: 0,
            compared: 0,
        }
    }

    /// A cycle of the board has passed, with these reports.
    pub fn cycle(&mut self, trace: &Trace, machine: &Machine, around: &Around, reports: &[(Frame, Ns)]) {
        if machine.board.engine().boots() != self.boots {
            // SK-4.47 The first state that a host sees of a board.
            self.boots = machine.board.engine().boots();
            self.state = StateByte::reached(MasterState::PreOp);
        }
        for (report, at) in reports {
            let state = MasterResponse::decode(&report.slot(machine.size, 0)).state;
            if let (Some(to), true, false) = (state.state(), state.is_failed(), self.state.is_failed()) {
                // The first answer after a change of state may come with the report of the new state, and show a lost
                // slave.
                let reached = StateByte::reached(to);
                assert_legal_state(self.state, reached);
                self.state = reached;
            }
            assert_legal_state(self.state, state);
            self.state = state;
            match trace.cycle_at(*at).filter(|_| state.state() == Some(MasterState::Op)) {
                Some(n) => self.report(trace, machine, around, report, n),
                None => self.answered = None,
            }
        }
        self.homing = around.homing;
    }

    fn report(&mut self, trace: &Trace, machine: &Machine, around: &Around, report: &Frame, n: usize) {
        let is_next = self.answered == n.checked_sub(1) && self.answered.is_some();
        self.answered = Some(n);
        let cycle = trace.cycle(n);
        let unheard = around.lost().union(cycle.lost).union(cycle.without_outputs);
        let mark = shown_mark(trace, n);
        if mark != 0 && n >= trace.op && !unheard.contains(MARKER as u8) {
            let answer = report.slot(machine.size, MARKER);
            let shown = (answer.id, answer.index, answer.data1);
            assert_eq!(shown, (CommandId::IoWrite.code(), mark as u8, mark.into()), "an answer belongs to its outputs");
            self.compared += 1;
        }
        for (k, unit) in machine.units.iter().enumerate() {
            let slave = unit.slave as u8;
            // The slot of a slave that was not found has no values of a slave.
            if slave > around.found || unheard.contains(slave) || n < trace.op {
                self.last[k] = Default::default();
                continue;
            }
            let (statusword, positions) = unit.answer(report, machine.size);
            let state = statusword.state();
            assert!(state.is_some(), "statusword {:04X}", statusword.0);
            if let (Some(from), Some(to), true) = (self.last[k][0].state, state, is_next) {
                assert!(from == to || is_legal(from, to), "slave {slave}: {from} to {to}");
            }
            self.last[k][0].state = state;
            // A drive homes by the outputs sent to it, even if the board has ended the homing since.
            let sent = [n.saturating_sub(1).max(trace.oldest()), n].map(|n| trace.cycle(n).outputs.as_ref());
            let bit_4 = |axis: usize| {
                let words = sent.iter().flatten().map(|(_, outputs)| outputs[unit.slave - 1][axis].controlword.0);
                words.fold(0, |all, word| all | word) & Controlword::HOMING_START != 0
            };
            let homing = around.homing.union(self.homing).contains(slave);
            for (axis, position) in positions.into_iter().enumerate().take(unit.axes) {
                let shaft = cycle.measured[unit.slave - 1][axis].expect("an axis has a shaft");
                let offset = (shaft as i32).wrapping_sub(position);
                let steps = self.last[k][axis].offset.is_some_and(|last| last != offset);
                assert!(
                    !steps || homing || bit_4(axis),
                    "slave {slave}: 0x6064 steps to {position} at {} ns",
                    cycle.at
                );
                self.homed += u64::from(steps);
                self.last[k][axis].offset = Some(offset);
            }
        }
    }
}
