//! Neither a cycle nor a call of a host allocates.

use allocation_counter::measure;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::engine::{Board, EngineConfig, Stepped};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::sk::{
    DriveResponse, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, Motion, RawSlot, SdoCommand,
    SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{DeviceFault, Drive, DriveConfig, Fault, Slave};

use crate::host::Host;
use support::ahead_bus::{Ahead, AheadBus};

const DRIVES: usize = 40;

fn network() -> SimBus {
    SimBus::new((0..DRIVES).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect())
}

fn host_over(bus: impl Fieldbus + 'static) -> Host {
    Host::new(EngineConfig::default(), bus)
}

/// 40 drives that are on.
fn in_op(bus: impl Fieldbus + 'static) -> Host {
    let mut host = host_over(bus);
    host.op(DRIVES).build(|frame, size| {
        (1..=DRIVES).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::ServoOn.into()));
    });
    host.until("all on", |host| (1..=DRIVES).all(|slave| host.drive(slave).statusword.is_enabled()));
    host
}

/// A target for every drive.
fn targets(size: SlotSize, n: i32) -> Frame {
    let mut frame = Frame::new();
    for slave in 1..=DRIVES {
        frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(n * slave as i32)).into());
    }
    frame
}

fn allocates_nothing(what: &str, run: impl FnOnce()) {
    let counted = measure(run);
    assert_eq!((counted.count_total, counted.count_current), (0, 0), "{what}: {counted:?}");
}

/// SK-5.3 Executing an entry a cycle with 40 drives under way allocates nothing; neither does a change of state.
#[test]
fn streaming_allocates_nothing() {
    let mut host = host_over(network());
    host.declare_drives(DRIVES);
    allocates_nothing("PreOP to OP", || {
        host.master(MasterCommand::SetState(MasterState::Op));
        while host.state() != StateByte::reached(MasterState::Op) {
            host.cycle();
        }
    });
    let mut host = in_op(network());
    allocates_nothing("2000 cycles of CSP", || {
        for n in 0..2000 {
            host.send(&targets(host.size, n)).cycle();
        }
    });
    assert!(host.drive(40).position > 70_000, "they moved: {:?}", host.drive(40));
}

/// SK-6.1 An SDO under way, its end and its abort allocate nothing.
#[test]
fn transfers_allocate_nothing() {
    let mut host = in_op(network());
    let object = ObjectAddress::new(0x6065, 0);
    let commands = [
        SdoCommand::Read { slave: 1, object },
        SdoCommand::Write { slave: 2, object, size: SdoSize::Four, value: 99 },
        SdoCommand::Write { slave: 2, object, size: SdoSize::One, value: 99 },
        SdoCommand::Read { slave: 3, object: ObjectAddress::new(0x1008, 0) },
        SdoCommand::Read { slave: 4, object: ObjectAddress::new(0x5555, 0) },
    ];
    for command in commands {
        let before = host.sdo_answer();
        allocates_nothing("an SDO", || {
            host.sdo(command);
            for n in 0..50 {
                host.send(&targets(host.size, n)).cycle();
            }
        });
        assert_ne!(host.sdo_answer(), before, "{command:?} has ended");
    }
}

/// SK-4.39 Rejecting commands allocates nothing; SK-5.6 nor does a full FIFO, nor a fault.
#[test]
fn what_goes_wrong_allocates_nothing() {
    let bus = network();
    let network = bus.handle();
    let mut host = in_op(bus);
    let mut nonsense = targets(host.size, 1);
    for slot in (0..42).step_by(2) {
        nonsense.put(host.size, slot, &RawSlot { id: 0x66, ..RawSlot::ZERO });
    }
    let before = host.counters();
    allocates_nothing("nonsense", || {
        for _ in 0..200 {
            host.send(&nonsense).cycle();
        }
    });
    allocates_nothing("a full FIFO", || {
        for n in 0..300 {
            host.arrive(&targets(SlotSize::Bytes12, n));
        }
        host.cycles(20);
        host.master(MasterCommand::SetFifo(FifoAction::Clear)).cycles(20);
    });
    network.apply_fault(1, Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x2310, resettable: true } });
    allocates_nothing("a fault", || {
        host.cycles(100);
    });
    let after = host.counters();
    assert_eq!(after.rejected_total() - before.rejected_total(), 21 * 200);
    assert!(after.full > 100 && after.cleared > 100, "{after:?}");
    assert_eq!(host.drive(1).error_code, 0x2310);
}

