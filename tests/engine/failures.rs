//! Changes of state that fail, and slaves of another kind than declared.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::{AlState, Ns, Role, SlaveSet};
use ecmsk::sk::{MasterCommand, MasterState, SdoCommand, SdoResponse, SlaveCommand, SlaveKind, StateByte};
use ecmsk::slave::{AlStatus, Drive, DriveConfig, Slave};

use crate::probe::{Bench, any_slaves, drives};

const REFUSAL: AlStatus = AlStatus(0x0011);

fn board(n: usize) -> Bench {
    let mut bench = Bench::new(EngineConfig::default(), drives(n));
    bench.host.declare_drives(n);
    bench
}

/// SK-4.55 A slave that refuses ends the change at 0x10 | the last state that all reached, and is not retried. SK-2.9
/// SK-2.17
#[test]
fn a_refused_state() {
    let ways = [
        (Init, PreOp, AlState::PreOp, 1),
        (PreOp, Op, AlState::SafeOp, 2),
        (PreOp, Op, AlState::Op, 4),
        (SafeOp, Op, AlState::Op, 4),
    ];
    for (from, target, refused, good) in ways {
        for slave in [1, 3] {
            let Bench { mut host, network, jobs } = board(3);
            host.go(from);
            network.refuse(slave, Some((refused, REFUSAL)));
            host.master(MasterCommand::SetState(target));
            host.until("the failure", |host| host.state().0 & 0x10 != 0);
            assert_eq!(host.state().0, 0x10 | good, "{from} to {target}, slave {slave}");
            network.refuse(slave, None);
            let jobs_so_far = jobs.len();
            host.cycles(15_000);
            assert_eq!((host.state().0, jobs.len()), (0x10 | good, jobs_so_far), "{from} to {target}: a retry");

            // The failure is acknowledged in the present state.
            let state = MasterState::from_request(good.into()).unwrap();
            host.go(state).cycles(20);
            assert_eq!(host.state().0, good);
            assert_eq!(jobs.moves().last().unwrap().0 as u8, good, "{from} to {target}");
        }
    }
}

/// SK-4.82 A SET_STATE that comes in the cycle in which a change fails, or a cycle sooner or later, is carried out.
#[test]
fn set_state_in_the_cycle_of_a_failure() {
    let failing = |network: &ecmsk::fieldbus::sim::SimHandle| network.refuse(2, Some((AlState::SafeOp, REFUSAL)));
    let fails_after = {
        let Bench { mut host, network, .. } = board(3);
        failing(&network);
        host.master(MasterCommand::SetState(SafeOp));
        let mut cycles = 0;
        host.until("the failure", |host| {
            cycles += 1;
            host.state().0 == 0x12
        });
        cycles
    };
    for target in [PreOp, Init, SafeOp] {
        for sooner_or_later in -3..=3 {
            let Bench { mut host, network, .. } = board(3);
            failing(&network);
            host.master(MasterCommand::SetState(SafeOp)).cycles((fails_after + sooner_or_later) as usize);
            network.refuse(2, None);
            let mark = host.mark();
            host.master(MasterCommand::SetState(target));
            host.cycles(3000);
            let failed = host.board.engine().events_since(mark).count();
            // A SET_STATE that repeats the target of a change is part of it, and fails with it.
            if target != SafeOp || sooner_or_later >= 0 {
                assert_eq!(host.state(), StateByte::reached(target), "{target} {sooner_or_later}: {failed} events");
            }
        }
    }
}

