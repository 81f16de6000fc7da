//! The state of the network: boot, every change up and down, and the effects of a change.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::cia402::Mode;
use ecmsk::engine::{Board, EngineConfig, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AlState, Ns, Role, SlaveSet};
use ecmsk::sk::{
    CommandId, CycleTime, DcShift, DriveSync, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SlaveCommand,
    SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::AlStatus;

use crate::host::{BOOT_LIMIT, Host};
use crate::probe::{Bench, any_slaves, drives};

fn board(n: usize) -> Bench {
    let mut bench = Bench::new(EngineConfig::default(), drives(n));
    bench.host.declare_drives(n);
    bench
}

/// Asks for a state; returns the state bytes of the reports until `wanted` is shown, and the number of reports.
fn walk(host: &mut Host, target: MasterState, wanted: u8) -> (Vec<u8>, usize) {
    host.cycle();
    host.master(MasterCommand::SetState(target));
    let (mut seen, mut reports) = (vec![host.state().0], 0);
    while *seen.last().unwrap() != wanted {
        assert!(host.cycle() && reports < 20_000, "never {wanted:02X}: {seen:02X?}");
        reports += 1;
        if host.state().0 != *seen.last().unwrap() {
            seen.push(host.state().0);
        }
    }
    (seen, reports)
}

fn kinds(first: &[SlaveKind]) -> MasterCommand {
    let mut kinds = [SlaveKind::None; 8];
    kinds[..first.len()].copy_from_slice(first);
    MasterCommand::SetAxis { group: 0, kinds }
}

fn set_dc(us: u32) -> MasterCommand {
    MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto }
}

/// SK-4.47 After power-up the ECM looks for slaves and enters PreOP by itself. SK-4.48 Until then the host interface is
/// silent: no report comes and no command is taken. SK-4.67 States 0 and 0x10 are not seen before the first PreOP.
#[test]
fn boot_ends_in_preop() {
    let mut board = Board::new(EngineConfig::default(), Box::new(SimBus::new(drives(2))));
    assert_eq!((board.engine().state(), board.engine().talks()), (StateByte::NETWORK_INIT, false));
    let mut reset = Frame::new();
    reset.put_master(SlotSize::Bytes12, &MasterCommand::SoftReset);
    while !board.engine().talks() {
        let mut reports = Vec::new();
        board.host(&reset, board.now() + 1, &mut |frame, _| reports.push(frame.clone()));
        board.cycle(&mut |frame, _| reports.push(frame.clone()));
        for report in reports {
            assert_eq!(MasterResponse::decode(&report.slot(SlotSize::Bytes12, 0)).state, StateByte::reached(PreOp));
        }
        assert!(board.now() < BOOT_LIMIT);
    }
    assert_eq!((board.engine().state(), board.engine().boots()), (StateByte::reached(PreOp), 1));
    assert_eq!(board.engine().slaves_found(), 2);
}

/// SK-2.9 SK-4.48 Without a slave the board is silent, and finds one that is plugged in later.
#[test]
fn boot_without_a_slave() {
    let bus = SimBus::new(drives(1));
    let network = bus.handle();
    network.cut_after(0);
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(!board.boot(BOOT_LIMIT));
    assert_eq!((board.engine().state(), board.engine().slaves_found()), (StateByte(0x10), 0));
    network.heal();
    assert!(board.boot(BOOT_LIMIT));
    assert_eq!((board.engine().state(), board.engine().slaves_found()), (StateByte::reached(PreOp), 1));
}

/// SK-4.47 A slave that does not enter PreOP at boot holds it up; the board looks for all slaves again.
#[test]
fn boot_with_a_slave_that_refuses() {
    let bus = SimBus::new(drives(3));
    let network = bus.handle();
    network.cut_after(2);
    network.refuse(2, Some((AlState::PreOp, AlStatus(0x0011))));
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(!board.boot(BOOT_LIMIT));
    assert_eq!(board.engine().state(), StateByte(0x10));
    network.refuse(2, None);
    network.heal();
    assert!(board.boot(BOOT_LIMIT));
    assert_eq!((board.engine().state(), board.engine().slaves_found()), (StateByte::reached(PreOp), 3));
}

