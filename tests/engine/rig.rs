//! An engine over a bus that may take outputs ahead, polled at times that the test chooses, with one obedient slave
//! that is on. Every report is checked against the outputs of the slave.

use ecmsk::engine::{Engine, EngineConfig};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AxisOut, Fieldbus, Ns};
use ecmsk::sk::{
    DriveResponse, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, Motion, SlaveCommand, SlaveKind,
    SlotSize, StateByte,
};

use crate::host::is_over;
use crate::puppet::Puppet;
use support::ahead_bus::{Ahead, AheadBus};

const SIZE: SlotSize = SlotSize::Bytes12;
const CYCLE: Ns = 1_000_000;

/// Every kind of bus in the tests.
pub fn ahead() -> impl Iterator<Item = Ahead> {
    let clocks = [(0, 333_333, 0), (1, 1, 100), (2, 999_999, 2500), (4, 500_000, 300)];
    // If the run chooses the bus of all boards, these would be the same once more.
    let depths = if is_over() { &[][..] } else { &[1, 8, 64] };
    depths
        .iter()
        .flat_map(move |&depth| clocks.map(|(pipeline, phase, slower)| Ahead::kind(depth, pipeline, phase, slower)))
}

pub struct Rig {
    pub engine: Engine,
    bus: AheadBus<SimBus>,
    how: Ahead,
    pub puppet: Puppet,
    /// A second slave, so that frames need not move the first.
    pub other: Puppet,
    now: Ns,
    pub report: Frame,
    /// Reports of the newest poll.
    pub news: usize,
    /// Targets sent so far; the n-th one is n.
    pub targets: i32,
    /// Set while only targets are sent and every report is checked: the cycle that the next report answers, as an index
    /// into the slave's outputs.
    checked: Option<usize>,
}

impl Rig {
    pub fn new(how: Ahead) -> Self {
        let (puppet, other) = (Puppet::obedient(), Puppet::obedient());
        let bus = AheadBus::new(SimBus::new(vec![puppet.boxed(), other.boxed()]), how);
        let engine = Engine::new(EngineConfig::default(), bus.pacing());
        let report = Frame::new();
        let mut rig = Self { engine, bus, how, puppet, other, now: 0, report, news: 0, targets: 0, checked: None };
        rig.until("PreOP", |rig| rig.engine.talks());
        let kinds = [SlaveKind::Drive; 8];
        rig.send(|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds }));
        rig.go(MasterState::Op);
        rig.servo_on();
        rig.puppet.forget();
        rig.other.forget();
        rig.run(10);
        rig
    }

    pub fn servo_on(&mut self) {
        self.send(|frame| {
            for slave in [1, 2] {
                frame.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into());
            }
        });
        self.until("on", |rig| [1, 2].iter().all(|slave| rig.drive(*slave).statusword.is_enabled()));
        self.run(10);
    }

    pub fn go(&mut self, state: MasterState) {
        self.send(|frame| frame.put_master(SIZE, &MasterCommand::SetState(state)));
        self.until("the state", |rig| rig.answer().state == StateByte::reached(state));
        self.run(10);
    }

    /// Lets a frame arrive now.
    pub fn send(&mut self, build: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        build(&mut frame);
        self.engine.host(&frame, self.now);
    }

    /// Lets a frame with the next target arrive; its index is the target's low byte.
    pub fn target(&mut self) {
        self.targets += 1;
        let csp = SlaveCommand::Csp(Motion::to(self.targets)).with_index(self.targets as u8);
        self.send(|frame| frame.put_slave(SIZE, 1, &csp));
    }

    /// Polls the engine after that time.
    pub fn poll_after(&mut self, ns: Ns) {
        self.now += ns;
        self.news = 0;
        let Self { engine, bus, how, puppet, report, news, targets, checked, .. } = self;
        engine.cycle(self.now, bus, &mut |frame, _| {
            *news += 1;
            report.clone_from(frame);
            if let Some(cycle) = checked {
                check(*how, frame, *targets, *cycle, &puppet.strings().sent);
                *cycle += 1;
            }
        });
    }

    /// The slave's outputs in the cycle of the newest answer.
    pub fn answered(&self) -> AxisOut {
        *self.puppet.strings().sent.iter().rev().nth(self.how.pipeline).expect("so many cycles have passed")
    }

    /// Nothing but targets is sent from now on, and every report is checked.
    pub fn check_reports(&mut self) {
        self.checked = Some(self.puppet.strings().sent.len() - self.how.pipeline);
    }

    /// Polls so often, once a cycle.
    pub fn run(&mut self, polls: usize) {
        for _ in 0..polls {
            self.poll_after(CYCLE);
        }
    }

    fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        for _ in 0..20_000 {
            if done(self) {
                return;
            }
            self.run(1);
        }
        panic!("never: {what}; {:?}", self.answer());
    }

    pub fn drained(&mut self) {
        self.until("an empty FIFO", |rig| rig.answer().fifo_free == FIFO_ENTRIES);
        self.run(self.how.pipeline + 2);
    }

    pub fn answer(&self) -> MasterResponse {
        MasterResponse::decode(&self.report.slot(SIZE, 0))
    }

    pub fn drive(&self, slave: usize) -> DriveResponse {
        DriveResponse::decode(&self.report.slot(SIZE, slave))
    }
}

/// Checks a report while only targets 1, 2, 3.. were sent, `accepted` of them; `sent` has the slave's outputs of each
/// cycle, and the report answers the one at `cycle`.
fn check(how: Ahead, report: &Frame, accepted: i32, cycle: usize, sent: &[AxisOut]) {
    let newest = sent[cycle].target;
    let free = MasterResponse::decode(&report.slot(SIZE, 0)).fifo_free;
    assert_eq!(i32::from(free) + accepted - newest, i32::from(FIFO_ENTRIES), "{how:?}: free + not known to be sent");
    // A cycle measures the effect of the one before.
    let drive = DriveResponse::decode(&report.slot(SIZE, 1));
    let expected = (newest as u8, sent[cycle - 1].target);
    assert_eq!((drive.head.index, drive.position), expected, "{how:?}: an answer belongs to its outputs");
}
