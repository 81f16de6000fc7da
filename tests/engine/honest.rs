//! Properties of a bus on other hardware, one at a time: it loses answers, knows a lost slave late, cannot configure a
//! slave without the others, takes no SDO during a change of state, has its own inputs and outputs.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use MasterState::{Op, PreOp, SafeOp};
use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{Board, EngineConfig, Event, EventKind};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AlState, CycleDone, Fieldbus, Inputs, Ns};
use ecmsk::sk::{
    FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, Motion, SdoCommand, SdoResponse, SlaveCommand,
    StateByte,
};
use ecmsk::slave::AlStatus;

use crate::host::{self, Host};
use crate::network_rig::{Net, buses, set};
use crate::puppet::Puppet;
use support::ahead_bus::{Ahead, Honesty};
use support::hand_on;

/// An ideal bus with one deviation.
fn but(honesty: Honesty) -> Ahead {
    Ahead { honesty: Honesty { seed: 1, ..honesty }, ..Ahead::kind(16, 2, 333_333, 100) }
}

fn events(net: &Net, mark: u64) -> Vec<Event> {
    net.host.board.engine().events_since(mark).collect()
}

/// SK-12.4 Answers that a bus has lost make no report and are counted and logged; no entry is lost by it, and a later
/// answer covers the earlier ones. SK-12.1
#[test]
fn lost_answers_are_counted() {
    let mut net = Net::on(Some(but(Honesty { loses: 7, ..Honesty::default() })), 2);
    let (before, mark) = (net.host.counters(), net.host.mark());
    net.stream(300).settle();
    let after = net.host.counters();
    assert!(after.answers_lost - before.answers_lost > 20);
    assert_eq!((after.executed - before.executed, after.cleared, net.host.answer().fifo_free), (300, 0, FIFO_ENTRIES));
    assert_eq!(net.received(1), (0..=300).collect::<Vec<_>>());
    let told: Vec<Event> = events(&net, mark);
    assert!(told.iter().all(|event| matches!(event.kind, EventKind::AnswersLost { cycles: 1.. })), "{told:?}");
    assert!(told[0].to_string().contains("are lost"), "{}", told[0]);
}

/// SK-12.4 The same when the bus is not polled for a while, so that it has no room for more answers.
#[test]
fn answers_of_a_long_pause_are_lost() {
    let how = but(Honesty { keeps: 20, ..Honesty::default() });
    let mut rig = crate::rig::Rig::new(how);
    let before = rig.engine.counters().answers_lost;
    (0..10).for_each(|_| rig.target());
    rig.run(1);
    rig.poll_after(100_000_000);
    assert!((75..=85).contains(&(rig.engine.counters().answers_lost - before)));
    rig.drained();
    assert_eq!(rig.puppet.targets(), (0..=10).collect::<Vec<_>>());
    assert_eq!(rig.answer().fifo_free, FIFO_ENTRIES);
}

/// SK-12.5 A slave whose loss is known only later: commands sent to it meanwhile are counted as for a lost slave,
/// exactly, and the others go on. SK-12.6 That not all slaves answer is reported at once, and once.
#[test]
fn a_loss_known_late() {
    for loss_delay in [0, 1, 5, 40] {
        let mut net = Net::on(Some(but(Honesty { loss_delay, keeps: 64, ..Honesty::default() })), 2);
        net.stream(50);
        let mark = net.host.mark();
        net.network.silence(2, true);
        net.stream(100).settle();
        assert_eq!((net.host.state().0, net.lost()), (0x18, set(&[2])), "{loss_delay}");
        let reached = *net.received(2).last().unwrap();
        assert_eq!(net.host.counters().for_lost, 150 - reached as u64, "{loss_delay}");
        assert_eq!(net.received(1), (0..=150).collect::<Vec<_>>());
        let told = events(&net, mark);
        match &told[..] {
            [Event { kind: EventKind::SlaveLost { slave: 2 }, .. }] => assert_eq!(loss_delay, 0),
            [
                Event { at, kind: EventKind::WorkingCounter { counted: 3, expected: 6 } },
                Event { at: then, kind: EventKind::SlaveLost { slave: 2 } },
            ] => {
                assert_eq!((then - at).div_ceil(1_000_200), loss_delay);
                assert!(told[0].to_string().contains("working counter 3 instead of 6"), "{}", told[0]);
            }
            _ => panic!("{loss_delay}: {told:?}"),
        }
        net.network.silence(2, false);
        net.ask(Op, StateByte(8)).host.servo_on(2);
    }
}

