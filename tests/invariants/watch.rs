//! Invariants of every report and every shaft.

use ecmsk::cia402::{DriveState, Mode};
use ecmsk::engine::HomingPhase;
use ecmsk::fieldbus::Ns;
use ecmsk::sk::{Frame, MasterResponse, MasterState, StateByte};

use crate::machine::{Machine, SPEED};

/// The last state of an axis.
#[derive(Clone, Copy, Default)]
struct Last {
    shaft: Option<i64>,
    state: Option<DriveState>,
    /// Shaft position minus position actual.
    offset: Option<i32>,
    /// Whether it was homing in the previous cycle.
    homing: bool,
    /// Whether its shaft was jammed, or has just been freed.
    jammed: bool,
}

/// The checks.
pub struct Watch {
    state: StateByte,
    boots: u64,
    axes: Vec<[Last; 2]>,
    /// The greatest speed of a shaft, as a share of its limit.
    pub fastest: f64,
    /// Steps of 0x6064 at a home event.
    pub homed: u64,
}

impl Watch {
    pub fn new(machine: &Machine) -> Self {
        Self {
            state: machine.state(),
            boots: machine.board.engine().boots(),
            axes: vec![Default::default(); machine.units.len()],
            fastest: 0.0,
            homed: 0,
        }
    }

    /// The shafts of a slave were jammed, or freed.
    pub fn jam(&mut self, n: usize, jammed: bool) {
        self.axes[n].iter_mut().for_each(|last| last.jammed = jammed);
    }

    /// A cycle of `dt_ns` has passed.
    pub fn cycle(&mut self, machine: &Machine, report: Option<&Frame>, dt_ns: Ns) {
        if machine.board.engine().boots() != self.boots {
            // SK-4.47 The first state that a host sees of a board.
            self.boots = machine.board.engine().boots();
            self.state = StateByte::reached(MasterState::PreOp);
        }
        if let Some(report) = report {
            let state = MasterResponse::decode(&report.slot(machine.size, 0)).state;
            assert_legal_state(self.state, state);
            self.state = state;
            for n in 0..machine.units.len() {
                self.answer(n, machine, report);
            }
        }
        for (n, unit) in machine.units.iter().enumerate() {
            for axis in 0..unit.axes {
                let shaft = machine.network.shaft(unit.slave as u8, axis).expect("an axis has a shaft");
                let last = self.axes[n][axis];
                if let Some(before) = last.shaft
                    && !last.jammed
                {
                    self.fastest = self.fastest.max(speed_share(shaft - before, unit.mode, dt_ns, unit.slave));
                }
                self.axes[n][axis].shaft = Some(shaft);
            }
        }
    }

    /// Checks a slave's slot.
    fn answer(&mut self, n: usize, machine: &Machine, report: &Frame) {
        let unit = &machine.units[n];
        let slave = unit.slave;
        let homing = machine.board.engine().homing_phase(slave as u8) != HomingPhase::Idle;
        if !machine.is_heard(slave) {
            // SK-4: lost slots keep their values, and so do the slots of a board that is not in OP.
            self.axes[n].iter_mut().for_each(|last| (last.state, last.homing) = (None, homing || last.homing));
            return;
        }
        let (statusword, positions) = unit.answer(report, machine.size);
        let state = statusword.state();
        assert!(state.is_some(), "statusword {:04X}", statusword.0);
        if let (Some(from), Some(to)) = (self.axes[n][0].state, state) {
            assert!(from == to || is_legal(from, to), "slave {slave}: {from} to {to}");
        }
        self.axes[n][0].state = state;
        for (last, position) in self.axes[n].iter_mut().zip(positions).take(unit.axes) {
            // Inputs are those of the slave when the frame passed it, at the end of the previous cycle.
            let Some(shaft) = last.shaft else { continue };
            let offset = (shaft as i32).wrapping_sub(position);
            let steps = last.offset.is_some_and(|last| last != offset);
            let at = machine.board.now();
            assert!(!steps || homing || last.homing, "slave {slave}: 0x6064 steps to {position} at {at} ns");
            self.homed += u64::from(steps);
            (last.offset, last.homing) = (Some(offset), homing);
        }
    }
}

/// Asserts that the board makes no shaft faster than the program's paths. Returns the speed as a share of the limit; in
/// CST 0.
pub fn speed_share(moved: i64, mode: Mode, dt_ns: Ns, slave: usize) -> f64 {
    let speed = moved.abs() as f64 * 1e9 / dt_ns as f64;
    // The tolerance of a count is half a count of rounding at either end.
    let rounding = 1e9 / dt_ns as f64;
    let limit = 2.0 * f64::from(SPEED) + rounding;
    assert!(speed <= limit, "slave {slave} ({mode}) turns at {speed} counts/s, no path at more than {SPEED}");
    if mode == Mode::Cst { 0.0 } else { speed / limit }
}

/// SK-4: from each state to those below it and the next one above it; and failures.
pub fn assert_legal_state(was: StateByte, is: StateByte) {
    if was == is {
        return;
    }
    let (Some(from), Some(to)) = (was.state(), is.state()) else { panic!("state {was} to {is}") };
    let legal = match (was.is_failed(), is.is_failed()) {
        (false, true) => from == to,
        // On the way down the present slaves go first.
        (true, true) => to < from,
        (true, false) => to <= from,
        (false, false) => to < from || to.code() == from.code() * 2,
    };
    assert!(legal, "state {was} to {is}");
}

/// The transitions of CiA 402-2 figure 2, and two of them in one cycle where the first does not wait.
pub fn is_legal(from: DriveState, to: DriveState) -> bool {
    use DriveState::*;
    match (from, to) {
        (_, FaultReactionActive | Fault) => from != Fault,
        (NotReadyToSwitchOn | ReadyToSwitchOn | SwitchedOn | OperationEnabled | QuickStopActive, SwitchOnDisabled) => {
            true
        }
        (Fault, SwitchOnDisabled) => true,
        (SwitchOnDisabled, ReadyToSwitchOn) | (ReadyToSwitchOn, SwitchedOn) | (SwitchedOn, OperationEnabled) => true,
        (OperationEnabled, SwitchedOn | ReadyToSwitchOn | QuickStopActive) | (SwitchedOn, ReadyToSwitchOn) => true,
        (QuickStopActive, OperationEnabled) => true,
        _ => false,
    }
}
