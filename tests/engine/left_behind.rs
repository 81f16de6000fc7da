//! A change to a lower state that a slave refuses: the others have left the state that the board shows.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::coe::{AbortCode, SdoSize};
use ecmsk::engine::{EngineConfig, Event, EventKind, StateFailure};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AlState, Busy, Fieldbus, Job, JobDone, Ns};
use ecmsk::sk::{MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind, StateByte};
use ecmsk::slave::{AlStatus, Io, Slave};

use crate::host::Host;
use crate::network_rig::{Net, buses, set, two_buses};
use crate::probe::drives;
use support::ahead_bus::{Ahead, AheadBus, Honesty};
use support::hand_on;

const REFUSAL: AlStatus = AlStatus(0x0011);

/// Slave 2 refuses the way down, whatever state is asked for.
fn refuse(net: &Net, to: MasterState) {
    let state = match to {
        Init => AlState::Init,
        PreOp => AlState::PreOp,
        _ => AlState::SafeOp,
    };
    net.network.refuse(2, Some((state, REFUSAL)));
}

/// SK-4.55 SK-4.73 Slave 2 refuses: the state is 0x10 | 8, and slave 1, which has left OP, is lost. Its slot keeps its
/// values and takes no command (SK-4.61), each of them is counted (SK-4.44), and slave 2 goes on.
#[test]
fn who_has_left_op_is_lost() {
    for how in buses() {
        for to in [SafeOp, PreOp, Init] {
            let mut net = Net::on(how, 2);
            net.stream(20).settle();
            refuse(&net, to);
            net.ask(to, StateByte(0x18)).host.cycles(30);
            let what = format!("{how:?} {to}");
            assert_eq!((net.host.state().0, net.lost()), (0x18, set(&[1])), "{what}");
            let (kept, before) = (net.host.slot(1), net.host.counters());
            net.stream(10).settle();
            net.host.slave(1, SlaveCommand::ServoOn).drained();
            let counters = net.host.counters();
            assert_eq!((net.host.slot(1), counters.for_lost - before.for_lost), (kept, 11), "{what}");
            assert_eq!(net.host.drive(2).position, net.targets, "{what}: slave 2 goes on");
            assert_eq!(counters.rejected_total(), before.rejected_total(), "{what}");
        }
    }
}

/// SK-4.55 The same in SafeOP.
#[test]
fn who_has_left_safeop_is_lost() {
    for how in two_buses() {
        for to in [PreOp, Init] {
            let mut net = Net::new(how, 2);
            net.host.go(SafeOp).cycles(30);
            refuse(&net, to);
            net.ask(to, StateByte(0x14)).host.cycles(30);
            assert_eq!(net.lost(), set(&[1]), "{how:?} {to}");
            net.ask(Op, StateByte(8)).host.drained().servo_on(1).servo_on(2);
        }
    }
}

/// SK-2.17 SK-2.18 SK-4.73 SET_STATE 8 acknowledges: slave 1 is configured again, from Init, too, comes back, and no
/// old command starts it.
#[test]
fn it_comes_back() {
    for how in buses() {
        for to in [SafeOp, PreOp, Init] {
            let mut net = Net::on(how, 2);
            net.stream(20).settle();
            refuse(&net, to);
            net.ask(to, StateByte(0x18)).host.cycles(30);
            let configured = net.puppets[0].strings().roles.len();
            net.puppets[0].forget();
            net.ask(Op, StateByte(8)).host.cycles(30);
            assert!(net.lost().is_empty(), "{how:?} {to}");
            assert_eq!(net.puppets[0].strings().roles.len(), configured + 1, "{how:?} {to}");
            assert!(net.puppets[0].controlwords().iter().all(|word| *word == 0), "{how:?} {to}");
            net.host.servo_on(1);
            net.stream(5).settle();
            assert_eq!([1, 2].map(|slave| net.host.drive(slave).position), [net.targets; 2], "{how:?} {to}");
        }
    }
}