/// SK-5.3 The engine does not allocate on a bus that takes outputs ahead, either.
#[test]
fn outputs_ahead_allocate_nothing() {
    let mut host = in_op(AheadBus::new(network(), Ahead::kind(64, 4, 333_333, 700)));
    allocates_nothing("outputs ahead", || {
        for n in 0..100 {
            host.arrive(&targets(SlotSize::Bytes12, n));
        }
        host.cycles(50);
        host.master(MasterCommand::SetFifo(FifoAction::Clear)).cycles(200);
    });
    assert_eq!(host.answer().fifo_free, FIFO_ENTRIES);
    assert!(host.counters().cleared > 0);
}

/// SK-9.8 Writing to and reading from a board that a link has opened allocate nothing, with the slaves behind a chip
/// either: the way to OP, targets, and the way back.
#[test]
fn a_board_of_a_link_allocates_nothing() {
    let all = |command: SlaveCommand| {
        let mut frame = Frame::new();
        (1..=8).for_each(|slave| frame.put_slave(SlotSize::Bytes12, slave, &command.into()));
        frame
    };
    let master = |command: MasterCommand| {
        let mut frame = Frame::new();
        frame.put_master(SlotSize::Bytes12, &command);
        frame
    };
    let declared = master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
    let [op, pre_op] = [MasterState::Op, MasterState::PreOp].map(|state| master(MasterCommand::SetState(state)));
    let (on, targets) = (all(SlaveCommand::ServoOn), all(SlaveCommand::Csp(Motion::to(500))));
    for keys in [
        "sim:?slaves=drive*8",
        "xf-sim:?slaves=drive*8",
        "xf-sim:?slaves=drive*8&chip_fw=old&int0=yes",
        "xf-sim:?slaves=drive*8&ahead=1",
    ] {
        let link = link::open(&format!("{keys}&clock=virtual"), Share::ByName).expect(keys);
        let mut report = Frame::new();
        let mut until = |frame: &Frame, so: &dyn Fn(&Frame) -> bool| {
            link.write(frame, Wait::Forever).unwrap();
            while !so(&report) {
                link.read(&mut report, Wait::Forever).unwrap();
            }
        };
        let is = |state| move |report: &Frame| report.bytes()[2] == StateByte::reached(state).0;
        let drive = |report: &Frame| DriveResponse::decode(&report.slot(SlotSize::Bytes12, 8));
        allocates_nothing(keys, || {
            until(&declared, &|_| true);
            until(&op, &is(MasterState::Op));
            until(&on, &|report| drive(report).statusword.is_enabled());
            // More targets are under way than a chip holds, so that every record of them is in use.
            for _ in 0..100 {
                link.write(&targets, Wait::Forever).unwrap();
            }
            until(&targets, &|report| drive(report).position == 500);
            until(&pre_op, &is(MasterState::PreOp));
        });
    }
}

/// SK-9.8 Writing and reading on the virtual clock allocate nothing, by the runner and by the link.
#[test]
fn the_stepped_runner_allocates_nothing() {
    let board = || {
        let mut board = Board::new(EngineConfig::default(), Box::new(network()));
        assert!(board.boot(60_000_000_000));
        board
    };
    let frame = targets(SlotSize::Bytes12, 5);
    let mut report = Frame::new();
    let stepped = Stepped::new(board(), 125_000, 32);
    allocates_nothing("the runner", || {
        for _ in 0..1000 {
            stepped.write(&frame).unwrap();
            stepped.read(&mut report, None).unwrap();
        }
    });
    let link = EngineLink::open("board", board(), RunOptions::default(), None).unwrap();
    allocates_nothing("the link", || {
        for _ in 0..1000 {
            link.write(&frame, Wait::Forever).unwrap();
            link.read(&mut report, Wait::Forever).unwrap();
        }
    });
}
