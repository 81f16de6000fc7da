//! The mode after homing: the board writes it back by SDO in firmware 1.7, and no drive jumps.

use allocation_counter::measure;
use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::{Event, EventKind, Firmware, HomingPhase, Reason};
use ecmsk::fieldbus::Ns;
use ecmsk::sk::{CommandId, DriveSync, Frame, MasterState, Motion, SdoCommand, SdoResponse, SlaveCommand};

use crate::homer::{BIT_13, Home, Script};
use crate::puppet::FAULT;
use crate::rig::ahead;
use support::ahead_bus::Ahead;

const PROFILES: [Firmware; 2] = [Firmware::V17, Firmware::V15];
const MS: Ns = 1_000_000;

pub fn buses() -> impl Iterator<Item = Option<Ahead>> {
    std::iter::once(None).chain(ahead().map(Some))
}

pub fn write_mode(slave: u8, mode: u32) -> SdoCommand {
    SdoCommand::Write { slave, object: ObjectAddress::new(0x6060, 0), size: SdoSize::One, value: mode }
}

pub fn read_method(slave: u8) -> SdoCommand {
    SdoCommand::Read { slave, object: ObjectAddress::new(0x6098, 0) }
}

pub fn rejected(home: &Home, reason: Reason) -> u64 {
    home.host.counters().rejected[reason.kind()]
}

/// Homes the first drive to the end.
pub fn home_it(home: &mut Home) {
    home.go_home(1);
    home.until_phase(1, HomingPhase::Homing);
    home.host.until("an end", |host| host.board.engine().homing_phase(1) != HomingPhase::Homing);
}

/// SK-7.22 After homing the mode returns to the one set before, CSP, CSV or CST, in profile 1.7.
/// SK-7.23 SK-3.8 In profile 1.5 it stays 6 until 0x6060 is written.
#[test]
fn the_mode_returns() {
    for firmware in PROFILES {
        for mode in [Mode::Csp, Mode::Csv, Mode::Cst] {
            let mut home = Home::in_preop(1, firmware, None);
            home.host.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync }).op(1);
            home.switch_on();
            home.mode(1, 6);
            home.drive().modes();
            home_it(&mut home);
            home.host.cycles(1000);
            let (restored, now) = match firmware {
                Firmware::V17 => (vec![u32::from(mode.code())], mode.code()),
                Firmware::V15 => (vec![], 6),
            };
            assert_eq!((home.drive().modes(), home.drive().mode()), (restored, now), "{firmware:?} {mode}");
            assert_eq!(home.phase(1), HomingPhase::Idle);
            let shown = home.host.drive(1).head.index;
            assert_eq!(shown, if firmware == Firmware::V15 { 6 } else { 0 }, "{firmware:?}");
            let command = match mode {
                Mode::Csv => SlaveCommand::Csv(Motion::to(100)),
                Mode::Cst => SlaveCommand::Cst(100),
                _ => SlaveCommand::Csp(Motion::to(-700_100)),
            };
            home.host.slave(1, command).drained().cycles(2);
            let refused = u64::from(firmware == Firmware::V15);
            assert_eq!(rejected(&home, Reason::WrongMode), refused, "{firmware:?} {mode}");
            let target = home.drive().target();
            assert_eq!(target == 100 || target == -700_100, firmware == Firmware::V17, "{firmware:?} {mode}: {target}");
            assert_eq!((home.ignored(), home.host.counters().discarded_before_enabled), (0, 0));
        }
    }
}

/// SK-7.22 It returns however homing has ended.
#[test]
fn the_mode_returns_after_every_end() {
    let ends: [fn(&mut Home); 5] = [
        |home| {
            home.host.slave(1, SlaveCommand::AbortHome);
        },
        |home| {
            home.host.slave(1, SlaveCommand::ServoOff);
        },
        |home| home.drive().fall(FAULT),
        |home| home.drive().script(Script { takes: 1, result: BIT_13, ..Script::default() }),
        |home| {
            home.host.go(MasterState::SafeOp);
        },
    ];
    for how in buses() {
        for (n, end) in ends.iter().enumerate() {
            let mut home = Home::ready(Firmware::V17, how);
            home.drive().script(Script { takes: 10_000, ..Script::default() });
            home.go_home(1).drained().cycles(30);
            end(&mut home);
            home.host.cycles(800);
            assert_eq!((home.drive().modes(), home.phase(1)), (vec![8], HomingPhase::Idle), "{how:?}, end {n}");
            assert_eq!(home.drive().jump(), 0, "{how:?}, end {n}");
        }
    }
}

