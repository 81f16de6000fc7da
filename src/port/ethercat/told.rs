//! Log lines about the slaves: their states, and the faults of their axes. Both are sampled: if a change is undone
//! before the next sample, it is not logged.
//!
//! A master can change states as often as it likes. For a slave that changes too often fewer lines are logged, each
//! with the present state and the number of changes that were left out. The final state is always logged.

use crate::ethercat::registers::{AL_STATUS_CODE, RequestedState};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::slave::esc::{Chain, EscSlave};
use crate::slave::{AXES_MAX, AxisFault};

/// The maximum number of lines for one slave within [`PERIOD_NS`], counted separately for states and for faults.
/// \[OURS]
const LINES_MAX: u32 = 20;
/// The period in which [`LINES_MAX`] lines are allowed, counted from the first of these lines, ns. \[OURS]
const PERIOD_NS: Ns = 10_000_000_000;

type State = (RequestedState, AlStatus);
type Faults = [Option<AxisFault>; AXES_MAX];

/// How many lines were logged for one slave in the present period.
#[derive(Clone, Copy, Default)]
struct Budget {
    since: Ns,
    lines: u32,
}

impl Budget {
    /// Whether another line may be logged for the slave at `now`. After [`PERIOD_NS`] a new period with its own budget
    /// begins.
    const fn has_room(&mut self, now: Ns) -> bool {
        if now.saturating_sub(self.since) >= PERIOD_NS {
            *self = Self { since: now, lines: 0 };
        }
        self.lines < LINES_MAX
    }
}

/// What was sampled and logged of one slave's state.
#[derive(Clone, Copy)]
struct Known {
    told: State,
    /// The state of the slave in the last sample.
    seen: State,
    /// How often the slave's state has changed since its last logged state.
    changes: u32,
    budget: Budget,
}

/// The states and faults of the slaves that were logged last.
pub(super) struct Told {
    states: Vec<Known>,
    faults: Vec<(Faults, Budget)>,
}

impl Told {
    /// Creates the state in which nothing is logged yet: all slaves count as being in Init and without a fault.
    pub(super) fn new(slaves: usize) -> Self {
        let init = (RequestedState::State(AlState::Init), AlStatus::NONE);
        let known = Known { told: init, seen: init, changes: 0, budget: Budget::default() };
        Self { states: vec![known; slaves], faults: vec![([None; AXES_MAX], Budget::default()); slaves] }
    }

    /// Whether a slave was in OP in the last sample.
    pub(super) fn has_op(&self) -> bool {
        self.states.iter().any(|known| known.seen.0 == RequestedState::State(AlState::Op))
    }

    /// Adds log lines for the slaves whose state has changed and for whose present state `which` returns true.
    /// Neighbouring slaves with the same change share a line.
    pub(super) fn look_at_states(
        &mut self,
        chain: &Chain,
        now: Ns,
        which: impl Fn(State) -> bool,
        lines: &mut Vec<String>,
    ) {
        let mut begin: Option<(usize, State, u32)> = None;
        for n in 0..=self.states.len() {
            let line = self.states.get_mut(n).and_then(|known| {
                let state = state_of(chain.slave(n));
                which(state).then(|| look_at(known, state, now)).flatten()
            });
            let goes_on = begin.is_some_and(|(_, state, left_out)| line == Some((state, left_out)));
            if let Some((first, state, left_out)) = begin.take_if(|_| !goes_on) {
                lines.push(line_of(first, n, state, left_out));
            }
            if begin.is_none() {
                begin = line.map(|(state, left_out)| (n, state, left_out));
            }
        }
    }

    /// Adds log lines for all changes that were held back because a slave had too many lines.
    pub(super) fn tell_rest(&mut self, chain: &Chain, now: Ns, lines: &mut Vec<String>) {
        self.states.iter_mut().for_each(|known| known.budget = Budget { since: now, lines: 0 });
        self.faults.iter_mut().for_each(|(_, budget)| *budget = Budget { since: now, lines: 0 });
        self.look_at_states(chain, now, |_| true, lines);
        self.look_at_faults(chain, now, lines);
    }

    /// Adds a log line for each fault of an axis that has begun or ended.
    pub(super) fn look_at_faults(&mut self, chain: &Chain, now: Ns, lines: &mut Vec<String>) {
        for (n, (told, budget)) in self.faults.iter_mut().enumerate() {
            let device = chain.slave(n).device();
            for (axis, told) in told.iter_mut().enumerate() {
                let fault = device.fault(axis);
                if fault == *told || !budget.has_room(now) {
                    continue;
                }
                let before = std::mem::replace(told, fault);
                budget.lines += 1;
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

/// Takes a sample of a slave's state. Returns the state to log, and the number of changes left out before it. `None`:
/// nothing has to be logged, or the slave has used up its log lines for the present period.
fn look_at(known: &mut Known, state: State, now: Ns) -> Option<(State, u32)> {
    if state != known.seen {
        known.seen = state;
        known.changes = known.changes.saturating_add(1);
    }
    if known.changes == 0 || !known.budget.has_room(now) {
        return None;
    }
    let left_out = std::mem::take(&mut known.changes) - 1;
    if left_out == 0 && known.told == state {
        return None;
    }
    known.told = state;
    known.budget.lines += 1;
    Some((state, left_out))
}

/// The AL state of a slave, and its AL status code: why the slave refused a state or left one; 0: no error.
pub(super) fn state_of(slave: &EscSlave) -> State {
    let code = slave.controller().peek(AL_STATUS_CODE, 2);
    let code = code.try_into().map_or(0, u16::from_le_bytes);
    (slave.shown_state(), AlStatus(code))
}

/// The log line about the slaves number `first` to `end - 1`, counted from 0: their state, and how many changes were
/// left out.
fn line_of(first: usize, end: usize, (state, code): State, left_out: u32) -> String {
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
    let left_out = match left_out {
        0 => String::new(),
        1 => " (1 change before was not told)".to_owned(),
        n => format!(" ({n} changes before were not told)"),
    };
    match code {
        AlStatus::NONE => format!("{who} in {state}{left_out}"),
        code => format!("{who} in {state} with AL status {code}{left_out}"),
    }
}
