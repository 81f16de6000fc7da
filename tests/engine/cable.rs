//! The network cable, cut and plugged again.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::cia402::Mode;
use ecmsk::engine::{EngineConfig, Event, EventKind, Reason};
use ecmsk::fieldbus::Role;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    CommandId, FIFO_ENTRIES, FifoAction, Frame, MASTER_CYCLIC, MasterCommand, MasterState, SlaveCommand, StateByte,
};

use crate::host::Host;
use crate::network_rig::{Net, buses, set, two_buses};
use crate::probe::drives;
use crate::puppet::Puppet;

const FAILED_OP: u8 = 0x18;

/// SK-4.59 Cut before the first slave in OP: silence, no entry is taken out, frames still queue.
/// SK-9.12 No report comes until the cable is plugged again.
/// SK-4.60 Then reports resume with 0x10 | 8.
#[test]
fn a_cut_before_the_first_slave() {
    for how in buses() {
        let mut net = Net::on(how, 2);
        net.stream(20).settle();
        let (executed, reports) = (net.host.counters().executed, net.host.reports);
        net.network.cut_after(0);
        // Answers already in the bus' pipeline still arrive.
        net.host.cycles(20);
        let silent_since = net.host.reports;
        assert!(silent_since - reports <= 6, "{how:?}");
        for queued in 1..=100 {
            net.target();
            assert!(!net.host.cycle(), "{how:?}: silence");
            assert_eq!(net.host.board.engine().fifo_free(), FIFO_ENTRIES - queued, "{how:?}: frames queue");
        }
        assert_eq!((net.host.counters().executed, net.host.counters().for_lost), (executed, 0), "{how:?}");
        (0..70).for_each(|_| net.target());
        assert_eq!(net.host.counters().full, 10, "{how:?}: up to 160");
        net.host.cycles(300);
        assert_eq!((net.host.reports, net.host.counters().executed), (silent_since, executed), "{how:?}");

        net.network.heal();
        net.host.until("a report", |host| host.reports > silent_since);
        let pipeline = how.map_or(0, |how| how.pipeline);
        net.host.cycles(pipeline);
        assert_eq!(net.host.state(), StateByte(FAILED_OP), "{how:?}");
        assert_eq!(net.lost(), set(&[1, 2]), "{how:?}");
    }
}

/// SK-4.60 The first report after the silence shows 0x10 | 8 already, even if the cable was loose for a moment only.
#[test]
fn the_first_report_says_it() {
    for cut_cycles in [1, 2, 50, 500] {
        let mut net = Net::on(None, 2);
        net.network.cut_after(0);
        for _ in 0..cut_cycles {
            assert!(!net.host.cycle());
        }
        net.network.heal();
        assert!(net.host.cycle());
        assert_eq!(net.host.state().0, FAILED_OP, "{cut_cycles} cycles");
    }
}

/// SK-4.61 Cut after some slave: state 0x10 | 8, lost slots keep their values, the others go on.
/// SK-4.62 When the cable heals they stay lost until the next SET_STATE, which brings them back.
/// SK-2.17 SK-2.18 It acknowledges and clears 0x10.
#[test]
fn a_cut_between_slaves() {
    for how in buses() {
        for reach in [1, 2] {
            let mut net = Net::on(how, 3);
            let lost: Vec<u8> = (reach + 1..=3).collect();
            let slots: Vec<usize> = lost.iter().map(|slave| usize::from(*slave)).collect();
            net.stream(100);
            net.network.cut_after(reach);
            let kept = net.slots(&slots);
            net.until_state(FAILED_OP);
            assert_eq!(net.lost(), set(&lost), "{how:?}");
            // A bus with a pipeline shows the cycles before the cut first.
            let kept = if how.is_some_and(|how| how.pipeline > 0) { net.slots(&slots) } else { kept };
            for _ in 0..200 {
                net.stream(1);
                assert_eq!(net.slots(&slots), kept, "{how:?}: lost slots keep their values");
                assert_eq!(net.host.state().0, FAILED_OP);
            }
            net.network.heal();
            net.stream(200).settle();
            assert_eq!((net.slots(&slots), net.host.state().0), (kept, FAILED_OP), "{how:?}: it stays lost");
            assert_eq!(net.host.drive(1).position, net.targets, "{how:?}: the others go on");

            net.puppets.iter().for_each(Puppet::forget);
            net.host.master(MasterCommand::SetState(Op));
            while net.host.state().0 == FAILED_OP {
                net.stream(1);
                assert!(net.host.counters().executed < 5000, "{how:?}: they never come back");
            }
            assert_eq!((net.host.state().0, net.lost().is_empty()), (8, true), "{how:?}");
            net.settle();
            let first = net.targets;
            assert_eq!(net.host.drive(1).position, first, "{how:?}: they went on");
            for slave in &slots {
                let puppet = &net.puppets[slave - 1];
                assert!(puppet.controlwords().iter().all(|word| *word == 0), "{how:?}: no motor starts");
                net.host.servo_on(*slave);
            }
            net.stream(10).settle();
            for slave in 1..=3 {
                assert_eq!(net.host.drive(slave).position, first + 10, "{how:?}: slave {slave}");
            }
        }
    }
}

