//! The random programs and faults of [`crate::program`] over a bus that takes outputs ahead, answers late, reports losses
//! late and loses answers, as other hardware does ([`Ahead::honest`]). The seed chooses the properties of the bus.
//!
//! The checks do not rely on the board's own reports. One wrapper is in front of that bus and one behind it (`log`), so that
//! a schedule knows which outputs were passed to it, when they were sent, which slaves got them, and when an answer was
//! taken. These invariants of a bus that the runner paces hold unchanged:
//!
//! - every frame that arrives in OP is executed, cleared, full or held, at any time; free and held entries are 160;
//! - entries are sent in order, each once, one in a cycle at most;
//! - states change by legal transitions, and so do drives, from one answer to the next; 0x6064 steps at a home event alone;
//! - no shaft is faster than the program's paths, in any cycle of the bus.
//!
//! These hold with another meaning or bound, because the board knows of a cycle only by its answer:
//!
//! - an entry is executed when its outputs are sent. At any time no more entries count as executed than were sent, and when
//!   all is answered the numbers are equal: an entry that a clear has taken back was never sent;
//! - a report shows the command of the outputs of the cycle that it answers, however late it comes;
//! - a motion command is in the outputs that carry its entry, or counted in the same cycle of the board. Outputs that a slave
//!   did not get count as for a lost slave when the bus has named it, exactly to the command;
//! - a target without a command is the axis's position in the newest answer (0 in CSV and CST), when it is passed to the bus.
//!   It may be sent as many cycles later as the bus has outputs ahead: an axis that is off may be held at its position of
//!   depth + delay cycles ago. For an axis that is being enabled, the holding target was ahead for at most [`ENABLING_AHEAD`]
//!   cycles;
//! - a motor is on by an SV_ON that was passed to the bus and neither cleared nor followed by a loss, and leaves Operation
//!   enabled within [`STOPS_WITHIN`] cycles after its SV_OFF was sent. The board cannot do that sooner: the steps down come
//!   after the outputs that the bus has ahead, and depend on answers.
//!
//! Not checked here: which of several counters has a command that was not executed, and the order of events of the marker's
//! entries while the marker itself is lost; then the ledger begins anew at rest. In that time no mark shows the commands of
//! outputs: an SV_ON or a target counts as passed to the bus when it may have been, by its place among the waiting frames.

mod answers;
mod axes;
mod ledger;
mod log;
mod trace;

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::engine::{Counters, HomingPhase};
use ecmsk::fieldbus::{Ns, SlaveOut, SlaveSet};
use ecmsk::sk::{Frame, SlaveCommand, SlotCommand, SlotSize};

use crate::machine::{Machine, Unit};
use crate::program::{Checks, Done, Program};
use crate::run_all;
use answers::Answers;
use axes::Axes;
use ledger::Ledger;
use log::{Log, SLAVES, Seam, Wire};
use support::ahead_bus::{Ahead, AheadBus};
use trace::Trace;

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 200;
/// Cycles of a schedule in OP, about.
const CYCLES: u64 = 2500;
/// Cycles after which all is at rest.
const REST: u64 = 500;

/// The 4 sets of outputs that the bus may have ahead while an axis is being switched on and others move (SK-12.3), and
/// two cycles of error of the board's estimate: its clock is not the bus's.
const ENABLING_AHEAD: usize = 6;
/// The bus has at most 64 sets ahead and answers are at most 64 cycles late; a clear, polls that find no cycle, and the
/// drive's own steps take the rest.
const STOPS_WITHIN: usize = 64 + 64 + 40;

/// The state before a cycle of the board, and after it.
pub struct Around {
    lost_before: SlaveSet,
    lost_after: SlaveSet,
    /// Slaves that were homing before or after.
    homing: SlaveSet,
    in_op: bool,
    /// Slaves that the board has found at its newest boot.
    found: u8,
}

impl Around {
    fn lost(&self) -> SlaveSet {
        self.lost_before.union(self.lost_after)
    }

    /// Whether the board surely knows that a slave follows targets.
    fn follows(&self, trace: &Trace, unit: Option<&Unit>, outputs: &[SlaveOut; SLAVES]) -> bool {
        let (Some(unit), Some(answer)) = (unit, trace.answer()) else { return false };
        let is_on = |axis: usize| {
            axes::is_enabled(trace, unit, axis, &answer.inputs[unit.slave - 1][axis])
                && outputs[unit.slave - 1][axis].controlword == Controlword::ENABLE_OPERATION
        };
        let between = trace.was_cleared || trace.new_modes.contains(unit.slave as u8);
        !between && !self.homing.contains(unit.slave as u8) && (0..unit.axes).all(is_on)
    }

    /// Whether the board may take targets of a slave: the newest answer shows one of its axes enabled.
    fn may_follow(trace: &Trace, unit: Option<&Unit>) -> bool {
        let (Some(unit), Some(answer)) = (unit, trace.answer()) else { return true };
        answer.inputs[unit.slave - 1].iter().any(|input| input.statusword.is_enabled())
    }
}