/// SK-12.5 Two slaves that are lost soon after each other, which is known only later: for each, only the commands count
/// that it missed. SK-12.4 Answers that are lost meanwhile do not change that.
#[test]
fn two_losses_known_late() {
    for loss_delay in [0, 1, 5, 40] {
        for (between, loses) in [0, 1, 3, 8, 30].into_iter().flat_map(|between| [(between, 0), (between, 4)]) {
            let mut net = Net::on(Some(but(Honesty { loss_delay, loses, keeps: 64, ..Honesty::default() })), 3);
            net.stream(50);
            net.network.silence(2, true);
            net.stream(between);
            net.network.silence(3, true);
            net.stream(100).settle();
            let missed = [2, 3].map(|slave| (net.targets - net.received(slave).last().unwrap()) as u64);
            let what = format!("{loss_delay} cycles late, {between} between them, one answer in {loses} lost");
            assert_eq!(net.host.counters().for_lost, missed[0] + missed[1], "{what}");
            assert_eq!((net.lost(), net.received(1).len()), (set(&[2, 3]), 151 + between), "{what}");
        }
    }
}

/// SK-12.5 A loss that is known only after OP was left, or ended by SW_RESET: commands sent to the slave in OP that did
/// not reach it count all the same.
#[test]
fn a_loss_known_when_op_is_over() {
    for command in [MasterCommand::SetState(SafeOp), MasterCommand::SetState(PreOp), MasterCommand::SoftReset] {
        let mut net = Net::on(Some(but(Honesty { loss_delay: 40, keeps: 64, ..Honesty::default() })), 2);
        let before = net.host.counters();
        net.stream(50);
        net.network.silence(2, true);
        net.stream(10);
        net.host.master(command).cycles(200);
        let after = net.host.counters();
        // The other outputs that slave 1 missed came when it had left OP.
        let sent = (after.executed - before.executed).min(60) as i32;
        let missed = [1, 2].map(|slave| (sent - net.received(slave).last().unwrap()) as u64);
        assert_eq!((after.for_lost, missed[1] > 5), (missed[0] + missed[1], true), "{command:?}");
    }
}

/// SK-12.5 A slave that was silent before the first outputs of the board were sent has received none of them.
#[test]
fn a_loss_before_the_first_outputs() {
    let mut net = Net::new(Some(but(Honesty { loss_delay: 40, keeps: 64, ..Honesty::default() })), 2);
    net.host.go(Op);
    net.network.silence(2, true);
    for slave in [1, 2] {
        net.host.slave(slave, SlaveCommand::ServoOn);
    }
    net.until_state(0x18);
    assert_eq!((net.lost(), net.host.counters().for_lost), (set(&[2]), 1));
}

/// SK-12.7 A bus that configures no slave without the others: bringing one back makes them leave OP. That is logged,
/// their motors stay off until they are switched on, and one SET_STATE brings all back. SK-4.62
#[test]
fn configuring_one_disturbs_the_others() {
    for honesty in [Honesty::default(), Honesty { clear_looks: 6, jitter: 20, keeps: 64, ..Honesty::default() }] {
        let mut net = Net::on(Some(but(Honesty { disturbs: true, ..honesty })), 3);
        net.stream(20);
        net.network.lose(2);
        net.until_state(0x18);
        net.stream(20);
        net.network.find(2);
        net.puppets.iter().for_each(Puppet::forget);
        let mark = net.host.mark();
        net.ask(Op, StateByte(8));
        net.host.cycles(100);
        assert_eq!((net.host.state().0, net.lost().is_empty()), (8, true));
        let told = events(&net, mark);
        let disturbed = |event: &&Event| matches!(event.kind, EventKind::SlaveDisturbed { slave: 1 | 3 });
        assert_eq!((told.iter().filter(disturbed).count(), told.len()), (2, 2), "{told:?}");
        for slave in [1, 2, 3] {
            assert!(!net.host.drive(slave).statusword.is_enabled(), "slave {slave} is off");
            assert_eq!(net.puppets[slave - 1].last().controlword.0, 0);
        }
        assert_eq!(net.puppets[1].controlwords(), [0], "and has been from the first outputs on");
        for slave in [1, 2, 3] {
            net.host.servo_on(slave);
        }
        net.puppets.iter().for_each(Puppet::forget);
        let from = net.targets;
        net.stream(50).settle();
        for slave in [1, 2, 3] {
            assert_eq!(*net.received(slave).last().unwrap(), from + 50);
        }
    }
}