/// SK-4.61 The others take every target once and in order, while slaves are lost and while they are brought back.
/// SK-4.44 A target for a lost slave is in a counter, or has reached it.
#[test]
fn every_target_is_executed_or_counted() {
    for how in buses() {
        for (cut, healed) in [(20, 300), (21, 22), (57, 900)] {
            let mut net = Net::on(how, 2);
            let before = net.host.counters();
            for n in 0..1500 {
                match n {
                    n if n == cut => net.network.cut_after(1),
                    n if n == healed => {
                        net.network.heal();
                    }
                    n if n == healed + 5 => {
                        net.host.master(MasterCommand::SetState(Op));
                    }
                    _ => {}
                }
                if net.host.board.engine().fifo_free() > 100 {
                    net.target();
                }
                net.host.cycle();
            }
            net.settle();
            assert_eq!(net.host.state().0, 8, "{how:?}");
            let all: Vec<i32> = (1..=net.targets).collect();
            assert_eq!(strip(net.received(1)), all, "{how:?}: slave 1");
            let counters = net.host.counters();
            let counted = counters.for_lost - before.for_lost + counters.discarded_before_enabled
                - before.discarded_before_enabled;
            let reached = strip(net.received(2)).len() as u64;
            assert_eq!(reached + counted, net.targets as u64, "{how:?}: slave 2, {counters:?}");
            assert!(reached > 15 && counted > 15, "{how:?}");
        }
    }
}

/// Targets without the ones that hold a drive where it is: those of the stream grow.
fn strip(targets: Vec<i32>) -> Vec<i32> {
    let mut newest = 0;
    let grows = |target: &i32| {
        let news = *target > newest;
        newest = newest.max(*target);
        news
    };
    targets.into_iter().filter(grows).collect()
}

/// SK-4.62 Lost slaves are configured again, as they were, and the others are not touched.
#[test]
fn lost_slaves_are_configured_again() {
    for how in two_buses() {
        let mut net = Net::on(how, 3);
        let roles = |net: &Net| net.puppets.iter().map(|puppet| puppet.strings().roles.len()).collect::<Vec<_>>();
        let before = roles(&net);
        net.network.cut_after(1);
        net.until_state(FAILED_OP);
        net.network.heal();
        net.ask(Op, StateByte(8));
        assert_eq!(roles(&net), [before[0], before[1] + 1, before[2] + 1], "{how:?}");
        assert_eq!(net.puppets[2].strings().roles.last(), Some(&Role::Drive(Mode::Csp)));
        assert_eq!(net.jobs.configured().selected, set(&[2, 3]));
    }
}

/// SK-2.16 With 0x10 in the state byte 0, bytes 8..11 and the allowed commands go by the low nibble.
#[test]
fn a_lost_slave_leaves_op_as_it_is() {
    for how in two_buses() {
        let mut net = Net::on(how, 2);
        net.network.cut_after(1);
        net.until_state(FAILED_OP);
        let mark = net.host.mark();
        net.host.master(MasterCommand::SetFifo(FifoAction::Threshold(100))).idle().idle().cycles(10);
        let answer = net.host.answer();
        assert_eq!((answer.id, answer.fifo_free, answer.state.0), (MASTER_CYCLIC, FIFO_ENTRIES - 3, FAILED_OP));
        net.host.master(MasterCommand::SetFifo(FifoAction::Clear)).drained().cycles(20);
        net.host.slave(1, SlaveCommand::ServoOff).cycles(20);
        assert!(!net.host.drive(1).statusword.is_enabled(), "{how:?}");
        net.host.servo_on(1);
        assert_eq!(net.host.rejections(mark), [], "{how:?}");
        net.host.master(MasterCommand::SetAxis { group: 0, kinds: Default::default() }).cycles(20);
        assert_eq!(net.host.rejections(mark), [(0, CommandId::SetAxis, Reason::WrongState)], "{how:?}");
    }
}

