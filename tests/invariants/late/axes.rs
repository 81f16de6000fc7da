//! Checks of the axes' outputs on a bus that takes outputs ahead: targets without a command, motors that no SV_ON has
//! switched on or that stay on, shafts that are too fast.

use ecmsk::cia402::{Controlword, DriveState, Mode};
use ecmsk::fieldbus::{AxisIn, MAX_AXES, SlaveOut, SlaveSet};
use ecmsk::sk::SlaveCommand;

use super::log::{Event, SLAVES};
use super::trace::Trace;
use super::{Around, ENABLING_AHEAD, STOPS_WITHIN};
use crate::machine::Unit;
use crate::watch::speed_share;

const ENABLE_OPERATION: u16 = Controlword::ENABLE_OPERATION.0;

/// The axes.
#[derive(Default)]
pub struct Axes {
    /// Slaves whose motors an SV_ON may have switched on with the newest outputs passed to the bus.
    on: SlaveSet,
    /// The same for outputs that were passed to the bus and may still be cleared.
    on_by: Vec<(u64, SlaveSet)>,
    /// Slaves with an SV_OFF since they were seen to be off last.
    pub falling: SlaveSet,
    /// SV_OFF that were sent to slaves that are on: the slave, and the cycle by which it is off.
    stops: Vec<(usize, usize)>,
    /// The last outputs passed to the bus in this OP.
    outputs: Option<Box<[SlaveOut; SLAVES]>>,
    jammed: SlaveSet,
    /// The greatest speed of a shaft, as a share of its limit.
    pub fastest: f64,
    /// Axes that were switched on.
    pub risen: u64,
}

impl Axes {
    /// Jams the shafts of a slave, or frees them.
    pub fn jam(&mut self, slave: usize, jammed: bool) {
        if jammed { self.jammed.insert(slave as u8) } else { self.jammed.remove(slave as u8) }
    }

    /// Outputs with these commands were passed to the bus; while the marker is lost they may have them.
    pub fn pushed(&mut self, trace: &Trace, units: &[Unit], around: &Around, carried: &[(usize, SlaveCommand)]) {
        let (pushed, _) = trace.newest_outputs();
        for unit in units {
            let n = unit.slave as u8;
            let of_unit = carried.iter().filter(|(slave, _)| *slave == unit.slave).map(|(_, command)| *command);
            let commands: Vec<SlaveCommand> = of_unit.collect();
            if commands.contains(&SlaveCommand::ServoOn) {
                self.on.insert(n);
            }
            if commands.contains(&SlaveCommand::ServoOff) {
                self.falling.insert(n);
            }
            if n > around.found {
                // The board does not know the axis's position, and outputs from before the boot must have no effect.
                let outputs = &pushed.outputs[unit.slave - 1];
                assert_eq!(*outputs, SlaveOut::default(), "slave {n} was not found");
                continue;
            }
            if around.lost().contains(n) {
                continue;
            }
            for axis in 0..unit.axes {
                let word = pushed.outputs[unit.slave - 1][axis].controlword.0;
                let motor = word & !(Controlword::FAULT_RESET | Controlword::HOMING_START);
                assert!(motor == 0 || self.on.contains(n), "slave {n} is switched on by {word:04X} without an SV_ON");
                self.target(trace, unit, axis, &pushed.outputs, &commands);
            }
        }
        self.on_by.push((pushed.id, self.on));
        self.outputs = Some(pushed.outputs.clone());
    }

    /// Checks that the target of an axis is a commanded one, or the axis's position in the newest answer.
    fn target(&self, trace: &Trace, unit: &Unit, axis: usize, outputs: &[SlaveOut; SLAVES], commands: &[SlaveCommand]) {
        let Some(answer) = trace.answer() else { return };
        let slave = unit.slave;
        let input = &answer.inputs[slave - 1][axis];
        let target = outputs[slave - 1][axis].target;
        let holding = if unit.mode == Mode::Csp { input.position } else { 0 };
        let before = self.outputs.as_ref().map(|outputs| outputs[slave - 1][axis].target);
        let asked = commands.iter().filter_map(|command| super::targets(unit, *command)).map(|targets| targets[axis]);
        let asked: Vec<i32> = asked.collect();
        // The effect of a change of mode or a clear on the target is known with the next answer.
        let is_between = trace.new_modes.contains(slave as u8) || trace.was_cleared;
        let right = if is_enabled(trace, unit, axis, input) {
            before.is_none_or(|before| target == before) || asked.contains(&target) || is_between && target == holding
        } else {
            target == holding || is_between && before == Some(target)
        };
        let state = input.statusword.state();
        assert!(
            right,
            "slave {slave} ({}) is sent {target}: asked for {asked:?}, sent before {before:?}, it is {state:?} at {holding}",
            unit.mode
        );
    }