/// SK-4.49 Every step up. SK-4.50 Any state back to any lower one.
/// SK-4.51 PreOP to OP goes through SafeOP by itself.
/// SK-2.8 Byte 2 of slot 0 shows them as 1, 2, 4, 8.
/// SK-4.5 A change takes several cycles.
/// SK-4.53 PreOP to SafeOP is the longest.
#[test]
fn every_way_up_and_down() {
    let Bench { mut host, jobs, .. } = board(2);
    let to_preop = walk(&mut host, Init, 1).1.min(walk(&mut host, PreOp, 2).1);
    let (_, to_safeop) = walk(&mut host, SafeOp, 4);
    let (_, to_op) = walk(&mut host, Op, 8);
    assert!(to_preop > 3 && to_op > 3 && to_safeop > to_op && to_safeop > to_preop);

    let ways: [(MasterState, MasterState, &[u8]); 10] = [
        (Op, SafeOp, &[8, 4]),
        (SafeOp, Op, &[4, 8]),
        (Op, PreOp, &[8, 2]),
        (PreOp, Op, &[2, 4, 8]),
        (Op, Init, &[8, 1]),
        (Init, PreOp, &[1, 2]),
        (PreOp, SafeOp, &[2, 4]),
        (SafeOp, PreOp, &[4, 2]),
        (PreOp, Init, &[2, 1]),
        (Init, PreOp, &[1, 2]),
    ];
    for (from, to, states) in ways {
        assert_eq!(host.state(), StateByte::reached(from));
        let (seen, reports) = walk(&mut host, to, to.code());
        assert_eq!(seen, states, "{from} to {to}");
        assert!(reports > 3, "{from} to {to}: {reports}");
    }
    host.go(SafeOp);
    assert_eq!(walk(&mut host, Init, 1).0, [4, 1]);
    let all = SlaveSet::first(2);
    assert_eq!(jobs.moves().last(), Some(&(AlState::Init, all)));
    assert_eq!(host.counters().rejected_total(), 0);
}

/// SK-4.54 Asking for the present state is not an error, and no slave changes its state.
#[test]
fn asking_for_the_present_state() {
    let Bench { mut host, jobs, .. } = board(1);
    for state in [PreOp, Init, PreOp, SafeOp, Op] {
        host.go(state);
        let jobs_before = jobs.len();
        assert_eq!(walk(&mut host, state, state.code()).0, [state.code()]);
        host.cycles(50);
        assert_eq!((host.state(), jobs.len()), (StateByte::reached(state), jobs_before));
    }
    assert_eq!(host.counters().rejected_total(), 0);
}

/// SK-4.63 Init accepts SET_STATE 1 and 2 only.
/// SK-4.4 SET_STATE accepts 1, 2, 4 and 8 in every other state.
#[test]
fn init_accepts_init_and_preop() {
    let Bench { mut host, .. } = board(1);
    host.go(Init);
    for (target, accepted) in [(Init, true), (SafeOp, false), (Op, false), (PreOp, true)] {
        let mark = host.mark();
        host.master(MasterCommand::SetState(target)).cycles(2);
        let expected = if accepted { vec![] } else { vec![(0, CommandId::SetState, Reason::WrongState)] };
        assert_eq!((host.rejections(mark), host.state().0), (expected, 1), "{target}");
    }
    // The way up has begun, but the state is still Init.
    let mark = host.mark();
    host.master(MasterCommand::SetState(Op)).cycle();
    assert_eq!((host.rejections(mark).len(), host.state().0), (1, 1));
    host.until("PreOP", |host| host.state().0 == 2).cycles(2000);
    assert_eq!(host.state().0, 2);
}

/// SK-4.52 SK-4.69 Without SET_AXIS, SET_DC and DRIVE_MODE before it the change to OP uses the defaults: all slaves IO,
/// 1000 us, CSP with DC sync.
#[test]
fn defaults() {
    let Bench { mut host, jobs, .. } = Bench::new(EngineConfig::default(), any_slaves(40));
    host.go(Op);
    let config = jobs.configured();
    assert_eq!(config.cycle.us(), 1000);
    assert!(config.slaves.iter().all(|slave| (slave.role, slave.sync) == (Role::Io, DriveSync::DcSync)));
    host.go(PreOp).declare_drives(40).go(Op);
    let config = jobs.configured();
    assert!(config.slaves.iter().all(|slave| (slave.role, slave.sync) == (Role::Drive(Mode::Csp), DriveSync::DcSync)));
}