/// SK-4.55 SK-4.62 While the cable is still cut the SET_STATE has its time and fails; the next one tries again.
/// SK-4.62 A cable that heals in time is no failure.
#[test]
fn a_set_state_while_the_cable_is_cut() {
    let config = EngineConfig { state_timeout_ns: 400_000_000, ..EngineConfig::default() };
    for how in two_buses() {
        let mut net = Net::with_config(how, 2, config);
        net.host.go(Op).drained().servo_on(1);
        net.network.cut_after(1);
        net.until_state(FAILED_OP);
        net.host.master(MasterCommand::SetState(Op)).cycles(1000);
        assert_eq!((net.host.state().0, net.lost()), (FAILED_OP, set(&[2])), "{how:?}");
        let jobs = net.jobs.len();
        net.network.heal();
        net.stream(1000).settle();
        assert_eq!((net.host.state().0, net.jobs.len()), (FAILED_OP, jobs), "{how:?}: nobody tries again");
        net.ask(Op, StateByte(8));

        let config = EngineConfig { state_timeout_ns: 2_000_000_000, ..config };
        let mut net = Net::with_config(how, 2, config);
        net.host.go(Op).drained();
        net.network.cut_after(1);
        net.until_state(FAILED_OP);
        net.host.master(MasterCommand::SetState(Op)).cycles(200);
        net.network.heal();
        net.until_state(8);
        assert!(net.lost().is_empty());
    }
}

/// SK-4.50 A lower state is reached without the lost ones, which follow: 0x10 stays until they are there.
/// SK-4.62 SET_STATE to a lower state brings them back to that one.
#[test]
fn down_with_lost_slaves() {
    for how in two_buses() {
        for (state, code) in [(SafeOp, 4), (PreOp, 2), (Init, 1)] {
            let mut net = Net::on(how, 2);
            net.network.cut_after(1);
            net.until_state(FAILED_OP);
            net.host.master(MasterCommand::SetState(state)).cycles(100);
            assert_eq!(net.host.state().0, 0x10 | code, "{how:?}");
            net.network.heal();
            net.until_state(code);
            assert!(net.lost().is_empty(), "{how:?}");
            let up = if state == Init { PreOp } else { Op };
            net.host.go(up).go(Op).drained();
            net.host.servo_on(1).servo_on(2);
        }
    }
}

/// SK-4.64 While a SET_STATE for a lost slave is not answered, one to a lower state is not delayed by it.
#[test]
fn down_while_lost_slaves_are_waited_for() {
    for how in two_buses() {
        for (state, code) in [(SafeOp, 4), (PreOp, 2), (Init, 1)] {
            let mut net = Net::on(how, 2);
            net.network.cut_after(1);
            net.until_state(FAILED_OP);
            net.host.master(MasterCommand::SetState(Op)).cycles(50);
            net.host.master(MasterCommand::SetState(state)).cycles(100);
            assert_eq!(net.host.state().0, 0x10 | code, "{how:?}");
        }
    }
}

/// SK-4.62 A host that asks for OP in every frame brings lost slaves back, too.
#[test]
fn asked_for_again_and_again() {
    for how in two_buses() {
        let mut net = Net::on(how, 2);
        net.network.lose(2);
        net.until_state(FAILED_OP);
        net.network.find(2);
        for _ in 0..1000 {
            net.host.master(MasterCommand::SetState(Op)).cycle();
        }
        assert_eq!(net.host.state().0, 8, "{how:?}");
    }
}

/// SK-4.50 A slave that is lost on the way down does not hold up the others.
#[test]
fn lost_on_the_way_down() {
    for how in two_buses() {
        let mut net = Net::on(how, 2);
        net.host.master(MasterCommand::SetState(PreOp)).cycles(5);
        net.network.cut_after(1);
        net.host.cycles(200);
        assert_eq!(net.host.state().0, 0x12, "{how:?}");
        net.network.heal();
        net.until_state(2);
        net.host.go(Op);
    }
}