/// SK-7.41 A drive that brakes is given time: the mode does not change before it is at rest, or half a second has
/// passed.
#[test]
fn the_mode_waits_until_the_drive_stands() {
    for (brakes, at_least, at_most) in [(5, 5, 40), (200, 200, 240), (100_000, 480, 560)] {
        let mut home = Home::ready(Firmware::V17, None);
        home.drive().script(Script { takes: 10_000, brakes, ..Script::default() });
        home.go_home(1).drained().cycles(30);
        home.host.slave(1, SlaveCommand::AbortHome).drained();
        let mut cycles = 0;
        while home.drive().mode() == 6 {
            home.host.cycle();
            cycles += 1;
        }
        assert!((at_least..=at_most).contains(&cycles), "{brakes}: {cycles}");
    }
}

/// SK-7.24 A program that writes 0x6060 = 8 by SDO itself after homing works in both profiles: at any time around the
/// home event, on every bus. SK-7.16 SK-7.41 No old target makes the drive jump. SK-6.5 The board's own write that has
/// not begun is cancelled.
#[test]
fn a_program_may_write_the_mode_itself() {
    for firmware in PROFILES {
        for how in buses() {
            for wait in [0, 16, 19, 20, 21, 22, 24, 30, 60] {
                let mut home = Home::ready(firmware, how);
                home.go_home(1).cycles(wait);
                home.host.sdo(write_mode(1, 8));
                home.host.until("the answer", |host| {
                    matches!(host.sdo_answer(), SdoResponse::Done { id: CommandId::SdoWrite, .. })
                        && host.board.engine().homing_phase(1) == HomingPhase::Idle
                });
                let what = format!("{firmware:?} {how:?} {wait}");
                home.host.cycles(30);
                let here = home.drive().position();
                home.host.cycles(200);
                assert_eq!((home.drive().jump(), home.drive().mode()), (0, 8), "{what}");
                assert_eq!(home.drive().position(), here, "{what}");
                home.host.csp(1, here + 10).drained().cycles(10);
                assert_eq!(home.drive().position(), here + 10, "{what}");
                assert_eq!(home.host.counters().rejected_total(), 0, "{what}");
            }
        }
    }
}

/// SK-7.41 A home event that comes while an ABORT_HOME lies ahead in the bus: the mode is written only after the old
/// targets are executed.
#[test]
fn a_home_event_behind_an_abort_makes_no_jump() {
    for how in ahead().filter(|how| how.depth > 1) {
        let mut home = Home::ready(Firmware::V17, Some(how));
        home.drive().script(Script { takes: 60, ..Script::default() });
        home.go_home(1);
        home.until_phase(1, HomingPhase::Homing);
        (0..100).for_each(|_| home.arrive_idle());
        let mut frame = Frame::new();
        frame.put_slave(home.host.size, 1, &SlaveCommand::AbortHome.into());
        home.host.arrive(&frame);
        for _ in 0..500 {
            home.arrive_idle();
            home.host.cycle();
        }
        assert_eq!((home.drive().jump(), home.drive().modes()), (0, vec![8]), "{how:?}");
        assert_eq!((home.drive().position(), home.phase(1)), (-700_000, HomingPhase::Idle), "{how:?}");
    }
}

/// SK-7.24 So does a program that waits for bits 10 and 12, writes 8, waits for the answer and moves on, streaming all
/// the while. SK-7.16 The home event moves the coordinate, not the drive.
#[test]
fn streams_around_homing_make_no_jump() {
    for firmware in PROFILES {
        for how in buses() {
            let mut home = Home::ready(firmware, how);
            home.go_home(1);
            let stream = |home: &mut Home, cycles: usize| {
                for _ in 0..cycles {
                    home.host.idle();
                    home.host.cycle();
                }
            };
            stream(&mut home, 100);
            assert_eq!(home.host.drive(1).position, -700_000);
            home.host.sdo(write_mode(1, 8));
            stream(&mut home, 200);
            let what = format!("{firmware:?} {how:?}");
            assert_eq!((home.drive().jump(), home.phase(1)), (0, HomingPhase::Idle), "{what}");
            for target in 1..=50 {
                home.host.csp(1, -700_000 + target).cycle();
            }
            home.host.drained().cycles(10);
            assert_eq!((home.drive().jump(), home.drive().position()), (1, -699_950), "{what}");
            assert_eq!(home.host.counters().discarded_before_enabled, 0, "{what}");
        }
    }
}

