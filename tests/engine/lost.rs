//! One lost slave: commands for it, its transfers and walks under way, and its way back.

use MasterState::{Op, PreOp, SafeOp};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::{EngineConfig, HomingPhase, Reason};
use ecmsk::fieldbus::AlState;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    CommandId, CycleTime, DcShift, FifoAction, Frame, MasterCommand, MasterState, Motion, RawSlot, SdoCommand,
    SdoResponse, SlaveCommand, SlaveKind, StateByte,
};
use ecmsk::slave::{AlStatus, Io, Slave};

use crate::homer::{Homer, Script};
use crate::host::Host;
use crate::network_rig::{Net, buses, set, two_buses};
use crate::probe::{any_slaves, drives};
use crate::puppet::{Puppet, READY};
use support::ahead_bus::{Ahead, AheadBus};

const FAILED_OP: u8 = 0x18;

/// SK-4.61 One slave loses its power: it is lost, those behind it stay. SK-4.62 It comes back by SET_STATE alone.
#[test]
fn a_slave_without_power() {
    for how in buses() {
        let mut net = Net::on(how, 3);
        net.stream(20);
        net.network.lose(2);
        net.until_state(FAILED_OP);
        assert_eq!(net.lost(), set(&[2]), "{how:?}");
        net.stream(100).settle();
        assert_eq!([1, 3].map(|slave| net.host.drive(slave).position), [net.targets; 2], "{how:?}");
        assert_eq!(net.puppets[1].strings().al_state(), AlState::Init);
        net.network.find(2);
        net.stream(200).settle();
        assert_eq!((net.host.state().0, net.puppets[1].strings().al_state()), (FAILED_OP, AlState::Init), "{how:?}");
        net.ask(Op, StateByte(8));
        assert_eq!((net.lost().is_empty(), net.puppets[1].strings().al_state()), (true, AlState::Op), "{how:?}");
        net.host.servo_on(2);
    }
}

/// SK-4.62 [OURS] No earlier command starts a motor of a slave that comes back: not a walk of SV_ON, not outputs that a
/// bus has taken ahead, not a SET_FIFO that takes entries back.
#[test]
fn no_motor_starts_when_a_slave_comes_back() {
    for how in buses() {
        for cleared in [false, true] {
            let mut net = Net::new(how, 2);
            net.host.master(slow()).go(Op).drained();
            net.puppets[1].strings().freeze(READY);
            net.host.slave(2, SlaveCommand::ServoOn).cycles(10);
            assert_ne!(net.puppets[1].last().controlword.0, 0, "a walk is under way");
            net.host.cycles(20);
            (0..12).for_each(|_| net.target());
            net.host.cycle();
            net.network.silence(2, true);
            net.stream(1);
            if cleared {
                net.host.master(MasterCommand::SetFifo(FifoAction::Clear)).cycle();
            }
            net.until_state(FAILED_OP);
            net.network.silence(2, false);
            net.puppets[1].forget();
            net.ask(Op, StateByte(8)).settle();
            net.host.cycles(100);
            assert_eq!(net.puppets[1].controlwords(), [0], "{how:?}");
            assert!(net.puppets[1].strings().sent.len() > 50, "{how:?}: it is in OP");
        }
    }
}

/// A cycle so slow that a bus has old outputs for longer than a slave needs to come back.
fn slow() -> MasterCommand {
    MasterCommand::SetDc { cycle: CycleTime::from_us(128_000).unwrap(), shift: DcShift::Auto }
}

/// SK-4.62 [OURS] No output of an IO slave is switched on, either.
#[test]
fn no_output_comes_on_when_a_slave_comes_back() {
    for how in buses() {
        let puppets = [Puppet::new(), Puppet::new()];
        let bus = SimBus::new(puppets.iter().map(Puppet::boxed).collect());
        let network = bus.handle();
        let mut host = match how {
            None => Host::new(EngineConfig::default(), bus),
            Some(how) => Host::new(EngineConfig::default(), AheadBus::new(bus, how)),
        };
        host.master(slow()).go(Op).drained();
        let write = |host: &mut Host, bits| {
            let mut frame = Frame::new();
            [1, 2].into_iter().for_each(|slave| frame.put_slave(host.size, slave, &SlaveCommand::IoWrite(bits).into()));
            host.arrive(&frame);
        };
        // As many entries as the bus takes at once.
        let taken = how.map_or(1, |how| how.depth);
        (1..=taken).for_each(|n| write(&mut host, 0x100 + n));
        host.cycles(3);
        network.silence(2, true);
        host.until("the loss", |host| host.state().0 == FAILED_OP);
        network.silence(2, false);
        puppets[1].forget();
        host.master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8).drained().cycles(30);
        assert!(puppets[1].strings().sent.iter().all(|out| out.outputs == 0), "{how:?}");
        assert_eq!(puppets[0].last().outputs, 0x100 + taken, "{how:?}: the other has its own");
        write(&mut host, 0x77);
        host.drained().cycles(10);
        assert_eq!(puppets[1].last().outputs, 0x77, "{how:?}");
    }
}

