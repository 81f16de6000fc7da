//! GO_HOME: its conditions, its start, the drive's answers that count, and the commands that are ignored meanwhile.

use ecmsk::coe::SdoSize;
use ecmsk::engine::{Firmware, HomingEnd, HomingPhase, Reason};
use ecmsk::sk::{CommandId, FifoAction, Frame, MasterCommand, Motion, SlaveCommand};

use crate::homer::{BIT_4, BIT_10, BIT_12, BIT_13, Home, Script};
use crate::puppet::{DISABLED, FAULT};
use crate::rig::ahead;
use support::ahead_bus::Ahead;

const PROFILES: [Firmware; 2] = [Firmware::V17, Firmware::V15];
/// On and homing: Enable operation with bit 4.
const HOMING: u16 = 0x1F;

fn every_bus() -> impl Iterator<Item = (Firmware, Option<Ahead>)> {
    let buses = || std::iter::once(None).chain(ahead().map(Some));
    PROFILES.into_iter().flat_map(move |firmware| buses().map(move |how| (firmware, how)))
}

fn rejected(home: &Home, reason: Reason) -> u64 {
    home.host.counters().rejected[reason.kind()]
}

/// SK-7.19 Before GO_HOME the application writes 0x6060 = 6, 0x6098 and what else it likes by SDO.
/// SK-7.20 Homing is done when bits 10 and 12 are both 1. SK-4.28 The answer is the drive's slot with the command's id.
#[test]
fn a_drive_goes_home() {
    for (firmware, how) in every_bus() {
        let mut home = Home::on(1, firmware, how);
        let writes = [(0x6060, SdoSize::One, 6), (0x6098, SdoSize::One, 35), (0x607C, SdoSize::Four, 77)];
        for (index, size, value) in writes {
            assert_eq!(home.host.write_object(1, index, 0, size, value), Ok(value));
        }
        for (sub, value) in [(1, 5000), (2, 500)] {
            assert_eq!(home.host.write_object(1, 0x6099, sub, SdoSize::Four, value), Ok(value));
        }
        let (mark, before) = (home.host.mark(), home.host.counters());
        home.drive().words();
        home.go_home(1).drained().cycles(8);
        assert_eq!(home.phase(1), HomingPhase::Homing, "{firmware:?} {how:?}");
        assert_eq!(home.host.drive(1).head.id, 0x18);
        home.host.until("home", |host| host.drive(1).position == -700_000).cycles(80);
        let status = home.host.drive(1).statusword.0;
        assert_eq!((status & 0x6F, status & (BIT_10 | BIT_12)), (0x27, BIT_10 | BIT_12), "{firmware:?} {how:?}");
        assert_eq!(home.ends(mark), [(1, HomingEnd::Attained)], "{firmware:?} {how:?}");
        assert_eq!(home.phase(1), HomingPhase::Idle);
        assert_eq!(home.drive().words(), [HOMING, 0x0F], "{firmware:?} {how:?}: one edge, and it ends");
        assert_eq!((home.drive().begun(), home.drive().jump()), (1, 0));
        let after = home.host.counters();
        assert_eq!((after.rejected_total(), after.ignored_homing), (before.rejected_total(), 0));
    }
}

/// SK-7.20 SK-7.39 Bits 10 and 12 of an earlier homing, or of another mode, are no end: however late the drive sees
/// bit 4 (up to 20 ms), and however far ahead a bus takes outputs.
#[test]
fn old_results_do_not_count() {
    for (firmware, how) in every_bus() {
        for deaf in [0, 1, 2, 5, 15] {
            let mut home = Home::ready(firmware, how);
            for old in [BIT_10 | BIT_12, BIT_13 | BIT_10, BIT_10, 0] {
                home.drive().fall(0x0237 | old);
                home.drive().script(Script { deaf, takes: 50, ..Script::default() });
                home.host.cycles(20);
                let (mark, begun) = (home.host.mark(), home.drive().begun());
                home.go_home(1);
                home.until_phase(1, HomingPhase::Homing);
                home.host.until("an end", |host| host.board.engine().homing_phase(1) != HomingPhase::Homing);
                let state = (home.drive().position(), home.drive().begun() - begun);
                assert_eq!(state, (-700_000, 1), "{firmware:?} {how:?} {deaf} {old:04x}: it was home");
                assert_eq!(home.ends(mark), [(1, HomingEnd::Attained)]);
                home.host.cycles(150);
                home.drive().state().shows.position = 100;
                home.host.cycles(20);
                home.mode(1, 6);
            }
        }
    }
}