/// SK-12.2 With all slaves lost and none in OP such a bus sends no outputs: entries do not wait in the FIFO until the
/// slaves are back. They count as cleared, their commands count as those for lost slaves (SK-4.61), and they start no
/// motor.
#[test]
fn entries_that_nobody_gets_are_cleared() {
    for honesty in [Honesty::default(), Honesty { clear_looks: 6, jitter: 20, keeps: 64, ..Honesty::default() }] {
        let mut net = Net::on(Some(but(Honesty { disturbs: true, ..honesty })), 2);
        net.network.lose(2);
        net.until_state(0x18);
        net.network.find(2);
        [1, 2].into_iter().for_each(|slave| net.network.refuse(slave, Some((AlState::Op, AlStatus(0x0011)))));
        net.host.master(MasterCommand::SetState(Op)).cycles(500);
        assert_eq!((net.host.state().0, net.lost()), (0x18, set(&[1, 2])));
        let before = net.host.counters();
        for _ in 0..300 {
            net.target();
            net.host.cycles(2);
        }
        for slave in [1, 2] {
            net.host.slave(slave, SlaveCommand::ServoOn);
        }
        net.host.cycles(300);
        let after = net.host.counters();
        assert_eq!((net.host.answer().fifo_free, after.full - before.full), (FIFO_ENTRIES, 0));
        assert_eq!((after.cleared - before.cleared, after.for_lost - before.for_lost), (302, 602));
        [1, 2].into_iter().for_each(|slave| net.network.refuse(slave, None));
        net.puppets.iter().for_each(Puppet::forget);
        net.ask(Op, StateByte(8)).host.cycles(200);
        for slave in [1, 2] {
            assert_eq!(net.puppets[slave - 1].controlwords(), [0], "slave {slave} stays off");
            net.host.servo_on(slave);
        }
    }
}

/// SK-4.62 SK-12.2 SET_FIFO 1 while slaves that were all lost return to OP, on a bus whose clear ends when they are
/// back: the newest sent outputs are from before the loss, and they switch no output of an IO slave on again.
#[test]
fn a_clear_brings_back_nothing_from_before_a_loss() {
    for wait in (410..560).step_by(10) {
        // Slave 1 leaves OP because slave 2 is configured, so that the bus sends no more outputs after those.
        let how = but(Honesty { clear_looks: 400, disturbs: true, ..Honesty::default() });
        let puppets = [Puppet::new(), Puppet::new()];
        let bus = SimBus::new(puppets.iter().map(Puppet::boxed).collect());
        let network = bus.handle();
        let mut host = host::on(Some(how), EngineConfig::default(), bus);
        host.go(Op).drained();
        let refuse = |refusal| [1, 2].into_iter().for_each(|slave| network.refuse(slave, refusal));
        let ask_for_op = |host: &mut Host, bits| {
            host.build(|frame, size| {
                frame.put_master(size, &MasterCommand::SetState(Op));
                frame.put_slave(size, 1, &SlaveCommand::IoWrite(bits).into());
            });
        };
        network.lose(2);
        host.until("the loss", |host| host.state().0 == 0x18);
        network.find(2);
        refuse(Some((AlState::Op, AlStatus(0x0011))));
        ask_for_op(&mut host, 0x101);
        host.cycles(500);
        assert_eq!((host.state().0, host.board.engine().lost()), (0x18, set(&[1, 2])));
        assert_eq!(puppets[0].last().outputs, 0x101);
        refuse(None);
        puppets[0].forget();
        ask_for_op(&mut host, 0x102);
        host.cycles(wait);
        assert_eq!(host.state().0, 0x18);
        host.master(MasterCommand::SetFifo(FifoAction::Clear)).until("OP", |host| host.state().0 == 8).cycles(500);
        assert!(puppets[0].strings().sent.len() > 300);
        assert!(puppets[0].strings().sent.iter().all(|out| out.outputs == 0), "clear after {wait} cycles");
        host.slave(1, SlaveCommand::IoWrite(0x77)).drained().cycles(20);
        assert_eq!(puppets[0].last().outputs, 0x77);
    }
}

/// SK-12.10 A bus may refuse an SDO during a change of state: it waits for the end of the change, and is answered then.
#[test]
fn an_sdo_waits_for_the_end_of_a_change() {
    let mut net = Net::new(Some(but(Honesty { refuses_sdo: true, ..Honesty::default() })), 3);
    net.puppets[0].strings().objects.insert((0x2000, 0), (4, 77));
    net.host.go(SafeOp);
    net.network.silence(2, true);
    net.host.master(MasterCommand::SetState(Op)).cycles(50);
    net.host.sdo(SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x2000, 0) }).cycles(3000);
    assert_eq!((net.host.state().0, net.host.sdo_answer()), (4, SdoResponse::Empty));
    net.network.silence(2, false);
    net.host.until("OP", |host| host.state().0 == 8).cycles(50);
    assert!(matches!(net.host.sdo_answer(), SdoResponse::Done { value: 77, .. }), "{:?}", net.host.sdo_answer());
    net.host.go(PreOp);
}

/// A bus whose chip has its own inputs and outputs.
struct WithPins<B> {
    bus: B,
    inputs: Arc<AtomicU8>,
    outputs: Arc<AtomicU8>,
}

