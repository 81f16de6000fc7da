//! SDO transfers while the network changes its state.

use MasterState::{Op, SafeOp};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::Job;
use ecmsk::sk::{MasterCommand, MasterState, SdoCommand, SdoResponse};

use crate::network_rig::set;
use crate::probe::{Bench, any_slaves};
use crate::watch::Started;

/// A board in SafeOP on the way to OP, which waits for slave 2.
fn waiting() -> Bench {
    let mut bench = Bench::new(EngineConfig::default(), any_slaves(3));
    bench.host.declare_drives(3).go(SafeOp);
    bench.network.silence(2, true);
    bench.host.master(MasterCommand::SetState(Op)).cycles(50);
    assert!(matches!(bench.jobs.under_way(), Some(Started::Job(Job::State { .. }))));
    bench
}

/// SK-6.15 A change that waits for a silent slave does not hold up an SDO: a healthy slave answers as usual, the silent
/// one and an absent one end in abort 0x05040000 within their time (SK-6.7), and the change goes on.
#[test]
fn beside_a_change_that_waits() {
    let Bench { mut host, network, .. } = waiting();
    for _ in 0..2 {
        let asked = host.board.now();
        assert_eq!(host.read_object(1, 0x1018, 0), Ok(0x1018));
        assert_eq!(host.write_object(3, 0x6065, 0, SdoSize::Four, 7), Ok(7));
        assert!(host.board.now() - asked < 50_000_000, "as ever");
        let asked = host.board.now();
        assert_eq!(host.read_object(2, 0x1000, 0), Err(AbortCode::TIMEOUT));
        assert_eq!(host.read_object(17, 0x1000, 0), Err(AbortCode::TIMEOUT));
        assert!(host.board.now() - asked < 1_050_000_000, "one second");
    }
    assert_eq!(host.state().0, 4);
    network.silence(2, false);
    host.until("OP", |host| host.state().0 == 8);
}

/// SK-6.8 SK-6.15 A transfer to a lost slave ends so, too, at once, while the change waits for the slave.
#[test]
fn beside_a_change_that_waits_for_a_lost_slave() {
    let mut bench = Bench::new(EngineConfig::default(), any_slaves(3));
    bench.host.op(3);
    bench.network.silence(2, true);
    bench.host.until("the loss", |host| host.board.engine().lost() == set(&[2]));
    bench.host.master(MasterCommand::SetState(Op)).cycles(50);
    let asked = bench.host.board.now();
    assert_eq!(bench.host.read_object(2, 0x1000, 0), Err(AbortCode::TIMEOUT));
    assert_eq!(bench.host.read_object(1, 0x1018, 0), Ok(0x1018));
    assert!(bench.host.board.now() - asked < 50_000_000);
}

/// SK-6.1 SK-6.15 Slaves are configured while no transfer is under way, and none begins then.
#[test]
fn not_beside_the_mapping() {
    let Bench { mut host, jobs, network } = Bench::new(EngineConfig::default(), any_slaves(3));
    host.declare_drives(3);
    network.delay_sdo(1, 100_000_000);
    let read = |sub| SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1018, sub) };
    host.sdo(read(1)).cycles(5).master(MasterCommand::SetState(Op)).cycles(60);
    assert!(matches!(jobs.under_way(), Some(Started::Sdo(_))));
    host.until("the mapping", |_| matches!(jobs.under_way(), Some(Started::Job(Job::Configure(_)))));
    network.delay_sdo(1, 0);
    host.sdo(read(2)).cycles(5);
    assert!(matches!(jobs.under_way(), Some(Started::Job(Job::Configure(_)))));
    let answered = |host: &crate::host::Host| match host.sdo_answer() {
        SdoResponse::Done { object, .. } => object.sub,
        other => panic!("{other:?}"),
    };
    assert_eq!(answered(&host), 1);
    host.until("the second answer", |host| answered(host) == 2);
    assert_eq!(host.state().0, 2, "it did not wait for SafeOP");
    host.until("OP", |host| host.state().0 == 8);
}

/// SK-4.33 SW_RESET ends both.
#[test]
fn sw_reset_ends_both() {
    let Bench { mut host, network, .. } = waiting();
    network.delay_sdo(1, 500_000_000);
    host.sdo(SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1018, 0) }).cycles(5);
    network.silence(2, false);
    host.soft_reset().cycles(2000);
    assert_eq!((host.sdo_answer(), host.state().0), (SdoResponse::Empty, 2));
}