/// SK-4.61 Its slot keeps its values until it is back in OP. SK-4.62 A slave that is back holds its position until the
/// first target: SK-7.16 its target is the actual position.
#[test]
fn a_slave_that_is_back_holds_its_place() {
    for how in two_buses() {
        let mut net = Net::on(how, 2);
        net.stream(50).settle();
        net.network.lose(2);
        net.until_state(FAILED_OP);
        net.network.find(2);
        net.puppets[1].stand(123_456);
        net.puppets[1].show(0x0250);
        net.puppets[1].forget();
        let kept = net.host.slot(2);
        net.host.master(MasterCommand::SetState(Op)).cycle();
        while net.host.state().0 == FAILED_OP {
            assert_eq!(net.host.slot(2), kept, "{how:?}");
            net.host.cycle();
        }
        net.host.cycles(20).servo_on(2).cycles(20);
        assert_eq!(net.puppets[1].strings().sent[0].target, 123_456, "{how:?}: with the very first outputs");
        let on: Vec<i32> =
            net.puppets[1].strings().sent.iter().filter(|out| out.controlword.0 != 0).map(|out| out.target).collect();
        assert!(!on.is_empty() && on.iter().all(|target| *target == 123_456), "{how:?}: {on:?}");
    }
}

/// SK-7.34 A slave that is back has the mode of DRIVE_MODE, whatever its 0x6060 was written before.
#[test]
fn a_slave_that_is_back_is_in_its_mode() {
    for how in buses() {
        let mut net = Net::new(how, 2);
        net.puppets[1].strings().objects.insert((0x6060, 0), (1, 8));
        net.host.go(Op).drained();
        assert_eq!(net.host.write_object(2, 0x6060, 0, SdoSize::One, 6), Ok(6));
        net.network.lose(2);
        net.until_state(FAILED_OP);
        net.network.find(2);
        net.ask(Op, StateByte(8));
        net.host.servo_on(2).csp(2, 1).drained();
        assert_eq!(net.host.counters().rejected_total(), 0, "{how:?}: CSP is what it is in");
    }
}

/// SK-4.44 SK-7.32 CSP for a lost drive that is not in CSP is rejected as for a present one.
#[test]
fn targets_for_a_lost_slave_in_another_mode() {
    let mut net = Net::new(None, 2);
    net.puppets[1].strings().objects.insert((0x6060, 0), (1, 8));
    net.host.go(Op).drained();
    assert_eq!(net.host.write_object(2, 0x6060, 0, SdoSize::One, 6), Ok(6));
    net.network.silence(2, true);
    net.host.cycle();
    let before = net.host.counters();
    net.host.csp(2, 5).cycles(2);
    let after = net.host.counters();
    assert_eq!(after.rejected[Reason::WrongMode.kind()], before.rejected[Reason::WrongMode.kind()] + 1);
    assert_eq!(after.for_lost, before.for_lost);
}