/// Targets of a motion command in the mode of its slave.
fn targets(unit: &Unit, command: SlaveCommand) -> Option<[i32; 2]> {
    match (command, unit.mode) {
        (SlaveCommand::Csp(motion), Mode::Csp) | (SlaveCommand::Csv(motion), Mode::Csv) => {
            Some([motion.first.target, motion.second.target])
        }
        (SlaveCommand::Cst(torque), Mode::Cst) => Some([torque.into(), 0]),
        _ => None,
    }
}

fn is_motion_of(unit: &Unit, command: SlaveCommand) -> bool {
    targets(unit, command).is_some()
}

/// The checks of a schedule.
struct Late {
    log: Log,
    trace: Trace,
    ledger: Ledger,
    axes: Axes,
    answers: Answers,
    lost: SlaveSet,
    homing: SlaveSet,
}

impl Late {
    fn new(log: Log, machine: &Machine) -> Self {
        let answers = Answers::new(machine);
        let (trace, ledger, axes) = (Trace::default(), Ledger::default(), Axes::default());
        Self { log, trace, ledger, axes, answers, lost: SlaveSet::EMPTY, homing: SlaveSet::EMPTY }
    }
}

fn homing(machine: &Machine) -> SlaveSet {
    let slaves = machine.units.iter().map(|unit| unit.slave as u8);
    slaves.filter(|slave| machine.board.engine().homing_phase(*slave) != HomingPhase::Idle).collect()
}

impl Checks for Late {
    fn next_mark(&mut self) -> SlotCommand {
        let mark = self.ledger.next_mark();
        SlaveCommand::IoWrite(mark).with_index(mark as u8)
    }

    fn arrived(&mut self, frame: &Frame, size: SlotSize, before: &Counters, after: &Counters) {
        self.ledger.arrived(frame, size, before, after);
    }

    fn forget(&mut self) {}

    fn jam(&mut self, machine: &Machine, n: usize, jammed: bool) {
        self.axes.jam(machine.units[n].slave, jammed);
    }

    fn cycle(&mut self, machine: &Machine, reports: &[(Frame, Ns)], _: Ns, before: &Counters, after: &Counters) {
        let now = homing(machine);
        let lost_after = machine.board.engine().lost();
        let around = Around {
            lost_before: std::mem::replace(&mut self.lost, lost_after),
            lost_after,
            homing: std::mem::replace(&mut self.homing, now).union(now),
            in_op: machine.in_op(),
            found: machine.board.engine().slaves_found(),
        };
        let Self { log, trace, ledger, axes, answers, .. } = self;
        ledger.begin(&around);
        for event in log.lock().expect("no panic").drain(..) {
            let sent = trace.apply(&event);
            if let log::Event::Pushed { .. } = event {
                let carried = ledger.carried(trace, &around);
                ledger.pushed(trace, &machine.units, &around, axes.falling);
                axes.pushed(trace, &machine.units, &around, &carried);
            }
            ledger.apply(trace, &machine.units, &event, sent);
            let mark = sent.and_then(|id| trace.outputs(id)).and_then(|pushed| pushed.mark);
            axes.apply(trace, &machine.units, &event, mark.map(|mark| ledger.entry(mark)));
        }
        ledger.check(trace, machine, before, after);
        axes.check(&around);
        answers.cycle(trace, machine, &around, reports);
    }

    fn tell(&self, done: &mut Done) {
        done.followed = self.ledger.followed;
        (done.homed, done.compared) = (self.answers.homed, self.answers.compared);
        (done.fastest, done.risen) = (self.axes.fastest, self.axes.risen);
    }

    fn close(&self, machine: &Machine) {
        self.ledger.close(machine);
    }
}

/// Prints the bus of a schedule if the schedule fails.
struct ToldOnPanic(Ahead);

impl Drop for ToldOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("on a bus with {:?}", self.0);
        }
    }
}

fn schedule(seed: u64) -> Done {
    let how = Ahead::honest(seed);
    let _told = ToldOnPanic(how);
    let log = Log::default();
    let mut machine = Machine::over(seed, |bus| {
        let network = bus.handle();
        let wire = Wire::new(bus, network, Log::clone(&log));
        Box::new(Seam::new(AheadBus::new(wire, how), Log::clone(&log)))
    });
    machine.late = (how.pipeline + how.honesty.jitter) as u64 + 10;
    let late = Late::new(log, &machine);
    let mut program = Program::new(seed, machine, late);
    program.run(CYCLES);
    program.come_to_rest(REST);
    program.done()
}

/// SK-4.44 SK-5.3 SK-7.16 SK-12.1 SK-12.2 SK-12.3 SK-12.5: over a bus that takes outputs ahead and is as late as a real one
/// no command is lost uncounted, every target is commanded or holds its axis, motors stop, reports belong to their outputs.
#[test]
fn random_schedules_over_a_late_bus() {
    let (schedules, all) = run_all("random_schedules_over_a_late_bus", SCHEDULES, schedule);
    if schedules >= SCHEDULES {
        all.assert_enough_late(schedules);
    }
}