/// SK-4.61 A slave lost in SafeOP shows as 0x10 | 4, and the next SET_STATE brings it back: to SafeOP or up to OP.
/// SK-4.55 In PreOP nothing is exchanged that would be missed: the next change finds out.
#[test]
fn lost_below_op() {
    for how in two_buses() {
        for (target, code) in [(SafeOp, 4), (Op, 8), (PreOp, 2)] {
            let mut net = Net::new(how, 3);
            net.host.go(SafeOp).cycles(20);
            net.network.cut_after(2);
            net.until_state(0x14);
            assert_eq!(net.lost(), set(&[3]), "{how:?}");
            net.network.heal();
            net.host.cycles(100);
            assert_eq!(net.host.state().0, 0x14, "{how:?}: it stays lost");
            net.ask(target, StateByte(code));
            net.host.go(if target == PreOp { SafeOp } else { target }).go(Op);
            net.host.drained().servo_on(3);
        }
        let mut net = Net::new(how, 2);
        net.network.cut_after(1);
        net.host.cycles(200);
        assert_eq!((net.host.state().0, net.lost().is_empty()), (2, true), "{how:?}");
        net.network.heal();
        net.host.go(Op);
    }
}

/// SK-4.61 A slave lost while others are brought back is not brought back with them: it waits for the next SET_STATE.
#[test]
fn lost_while_others_come_back() {
    for how in two_buses() {
        let mut net = Net::on(how, 3);
        let mark = net.host.mark();
        net.network.silence(2, true);
        net.until_state(FAILED_OP);
        net.network.silence(2, false);
        net.host.master(MasterCommand::SetState(Op)).cycles(100);
        assert_eq!(net.host.state().0, FAILED_OP);
        net.network.silence(3, true);
        net.host.cycles(50);
        assert_eq!(net.lost(), set(&[2, 3]), "{how:?}");
        net.network.silence(3, false);
        net.host.until("slave 2", |host| host.board.engine().lost() == set(&[3]));
        net.host.cycles(1000);
        assert_eq!((net.host.state().0, net.lost()), (FAILED_OP, set(&[3])), "{how:?}");
        assert_eq!(net.host.board.engine().events_since(mark).count(), 2, "{how:?}: lost once each");
        net.ask(Op, StateByte(8));
        net.host.servo_on(2).servo_on(3);
    }
}

/// SK-4.39 Every loss is logged, with what to do.
#[test]
fn losses_are_logged() {
    let mut net = Net::on(None, 3);
    let mark = net.host.mark();
    net.network.cut_after(1);
    net.host.cycles(5);
    let events: Vec<Event> = net.host.board.engine().events_since(mark).collect();
    let kinds: Vec<EventKind> = events.iter().map(|event| event.kind).collect();
    assert_eq!(kinds, [2, 3].map(|slave| EventKind::SlaveLost { slave }));
    assert!(events[0].to_string().contains("SET_STATE"), "{}", events[0]);
}

/// SK-4.60 SK-4.62 End to end on the simulated bus: servo drives that move, a cable that is cut for longer than their
/// watchdog, and all of them on again.
#[test]
fn drives_on_a_cable_that_is_cut() {
    for reach in [0, 1] {
        let bus = SimBus::new(drives(3));
        let network = bus.handle();
        let mut host = Host::new(EngineConfig::default(), bus);
        host.op(3).servo_on(1).servo_on(2).servo_on(3);
        for n in 1..=200 {
            host.build(|frame, size| {
                let csp = SlaveCommand::Csp(ecmsk::sk::Motion::to(n * 10));
                (1..=3).for_each(|slave| frame.put_slave(size, slave, &csp.into()));
            });
            host.cycle();
        }
        network.cut_after(reach);
        let frame = Frame::new();
        for _ in 0..300 {
            host.send(&frame).cycle();
        }
        network.heal();
        host.cycles(500);
        assert_eq!(host.state().0, FAILED_OP);
        let still: Vec<_> = (1..=3).map(|slave| network.shaft(slave, 0)).collect();
        host.go(Op).cycles(100);
        assert_eq!((1..=3).map(|slave| network.shaft(slave, 0)).collect::<Vec<_>>(), still, "nobody moves by itself");
        let on = (1..=3).filter(|slave| host.drive(*slave).statusword.is_enabled()).count();
        assert_eq!(on, usize::from(reach), "who was lost is off");
        host.servo_on(1).servo_on(2).servo_on(3).drained();
        for slave in 1..=3 {
            host.csp(slave, 2100).cycles(5);
        }
        host.cycles(300);
        assert!((1..=3).all(|slave| host.drive(slave).position == 2100));
    }
}