/// SK-4.55 The next SET_STATE tries again: up, without an acknowledgement before, though some slaves went further than
/// others; and a state that all slaves reach on the way is no failure any more.
#[test]
fn the_next_set_state_tries_again() {
    for (refused, good) in [(AlState::SafeOp, 0x12), (AlState::Op, 0x14)] {
        for slave in [1, 2, 3] {
            let Bench { mut host, network, .. } = board(3);
            network.refuse(slave, Some((refused, REFUSAL)));
            host.master(MasterCommand::SetState(Op)).until("the failure", |host| host.state().0 == good);
            // The slave still refuses: the same end.
            host.master(MasterCommand::SetState(Op)).cycles(1000);
            assert_eq!(host.state().0, good, "slave {slave}");

            network.refuse(slave, None);
            host.master(MasterCommand::SetState(Op));
            let mut seen = vec![good];
            host.until("OP", |host| {
                if *seen.last().unwrap() != host.state().0 {
                    seen.push(host.state().0);
                }
                host.state().0 == 8
            });
            let clean: &[u8] = if good == 0x12 { &[0x12, 2, 4, 8] } else { &[0x14, 4, 8] };
            assert_eq!(seen, clean, "slave {slave}");
            host.drained().servo_on(1).servo_on(2).servo_on(3);
        }
    }
}

/// SK-4.55 A lower state ends a failure too.
#[test]
fn a_failure_ends_with_a_lower_state() {
    let Bench { mut host, network, .. } = board(2);
    network.refuse(2, Some((AlState::Op, REFUSAL)));
    host.master(MasterCommand::SetState(Op)).until("the failure", |host| host.state().0 == 0x14);
    host.go(PreOp);
    network.refuse(2, None);
    host.go(Op);
}

/// SK-4.55 A change has 10 s, or the configured time.
#[test]
fn a_change_has_its_time() {
    let default = EngineConfig::default().state_timeout_ns;
    assert_eq!(default, 10_000_000_000);
    for state_timeout_ns in [default, 2_000_000_000, 500_000_000] {
        let config = EngineConfig { state_timeout_ns, ..EngineConfig::default() };
        let Bench { mut host, network, .. } = Bench::new(config, drives(2));
        host.declare_drives(2).go(SafeOp).cycle();
        network.silence(2, true);
        let asked = host.board.now();
        host.master(MasterCommand::SetState(Op)).until("the failure", |host| host.state().0 & 0x10 != 0);
        let took = host.board.now() - asked;
        assert_eq!(host.state().0, 0x14);
        let late: Ns = 5_000_000;
        assert!((state_timeout_ns..state_timeout_ns + late).contains(&took), "{took} ns");
        network.silence(2, false);
        host.go(SafeOp).go(Op);
    }
}

/// SK-4.55 The time runs while an SDO transfer of the host keeps the network busy, too.
#[test]
fn a_change_that_waits_has_its_time() {
    let config =
        EngineConfig { state_timeout_ns: 500_000_000, sdo_timeout_ns: 5_000_000_000, ..EngineConfig::default() };
    let Bench { mut host, network, .. } = Bench::new(config, drives(2));
    network.silence(2, true);
    host.declare_drives(2).sdo(SdoCommand::Read { slave: 2, object: ObjectAddress::new(0x1000, 0) }).cycles(5);
    let asked = host.board.now();
    host.master(MasterCommand::SetState(Op)).until("the failure", |host| host.state().0 & 0x10 != 0);
    assert_eq!((host.state().0, host.board.now() - asked < 510_000_000), (0x12, true));
    // The transfer goes on to its own end.
    host.until("the end of the SDO", |host| host.sdo_answer() != SdoResponse::Empty);
    assert!(matches!(host.sdo_answer(), SdoResponse::Aborted { slave: 2, code: AbortCode::TIMEOUT, .. }));
    assert_eq!(host.state().0, 0x12);
    network.silence(2, false);
    host.go(Op);
}

/// SK-4.55 The time may be without limit.
#[test]
fn a_change_may_take_for_ever() {
    let config = EngineConfig { state_timeout_ns: Ns::MAX, ..EngineConfig::default() };
    let Bench { mut host, network, .. } = Bench::new(config, drives(1));
    host.declare_drives(1).go(SafeOp);
    network.silence(1, true);
    host.master(MasterCommand::SetState(Op)).cycles(20_000);
    assert_eq!(host.state(), StateByte::reached(SafeOp));
}