/// SK-4.61 Commands for a lost slave do not change its slot. SK-4.44 [OURS] They have their own counter; SK-4.39 a
/// command that is not for such a slot is rejected as usual; GET_STATUS does not count.
#[test]
fn commands_for_a_lost_slave() {
    let mut net = Net::on(None, 2);
    net.host.raw(2, RawSlot { id: 0x12, index: 7, ..RawSlot::ZERO }).drained().cycles(50);
    net.network.silence(2, true);
    net.host.cycle();
    let (kept, before, mark) = (net.host.slot(2), net.host.counters(), net.host.mark());
    assert_eq!((kept.id, kept.index), (0x12, 7));
    let commands =
        [SlaveCommand::ServoOn, SlaveCommand::Csp(Motion::to(5)), SlaveCommand::AlarmClear, SlaveCommand::ServoOff];
    for command in commands {
        net.host.slave(2, command).cycles(2);
        assert_eq!(net.host.slot(2), kept, "{command:?}");
    }
    net.host.idle().cycles(2).raw(2, RawSlot { id: 0x99, ..RawSlot::ZERO }).cycles(2);
    net.host.slave(2, SlaveCommand::DriveMode { mode: ecmsk::cia402::Mode::Csv, sync: Default::default() }).cycles(2);
    assert_eq!(net.host.slot(2), kept);
    let after = net.host.counters();
    assert_eq!(after.for_lost - before.for_lost, 4);
    assert_eq!(after.discarded_before_enabled, before.discarded_before_enabled);
    // Commands that are rejected for a present slave are rejected for a lost one: they are for another kind of slave,
    // or mode.
    let wrong =
        [SlaveCommand::IoRead, SlaveCommand::IoWrite(1), SlaveCommand::Csv(Motion::to(5)), SlaveCommand::Cst(5)];
    for command in wrong {
        net.host.slave(2, command).cycles(2);
        assert_eq!(net.host.slot(2), kept, "{command:?}");
    }
    assert_eq!(net.host.counters().for_lost, after.for_lost);
    let reasons = [
        (2, CommandId::Unknown(0x99), Reason::UnknownId),
        (2, CommandId::DriveMode, Reason::WrongState),
        (2, CommandId::IoRead, Reason::WrongSlot),
        (2, CommandId::IoWrite, Reason::WrongSlot),
        (2, CommandId::Csv, Reason::WrongMode),
        (2, CommandId::Cst, Reason::WrongMode),
    ];
    assert_eq!(net.host.rejections(mark), reasons);
    net.network.silence(2, false);
    net.ask(Op, StateByte(8));
    net.host.cycles(5);
    assert_eq!((net.host.slot(2).id, net.host.slot(2).index), (0x12, 7), "the last one that was executed");
}

/// SK-3.1 A slave that is back shows the last command that reached it, not one that a bus had taken ahead. SK-4.62
#[test]
fn a_slave_that_is_back_shows_what_has_reached_it() {
    for cleared in [false, true] {
        let how = Ahead::kind(16, 0, 1, 0);
        let mut net = Net::new(Some(how), 2);
        net.host.master(slow()).go(Op).drained().servo_on(2).cycles(20);
        (0..10).for_each(|_| net.target());
        net.host.cycles(4);
        let reached = net.host.slot(2).index;
        assert!((1..10).contains(&reached));
        net.network.silence(2, true);
        net.until_state(FAILED_OP);
        if cleared {
            net.host.master(MasterCommand::SetFifo(FifoAction::Clear));
        }
        net.settle();
        net.network.silence(2, false);
        net.ask(Op, StateByte(8)).settle();
        assert_eq!((net.host.slot(2).id, net.host.slot(2).index), (0x15, reached), "{cleared}");
        assert_eq!(net.puppets[1].last().controlword.0, 0);
    }
}

/// SK-4.61 A CSP that was under way in the very cycle of the loss is counted.
#[test]
fn the_command_of_the_cycle_of_the_loss() {
    let mut net = Net::on(None, 2);
    net.target();
    net.network.silence(2, true);
    net.host.cycle();
    assert_eq!((net.host.counters().for_lost, net.received(2)), (1, vec![]));
    net.host.cycles(5);
    assert_eq!(net.host.counters().for_lost, 1, "repeated outputs are no command");
}

/// SK-6.8 An SDO transfer with a lost slave ends in abort 0x05040000, also when it could answer again; one with another
/// slave does not. SK-4.62 After the SET_STATE it works again.
#[test]
fn sdo_transfers_with_a_lost_slave() {
    let mut bench = crate::probe::Bench::new(EngineConfig::default(), any_slaves(2));
    bench.host.op(2);
    bench.network.silence(2, true);
    bench.host.until("the loss", |host| host.state().0 == FAILED_OP);
    for powered in [false, true] {
        let n = u8::from(powered);
        assert_eq!(bench.host.read_object(2, 0x1000, n), Err(AbortCode::TIMEOUT), "powered: {powered}");
        assert_eq!(AbortCode::TIMEOUT.0, 0x0504_0000);
        assert_eq!(bench.host.read_object(1, 0x1018, n), Ok(0x1018));
        // The slave falls to SafeOP, where it has a mailbox.
        bench.network.silence(2, false);
        bench.host.cycles(100);
    }
    bench.host.go(Op);
    assert_eq!(bench.host.read_object(2, 0x1000, 0), Ok(0x1000));
}

/// SK-6.8 So does a transfer that is under way when the slave is lost, and the slot shows it as an abort.
#[test]
fn a_transfer_under_way() {
    let mut net = Net::on(None, 2);
    net.network.delay_sdo(2, 100_000_000);
    net.host.sdo(SdoCommand::Read { slave: 2, object: ObjectAddress::new(0x1000, 0) }).cycles(10);
    net.network.lose(2);
    net.host.until("the end of the SDO", |host| host.sdo_answer() != SdoResponse::Empty);
    assert!(matches!(net.host.sdo_answer(), SdoResponse::Aborted { slave: 2, code: AbortCode::TIMEOUT, .. }));
}