/// SK-4.73 SK-12.5 The same when SET_STATE comes at once, before the answers of a late bus show which slaves have left:
/// the board waits for these answers, in OP and in SafeOP.
#[test]
fn it_comes_back_at_once() {
    let late =
        Ahead { honesty: Honesty { seed: 1, keeps: 64, jitter: 20, ..Honesty::default() }, ..Ahead::kind(16, 5, 0, 0) };
    for how in buses().chain([Some(late)]) {
        for (from, to) in [(Op, SafeOp), (Op, PreOp), (SafeOp, PreOp)] {
            let mut net = if from == Op { Net::on(how, 2) } else { Net::new(how, 2) };
            net.host.go(from);
            refuse(&net, to);
            let configured = net.puppets[0].strings().roles.len();
            let mark = net.host.mark();
            net.host.master(MasterCommand::SetState(to));
            net.host.until("the failure", |host| host.board.engine().state().is_failed());
            net.host.master(MasterCommand::SetState(Op));
            net.host.until("OP", |host| host.board.engine().state() == StateByte(8)).cycles(100);
            let what = format!("{how:?} {from} {to}");
            let told: Vec<_> = net.host.board.engine().events_since(mark).collect();
            assert!(
                told.iter().any(|event| matches!(event.kind, EventKind::SlaveLeft { slave: 1 })),
                "{what}: {told:?}"
            );
            assert_eq!(net.puppets[0].strings().roles.len(), configured + 1, "{what}");
            assert!(!net.host.drive(1).statusword.is_enabled(), "{what}");
        }
    }
}

/// SK-4.73 The same with the simulated drives, which forget their process data in Init.
#[test]
fn simulated_drives() {
    for to in [SafeOp, PreOp, Init] {
        let bus = SimBus::new(drives(2));
        let network = bus.handle();
        let mut host = Host::new(EngineConfig::default(), bus);
        host.op(2).servo_on(1).servo_on(2);
        let refused = if to == Init { AlState::Init } else { AlState::PreOp };
        network.refuse(2, Some((if to == SafeOp { AlState::SafeOp } else { refused }, REFUSAL)));
        host.master(MasterCommand::SetState(to)).until("the failure", |host| host.state().0 == 0x18).cycles(300);
        host.master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8).drained();
        assert!(host.drive(2).statusword.is_enabled(), "{to}: it stayed");
        assert!(!host.drive(1).statusword.is_enabled(), "{to}: it is off");
        host.servo_on(1).slave(1, SlaveCommand::Csp(Motion::to(20))).cycles(200);
        assert!((18..=22).contains(&host.drive(1).position), "{to}");
        assert_eq!(host.read_object(1, 0x6061, 0), Ok(8));
    }
}

/// SK-4.73 SK-4.62 An IO slave comes back with its outputs off until new ones are sent. SK-3.14 Its slot shows that.
#[test]
fn outputs_are_off() {
    for (how, to) in two_buses().flat_map(|how| [(how, PreOp), (how, Init)]) {
        let what = format!("{how:?} {to}");
        let bus = SimBus::new(vec![Box::<Io>::default() as Box<dyn Slave>, Box::<Io>::default()]);
        let network = bus.handle();
        let mut host = match how {
            None => Host::new(EngineConfig::default(), bus),
            Some(how) => Host::new(EngineConfig::default(), AheadBus::new(bus, how)),
        };
        host.go(Op).drained();
        network.refuse(2, Some((if to == Init { AlState::Init } else { AlState::PreOp }, REFUSAL)));
        host.build(|frame, size| {
            frame.put_master(size, &MasterCommand::SetState(to));
            [1, 2].into_iter().for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::IoWrite(0xF0F0).into()));
        });
        host.until("the failure", |host| host.state().0 == 0x18).cycles(20);
        assert_eq!([1, 2].map(|slave| host.slot(slave).data1), [0xF0F0; 2], "{what}: lost slots keep their values");
        host.master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8).cycles(20);
        assert_eq!((host.slot(1).id, host.slot(1).data1), (0x14, 0), "{what}: what is output");
        for slave in [1, 2] {
            host.slave(slave, SlaveCommand::IoRead).cycles(6);
        }
        assert_eq!([1, 2].map(|slave| host.slot(slave).data1), [0, 0xF0F0], "{what}: what the terminals have");
    }
}