/// Cycles to wait after asking for a state.
type Requests = &'static [(u32, MasterState)];

/// SK-4.64 A SET_STATE during a change replaces its target.
#[test]
fn a_target_is_replaced_during_a_change() {
    let ways: [(Requests, &[u8]); 8] = [
        // A change up is given up before SafeOP, in any phase of it.
        (&[(4, Op), (1000, PreOp)], &[2]),
        (&[(15, Op), (1000, PreOp)], &[2]),
        (&[(100, Op), (1000, PreOp)], &[2]),
        (&[(100, Op), (1000, Init)], &[2, 1]),
        (&[(100, Op), (1000, SafeOp)], &[2, 4]),
        (&[(100, SafeOp), (1000, Op)], &[2, 4, 8]),
        (&[(15, SafeOp), (100, PreOp), (1000, Op)], &[2, 4, 8]),
        (&[(4, Init), (1000, Op)], &[2, 1, 2, 4, 8]),
    ];
    for (requests, states) in ways {
        let Bench { mut host, .. } = board(2);
        host.cycle();
        let mut seen = vec![host.state().0];
        for (cycles, target) in requests {
            host.master(MasterCommand::SetState(*target));
            for _ in 0..*cycles {
                host.cycle();
                if host.state().0 != *seen.last().unwrap() {
                    seen.push(host.state().0);
                }
            }
        }
        assert_eq!(seen, states, "{requests:?}");
        // No slave is left in between: the way up still works.
        host.go(if host.state().0 == 1 { PreOp } else { Op }).go(PreOp).go(Op);
    }
}

/// SK-4.64 The remaining steps to the replaced target are given up: slaves that cannot be configured do no harm.
#[test]
fn a_replaced_target_is_given_up_at_once() {
    let Bench { mut host, jobs, .. } = Bench::new(EngineConfig::default(), drives(2));
    // The slaves are declared IO, which fails after some 10 ms.
    host.master(MasterCommand::SetState(Op)).cycles(4);
    host.master(MasterCommand::SetState(PreOp)).cycles(1000);
    assert_eq!(host.state().0, 2);

    // The configuration for the replaced target does not count for the next one.
    host.declare_drives(2).cycle();
    host.master(MasterCommand::SetState(Op)).cycles(100);
    host.master(MasterCommand::SetState(PreOp)).cycles(2);
    host.master(set_dc(2000)).master(MasterCommand::SetState(Op)).until("OP", |host| host.state().0 == 8);
    assert_eq!(jobs.configured().cycle.us(), 2000);
}

/// SK-4.64 The same on the way down.
#[test]
fn a_target_is_replaced_on_the_way_down() {
    for (first, second, end) in [(PreOp, Op, 8), (SafeOp, Init, 1), (Init, PreOp, 2), (Init, Op, 8)] {
        let Bench { mut host, .. } = board(2);
        host.go(Op).master(MasterCommand::SetState(first)).cycles(2);
        assert_eq!(host.state().0, 8);
        host.master(MasterCommand::SetState(second)).until("the end", |host| host.state().0 != 8);
        host.until("the end", |host| host.state().0 == end).cycles(500);
        assert_eq!(host.state().0, end, "{first} then {second}");
    }
}

/// SK-4.6 SET_AXIS: nibble k of group g is slave g*8+k+1. SK-4.7 0 is a drive, 1 IO, 2 HSP, 3 STEP, F none.
/// SK-4.8 Nibbles of slaves above 40 (30) are ignored.
/// SK-4.41 DRIVE_MODE is without effect on an IO slave.
#[test]
fn axes_are_declared_by_nibbles() {
    let nibbles = [0x0u32, 0x1, 0x2, 0x3, 0xF, 0x1, 0x0];
    let roles = [
        Role::Drive(Mode::Csv),
        Role::Io,
        Role::Hsp(Mode::Csv),
        Role::Step(Mode::Csp),
        Role::Unused,
        Role::Io,
        Role::Drive(Mode::Csv),
    ];
    for slot in SlotSize::ALL {
        let slaves = slot.max_slaves();
        let Bench { mut host, jobs, .. } =
            Bench::new(EngineConfig { slot, ..EngineConfig::default() }, any_slaves(slaves));
        for slave in (1..=slaves).filter(|slave| nibbles[(slave - 1) % nibbles.len()] != 3) {
            host.slave(slave, SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync });
        }
        for group in [3, 0, 4, 2, 1usize] {
            let nibble = |k: usize| match group * 8 + k {
                // Nibbles of missing slaves: they are not checked.
                n if n >= slaves => 0x7,
                n => nibbles[n % nibbles.len()],
            };
            let data1 = (0..8).fold(0, |word, k| word | nibble(k) << (4 * k));
            host.raw(0, RawSlot { id: 0x02, parm: group as u16, data1, ..RawSlot::ZERO });
        }
        host.go(SafeOp);
        assert_eq!(host.counters().rejected_total(), 0);
        let config = jobs.configured();
        for (n, slave) in config.slaves.iter().enumerate() {
            let expected = if n < slaves { roles[n % roles.len()] } else { Role::Unused };
            assert_eq!(slave.role, expected, "{slot:?} slave {}", n + 1);
        }
    }
}

