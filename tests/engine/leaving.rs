//! The end of OP, and SW_RESET.

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::engine::{EngineConfig, Firmware};
use ecmsk::fieldbus::{AxisOut, Role};
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, RawSlot, SdoResponse,
    SlaveCommand, SlotSize, StateByte,
};

use crate::host::BOOT_LIMIT;
use crate::network_rig::{Net, buses};
use crate::probe::{Bench, any_slaves, drives};

/// A cycle so slow that the FIFO fills within it.
fn slow() -> MasterCommand {
    MasterCommand::SetDc { cycle: CycleTime::from_us(512_000).unwrap(), shift: DcShift::Auto }
}

fn op(n: usize) -> Bench {
    let mut bench = Bench::new(EngineConfig::default(), drives(n));
    bench.host.op(n);
    bench
}

/// SK-4.66 On leaving OP the slave slots keep their last values.
#[test]
fn slave_slots_keep_their_values() {
    for size in SlotSize::ALL {
        let config = EngineConfig { slot: size, ..EngineConfig::default() };
        for state in [MasterState::SafeOp, MasterState::PreOp, MasterState::Init] {
            let Bench { mut host, .. } = Bench::new(config, any_slaves(3));
            host.op(3).raw(2, RawSlot { id: 0x12, index: 0x44, ..RawSlot::ZERO });
            host.cycles(100).master(MasterCommand::SetState(state));
            let mut last = host.report.clone();
            host.until("the state", |host| {
                if host.state() == StateByte::reached(MasterState::Op) {
                    last.clone_from(&host.report);
                }
                host.state() == StateByte::reached(state)
            });
            for _ in 0..20 {
                host.cycle();
                for slave in 1..size.slots() {
                    assert_eq!(host.slot(slave), last.slot(size, slave), "{size:?} {state} slot {slave}");
                }
            }
            assert!(host.slot(2).data1 > 100, "{size:?} {state}: the values of OP");
            assert_eq!((host.answer().fifo_free, host.answer().full_count), (0, 0), "{size:?} {state}");
        }
    }
}

/// SK-5.25 Leaving OP empties the FIFO; SK-4.44 the entries are counted as cleared.
#[test]
fn leaving_op_empties_the_fifo() {
    let Bench { mut host, .. } = op(1);
    host.master(MasterCommand::SetFifo(FifoAction::Threshold(1)));
    (0..49).for_each(|_| {
        host.slave(1, SlaveCommand::ServoOn);
    });
    assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES - 50);
    // This differs from a clear: SET_STATE's own frame is an entry, too.
    host.go(MasterState::SafeOp);
    assert_eq!(host.counters().cleared, 51);
    host.go(MasterState::Op).cycle();
    assert_eq!(host.answer().fifo_free, FIFO_ENTRIES);
    // The threshold is the default again: the first entry is taken at once.
    let executed = host.counters().executed;
    host.idle().cycle();
    assert_eq!((host.counters().executed, host.answer().fifo_free), (executed + 1, FIFO_ENTRIES));
    host.cycles(100);
    assert!(!host.drive(1).statusword.is_enabled());
}

