//! What every report and every shaft must show.

use ecmsk::cia402::{DriveState, Mode};
use ecmsk::fieldbus::Ns;
use ecmsk::sk::{DriveResponse, Frame, MasterResponse, MasterState, StateByte};

use crate::machine::{Machine, SPEED};

/// A drive's shaft and statusword as they were last.
#[derive(Clone, Copy, Default)]
struct Last {
    shaft: Option<i64>,
    state: Option<DriveState>,
    /// Shaft less position actual.
    offset: Option<i32>,
}

/// The watch.
pub struct Watch {
    state: StateByte,
    drives: Vec<Last>,
    /// Fastest that a shaft was, as a part of what it may be.
    pub fastest: f64,
}

impl Watch {
    pub fn new(machine: &Machine) -> Self {
        Self { state: machine.state(), drives: vec![Last::default(); machine.axes.len()], fastest: 0.0 }
    }

    /// A cycle of `dt_ns` has passed.
    pub fn cycle(&mut self, machine: &Machine, report: Option<&Frame>, dt_ns: Ns) {
        let shafts: Vec<_> = machine.axes.iter().map(|axis| machine.network.shaft(axis.slave as u8, 0)).collect();
        if let Some(report) = report {
            self.state_byte(MasterResponse::decode(&report.slot(machine.size, 0)).state);
            for (n, axis) in machine.axes.iter().enumerate() {
                // SK-4: lost slots keep their values.
                if machine.state() == StateByte::reached(MasterState::Op) {
                    self.drive(n, &DriveResponse::decode(&report.slot(machine.size, axis.slave)), machine.board.now());
                } else {
                    self.drives[n].state = None;
                }
            }
        }
        for (n, (axis, shaft)) in machine.axes.iter().zip(shafts).enumerate() {
            let shaft = shaft.expect("a drive has a shaft");
            if let Some(before) = self.drives[n].shaft {
                let speed = (shaft - before).abs() as f64 * 1e9 / dt_ns as f64;
                self.speed(speed, axis.mode, dt_ns, axis.slave);
            }
            self.drives[n].shaft = Some(shaft);
        }
    }

    /// Nothing that the board adds makes a shaft faster than the program's paths are.
    fn speed(&mut self, speed: f64, mode: Mode, dt_ns: Ns, slave: usize) {
        // A count more or less is half a count of rounding at either end.
        let rounding = 1e9 / dt_ns as f64;
        let limit = 2.0 * f64::from(SPEED) + rounding;
        if mode != Mode::Cst {
            self.fastest = self.fastest.max(speed / limit);
        }
        assert!(speed <= limit, "slave {slave} ({mode}) turns at {speed} counts/s, no path at more than {SPEED}");
    }

    /// SK-4: from each state those below it and the next above it; and failures.
    fn state_byte(&mut self, state: StateByte) {
        let (was, is) = (self.state, state);
        self.state = state;
        if was == is {
            return;
        }
        let (Some(from), Some(to)) = (was.state(), is.state()) else { panic!("state {was} to {is}") };
        let legal = match (was.is_failed(), is.is_failed()) {
            (_, true) => from == to,
            (true, false) => to <= from,
            (false, false) => to < from || to.code() == from.code() * 2,
        };
        assert!(legal, "state {was} to {is}");
    }

    fn drive(&mut self, n: usize, answer: &DriveResponse, at: Ns) {
        let last = &mut self.drives[n];
        let state = answer.statusword.state();
        assert!(state.is_some(), "statusword {:04X}", answer.statusword.0);
        if let (Some(from), Some(to)) = (last.state, state) {
            assert!(from == to || is_legal(from, to), "slave {}: {from} to {to}", n + 2);
        }
        last.state = state;
        // Inputs are those that the slave had when the frame passed it, at the end of the cycle before.
        if let Some(shaft) = last.shaft {
            let offset = (shaft as i32).wrapping_sub(answer.position);
            let steps = format!("slave {}: 0x6064 steps to {} at {} ns", n + 2, answer.position, at);
            assert_eq!(last.offset.unwrap_or(offset), offset, "{steps}");
            last.offset = Some(offset);
        }
    }
}

/// The transitions of CiA 402-2 figure 2, and two of them in one cycle where the first does not wait.
fn is_legal(from: DriveState, to: DriveState) -> bool {
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