/// SK-4.57 An unused slave is not missed. SK-4.61
#[test]
fn an_unused_slave_is_not_missed() {
    for how in two_buses() {
        let mut net = Net::new(how, 3);
        let mut kinds = [SlaveKind::Drive; 8];
        kinds[1] = SlaveKind::None;
        net.host.master(MasterCommand::SetAxis { group: 0, kinds });
        for state in [SafeOp, Op] {
            net.host.go(state).cycles(20);
            net.network.lose(2);
            net.host.cycles(200);
            assert_eq!((net.host.state(), net.lost().is_empty()), (StateByte::reached(state), true), "{how:?}");
            net.network.find(2);
            net.host.cycles(200);
            assert_eq!(net.host.state(), StateByte::reached(state), "{how:?}");
        }
        net.network.cut_after(1);
        net.until_state(FAILED_OP);
        assert_eq!(net.lost(), set(&[3]));
    }
}

/// SK-4.61 [OURS] A slave that falls from OP by itself, as by its watchdog, is lost, too.
#[test]
fn a_slave_that_falls_by_itself() {
    for how in two_buses() {
        let mut net = Net::on(how, 2);
        net.puppets[1].strings().fall(AlState::SafeOp);
        net.until_state(FAILED_OP);
        assert_eq!(net.lost(), set(&[2]), "{how:?}");
        net.stream(50).settle();
        assert_eq!(net.host.drive(1).position, net.targets);
        net.ask(Op, StateByte(8));
        net.host.servo_on(2);
    }
}

/// SK-4.55 A lost slave that refuses its way back leaves 0x10 | 8, and the next SET_STATE tries again.
#[test]
fn a_lost_slave_that_refuses() {
    for how in two_buses() {
        for refused in [AlState::PreOp, AlState::SafeOp, AlState::Op] {
            let mut net = Net::on(how, 2);
            net.network.lose(2);
            net.until_state(FAILED_OP);
            net.network.find(2);
            net.network.refuse(2, Some((refused, AlStatus(0x0011))));
            net.host.master(MasterCommand::SetState(Op));
            net.stream(1500).settle();
            assert_eq!((net.host.state().0, net.lost()), (FAILED_OP, set(&[2])), "{how:?} {refused:?}");
            assert_eq!(net.host.drive(1).position, net.targets, "{how:?}: the other goes on");
            net.network.refuse(2, None);
            net.ask(Op, StateByte(8));
            net.host.servo_on(2);
        }
    }
}

/// SK-4.62 SK-4.64 A SET_STATE that comes while a slave is on its way back replaces the target.
#[test]
fn another_target_on_the_way_back() {
    for how in two_buses() {
        for cycles in [1, 30, 60, 100, 200, 300, 390] {
            for (state, code) in [(PreOp, 2), (SafeOp, 4), (Op, 8)] {
                let mut net = Net::on(how, 3);
                net.network.lose(2);
                net.until_state(FAILED_OP);
                net.network.find(2);
                net.host.master(MasterCommand::SetState(Op)).cycles(cycles);
                assert_eq!(net.host.state().0, FAILED_OP, "{how:?} {cycles}");
                net.ask(state, StateByte(code));
                net.host.cycles(500);
                assert_eq!((net.host.state().0, net.lost().is_empty()), (code, true), "{how:?} {cycles} {state}");
                net.host.go(Op).drained().servo_on(2);
            }
        }
    }
}

/// SK-4.62 All slaves lost, and outputs that a bus has taken ahead: these do not prevent the slaves from coming back.
#[test]
fn all_lost_with_outputs_ahead() {
    for how in buses() {
        let mut net = Net::new(how, 2);
        net.host.master(slow()).go(Op).drained().servo_on(1);
        (0..100).for_each(|_| net.target());
        net.host.cycles(2);
        [1, 2].into_iter().for_each(|slave| net.network.lose(slave));
        net.until_state(FAILED_OP);
        [1, 2].into_iter().for_each(|slave| net.network.find(slave));
        net.puppets.iter().for_each(Puppet::forget);
        net.ask(Op, StateByte(8));
        net.host.cycles(40);
        let words = [0, 1].map(|n| net.puppets[n].controlwords());
        assert!(words.iter().flatten().all(|word| *word == 0), "{how:?}: no motor starts: {words:02x?}");
        net.host.servo_on(1).servo_on(2);
    }
}