/// SK-7.20 SK-7.39 The end of a drive that is home at once (methods 35 and 37) and whose bits never clear is accepted
/// after a while. SK-7.21 So is that of a drive that is in error at once.
#[test]
fn a_drive_that_is_home_at_once() {
    let results = [(BIT_10 | BIT_12, HomingEnd::Attained), (BIT_13 | BIT_10, HomingEnd::Error)];
    for (firmware, how) in every_bus() {
        for (result, end) in results {
            let mut home = Home::ready(firmware, how);
            home.drive().fall(0x0237 | result);
            home.drive().script(Script { takes: 0, result, ..Script::default() });
            home.host.cycles(20);
            let mark = home.host.mark();
            home.go_home(1).drained().cycles(200);
            assert_eq!(home.ends(mark), [(1, end)], "{firmware:?} {how:?}");
            assert_eq!(home.phase(1), HomingPhase::Idle);
        }
    }
}

/// SK-7.20 Only both bits together are an end.
#[test]
fn one_bit_is_no_end() {
    for firmware in PROFILES {
        let mut home = Home::ready(firmware, None);
        home.drive().script(Script { takes: 3, result: 0, ..Script::default() });
        home.go_home(1).drained().cycles(10);
        for bits in [BIT_10, BIT_12, 0, BIT_12, BIT_10] {
            home.drive().fall(0x0237 | bits);
            home.host.cycles(300);
            assert_eq!(home.phase(1), HomingPhase::Homing, "{firmware:?} {bits:04x}");
        }
        home.drive().fall(0x0237 | BIT_10 | BIT_12);
        home.host.cycles(3);
        assert_ne!(home.phase(1), HomingPhase::Homing);
    }
}

/// SK-7.30 GO_HOME for a drive not in mode 6, as written last, is rejected, and does nothing.
#[test]
fn go_home_needs_mode_6() {
    for firmware in PROFILES {
        let mut home = Home::on(1, firmware, None);
        for (n, mode) in [8, 9, 10, 8].into_iter().enumerate() {
            home.mode(1, mode);
            home.host.write_object(1, 0x6060, 0, SdoSize::One, 99).unwrap_err();
            let mark = home.host.mark();
            home.go_home(1).drained().cycles(30);
            let rejection = (1, CommandId::GoHome, Reason::NotInHomingMode);
            assert_eq!(home.host.rejections(mark), [rejection], "{firmware:?} {mode}");
            assert_eq!(rejected(&home, Reason::NotInHomingMode), n as u64 + 1);
            assert_eq!((home.phase(1), home.host.drive(1).head.id), (HomingPhase::Idle, 0));
        }
        assert_eq!(home.drive().words(), [0; 0]);
        assert_eq!(home.drive().begun(), 0);
    }
}

/// SK-7.38 GO_HOME for a drive that is not on is rejected, and no motor homes because of it later.
#[test]
fn go_home_needs_a_drive_that_is_on() {
    for firmware in PROFILES {
        let mut home = Home::ready(firmware, None);
        home.host.slave(1, SlaveCommand::ServoOff).cycles(2);
        home.go_home(1).drained().cycles(50);
        home.go_home(1).drained();
        assert_eq!(rejected(&home, Reason::NotEnabled), 2, "on its way down, and down");
        assert_eq!(home.host.drive(1).head.id, 0, "not executed");
        home.switch_on();
        home.drive().fall(FAULT);
        home.host.cycles(2);
        home.go_home(1).drained().cycles(30);
        assert_eq!(rejected(&home, Reason::NotEnabled), 3, "in a fault");
        home.drive().fall(DISABLED);
        home.host.cycles(3);
        home.switch_on();
        home.host.cycles(100);
        assert_eq!((home.phase(1), home.drive().words()), (HomingPhase::Idle, vec![]), "{firmware:?}");
        home.go_home(1).drained().cycles(10);
        assert_eq!(home.drive().begun(), 1, "{firmware:?}");
    }
}