impl<B: Fieldbus> Fieldbus for WithPins<B> {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push, poll);

    fn local_inputs(&self) -> Option<u8> {
        Some(self.inputs.load(Relaxed))
    }

    fn set_local_outputs(&mut self, bits: u8) {
        assert_ne!(self.outputs.swap(bits, Relaxed), bits, "it is told changes");
    }
}

/// SK-12.8 LIO_RD returns the inputs of the bus's chip and LIO_WR sets its outputs, in every state; SW_RESET switches
/// them off.
#[test]
fn local_io_is_that_of_the_bus() {
    for how in buses() {
        let (inputs, outputs) = (Arc::new(AtomicU8::new(0)), Arc::new(AtomicU8::new(0)));
        let pins = WithPins {
            bus: SimBus::new(vec![Puppet::obedient().boxed()]),
            inputs: Arc::clone(&inputs),
            outputs: Arc::clone(&outputs),
        };
        let mut host = host::on(how, EngineConfig::default(), pins);
        host.declare_drives(1);
        for (n, state) in [PreOp, SafeOp, Op].into_iter().enumerate() {
            host.go(state);
            let bits = 0x15 + n as u8;
            inputs.store(bits, Relaxed);
            host.master(MasterCommand::LocalWrite(bits ^ 0x3F)).cycles(30);
            host.master(MasterCommand::LocalRead).cycles(30);
            assert_eq!((host.answer().result, outputs.load(Relaxed)), (bits.into(), bits ^ 0x3F), "{how:?} {state}");
        }
        host.soft_reset();
        assert_eq!(outputs.load(Relaxed), 0, "{how:?}");
    }
}

/// A bus that requests every cycle to be later by that time than planned.
struct Nudging(SimBus, i64);

impl Fieldbus for Nudging {
    hand_on!(0: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push);

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let done = self.0.poll(now, inputs)?;
        Some(CycleDone { next_deadline: (now + 1_000_000).checked_add_signed(self.1), ..done })
    }
}

/// SK-12.9 A bus with distributed clocks nudges the next cycle, by half a period at most.
#[test]
fn a_bus_nudges_the_next_cycle() {
    for (wish, period) in
        [(0, 1_000_000), (-700, 999_300), (12_000, 1_012_000), (900_000, 1_500_000), (-900_000, 500_000)]
    {
        let bus = Nudging(SimBus::new(vec![Puppet::obedient().boxed()]), wish);
        let mut board = Board::new(EngineConfig::default(), Box::new(bus));
        assert!(board.boot(60_000_000_000));
        for _ in 0..5 {
            let at = board.next_cycle();
            board.cycle(&mut |_, _| {});
            assert_eq!(board.next_cycle() - at, period, "{wish}");
        }
    }
}

/// SK-12.2 A clear that takes a while: cycles go on sending meanwhile, and those outputs count as executed. The rest
/// counts as cleared, and the axis stays at the newest sent target. Frames that come meanwhile are executed after the
/// clear, once and in order. SK-5.22
#[test]
fn a_clear_takes_a_while() {
    for clear_looks in [0, 1, 2, 3, 8, 20] {
        for jitter in [0, 20] {
            let how = but(Honesty { clear_looks, jitter, keeps: 64, stale_looks: 2, ..Honesty::default() });
            let mut net = Net::on(Some(how), 1);
            let before = net.host.counters();
            (0..100).for_each(|_| net.target());
            net.host.cycles(20);
            let clear = MasterCommand::SetFifo(FifoAction::Clear);
            let mut frame = Frame::new();
            frame.put_master(net.host.size, &clear);
            net.host.arrive(&frame).cycle();
            let last = *net.received(1).last().unwrap();
            for k in 1..=5 {
                let mut frame = Frame::new();
                frame.put_slave(net.host.size, 1, &SlaveCommand::Csp(Motion::to(1000 + k)).into());
                net.host.arrive(&frame).cycle();
            }
            net.host.cycles(60 + jitter);
            let after = net.host.counters();
            let received = net.received(1);
            let reached = *received.iter().filter(|target| **target < 1000).max().unwrap();
            let what = format!("{how:?}");
            assert!((0..=clear_looks as i32 / 2 + 1).contains(&(reached - last)), "{what}: {last}, {reached}");
            assert_eq!(received, (0..=reached).chain(1001..=1005).collect::<Vec<_>>(), "{what}");
            let counted = (after.executed - before.executed, after.cleared - before.cleared);
            assert_eq!(counted, (reached as u64 + 6, 100 - reached as u64), "{what}");
            assert_eq!(net.host.answer().fifo_free, FIFO_ENTRIES, "{what}");
        }
    }
}