/// SK-7.18 SK-7.24 A program that streams its target over the end of homing: from the entry on that follows the mode, written
/// by the program or by the board, the target is taken. Each earlier entry is counted with its reason, and none is discarded as
/// too early: the drive shows Operation enabled all the while.
#[test]
fn the_first_target_in_the_mode_is_taken() {
    const HOME: i32 = -700_000;
    for how in buses() {
        for writes_mode in [true, false] {
            let firmware = if writes_mode { Firmware::V15 } else { Firmware::V17 };
            let mut home = Home::ready(firmware, how);
            home.go_home(1).drained();
            home.host.until("home", |host| host.drive(1).position == HOME);
            if writes_mode {
                home.host.cycles(60).sdo(write_mode(1, 8));
            }
            let before = home.host.counters();
            // Each cycle takes one of them from the FIFO.
            for _ in 0..150 {
                home.host.csp(1, HOME + 10);
            }
            home.host.drained().cycles(20);
            let after = home.host.counters();
            let what = format!("{how:?}, the mode written by the program: {writes_mode}");
            let early = if writes_mode {
                after.rejected[Reason::WrongMode.kind()] - before.rejected[Reason::WrongMode.kind()]
            } else {
                after.ignored_homing - before.ignored_homing
            };
            assert!((1..150).contains(&early), "{what}: {early}");
            let not_taken =
                after.rejected_total() - before.rejected_total() + after.ignored_homing - before.ignored_homing;
            assert_eq!((not_taken, after.discarded_before_enabled), (early, 0), "{what}");
            assert_eq!((home.drive().jump(), home.drive().position()), (10, HOME + 10), "{what}");
        }
    }
}

/// SK-7.43 SV_OFF and ALM_CLR always act, while the mode is restored, too.
#[test]
fn servo_off_and_alarm_clear_act_while_restoring() {
    let mut home = Home::ready(Firmware::V17, None);
    home.network.delay_sdo(1, 500 * MS);
    home_it(&mut home);
    home.host.slave(1, SlaveCommand::ServoOff).drained().cycles(20);
    assert_eq!((home.phase(1), home.ignored()), (HomingPhase::Restoring, 0));
    assert!(!home.host.drive(1).statusword.is_enabled());
    home.drive().fall(FAULT);
    home.host.cycles(3).slave(1, SlaveCommand::AlarmClear).drained().cycles(3);
    assert!(home.drive().words().iter().any(|word| word & 0x80 != 0), "a fault reset");
    assert_eq!((home.phase(1), home.ignored()), (HomingPhase::Restoring, 0));
}

/// SK-7.42 A transfer of the board's own that fails is tried again; after the third time the drive stays in mode 6, which
/// is counted and logged, and the host's own write helps.
#[test]
fn a_mode_that_cannot_be_restored() {
    let mut home = Home::ready_of(2, Firmware::V17, None);
    home.network.abort_sdo(1, Some(AbortCode(0x0800_0022)));
    let (mark, transfers) = (home.host.mark(), home.jobs.transfers().len());
    home_it(&mut home);
    home.until_phase(1, HomingPhase::Idle);
    assert_eq!(home.jobs.transfers().len() - transfers, 3);
    assert_eq!(home.host.counters().modes_not_restored, 1);
    let events: Vec<Event> = home.host.board.engine().events_since(mark).collect();
    let [Event { kind: EventKind::HomingEnded { .. }, .. }, failure] = events[..] else { panic!("{events:?}") };
    assert!(matches!(failure.kind, EventKind::ModeNotRestored { slave: 1, axis: 0, code: AbortCode(0x0800_0022) }));
    assert!(failure.to_string().contains("0x6060"), "{failure}");
    home.host.csp(1, -700_000).drained();
    assert_eq!((rejected(&home, Reason::WrongMode), home.ignored()), (1, 0));
    home.network.abort_sdo(1, None);
    home.mode(1, 8);
    home.host.csp(1, -700_001).drained();
    assert_eq!((home.drive().target(), rejected(&home, Reason::WrongMode)), (-700_001, 1));

    // A transfer that fails once.
    home.mode(1, 6);
    home.drive().modes();
    home.network.abort_sdo(1, Some(AbortCode(0x0800_0022)));
    let (jobs, transfers) = (home.jobs.clone(), home.jobs.transfers().len());
    home.go_home(1).until("a failure", |_| jobs.transfers()[transfers..].iter().any(|(_, span)| span.ended.is_some()));
    home.network.abort_sdo(1, None);
    home.until_phase(1, HomingPhase::Idle);
    assert_eq!((home.drive().modes(), home.host.counters().modes_not_restored), (vec![8], 1));
}

