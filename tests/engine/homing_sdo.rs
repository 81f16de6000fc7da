//! The board's own SDO that restores the mode after homing, together with those of the host.

use ecmsk::engine::{Firmware, HomingEnd, HomingPhase, Reason};
use ecmsk::fieldbus::Ns;
use ecmsk::sk::{CommandId, MasterCommand, MasterState, Motion, SdoResponse, SlaveCommand, StateByte};

use crate::homer::{Home, Script};
use crate::homing_restore::{home_it, read_method, rejected, write_mode};

const MS: Ns = 1_000_000;

/// SK-7.25 Restoring is an SDO of the board's own: it takes several cycles and is not seen in the SDO slot.
/// SK-7.26 Commands for the slave until it is done count as ignored while homing.
#[test]
fn restoring_is_not_seen_in_the_sdo_slot() {
    let mut home = Home::ready(Firmware::V17, None);
    let answer = home.host.sdo_answer();
    home.network.delay_sdo(1, 50 * MS);
    home_it(&mut home);
    let mut cycles = 0;
    while home.phase(1) == HomingPhase::Restoring {
        assert_eq!(home.host.sdo_answer(), answer);
        let ignored = home.ignored();
        let commands = [
            // A late bus may execute the last command after the mode is back, so that the target is where the axis is.
            SlaveCommand::Csp(Motion::to(-700_000)),
            SlaveCommand::Csv(Motion::to(5)),
            SlaveCommand::ServoOn,
            SlaveCommand::GoHome,
        ];
        home.host.slave(1, commands[cycles % 4]);
        home.host.cycle();
        cycles += 1;
        if home.phase(1) == HomingPhase::Restoring {
            assert_eq!((home.ignored(), home.host.counters().rejected_total()), (ignored + 1, 0));
        }
    }
    assert!(cycles > 50, "{cycles}");
    assert_eq!((home.host.sdo_answer(), home.drive().modes()), (answer, vec![8]));
    home.host.drained().csp(1, -700_003).drained();
    assert_eq!(home.drive().target(), -700_003);
    assert_eq!(home.drive().jump(), 3);
}

/// SK-7.25 Restoring waits for a transfer of the host.
#[test]
fn restoring_waits_for_the_host() {
    let mut home = Home::ready_of(2, Firmware::V17, None);
    home.network.delay_sdo(2, 300 * MS);
    home.host.sdo(read_method(2));
    home_it(&mut home);
    home.host.cycles(150);
    assert_eq!((home.phase(1), home.drive().modes()), (HomingPhase::Restoring, vec![]));
    home.until_phase(1, HomingPhase::Idle);
    assert!(matches!(home.host.sdo_answer(), SdoResponse::Done { slave: 2, .. }));
    assert_eq!(home.drive().modes(), [8]);
}

/// SK-6.4 A request that comes while the board restores is not rejected but waits, and runs next: also before other
/// modes that are due. SK-6.3 One more request is held behind it. SK-7.25 The board and the host take turns.
#[test]
fn a_request_while_restoring_is_held() {
    let mut home = Home::ready_of(3, Firmware::V17, None);
    (1..=3).for_each(|slave| home.network.delay_sdo(slave, 40 * MS));
    let transfers = home.jobs.transfers().len();
    home.host.build(|frame, size| {
        (1..=3).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::GoHome.into()));
    });
    let jobs = home.jobs.clone();
    home.host.until("the first one", |_| jobs.transfers().len() > transfers).cycles(5);
    home.host.sdo(read_method(3)).cycle();
    assert_eq!(home.host.counters().rejected_total(), 0);
    home.host.sdo(read_method(2)).cycle();
    home.host.sdo(read_method(1)).cycle();
    assert_eq!(rejected(&home, Reason::SdoBusy), 1, "one deep behind the one that waits");
    home.host.cycles(400);
    let order: Vec<(u8, bool)> = home.jobs.transfers()[transfers..]
        .iter()
        .map(|(request, _)| (request.slave, request.write.is_some()))
        .collect();
    assert_eq!(order, [(1, true), (3, false), (2, true), (1, false), (3, true)]);
    assert!((1..=3).all(|slave| home.phase(slave) == HomingPhase::Idle));
    assert!(matches!(home.host.sdo_answer(), SdoResponse::Done { slave: 1, id: CommandId::SdoRead, .. }));
}

