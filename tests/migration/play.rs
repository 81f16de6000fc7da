//! Runs a program on a machine and keeps its results, part by part.

mod motion;

use std::time::Duration;

use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::{Counters, StateFailure};
use ecmsk::fieldbus::{AlState, MAX_AXES};
use ecmsk::sk::{
    AxisTarget, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, Motion as Targets, SdoCommand,
    SdoResponse, SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{AlStatus, DeviceFault, Fault};

use crate::judge::Rule;
use crate::machine::{Behind, Machine};
use crate::plan::{Meanwhile, Motion, Pace, Plan, Step, Unit};
use crate::tap::Row;

/// The bits of a statusword that encode the state (CiA 402-2), and the warning bit.
const STATE_BITS: u16 = 0x006F;
/// The maximum difference in cycles between the ends of a motion that the program ends by a command or by a report:
/// latency and SET_FIFO clear together, with 5 slaves (the rows `latency` and `clear`).
const CUT_BY: usize = 24;
/// The maximum delay of an answer in cycles, in addition to the sets in the chip's FIFO for a stall and for the
/// transport.
const LATENCY: u64 = 8;
/// Time of the transport in the chip's FIFO, for any packet size (the row `latency`).
const TRANSPORT_US: u64 = 5000;
/// An alarm stops an axis up to that many cycles' distance away, if idle cycles came in between.
const STOP: u32 = 20;
const ALARM: DeviceFault = DeviceFault { code: 0x7500, resettable: true };

/// The program's view at the end of a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Saw {
    pub state: StateByte,
    pub failure: Option<StateFailure>,
    /// Of each slave: the state in its statusword, error code, positions if it is at rest, inputs.
    pub slaves: Vec<(u16, u16, [i32; MAX_AXES], u16)>,
    pub sdos: Vec<SdoResponse>,
    /// The board's counters since the previous part: entries executed, commands rejected, discarded, ignored, lost.
    pub counted: [u64; 5],
}

/// A part of a run.
#[derive(Clone, Debug)]
pub struct Part {
    pub what: String,
    pub rows: Vec<Row>,
    pub saw: Saw,
    /// Slave n has `rules[n - 1]`.
    pub rules: Vec<Rule>,
    /// Axes that move together.
    pub together: Vec<(usize, usize)>,
    /// The program keeps the FIFO filled: no target is repeated.
    pub is_steady: bool,
    /// Allowed difference of the board's count of discarded commands: it sees an alarm only with the answers, and until
    /// then targets are executed (the row `latency`).
    pub counts_apart: u64,
    /// An axis whose position may differ by that many counts: its motion was paced by reports and stopped by an alarm.
    pub position_apart: Option<(usize, u32)>,
}

/// A run, and whether the chip has refused the cycle.
pub struct Run {
    pub parts: Vec<Part>,
    pub refused: bool,
}

/// Runs a program.
pub fn play(plan: &Plan, behind: Behind) -> Run {
    let machine = Machine::new(behind, plan.size, plan.slaves());
    let mut player = Player {
        machine,
        plan,
        goals: vec![[0; MAX_AXES]; plan.units.len()],
        sdos: Vec::new(),
        counters: Counters::default(),
        parts: Vec::new(),
        apart: None,
    };
    for step in &plan.steps {
        if !player.step(step) {
            return Run { parts: player.parts, refused: true };
        }
    }
    Run { parts: player.parts, refused: false }
}

struct Player<'a> {
    machine: Machine,
    plan: &'a Plan,
    /// The program's position of each axis in CSP.
    goals: Vec<[i32; MAX_AXES]>,
    sdos: Vec<SdoResponse>,
    counters: Counters,
    parts: Vec<Part>,
    /// See [`Part::position_apart`].
    apart: Option<(usize, u32)>,
}