/// SK-7.28 Several GO_HOME slots in one frame start together.
/// SK-7.27 One in a later frame for another slave is rejected while any is homing; SK-3.9 not in profile 1.5.
/// SK-7.26 Restoring no longer counts as homing for that.
#[test]
fn one_homing_at_a_time() {
    for (firmware, how) in every_bus() {
        let mut home = Home::ready_of(4, firmware, how);
        home.drives[0].script(Script { takes: 30, ..Script::default() });
        home.drives[1].script(Script { takes: 80, ..Script::default() });
        home.drives[2].script(Script { takes: 500, ..Script::default() });
        home.host.build(|frame, size| {
            frame.put_slave(size, 1, &SlaveCommand::GoHome.into());
            frame.put_slave(size, 2, &SlaveCommand::GoHome.into());
        });
        home.host.drained().cycles(8);
        let begun = |home: &Home| home.drives.iter().map(|drive| drive.begun()).collect::<Vec<_>>();
        assert_eq!(begun(&home), [1, 1, 0, 0], "{firmware:?} {how:?}");
        home.go_home(3).drained().cycles(8);
        let refused = u64::from(firmware == Firmware::V17);
        assert_eq!(rejected(&home, Reason::HomingElsewhere), refused, "{firmware:?} {how:?}");
        assert_eq!(begun(&home), [1, 1, 1 - refused as u32, 0], "{firmware:?} {how:?}");
        if firmware == Firmware::V15 {
            continue;
        }
        home.host.until("the end of 1", |host| host.board.engine().homing_phase(1) != HomingPhase::Homing);
        home.go_home(3).drained();
        assert_eq!(rejected(&home, Reason::HomingElsewhere), 2, "{how:?}: 2 is homing still");
        home.network.delay_sdo(2, 500_000_000);
        home.until_phase(2, HomingPhase::Restoring);
        home.go_home(3).drained().cycles(8);
        assert_eq!(home.phase(2), HomingPhase::Restoring, "{how:?}");
        assert_eq!((rejected(&home, Reason::HomingElsewhere), begun(&home)), (2, vec![1, 1, 1, 0]), "{how:?}");
    }
}

/// SK-7.37 CSP, CSV and CST for a drive that is homing are not executed and count as ignored, never as rejected.
/// SK-7.29 So does a repeated GO_HOME. SK-4.45 They are counted. SK-7.26 So is SV_ON.
/// SK-3.30 Its slot shows the command that was executed last.
/// SK-7.43 ALM_CLR is none of them and harms nothing. SK-7.55
#[test]
fn what_comes_while_homing_is_ignored_and_counted() {
    for firmware in PROFILES {
        let mut home = Home::ready_of(2, firmware, None);
        home.drives[0].script(Script { takes: 2000, ..Script::default() });
        home.go_home(1).drained().cycles(5);
        home.drives[0].words();
        let to = Motion::to(123_456);
        let commands = [
            SlaveCommand::Csp(to),
            SlaveCommand::Csv(to),
            SlaveCommand::Cst(99),
            SlaveCommand::GoHome,
            SlaveCommand::ServoOn,
        ];
        for (n, command) in commands.into_iter().enumerate() {
            home.host.slave(1, command).drained().cycles(3);
            assert_eq!(home.ignored(), n as u64 + 1, "{firmware:?} {command:?}");
            // SK-7.55 SV_ON alone is answered, though it has no effect.
            let shown = if command == SlaveCommand::ServoOn { CommandId::ServoOn } else { CommandId::GoHome };
            assert_eq!(home.host.drive(1).head.id, shown.code(), "the one executed last");
        }
        home.host.slave(1, SlaveCommand::AlarmClear).slave(1, SlaveCommand::GetStatus).drained();
        let counters = home.host.counters();
        assert_eq!((counters.ignored_homing, counters.rejected_total()), (5, 0), "{firmware:?}");
        assert_eq!(counters.discarded_before_enabled, 0, "counted once");
        assert_eq!((home.drives[0].words(), home.phase(1)), (vec![HOMING], HomingPhase::Homing));
        assert_ne!(home.drives[0].target(), 123_456);
        // Another slave is not concerned.
        home.host.csp(2, 1).drained();
        assert_eq!((home.ignored(), rejected(&home, Reason::WrongMode)), (5, 1), "2 is in mode 6 and idle");
    }
}