/// SK-4.62 [OURS] Answers that a bus still has under way when a slave is back are no new loss.
#[test]
fn old_answers_are_no_new_loss() {
    for pipeline in [1, 8, 16] {
        let how = Ahead::kind(4, pipeline, 1, 0);
        let mut net = Net::new(Some(how), 2);
        net.host.master(slow()).go(Op).drained();
        for _ in 0..3 {
            net.network.silence(2, true);
            net.until_state(FAILED_OP);
            net.network.silence(2, false);
            net.host.master(MasterCommand::SetState(Op));
            net.until_state(8);
            for _ in 0..60 {
                net.host.cycle();
                assert_eq!(net.host.state().0, 8, "pipeline {pipeline}");
            }
        }
    }
}

/// SK-4.33 SW_RESET resets losses, too, and finds the present slaves.
#[test]
fn sw_reset_finds_who_is_there() {
    for how in two_buses() {
        let mut net = Net::on(how, 3);
        net.network.cut_after(2);
        net.until_state(FAILED_OP);
        net.host.soft_reset().cycles(50);
        assert_eq!((net.host.state().0, net.lost().is_empty()), (2, true), "{how:?}");
        assert_eq!(net.host.board.engine().slaves_found(), 2);
        net.host.declare_drives(2).go(Op);
    }
}

/// SK-4.61 A cycle with lost slaves allocates nothing, nor does bringing them back.
#[test]
fn lost_slaves_allocate_nothing() {
    let bus = SimBus::new(drives(40));
    let network = bus.handle();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(40);
    let frame = Frame::new();
    let counted = allocation_counter::measure(|| {
        network.cut_after(7);
        network.lose(3);
        (0..300).for_each(|_| {
            host.send(&frame).cycle();
        });
        network.heal();
        network.find(3);
        host.master(MasterCommand::SetState(Op));
        while host.state().0 != 8 {
            host.cycle();
        }
    });
    assert_eq!((counted.count_total, counted.count_current), (0, 0), "{counted:?}");
}

/// SK-4.62 The first outputs of an IO slave that was lost are off, on simulated modules as well.
#[test]
fn a_simulated_module_comes_back() {
    let bus = SimBus::new(vec![Box::<Io>::default() as Box<dyn Slave>, Box::<Io>::default()]);
    let network = bus.handle();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.go(Op).drained();
    for slave in [1, 2] {
        host.slave(slave, SlaveCommand::IoWrite(0xF0F0)).cycles(3);
    }
    network.lose(1);
    host.cycles(5).slave(1, SlaveCommand::IoWrite(0x1111)).cycles(3);
    assert_eq!((host.slot(1).data1, host.counters().for_lost), (0xF0F0, 1), "its slot keeps its values");
    network.find(1);
    host.go(Op).idle().cycles(5);
    for slave in [1, 2] {
        host.slave(slave, SlaveCommand::IoRead).cycles(3);
    }
    assert_eq!([host.slot(1).data1, host.slot(2).data1], [0, 0xF0F0]);
}

/// SK-4.36 SK-4.61 ABORT_HOME in a lost IO slave's slot is no command for such a slave, and ends no homing; CSP there is
/// rejected as well.
#[test]
fn commands_for_a_lost_io_slave() {
    let homer = Homer::new();
    homer.script(Script { takes: 5000, ..Script::default() });
    let bus = SimBus::new(vec![Box::new(homer.clone()) as Box<dyn Slave>, Box::<Io>::default()]);
    let network = bus.handle();
    let mut host = Host::new(EngineConfig::default(), bus);
    let mut kinds = [SlaveKind::None; 8];
    (kinds[0], kinds[1]) = (SlaveKind::Drive, SlaveKind::Io);
    host.master(MasterCommand::SetAxis { group: 0, kinds }).go(Op).drained().servo_on(1);
    host.write_object(1, 0x6060, 0, SdoSize::One, 6).unwrap();
    host.slave(1, SlaveCommand::GoHome).cycles(5);
    network.lose(2);
    host.cycles(5);
    let (before, mark) = (host.counters(), host.mark());
    host.slave(2, SlaveCommand::AbortHome).cycles(3).csp(2, 5).cycles(3);
    assert_eq!(host.board.engine().homing_phase(1), HomingPhase::Homing);
    let rejected = [CommandId::AbortHome, CommandId::Csp].map(|id| (2, id, Reason::WrongSlot));
    assert_eq!((host.rejections(mark), host.counters().for_lost), (rejected.into(), before.for_lost));
    host.slave(2, SlaveCommand::IoWrite(5)).cycles(3);
    assert_eq!(host.counters().for_lost, before.for_lost + 1);
}