/// SK-4.58 A drive declared IO does not have an IO slave's objects: PreOP to SafeOP fails.
#[test]
fn a_drive_declared_io() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(2));
    // Nothing declared: the default is IO.
    host.master(MasterCommand::SetState(Op)).until("the failure", |host| host.state().0 & 0x10 != 0);
    assert_eq!(host.state().0, 0x12);
    let mut kinds = [SlaveKind::Drive; 8];
    kinds[1] = SlaveKind::Io;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    host.master(MasterCommand::SetState(SafeOp)).cycles(1000);
    assert_eq!(host.state().0, 0x12);
    host.declare_drives(2).go(Op);
}

/// SK-4.58 A stepper declared as a drive has its objects in CSP, and goes; in CSV it does not.
#[test]
fn a_stepper_declared_as_a_drive() {
    let stepper = || vec![Box::new(Drive::new(DriveConfig::stepper())) as Box<dyn Slave>];
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), stepper());
    host.op(1).servo_on(1).csp(1, 100).cycles(300);
    assert_eq!(host.drive(1).position, 100);
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), stepper());
    host.declare_drives(1).slave(1, SlaveCommand::DriveMode { mode: Mode::Csv, sync: Default::default() });
    host.master(MasterCommand::SetState(Op)).until("the failure", |host| host.state().0 == 0x12);
}

/// SK-4.56 Slots without a slave are no error, whatever their nibble.
#[test]
fn slots_without_a_slave() {
    for kind in [SlaveKind::Io, SlaveKind::Drive, SlaveKind::Hsp, SlaveKind::Step, SlaveKind::None] {
        let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(1));
        for group in 0..=4 {
            host.master(MasterCommand::SetAxis { group, kinds: [kind; 8] });
        }
        let mut kinds = [kind; 8];
        kinds[0] = SlaveKind::Drive;
        host.master(MasterCommand::SetAxis { group: 0, kinds }).go(Op).drained().servo_on(1);
        assert_eq!(host.counters().rejected_total(), 0, "{kind:?}");
    }
}

/// SK-4.57 A found slave with nibble F stays in PreOP, and the board does not wait for it; the slave count includes it.
#[test]
fn a_slave_declared_none_stays_in_preop() {
    let Bench { mut host, network, jobs } = Bench::new(EngineConfig::default(), any_slaves(3));
    network.refuse(2, Some((AlState::SafeOp, REFUSAL)));
    let mut kinds = [SlaveKind::Drive; 8];
    kinds[1] = SlaveKind::None;
    host.master(MasterCommand::SetAxis { group: 0, kinds }).cycle();
    assert_eq!(host.answer().result, 3);
    host.go(Op).cycles(20);
    assert_eq!(jobs.configured().slaves[1].role, Role::Unused);
    assert_eq!(jobs.configured().slaves[2].role, Role::Drive(Mode::Csp));
    let mut used = SlaveSet::first(3);
    used.remove(2);
    let above = |moves: Vec<(AlState, SlaveSet)>| moves.into_iter().filter(|(state, _)| *state > AlState::PreOp);
    assert!(above(jobs.moves()).all(|(_, slaves)| slaves == used));
    assert_eq!(above(jobs.moves()).count(), 2);
    assert!(host.slot(1).data1 > 0 && host.slot(3).data1 > 0);
    assert!(host.slot(2).is_zero());
    // It still has its mailbox.
    assert_eq!(host.read_object(2, 0x1018, 0), Ok(0x1018));

    // All are declared none: no slave has to change its state.
    host.go(PreOp).master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::None; 8] }).go(Op).go(Init).go(PreOp);
}

/// SK-4.57 The board does not wait for a slave with nibble F, on the way up or back to PreOP, even if it is switched
/// off.
#[test]
fn a_silent_slave_declared_none() {
    let Bench { mut host, network, .. } = Bench::new(EngineConfig::default(), drives(3));
    let mut kinds = [SlaveKind::Drive; 8];
    kinds[1] = SlaveKind::None;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    network.silence(2, true);
    for _ in 0..2 {
        host.go(Op).drained().servo_on(3).go(PreOp).go(SafeOp).go(PreOp);
    }
    // All slaves go to Init, but the silent one does not follow.
    host.master(MasterCommand::SetState(Init)).until("the failure", |host| host.state().0 & 0x10 != 0);
    network.silence(2, false);
    host.go(PreOp).go(Op);
}