    /// Processes an event.
    pub fn apply(&mut self, trace: &Trace, units: &[Unit], event: &Event, entry: Option<&[(usize, SlaveCommand)]>) {
        match event {
            Event::Passed(_) => {
                self.shafts(trace, units);
                self.stops(trace, units, entry);
                self.enabled(trace, units);
            }
            Event::Answered { .. } => {
                let Some(answer) = trace.answer() else { return };
                let mut faulted = SlaveSet::EMPTY;
                for unit in units {
                    let states = (0..unit.axes).map(|axis| answer.inputs[unit.slave - 1][axis].statusword.state());
                    for state in states.flatten() {
                        if matches!(state, DriveState::Fault | DriveState::FaultReactionActive) && unit.axes == 1 {
                            faulted.insert(unit.slave as u8);
                        }
                        if state != DriveState::OperationEnabled {
                            self.falling.remove(unit.slave as u8);
                        }
                    }
                }
                self.ended(faulted);
            }
            Event::Cleared { newest_sent } => {
                self.on_by.retain(|(id, _)| Some(*id) <= *newest_sent);
                if let Some((_, on)) = self.on_by.last() {
                    self.on = self.on.intersection(*on);
                }
                if self.outputs.is_some() {
                    self.outputs = newest_sent.and_then(|id| trace.outputs(id)).map(|pushed| pushed.outputs.clone());
                }
            }
            Event::Pushed { .. } | Event::Mode { .. } | Event::Op => {}
        }
    }

    /// A fault or a loss has ended every SV_ON passed to the bus so far: a clear brings none of them back.
    fn ended(&mut self, slaves: SlaveSet) {
        if slaves.is_empty() {
            return;
        }
        let all = self.on_by.iter_mut().map(|(_, on)| on).chain([&mut self.on]);
        all.for_each(|on| *on = on.difference(slaves));
    }

    /// A cycle of the board has passed.
    pub fn check(&mut self, around: &Around) {
        self.ended(around.lost_after);
        if !around.in_op {
            (self.on, self.outputs) = (SlaveSet::EMPTY, None);
        }
        if self.on_by.len() > 500 {
            self.on_by.drain(..200);
        }
    }

    /// Checks that no shaft is faster than the program's paths.
    fn shafts(&mut self, trace: &Trace, units: &[Unit]) {
        let cycle = trace.newest();
        for unit in units.iter().filter(|unit| !self.jammed.contains(unit.slave as u8)) {
            for axis in 0..unit.axes {
                let [before, after] = [cycle.measured, cycle.shafts].map(|shafts| shafts[unit.slave - 1][axis]);
                let moved = after.expect("an axis has a shaft") - before.expect("an axis has a shaft");
                let share = speed_share(moved, unit.mode, cycle.dt_ns, unit.slave);
                self.fastest = self.fastest.max(share);
            }
        }
    }

    /// Checks that an SV_OFF switches a slave off within the cycles that the bus has ahead and the delay of answers.
    fn stops(&mut self, trace: &Trace, units: &[Unit], entry: Option<&[(usize, SlaveCommand)]>) {
        let (cycle, n) = (trace.newest(), trace.passed() - 1);
        let unreached = cycle.lost.union(cycle.without_outputs);
        // The time until the drive is at rest does not count.
        let is_on = |slave: usize| {
            cycle.outputs.as_ref().is_some_and(|(_, outputs)| {
                outputs[slave - 1][0].controlword.0 & ENABLE_OPERATION == ENABLE_OPERATION
                    && cycle.inputs[slave - 1][0].statusword.is_enabled()
                    && !unreached.contains(slave as u8)
            })
        };
        self.stops.retain(|(slave, _)| is_on(*slave));
        for unit in units {
            let off = entry.is_some_and(|entry| entry.contains(&(unit.slave, SlaveCommand::ServoOff)));
            if off && is_on(unit.slave) {
                self.stops.push((unit.slave, n + STOPS_WITHIN));
            }
        }
        for (slave, end) in &self.stops {
            assert!(n <= *end, "slave {slave} is kept on for {STOPS_WITHIN} cycles after its SV_OFF was sent");
        }
    }

    /// Checks that the outputs that hold an axis when it becomes enabled in CSP were not ahead for long.
    fn enabled(&mut self, trace: &Trace, units: &[Unit]) {
        let n = trace.passed() - 1;
        if n == 0 || trace.oldest() == n {
            return;
        }
        let (before, cycle) = (trace.cycle(n - 1), trace.cycle(n));
        let Some((id, _)) = before.outputs else { return };
        let Some(pushed) = trace.outputs(id) else { return };
        let Some(sent) = pushed.sent else { return };
        for unit in units.iter().filter(|unit| unit.mode == Mode::Csp) {
            for axis in 0..unit.axes {
                let [was, is] = [before, cycle].map(|cycle| &cycle.inputs[unit.slave - 1][axis]);
                if is.statusword.is_enabled() && !was.statusword.is_enabled() {
                    self.risen += 1;
                    let lay = sent - pushed.at;
                    assert!(
                        lay <= ENABLING_AHEAD,
                        "slave {} is enabled and held by outputs that lay ahead for {lay} cycles: at {}, it is at {}",
                        unit.slave,
                        pushed.outputs[unit.slave - 1][axis].target,
                        is.position
                    );
                }
            }
        }
    }
}

/// Whether an answer shows an axis that follows targets.
pub fn is_enabled(trace: &Trace, unit: &Unit, axis: usize, input: &AxisIn) -> bool {
    debug_assert!(axis < MAX_AXES);
    input.statusword.is_enabled() && trace.mode(unit.slave, axis) == unit.mode.code()
}