/// A bus that reports the end of a change of state later than its slaves.
struct Slow {
    bus: SimBus,
    ended: Option<(JobDone, Ns)>,
}

impl Fieldbus for Slow {
    hand_on!(bus: pacing, start_sdo, poll_sdo, cancel_sdo, room, clear_ahead, poll_clear, push, poll);

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        if self.ended.is_some() { Err(Busy) } else { self.bus.start(job, now) }
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.ended = self.ended.or_else(|| self.bus.poll_job(now).map(|done| (done, now + 50_000_000)));
        self.ended.take_if(|(_, at)| now >= *at).map(|(done, _)| done)
    }

    fn cancel_job(&mut self) {
        self.ended = None;
        self.bus.cancel_job();
    }
}

/// SK-4.73 SK-4.50 Slaves that go down one after another are not left behind by a change that is under way.
#[test]
fn a_change_under_way_leaves_nobody_behind() {
    let mut host = Host::new(EngineConfig::default(), Slow { bus: SimBus::new(drives(3)), ended: None });
    host.op(3);
    for (from, to) in [(Op, SafeOp), (Op, PreOp), (SafeOp, PreOp), (SafeOp, Init)] {
        host.go(from).cycles(30);
        let mark = host.mark();
        host.master(MasterCommand::SetState(to));
        host.until("the state", |host| host.state().0 & 0x10 != 0 || host.state() == StateByte::reached(to));
        assert_eq!((host.state(), host.mark()), (StateByte::reached(to), mark), "{from} to {to}");
        if to == Init {
            host.go(PreOp);
        }
    }
}

/// SK-4.39 The loss is logged, with what to do. SK-6.8 The slave's mailbox is not used.
#[test]
fn it_is_logged() {
    let mut net = Net::on(None, 3);
    refuse(&net, PreOp);
    let mark = net.host.mark();
    net.ask(PreOp, StateByte(0x18)).host.cycles(30);
    let events: Vec<Event> = net.host.board.engine().events_since(mark).collect();
    let [Event { kind: EventKind::StateFailed { why }, .. }, left @ ..] = &events[..] else { panic!("{events:?}") };
    assert!(matches!(why, StateFailure::Refused { slave: 2, target: PreOp, .. }), "{events:?}");
    let kinds: Vec<EventKind> = left.iter().map(|event| event.kind).collect();
    assert_eq!(kinds, [1, 3].map(|slave| EventKind::SlaveLeft { slave }));
    assert!(left[0].to_string().contains("SET_STATE"), "{}", left[0]);
    assert_eq!(net.host.write_object(1, 0x6060, 0, SdoSize::One, 8), Err(AbortCode::TIMEOUT));
}

/// SK-4.64 A way down that is replaced by OP in the middle leaves no slave behind. SK-4.57 A slave declared as none is
/// not lost, either.
#[test]
fn nobody_is_left_behind_without_a_failure() {
    for how in two_buses() {
        let mut net = Net::new(how, 3);
        let mut kinds = [SlaveKind::Drive; 8];
        kinds[2] = SlaveKind::None;
        net.host.master(MasterCommand::SetAxis { group: 0, kinds }).go(Op).drained();
        for cycles in [1, 5, 15, 20, 22, 25, 40] {
            let mark = net.host.mark();
            net.host.master(MasterCommand::SetState(PreOp)).cycles(cycles);
            net.host.master(MasterCommand::SetState(Op)).cycles(800);
            assert_eq!((net.host.state().0, net.host.mark()), (8, mark), "{how:?} {cycles}");
        }
    }
}
