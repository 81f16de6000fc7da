//! The bus of a network card under a runner that waits for the time of each cycle, and is late now and then, in virtual time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::ethercat::FRAME_LEN_MAX;
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::nic::{ChainWires, NicBus, NicWires};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::sk::{
    CycleTime, DcShift, DriveResponse, Frame, MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind, SlotSize,
    StateByte,
};

use crate::puppet::Puppet;

const US: Ns = 1_000;
const SIZE: SlotSize = SlotSize::Bytes12;
/// More cycles than any change of state takes.
const PATIENCE: usize = 30_000;

/// Wires with a clock that goes on while the bus does not wait; clones share them.
#[derive(Clone)]
struct RunnerWires(Arc<Mutex<Inside>>);

struct Inside {
    wires: ChainWires,
    /// Frames that came while the bus did not poll.
    came: VecDeque<Vec<u8>>,
}

impl RunnerWires {
    /// Lets time pass until then, whatever comes.
    fn pass(&self, until: Ns) {
        let Inside { wires, came } = &mut *self.0.lock().expect("no panic");
        let mut buffer = [0; FRAME_LEN_MAX];
        while NicWires::now(wires) < until {
            while let Some(len) = Wire::receive(wires, &mut buffer) {
                came.push_back(buffer[..len].to_vec());
            }
            NicWires::wait(wires, until);
        }
    }
}

impl Wire for RunnerWires {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        Wire::send(&mut self.0.lock().expect("no panic").wires, frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let Inside { wires, came } = &mut *self.0.lock().expect("no panic");
        let Some(frame) = came.pop_front() else { return Wire::receive(wires, buffer) };
        buffer[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }
}

impl NicWires for RunnerWires {
    fn now(&self) -> Ns {
        NicWires::now(&self.0.lock().expect("no panic").wires)
    }

    fn wait(&mut self, until: Ns) {
        NicWires::wait(&mut self.0.lock().expect("no panic").wires, until);
    }

    fn is_real_time(&self) -> bool {
        true
    }
}

/// A board and its runner.
struct Runner {
    board: Board,
    wires: RunnerWires,
    /// The skipped time: the board's time is behind the wires' clock by that much.
    behind: Ns,
    report: Frame,
}

impl Runner {
    fn new(puppet: &Puppet) -> Self {
        let wires = ChainWires::new(vec![puppet.boxed()], SimHandle::default()).expect("it has an EEPROM");
        let wires = RunnerWires(Arc::new(Mutex::new(Inside { wires, came: VecDeque::new() })));
        let bus = NicBus::new(wires.clone(), Settings::default());
        let board = Board::new(EngineConfig { slot: SIZE, ..EngineConfig::default() }, Box::new(bus));
        Self { board, wires, behind: 0, report: Frame::new() }
    }

    /// Runs the next cycle, so late.
    fn cycle(&mut self, late_ns: Ns) {
        let Self { board, wires, behind, report } = self;
        let (due, period) = (board.next_cycle() + *behind, board.period_ns());
        board.work_until(wires.now() - *behind, board.next_cycle());
        wires.pass(due + late_ns);
        if late_ns > period / 2 {
            let cycles = late_ns.div_ceil(period);
            board.leave_out(cycles);
            *behind += cycles * period;
            wires.pass(due + cycles * period);
        }
        board.cycle(&mut |frame, _| report.clone_from(frame));
    }

    fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        for _ in 0..PATIENCE {
            if done(self) {
                return;
            }
            self.cycle(0);
        }
        panic!("never: {what}");
    }

    fn send(&mut self, build: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        build(&mut frame);
        self.board.host(&frame, self.board.now(), &mut |_, _| {});
    }

    fn go(&mut self, state: MasterState) {
        self.send(|frame| frame.put_master(SIZE, &MasterCommand::SetState(state)));
        self.until("the state", |runner| runner.board.engine().state() == StateByte::reached(state));
    }
}

/// If slaves left OP by their watchdog because this machine stalled, the message says so, with the length of the stall,
/// and does not blame the cable. If frames were lost, the message does not blame this machine.
#[test]
fn a_machine_that_stood_still_is_named() {
    let puppet = Puppet::obedient();
    let mut runner = Runner::new(&puppet);
    runner.until("it talks", |runner| runner.board.engine().talks());
    let mut kinds = [SlaveKind::None; 8];
    kinds[0] = SlaveKind::Drive;
    runner.send(|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds }));
    runner.go(MasterState::Op);
    (0..300).for_each(|_| runner.cycle(0));
    let mark = runner.board.engine().events_total();
    runner.cycle(312_000 * US);
    runner.until("the loss", |runner| runner.board.engine().state().is_failed());
    let failure = runner.board.engine().state_failure().expect("there is one").to_string();
    let told: Vec<String> = runner.board.engine().events_since(mark).map(|event| event.to_string()).collect();
    assert!(!told.iter().any(|said| said.contains("cable")), "{told:?}");
    for said in [&failure, &told[0]] {
        assert!(
            said.contains("this machine stood still for 31") && said.contains(" ms; the slaves' watchdog"),
            "{said}"
        );
        assert!(said.contains("slave 1") && said.contains("0x001B (sync manager watchdog)"), "{said}");
        assert!(!said.contains("cable") && !said.contains("SET_AXIS"), "{said}");
    }
}

/// A runner that has skipped cycles below OP, where the cycle time differs, keeps step with SYNC0 in OP all the same:
/// sets that are late by less than half a cycle come before the pulse, each before its own, and none is overwritten.
#[test]
fn cycles_that_are_left_out_below_op_change_nothing_in_op() {
    for left_out in [0, 1, 2] {
        let puppet = Puppet::obedient();
        let mut runner = Runner::new(&puppet);
        runner.until("it talks", |runner| runner.board.engine().talks());
        let mut kinds = [SlaveKind::None; 8];
        kinds[0] = SlaveKind::Drive;
        runner.send(|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds }));
        let cycle = CycleTime::from_us(4000).expect("a cycle of the guide's");
        runner.send(|frame| frame.put_master(SIZE, &MasterCommand::SetDc { cycle, shift: DcShift::Auto }));
        runner.go(MasterState::SafeOp);
        runner.cycle(left_out * 1000 * US);
        runner.cycle(0);
        runner.go(MasterState::Op);
        runner.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOn.into()));
        runner.until("it is on", |runner| DriveResponse::decode(&runner.report.slot(SIZE, 1)).statusword.is_enabled());
        (0..300).for_each(|_| runner.cycle(0));
        for n in 1..=60 {
            runner.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n * 10)).into()));
            let at = runner.board.now();
            runner.cycle(if n % 3 == 0 { 1900 * US } else { 0 });
            let took = runner.board.now() - at;
            assert!(took.abs_diff(cycle.ns()) < 100 * US, "{left_out} left out: a cycle takes {took} ns");
        }
        (0..20).for_each(|_| runner.cycle(0));
        let expected: Vec<i32> = (1..=60).map(|n| n * 10).collect();
        assert_eq!(puppet.targets_from(10), expected, "{left_out} left out");
        let counters = runner.board.engine().counters();
        assert_eq!((counters.cycles_left_out, counters.answers_lost), (0, 0), "{counters:?}");
    }
}