/// SK-7.42 In SafeOP as well, when homing has ended with OP.
#[test]
fn a_mode_that_cannot_be_restored_after_op() {
    let mut home = Home::ready(Firmware::V17, None);
    home.drive().script(Script { takes: 10_000, ..Script::default() });
    home.go_home(1).drained().cycles(20);
    home.network.abort_sdo(1, Some(AbortCode(0x0800_0022)));
    let transfers = home.jobs.transfers().len();
    home.host.go(MasterState::SafeOp).cycles(200);
    assert_eq!((home.jobs.transfers().len() - transfers, home.host.counters().modes_not_restored), (3, 1));
    assert_eq!(home.phase(1), HomingPhase::Idle);
}

/// SK-7.22 When OP is left the mode is restored in SafeOP; a way down to PreOP leaves it to the next way up.
#[test]
fn the_mode_returns_after_op() {
    for firmware in PROFILES {
        let mut home = Home::ready(firmware, None);
        home.drive().script(Script { takes: 10_000, ..Script::default() });
        home.go_home(1).drained().cycles(20);
        home.host.go(MasterState::SafeOp).cycles(50).go(MasterState::Op).cycles(50);
        let mode = if firmware == Firmware::V17 { 8 } else { 6 };
        assert_eq!((home.drive().mode(), home.phase(1)), (mode, HomingPhase::Idle), "{firmware:?}");
        home.switch_on();
        home.mode(1, 6);
        home.drive().modes();
        home.go_home(1).drained().cycles(20);
        home.host.go(MasterState::PreOp).cycles(200);
        assert_eq!((home.drive().modes(), home.phase(1)), (vec![], HomingPhase::Idle), "{firmware:?}");
        home.host.go(MasterState::Op);
        home.switch_on();
        let here = home.drive().position();
        home.host.csp(1, here).drained();
        assert_eq!((home.host.counters().rejected_total(), home.drive().jump()), (0, 0), "{firmware:?}");
    }
}

/// SK-7.25 Forty slaves that homed together are restored one after the other, and a host that keeps asking does not
/// keep them from it.
#[test]
fn forty_slaves_are_restored() {
    let mut home = Home::ready_of(40, Firmware::V17, None);
    home.host.build(|frame, size| {
        (1..=40).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::GoHome.into()));
    });
    home.host.drained();
    for n in 0..3000u16 {
        home.host.sdo(read_method(1 + (n % 40) as u8)).cycle();
    }
    assert!((1..=40).all(|slave| home.phase(slave) == HomingPhase::Idle));
    assert!(home.drives.iter().all(|drive| drive.modes() == [8] && drive.jump() == 0));
}

/// SK-7.25 Homing, its end, restoring and a transfer that fails allocate nothing.
#[test]
fn homing_allocates_nothing() {
    for how in [None, Some(Ahead::kind(64, 4, 333_333, 700))] {
        let mut home = Home::ready_of(8, Firmware::V17, how);
        home.network.abort_sdo(3, Some(AbortCode(0x0800_0022)));
        let counted = measure(|| {
            home.host.build(|frame, size| {
                (1..=8).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::GoHome.into()));
            });
            home.host.cycles(10).slave(2, SlaveCommand::ServoOff).cycles(500);
        });
        assert_eq!((counted.count_total, counted.count_current), (0, 0), "{how:?}: {counted:?}");
        assert!((1..=8).all(|slave| home.phase(slave) == HomingPhase::Idle), "{how:?}");
        assert_eq!(home.host.counters().modes_not_restored, 1, "{how:?}");
    }
}
