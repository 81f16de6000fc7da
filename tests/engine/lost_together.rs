//! Several lost slaves: those that can come back do so without those that cannot.

use MasterState::{Op, PreOp, SafeOp};
use ecmsk::fieldbus::AlState;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{MasterCommand, MasterState, SlaveCommand};
use ecmsk::slave::AlStatus;

use crate::host::Host;
use crate::network_rig::{Net, set, two_buses};
use crate::probe::drives;

const REFUSAL: AlStatus = AlStatus(0x0011);

/// SK-4.62 SK-4.74 Dead slaves do not hold up the others. The board waits for them while the change has time; then it
/// has failed (SK-4.55), and the next SET_STATE brings them back.
#[test]
fn dead_slaves_keep_nobody_back() {
    for how in two_buses() {
        for dead in [&[1][..], &[2], &[4], &[1, 3], &[1, 2, 4]] {
            let what = format!("{how:?} {dead:?}");
            let mut net = Net::on(how, 5);
            [1, 2, 3, 4].into_iter().for_each(|slave| net.network.lose(slave));
            net.host.until("the losses", |host| host.board.engine().lost() == set(&[1, 2, 3, 4]));
            let back = |slave: &u8| !dead.contains(slave);
            [1, 2, 3, 4].into_iter().filter(back).for_each(|slave| net.network.find(slave));
            let asked = net.host.board.now();
            net.host.master(MasterCommand::SetState(Op));
            net.host.until("those that can", |host| host.board.engine().lost() == set(dead));
            assert!(net.host.board.now() - asked < 5_000_000_000, "{what}");
            net.host.cycles(30);
            for slave in [1, 2, 3, 4].into_iter().filter(back) {
                net.host.servo_on(slave.into());
            }
            net.stream(10).settle();
            for slave in [1, 2, 3, 4, 5].into_iter().filter(back) {
                assert_eq!(net.host.drive(slave.into()).position, net.targets, "{what}: slave {slave}");
            }
            net.host.cycles(10_000);
            assert_eq!((net.host.state().0, net.lost()), (0x18, set(dead)), "{what}");
            let jobs = net.jobs.len();
            dead.iter().for_each(|slave| net.network.find(*slave));
            net.host.cycles(500);
            assert_eq!((net.jobs.len(), net.lost()), (jobs, set(dead)), "{what}: nobody tries again");
            net.host.go(Op);
        }
    }
}

/// SK-4.74 A slave that answers a little later comes back with the same SET_STATE.
#[test]
fn a_late_one_comes_back_too() {
    for how in two_buses() {
        for late in [1, 2] {
            let mut net = Net::on(how, 3);
            [1, 2].into_iter().for_each(|slave| net.network.lose(slave));
            net.host.until("the losses", |host| host.board.engine().lost() == set(&[1, 2]));
            net.network.find(3 - late);
            net.host.master(MasterCommand::SetState(Op)).cycles(4000);
            assert_eq!(net.lost(), set(&[late]), "{how:?}");
            net.network.find(late);
            net.until_state(8);
        }
    }
}

/// SK-4.74 SK-4.55 A slave that refuses, in any step, holds up no other one and is not asked again.
#[test]
fn who_refuses_keeps_nobody_back() {
    for how in two_buses() {
        for (slave, refused) in [(1, AlState::PreOp), (2, AlState::SafeOp), (3, AlState::Op), (1, AlState::Op)] {
            let mut net = Net::on(how, 3);
            [1, 2, 3].into_iter().for_each(|slave| net.network.lose(slave));
            net.host.until("the losses", |host| host.board.engine().lost() == set(&[1, 2, 3]));
            [1, 2, 3].into_iter().for_each(|slave| net.network.find(slave));
            net.network.refuse(slave, Some((refused, REFUSAL)));
            net.host.master(MasterCommand::SetState(Op)).cycles(3000);
            assert_eq!((net.host.state().0, net.lost()), (0x18, set(&[slave])), "{how:?} {slave} {refused:?}");
            let jobs = net.jobs.len();
            net.network.refuse(slave, None);
            net.host.cycles(500);
            assert_eq!(net.jobs.len(), jobs, "{how:?}: nobody tries again");
            net.host.go(Op);
        }
    }
}

/// SK-4.74 The same below OP: in SafeOP, and on the way down to a lower state.
#[test]
fn below_op() {
    for how in two_buses() {
        for (asked, shown) in [(SafeOp, 0x14), (PreOp, 0x12)] {
            let mut net = Net::on(how, 3);
            [1, 2].into_iter().for_each(|slave| net.network.lose(slave));
            net.host.until("the losses", |host| host.board.engine().lost() == set(&[1, 2]));
            net.network.find(2);
            net.host.master(MasterCommand::SetState(asked)).cycles(4000);
            assert_eq!((net.host.state().0, net.lost()), (shown, set(&[1])), "{how:?} {asked}");
            net.network.find(1);
            net.host.go(asked).go(Op).drained().servo_on(1).servo_on(2).servo_on(3);
        }
    }
}

/// SK-4.55 SK-4.74 A slave that refuses ends a change to a higher state: the others do not go up without it.
#[test]
fn nobody_goes_up_without_who_refuses() {
    for how in two_buses() {
        let mut net = Net::new(how, 3);
        net.host.go(SafeOp).cycles(30);
        [1, 2].into_iter().for_each(|slave| net.network.lose(slave));
        net.host.until("the losses", |host| host.board.engine().lost() == set(&[1, 2]));
        [1, 2].into_iter().for_each(|slave| net.network.find(slave));
        net.network.refuse(1, Some((AlState::SafeOp, REFUSAL)));
        net.host.master(MasterCommand::SetState(Op)).cycles(3000);
        assert_eq!((net.host.state().0, net.lost()), (0x14, set(&[1])), "{how:?}");
        net.network.refuse(1, None);
        net.host.go(Op).drained().servo_on(1).servo_on(2).servo_on(3);
    }
}

/// SK-4.74 Forty drives, the cable cut behind the fifth and healed, and seven of them dead.
#[test]
fn many_at_once() {
    let bus = SimBus::new(drives(40));
    let network = bus.handle();
    let mut host = Host::new(Default::default(), bus);
    host.op(40);
    let dead = [6, 13, 14, 15, 22, 39, 40];
    network.cut_after(5);
    host.cycles(200);
    dead.into_iter().for_each(|slave| network.lose(slave));
    network.heal();
    host.master(MasterCommand::SetState(Op));
    host.until("those that can", |host| host.board.engine().lost() == set(&dead));
    assert_eq!(host.state().0, 0x18);
    host.build(|frame, size| {
        (1..=40).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::ServoOn.into()));
    });
    let alive = |slave: &usize| !dead.contains(&(*slave as u8));
    host.until("all on", |host| (1..=40).filter(alive).all(|slave| host.drive(slave).statusword.is_enabled()));
}