/// SK-7.40 A second homing has an edge of bit 4 of its own, and the drive gets time to see that the bit was low.
/// SK-3.8 In profile 1.5 it needs no other mode in between.
#[test]
fn a_second_homing_has_its_own_edge() {
    for how in std::iter::once(None).chain(ahead().map(Some)) {
        for deaf in [0, 7] {
            let mut home = Home::ready(Firmware::V15, how);
            home.drive().script(Script { deaf, ..Script::default() });
            for n in 1..=4 {
                home.go_home(1);
                home.until_phase(1, HomingPhase::Homing);
                home.until_phase(1, HomingPhase::Idle);
                assert_eq!(home.drive().begun(), n, "{how:?}: right after the end");
            }
            let rests = home.drive().state().words.clone();
            let lows = rests.split(|word| word & BIT_4 != 0).filter(|low| !low.is_empty());
            assert!(lows.skip(1).all(|low| low.len() >= 8), "{how:?}");
            let counters = home.host.counters();
            assert_eq!((counters.rejected_total(), counters.ignored_homing), (0, 0), "{how:?}");
        }
    }
}

/// SK-7.16 While a drive homes, its target follows the actual position only.
#[test]
fn the_target_follows_while_homing() {
    for firmware in PROFILES {
        let mut home = Home::ready(firmware, None);
        home.drive().script(Script { takes: 100, ..Script::default() });
        home.go_home(1).drained().cycles(5);
        while home.phase(1) == HomingPhase::Homing {
            let shown = home.host.drive(1).position;
            home.host.csp(1, 7);
            home.host.cycle();
            let target = home.drive().target();
            assert!((shown..=shown + 1000).contains(&target) || target == -700_000, "{target} after {shown}");
        }
        home.host.cycles(3);
        assert_eq!(home.drive().target(), -700_000, "{firmware:?}");
    }
}

/// SK-5.22 A GO_HOME that a SET_FIFO clear takes back has no effect, and neither has an ABORT_HOME. A homing that the
/// drive has ended stays ended.
#[test]
fn a_clear_takes_homing_back() {
    let clear = MasterCommand::SetFifo(FifoAction::Clear);
    for how in ahead().filter(|how| how.depth > 1) {
        for firmware in PROFILES {
            let mut home = Home::ready(firmware, Some(how));
            home.drive().script(Script { takes: 400, ..Script::default() });
            let take_back = |home: &mut Home, command: SlaveCommand| {
                (0..how.depth / 2).for_each(|_| home.arrive_idle());
                let mut frame = Frame::new();
                frame.put_slave(home.host.size, 1, &command.into());
                home.host.arrive(&frame).cycles(1).master(clear).cycles(60);
            };
            take_back(&mut home, SlaveCommand::GoHome);
            assert_eq!((home.phase(1), home.drive().words()), (HomingPhase::Idle, vec![]), "{how:?}");
            home.go_home(1).drained().cycles(30);
            assert_eq!((home.phase(1), home.drive().words()), (HomingPhase::Homing, vec![HOMING]), "{how:?}");
            take_back(&mut home, SlaveCommand::AbortHome);
            assert_eq!((home.phase(1), home.drive().words()), (HomingPhase::Homing, vec![HOMING]), "{how:?}");
            assert_eq!(home.drive().begun(), 1, "{how:?}");

            // The drive comes home while the bus has entries ahead that are then taken back.
            let mark = home.host.mark();
            home.drive().fall(0x0237 | BIT_10 | BIT_12);
            home.drive().script(Script { takes: 0, ..Script::default() });
            (0..80).for_each(|_| home.arrive_idle());
            home.host.until("the end", |host| host.board.engine().homing_phase(1) != HomingPhase::Homing);
            home.host.master(clear).cycles(100);
            assert_eq!(
                (home.phase(1), home.ends(mark)),
                (HomingPhase::Idle, vec![(1, HomingEnd::Attained)]),
                "{how:?}"
            );
            assert_eq!(home.drive().words(), [HOMING, 0x0F], "{how:?}");
        }
    }
}
