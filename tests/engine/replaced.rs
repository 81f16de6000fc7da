//! SET_STATE again during a change: settings that were replaced meanwhile, and its timeout.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::cia402::Mode;
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::{AlState, Ns, Role};
use ecmsk::sk::{CycleTime, DcShift, DriveSync, MasterCommand, MasterState, SlaveCommand, SlaveKind};
use ecmsk::slave::AlStatus;

use crate::host::Host;
use crate::probe::{Bench, any_slaves, drives};
use crate::watch::Spans;

fn board() -> Bench {
    let mut bench = Bench::new(EngineConfig::default(), any_slaves(2));
    bench.host.declare_drives(2).cycle();
    bench
}

fn set_dc(us: u32) -> MasterCommand {
    MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto }
}

/// SK-4.64 SK-4.75 Settings of SET_DC, SET_AXIS and DRIVE_MODE during a change, in any phase of the way to SafeOP, are
/// configured by the next SET_STATE, and the change ends in OP with it.
#[test]
fn new_settings_are_configured() {
    for first in [SafeOp, Op] {
        for cycles in [0, 1, 5, 12, 18, 22, 30, 60, 120, 200, 260, 310] {
            let Bench { mut host, jobs, .. } = board();
            host.master(MasterCommand::SetState(first)).cycles(cycles);
            assert_eq!(host.state().0, 2, "{cycles}");
            let mut kinds = [SlaveKind::Drive; 8];
            kinds[1] = SlaveKind::Io;
            host.master(set_dc(2000)).master(MasterCommand::SetAxis { group: 0, kinds });
            host.slave(1, SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::FreeRun });
            let mark = host.mark();
            host.master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8).cycle();
            let (from, config) = (host.board.now(), jobs.configured());
            host.cycles(10);
            assert_eq!(host.board.now() - from, 20_000_000, "{first} {cycles}");
            let roles = [0, 1].map(|n| config.slaves[n].role);
            assert_eq!(roles, [Role::Drive(Mode::Csv), Role::Io], "{first} {cycles}");
            assert_eq!((config.cycle.us(), config.slaves[0].sync), (2000, DriveSync::FreeRun), "{first} {cycles}");
            assert_eq!(host.rejections(mark), []);
            // The last change up came from PreOP.
            let moves: Vec<AlState> = jobs.moves().into_iter().map(|(state, _)| state).collect();
            assert_eq!(moves[moves.len() - 2..], [AlState::SafeOp, AlState::Op], "{first} {cycles}");
        }
    }
}

/// SK-4.64 SK-4.75 One new setting is enough: the cycle alone, or one slave alone.
#[test]
fn one_new_setting_is_configured() {
    type Setting = (fn(&mut Host) -> &mut Host, (u32, Mode));
    let settings: [Setting; 2] = [
        (|host| host.master(set_dc(2000)), (2000, Mode::Csp)),
        (|host| host.slave(1, SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync }), (1000, Mode::Csv)),
    ];
    for (setting, (us, mode)) in settings {
        for cycles in [5, 60, 310] {
            let Bench { mut host, jobs, .. } = board();
            host.master(MasterCommand::SetState(Op)).cycles(cycles);
            setting(&mut host);
            host.master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8);
            let config = jobs.configured();
            assert_eq!((config.cycle.us(), config.slaves[0].role), (us, Role::Drive(mode)), "after {cycles} cycles");
        }
    }
}

/// SK-4.64 A SET_STATE that replaces nothing does not restart the change, nor do equal settings.
#[test]
fn the_same_again_is_nothing_new() {
    let mut alone = board();
    alone.host.master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8);
    let Bench { mut host, jobs, .. } = board();
    for _ in 0..1000 {
        host.declare_drives(2).master(set_dc(1000)).master(MasterCommand::SetState(Op)).cycle();
        if host.state().0 == 8 {
            break;
        }
    }
    assert_eq!((host.state().0, jobs.len()), (8, alone.jobs.len()));
}

/// SK-4.76 [OURS] A program that sends SET_STATE in every frame sees the failure as well: a repeated SET_STATE gives no
/// more time.
#[test]
fn asking_again_gives_no_more_time() {
    let config = EngineConfig { state_timeout_ns: 2_000_000_000, ..EngineConfig::default() };
    let Bench { mut host, network, .. } = Bench::new(config, drives(2));
    host.declare_drives(2).go(SafeOp).cycle();
    network.silence(2, true);
    let asked = host.board.now();
    while host.state().0 != 0x14 {
        host.master(MasterCommand::SetState(Op)).cycle();
        assert!(host.board.now() - asked < 2_100_000_000, "it never fails");
    }
    assert!(host.board.now() - asked >= 2_000_000_000);
}

/// SK-4.76 [OURS] Another target has its own 10 s, whatever the bus does at that time.
#[test]
fn another_target_has_its_own_time() {
    let timeout: Ns = 2_000_000_000;
    let config = EngineConfig { state_timeout_ns: timeout, ..EngineConfig::default() };
    for answers in [false, true] {
        let Bench { mut host, network, .. } = Bench::new(config, drives(2));
        host.declare_drives(2).cycle();
        host.master(MasterCommand::SetState(SafeOp)).cycles(100);
        network.silence(2, true);
        host.cycles(1500).master(MasterCommand::SetState(Op));
        let asked = host.board.now();
        if answers {
            // This is later than the timeout of the first one.
            host.cycles(1000);
            assert_eq!(host.state().0, 2);
            network.silence(2, false);
            host.until("OP", |host| host.state().0 == 8);
        } else {
            host.until("the failure", |host| host.state().0 & 0x10 != 0);
            let took = host.board.now() - asked;
            assert!((timeout..timeout + 5_000_000).contains(&took), "{took}");
        }
    }
}

/// SK-4.55 A refusal is a failure all the same, without a retry.
#[test]
fn a_refusal_after_another_target() {
    let Bench { mut host, network, jobs } = board();
    network.refuse(2, Some((AlState::SafeOp, AlStatus(0x0011))));
    host.master(MasterCommand::SetState(SafeOp)).cycles(100).master(MasterCommand::SetState(Op));
    host.until("the failure", |host| host.state().0 == 0x12);
    let jobs_so_far = jobs.len();
    host.cycles(12_000);
    assert_eq!((host.state().0, jobs.len()), (0x12, jobs_so_far));
    host.go(PreOp).go(Init);
}

/// SK-4.55 SK-4.76 So is a refusal that comes when the slave was asked already, and the new target has more time.
#[test]
fn a_refusal_of_what_was_asked_before() {
    let Bench { mut host, network, jobs } = board();
    let asked = |jobs: &Spans| jobs.moves().iter().filter(|(state, _)| *state == AlState::SafeOp).count();
    host.master(MasterCommand::SetState(SafeOp)).until("it is asked", |_| asked(&jobs) == 1);
    network.silence(2, true);
    host.cycles(50).master(MasterCommand::SetState(Op));
    network.refuse(2, Some((AlState::SafeOp, AlStatus(0x0011))));
    network.silence(2, false);
    host.until("the failure", |host| host.state().0 == 0x12);
    assert_eq!(asked(&jobs), 1, "it is not asked again");
}

/// SK-4.50 Kinds and modes that do not fit each other do no harm on the way down: Init is reached.
#[test]
fn the_way_down_needs_no_process_data() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), any_slaves(1));
    host.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Step; 8] });
    host.slave(1, SlaveCommand::DriveMode { mode: Mode::Cst, sync: DriveSync::DcSync });
    host.go(Init).go(PreOp);
}