/// SK-6.5 A host's write of 0x6060 cancels a restore not yet begun; a write that the drive refuses does not. SK-6.4 A
/// write that comes after the restore has begun runs next, and counts.
#[test]
fn the_hosts_mode_counts() {
    for (when, mode, written) in [(0, 6, vec![6]), (0, 99, vec![8]), (12, 6, vec![8, 6]), (12, 99, vec![8])] {
        let mut home = Home::ready(Firmware::V17, None);
        home.network.delay_sdo(1, 30 * MS);
        home_it(&mut home);
        home.host.cycles(when).sdo(write_mode(1, mode)).cycles(300);
        let what = format!("{mode} after {when}");
        assert_eq!((home.drive().modes(), home.phase(1)), (written.clone(), HomingPhase::Idle), "{what}");
        let shows = home.drive().mode();
        home.host.csp(1, -700_000).drained();
        assert_eq!(rejected(&home, Reason::WrongMode), u64::from(shows == 6), "{what}");
        if shows == 6 {
            home_it(&mut home);
            assert_eq!(home.drive().begun(), 2, "{what}: it can home again");
        }
    }
}

/// SK-6.5 A write of the mode that was under way already when GO_HOME came ends that homing, and its mode stays. The drive does
/// not begin to go home: it might come home just before its mode changes, and no target of CSP is there yet (SK-7.41).
#[test]
fn a_write_under_way_when_homing_begins() {
    for mode in [6, 8] {
        let mut home = Home::ready(Firmware::V17, None);
        home.network.delay_sdo(1, 60 * MS);
        home.drive().script(Script { takes: 10_000, ..Script::default() });
        home.host.sdo(write_mode(1, mode)).cycles(5);
        let mark = home.host.mark();
        home.go_home(1).drained().cycles(10);
        assert_eq!(home.phase(1), HomingPhase::Homing);
        home.host.cycles(900);
        assert_eq!(home.ends(mark), [(1, HomingEnd::ModeWritten)], "{mode}");
        assert_eq!((home.drive().modes(), home.phase(1)), (vec![mode], HomingPhase::Idle));
        assert_eq!(home.drive().begun(), 0, "{mode}");
    }
}

/// SK-6.5 A write that the drive refuses was under way when GO_HOME came: homing waits for it, and begins.
#[test]
fn a_refused_write_under_way_when_homing_begins() {
    let mut home = Home::ready(Firmware::V17, None);
    home.network.delay_sdo(1, 300 * MS);
    home.host.sdo(write_mode(1, 99)).cycles(5);
    let mark = home.host.mark();
    home.go_home(1).drained().cycles(40);
    assert_eq!((home.phase(1), home.drive().begun()), (HomingPhase::Homing, 0));
    home.host.cycles(1200);
    assert_eq!((home.ends(mark), home.drive().begun()), (vec![(1, HomingEnd::Attained)], 1));
}

/// SK-6.5 A host's write of 0x6060 ends homing when it is taken, though it has to wait for a transfer of the board's own;
/// SK-6.4 and then it runs next, before a change of state that was asked for later.
#[test]
fn a_write_that_waits_ends_homing_at_once() {
    let mut home = Home::ready_of(2, Firmware::V17, None);
    home.network.delay_sdo(2, 100 * MS);
    home.drives[0].script(Script { takes: 10_000, ..Script::default() });
    home.host.build(|frame, size| {
        (1..=2).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::GoHome.into()));
    });
    home.until_phase(2, HomingPhase::Homing);
    let (jobs, transfers, moves) = (home.jobs.clone(), home.jobs.transfers().len(), home.jobs.moves().len());
    home.host.until("restoring of 2", |_| jobs.transfers().len() > transfers);
    let mark = home.host.mark();
    home.host.sdo(write_mode(1, 6)).cycles(2);
    assert_eq!(home.ends(mark), [(1, HomingEnd::ModeWritten)]);
    assert_eq!(jobs.transfers().len(), transfers + 1, "it waits");
    home.host.cycles(30).master(MasterCommand::SetState(MasterState::SafeOp));
    home.host.until("the write", |_| jobs.transfers().len() > transfers + 1);
    assert_eq!((jobs.transfers()[transfers + 1].0.slave, jobs.moves().len()), (1, moves));
    home.host.until("SafeOP", |host| host.state() == StateByte::reached(MasterState::SafeOp)).cycles(50);
    assert_eq!((home.drives[0].modes(), home.drives[1].modes()), (vec![6], vec![8]));
}
