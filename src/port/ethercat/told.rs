//! What is told of the slaves: their states, and the faults of their axes. It is told when it was looked at, so that what has come
//! and gone between two looks is not told.

use crate::ethercat::registers::{AL_STATUS_CODE, RequestedState};
use crate::ethercat::{AlState, AlStatus};
use crate::slave::esc::{Chain, EscSlave};
use crate::slave::{AXES_MAX, AxisFault};

/// What was told last.
pub(super) struct Told {
    /// The state of each slave.
    states: Vec<(RequestedState, AlStatus)>,
    /// The faults of the axes of each slave.
    faults: Vec<[Option<AxisFault>; AXES_MAX]>,
}

impl Told {
    /// Nothing was told of so many slaves: they are in Init and have no fault.
    pub(super) fn new(slaves: usize) -> Self {
        let init = (RequestedState::State(AlState::Init), AlStatus::NONE);
        Self { states: vec![init; slaves], faults: vec![[None; AXES_MAX]; slaves] }
    }

    /// Whether a slave is in OP.
    pub(super) fn has_op(&self) -> bool {
        self.states.iter().any(|(state, _)| *state == RequestedState::State(AlState::Op))
    }

    /// Makes lines of the states of `which` that have changed, one for neighbours that have changed alike.
    pub(super) fn look_at_states(
        &mut self,
        chain: &Chain,
        which: impl Fn((RequestedState, AlStatus)) -> bool,
        lines: &mut Vec<String>,
    ) {
        let mut n = 0;
        while n < self.states.len() {
            let state = state_of(chain.slave(n));
            let is_alike = |n: &usize| which(state) && self.states[*n] != state && state_of(chain.slave(*n)) == state;
            let end = (n..self.states.len()).find(|n| !is_alike(n)).unwrap_or(self.states.len());
            if end > n {
                lines.push(line_of(n, end, state));
                self.states[n..end].fill(state);
            }
            n = end.max(n + 1);
        }
    }

    /// Makes lines of the faults of axes that have come or gone.
    pub(super) fn look_at_faults(&mut self, chain: &Chain, lines: &mut Vec<String>) {
        for (n, told) in self.faults.iter_mut().enumerate() {
            let device = chain.slave(n).device();
            for (axis, told) in told.iter_mut().enumerate() {
                let fault = device.fault(axis);
                let before = std::mem::replace(told, fault);
                if fault == before {
                    continue;
                }
                let who = match device.shaft(1) {
                    None => format!("slave {}", n + 1),
                    Some(_) => format!("slave {}.{}", n + 1, axis + 1),
                };
                lines.extend(match (before, fault) {
                    (_, Some(AxisFault { code, meaning })) => Some(format!("{who}: alarm 0x{code:04X} ({meaning})")),
                    (Some(AxisFault { code, .. }), None) => Some(format!("{who}: alarm 0x{code:04X} is cleared")),
                    (None, None) => None,
                });
            }
        }
    }
}

/// The AL state of a slave and why it is there; 0: as the master wanted.
pub(super) fn state_of(slave: &EscSlave) -> (RequestedState, AlStatus) {
    let code = slave.controller().peek(AL_STATUS_CODE, 2);
    let code = code.try_into().map_or(0, u16::from_le_bytes);
    (slave.shown_state(), AlStatus(code))
}

/// The line on the slaves from the place `first` to the one before `end`.
fn line_of(first: usize, end: usize, (state, code): (RequestedState, AlStatus)) -> String {
    let who = match end - first {
        1 => format!("slave {} is", first + 1),
        _ => format!("slaves {} to {end} are", first + 1),
    };
    let state = match state {
        RequestedState::Boot => "BOOT",
        RequestedState::State(AlState::PreOp) => "PreOP",
        RequestedState::State(AlState::SafeOp) => "SafeOP",
        RequestedState::State(AlState::Op) => "OP",
        _ => "Init",
    };
    match code {
        AlStatus::NONE => format!("{who} in {state}"),
        code => format!("{who} in {state} with AL status {code}"),
    }
}