/// SK-9.9 A report per default cycle before OP, also in SafeOP; in OP one per EtherCAT cycle of SET_DC.
#[test]
fn report_period() {
    for us in [250, 500, 1000, 4000, 512_000] {
        let Bench { mut host, jobs, .. } = board(1);
        host.master(set_dc(us));
        for (state, period) in [(PreOp, 1000), (SafeOp, 1000), (Op, us), (PreOp, 1000), (Op, us), (SafeOp, 1000)] {
            host.go(state).cycle();
            let (from, reports) = (host.board.now(), host.reports);
            host.cycles(10);
            assert_eq!(host.board.now() - from, Ns::from(period) * 10_000, "{us} us, {state}");
            assert_eq!(host.reports - reports, 10, "{us} us, {state}");
        }
        assert_eq!(jobs.configured().cycle.us(), us);
    }
}

/// SK-4.65 Axes, DC and modes survive going back from OP, and a setting during a change counts from the next change on:
/// the slaves were configured with the earlier one.
#[test]
fn settings_during_a_change_count_from_the_next() {
    let Bench { mut host, jobs, .. } = board(2);
    host.master(set_dc(2000)).master(MasterCommand::SetState(Op)).cycles(100);
    assert_eq!(host.state(), StateByte::reached(PreOp));
    host.master(set_dc(4000)).master(kinds(&[SlaveKind::Drive])).until("OP", |host| host.state().0 == 8).cycle();
    let from = host.board.now();
    host.cycles(10);
    assert_eq!((host.board.now() - from, jobs.configured().cycle.us()), (20_000_000, 2000));
    assert_eq!(jobs.configured().slaves[1].role, Role::Drive(Mode::Csp));
    for state in [SafeOp, PreOp, Init] {
        host.go(state).go(if state == Init { PreOp } else { Op }).go(Op);
    }
    assert_eq!((jobs.configured().cycle.us(), jobs.configured().slaves[1].role), (4000, Role::Unused));
    let from = host.board.now();
    host.cycles(10);
    assert_eq!(host.board.now() - from, 40_000_000);
}

/// SK-4.65 Axes, DC and modes survive going back from OP.
/// SK-4.42 SET_AXIS does not reset what DRIVE_MODE stored.
#[test]
fn settings_survive_leaving_op() {
    let Bench { mut host, jobs, .. } = Bench::new(EngineConfig::default(), any_slaves(4));
    let mode = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::FreeRun };
    let drive_hsp = [SlaveKind::Drive, SlaveKind::Hsp, SlaveKind::None, SlaveKind::Drive];
    host.slave(1, mode).slave(2, mode).slave(3, mode).slave(4, mode).master(kinds(&drive_hsp)).master(set_dc(500));
    for back in [SafeOp, PreOp, Init] {
        host.go(PreOp).go(Op);
        let config = jobs.configured();
        let roles = [Role::Drive(Mode::Csv), Role::Hsp(Mode::Csv), Role::Unused, Role::Drive(Mode::Csv)];
        assert_eq!([0, 1, 2, 3].map(|n| config.slaves[n].role), roles, "{back}");
        assert_eq!((config.slaves[0].sync, config.cycle.us()), (DriveSync::FreeRun, 500), "{back}");
        host.go(back);
    }
    host.go(PreOp).master(kinds(&[SlaveKind::Drive; 4])).go(Op);
    assert_eq!(jobs.configured().slaves[2].role, Role::Drive(Mode::Csv));
}