impl Player<'_> {
    /// Whether the program can go on.
    fn step(&mut self, step: &Step) -> bool {
        let what = format!("{step:?}");
        let mut rules = vec![Rule::Same; self.plan.units.len()];
        match step {
            Step::Op => {
                if !self.up() {
                    return false;
                }
            }
            Step::Leave(state) => {
                self.machine.go(*state);
                self.end(&format!("{what}, down"), &rules);
                self.up();
            }
            Step::On(slaves) => self.on(slaves),
            Step::Off(slaves) => self.off(slaves),
            Step::Move(motion) => {
                self.motion(motion, &what);
                return true;
            }
            Step::Home(slave, method) => {
                self.home(*slave, *method);
                rules[slave - 1] = Rule::Same;
                self.end(&what, &rules);
                self.goals[slave - 1] = [0; MAX_AXES];
                self.back(&[*slave]);
                return true;
            }
            Step::Sdo(slave) => self.transfers(*slave),
            Step::SdoAborted(slave) => {
                self.machine.network.abort_sdo(*slave as u8, Some(AbortCode::VALUE_RANGE));
                let answer = self.machine.sdo_read(*slave, 0x1018, 2);
                self.sdos.push(answer);
                self.machine.network.abort_sdo(*slave as u8, None);
            }
            Step::Refused(slave) => {
                self.machine.go(MasterState::PreOp);
                let network = self.machine.network.clone();
                network.refuse(*slave as u8, Some((AlState::Op, AlStatus::INVALID_OUTPUTS)));
                assert!(!self.machine.asks_for(MasterState::Op), "slave {slave} refuses");
                self.end(&format!("{what}, refused"), &rules);
                network.refuse(*slave as u8, None);
                self.machine.go(MasterState::PreOp);
                self.up();
            }
            Step::Outputs(slave, bits) => {
                self.machine.slave(*slave, SlaveCommand::IoWrite(*bits));
            }
        }
        self.end(&what, &rules);
        true
    }

    /// The end of a part: waits until all axes are at rest, and keeps the results.
    fn end(&mut self, what: &str, rules: &[Rule]) {
        self.machine.fresh();
        if self.machine.answer().state == StateByte::reached(MasterState::Op) {
            self.machine.settle();
            self.stand();
        }
        let (what, rules) = (what.to_owned(), rules.to_vec());
        let (saw, rows) = (self.saw(), self.machine.log.take());
        self.parts.push(Part {
            what,
            rows,
            saw,
            rules,
            together: Vec::new(),
            is_steady: false,
            counts_apart: 0,
            position_apart: self.apart,
        });
    }

    /// Waits until axes in CSP are at rest.
    fn stand(&mut self) {
        for _ in 0..100 {
            let before = self.positions();
            self.machine.rest(40);
            if self.positions() == before {
                return;
            }
        }
        panic!("axes do not come to rest");
    }

    fn positions(&self) -> Vec<[i32; MAX_AXES]> {
        let all = (1..).zip(&self.plan.units);
        all.map(|(slave, unit)| if unit.is_csp() { self.position(slave) } else { [0; MAX_AXES] }).collect()
    }

    fn position(&self, slave: usize) -> [i32; MAX_AXES] {
        let answer = ecmsk::sk::HspResponse::decode(&self.machine.slot(slave), self.machine.size);
        let second = if self.plan.units[slave - 1].axes == 2 { answer.second.position } else { 0 };
        [self.machine.drive(slave).position, second]
    }

    fn saw(&mut self) -> Saw {
        let machine = &self.machine;
        let in_op = machine.answer().state.state() == Some(MasterState::Op);
        let slave = |(slave, unit): (usize, &Unit)| {
            let slot = machine.slot(slave);
            match unit.kind {
                _ if !in_op => (0, 0, [0; MAX_AXES], 0),
                SlaveKind::Io | SlaveKind::None => (0, 0, [0; MAX_AXES], slot.data1 as u16),
                _ => {
                    let drive = machine.drive(slave);
                    let position = if unit.is_csp() { self.position(slave) } else { [0; MAX_AXES] };
                    let code = if unit.kind == SlaveKind::Hsp { 0 } else { drive.error_code };
                    (drive.statusword.0 & STATE_BITS, code, position, 0)
                }
            }
        };
        let slaves = (1..).zip(&self.plan.units).map(slave).collect();
        let now = machine.counters();
        let counts = |of: &Counters| {
            [of.executed, of.rejected_total(), of.discarded_before_enabled, of.ignored_homing, of.for_lost]
        };
        let before = counts(&self.counters);
        let counted = std::array::from_fn(|n| counts(&now)[n] - before[n]);
        let (state, failure) = (machine.answer().state, machine.failure());
        self.counters = now;
        Saw { state, failure, slaves, sdos: std::mem::take(&mut self.sdos), counted }
    }

    /// Goes to OP; whether the hardware supports it.
    fn up(&mut self) -> bool {
        let kinds: Vec<SlaveKind> = self.plan.units.iter().map(|unit| unit.kind).collect();
        let modes: Vec<_> = self.plan.units.iter().map(|unit| unit.mode).collect();
        if self.machine.answer().state.state() == Some(MasterState::Init) {
            self.machine.go(MasterState::PreOp);
        }
        if self.machine.answer().state.state() == Some(MasterState::PreOp) {
            self.machine.declare(&kinds, &modes, self.plan.cycle_us);
        }
        if !self.machine.asks_for(MasterState::Op) {
            let failure = self.machine.failure();
            assert!(matches!(failure, Some(StateFailure::Hardware(_))), "{failure:?}");
            return false;
        }
        self.machine.settle();
        true
    }

    fn on(&mut self, slaves: &[usize]) {
        self.machine.servo_on(slaves);
        self.machine.settle();
        slaves.iter().for_each(|slave| self.goals[slave - 1] = self.position(*slave));
    }

    fn off(&mut self, slaves: &[usize]) {
        let mut frame = Frame::new();
        let size = self.machine.size;
        slaves.iter().for_each(|slave| frame.put_slave(size, *slave, &SlaveCommand::ServoOff.into()));
        self.machine.send(|out, _| out.clone_from(&frame));
        self.machine.until("servo off", |machine| slaves.iter().all(|slave| !machine.word(*slave).is_enabled()));
    }

    fn transfers(&mut self, slave: usize) {
        let object = |index, sub| ObjectAddress::new(index, sub);
        let number = slave as u8;
        let of_axes = self.plan.units[slave - 1].axes > 0;
        let mut commands = vec![
            SdoCommand::Read { slave: number, object: object(0x1018, 1) },
            SdoCommand::Read { slave: number, object: object(0x1000, 0) },
            SdoCommand::Read { slave: number, object: object(0x1234, 5) },
        ];
        if of_axes {
            let object = object(0x6081, 0);
            commands.push(SdoCommand::Write { slave: number, object, size: SdoSize::Four, value: 12_345 });
            commands.push(SdoCommand::Read { slave: number, object });
            let object = ObjectAddress::new(0x6041, 0);
            commands.push(SdoCommand::Write { slave: number, object, size: SdoSize::Two, value: 1 });
        }
        for command in commands {
            let answer = self.machine.sdo(command);
            self.sdos.push(answer);
        }
    }

    fn write(&mut self, slave: usize, index: u16, value: u32) {
        let object = ObjectAddress::new(index, 0);
        let size = if index == 0x609A { SdoSize::Four } else { SdoSize::One };
        let answer = self.machine.sdo(SdoCommand::Write { slave: slave as u8, object, size, value });
        self.sdos.push(answer);
    }

    fn home(&mut self, slave: usize, method: i8) {
        self.write(slave, 0x6098, u32::from(method as u8));
        self.write(slave, 0x6060, 6);
        self.machine.settle().slave(slave, SlaveCommand::GoHome).settle();
        self.machine.until("the end of homing", |machine| {
            let word = machine.word(slave).0;
            word & 0x1400 == 0x1400 || word & 0x2000 != 0
        });
        self.machine.settle();
        self.write(slave, 0x6060, 8);
        self.machine.rest(100);
    }
}

/// The size of slots that a plan has, for messages.
impl std::fmt::Display for Plan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bytes = if self.size == SlotSize::Bytes16 { 16 } else { 12 };
        write!(f, "slots of {bytes} bytes, {} us, ahead {}, {:?}", self.cycle_us, self.ahead, self.units)
    }
}