/// SK-4.33 SW_RESET resets all variables, in every state; it has no answer.
/// SK-4.34 The host interface is gone until the board has booted.
/// SK-4.65 Axes, DC and modes do not survive it.
/// SK-4.67 After it no report comes before the next PreOP.
#[test]
fn sw_reset_resets_all_variables() {
    let defaults: Vec<Frame> = SlotSize::ALL
        .map(|slot| {
            let config = EngineConfig { slot, ..EngineConfig::default() };
            let Bench { mut host, .. } = Bench::new(config, any_slaves(3));
            host.cycles(2);
            host.report
        })
        .into();
    for (size, fresh) in SlotSize::ALL.into_iter().zip(defaults) {
        // Slower than the default, and fast enough for the watchdog of slaves on any bus.
        let slower = MasterCommand::SetDc { cycle: CycleTime::from_us(64_000).unwrap(), shift: DcShift::Auto };
        for state in [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
            let config = EngineConfig { slot: size, ..EngineConfig::default() };
            let Bench { mut host, jobs, .. } = Bench::new(config, any_slaves(3));
            host.declare_drives(3).master(slower);
            let mode = SlaveCommand::DriveMode { mode: Mode::Cst, sync: DriveSync::FreeRun };
            host.slave(1, mode).master(MasterCommand::LocalWrite(0x3F)).read_object(1, 0x1000, 0).unwrap();
            host.master(MasterCommand::SetAxis { group: 4, kinds: Default::default() }).go(state);
            if state == MasterState::Op {
                host.drained().master(MasterCommand::SetFifo(FifoAction::Threshold(1)));
                while host.counters().full == 0 {
                    host.idle();
                }
            }
            let (boots, reports) = (host.board.engine().boots(), host.reports);
            host.master(MasterCommand::SoftReset);
            assert_eq!((host.board.engine().boots(), host.board.engine().talks()), (boots + 1, false), "{state}");
            assert!(!host.cycle() && host.reports == reports, "{size:?} {state}: no answer");
            assert_eq!((host.board.engine().state(), host.board.engine().local_outputs()), (StateByte(0), 0));
            host.until("PreOP", |host| host.board.engine().talks()).cycles(2);
            assert_eq!(host.report.wire(size), fresh.wire(size), "{size:?} {state}: as a board just switched on");

            host.go(MasterState::Op).cycle();
            let config = jobs.configured();
            assert_eq!((config.cycle.us(), config.slaves[0].role), (1000, Role::Io), "{size:?} {state}");
            assert_eq!((host.answer().fifo_free, host.answer().full_count), (FIFO_ENTRIES, 0), "{size:?} {state}");
            host.go(MasterState::PreOp).declare_drives(3).go(MasterState::Op);
            let slave = jobs.configured().slaves[0];
            assert_eq!((slave.role, slave.sync), (Role::Drive(Mode::Csp), DriveSync::DcSync), "{size:?} {state}");
        }
    }
}

/// SK-4.33 SW_RESET ends a transfer under way and a change under way.
#[test]
fn sw_reset_during_other_things() {
    let Bench { mut host, network, .. } = op(2);
    network.delay_sdo(1, 500_000_000);
    host.raw(41, RawSlot { id: 0x07, parm: 1, data1: 0x1000_0000, ..RawSlot::ZERO }).cycles(5).soft_reset();
    host.cycles(1000);
    assert_eq!(host.sdo_answer(), SdoResponse::Empty);
    network.delay_sdo(1, 0);
    host.read_object(1, 0x1000, 0).unwrap();

    host.declare_drives(2).master(MasterCommand::SetState(MasterState::Op)).cycles(100).soft_reset().cycles(2000);
    assert_eq!(host.state(), StateByte::reached(MasterState::PreOp));
    host.op(2).servo_on(1);
}

/// SK-4.33 SW_RESET resets the outputs of slaves, also of those that are not found any more: their motors are not
/// requested.
#[test]
fn sw_reset_leaves_no_outputs() {
    for how in buses() {
        let mut net = Net::on(how, 2);
        assert_eq!(net.jobs.outputs().slaves[1][0].controlword, Controlword::ENABLE_OPERATION);
        net.host.master(MasterCommand::SoftReset);
        net.network.cut_after(1);
        assert!(net.host.board.boot(BOOT_LIMIT));
        net.host.report = Frame::new();
        net.host.declare_drives(2).go(MasterState::Op).cycles(50);
        assert_eq!(net.host.board.engine().slaves_found(), 1);
        let [first, second] = [0, 1].map(|n| net.jobs.outputs().slaves[n][0]);
        assert_eq!((first.controlword.0, second), (0, AxisOut::default()), "{how:?}");
    }
}

/// SK-4.44 The counters outside the wire survive SW_RESET, and the frames in the FIFO count as cleared.
#[test]
fn counters_survive_sw_reset() {
    for firmware in [Firmware::V17, Firmware::V15] {
        let config = EngineConfig { firmware, ..EngineConfig::default() };
        let Bench { mut host, .. } = Bench::new(config, drives(1));
        host.raw(0, RawSlot { id: 0x99, ..RawSlot::ZERO }).master(slow()).op(1);
        host.csp(1, 5).drained();
        for _ in 0..165 {
            host.idle();
        }
        host.soft_reset();
        let counters = host.counters();
        assert_eq!((counters.rejected_total(), counters.discarded_before_enabled, counters.full), (1, 1, 5));
        assert_eq!((counters.executed, counters.cleared), (1, 160));
    }
}

/// SK-4.44 Frames that arrive while the board boots after SW_RESET are not executed, and have their own counter.
#[test]
fn frames_while_booting_are_counted() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(1));
    let frames = host.counters().frames;
    host.master(MasterCommand::SoftReset).master(slow()).idle().cycles(20).idle();
    assert!(!host.board.engine().talks());
    assert_eq!((host.counters().frames - frames, host.counters().while_booting), (1, 3));
    assert_eq!(host.reports, 0);
}
