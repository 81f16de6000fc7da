//! The ends of homing other than success.

use ecmsk::coe::SdoSize;
use ecmsk::engine::{Firmware, HomingEnd, HomingPhase, Reason};
use ecmsk::sk::{CommandId, MasterCommand, MasterState, Motion, SlaveCommand};

use crate::homer::{BIT_4, BIT_10, BIT_12, BIT_13, Home, Script};
use crate::network_rig::buses;
use crate::puppet::{DISABLED, FAULT, FAULT_REACTION, QUICK_STOP, READY, SWITCHED_ON};
use crate::rig::ahead;
use support::ahead_bus::Ahead;

const PROFILES: [Firmware; 2] = [Firmware::V17, Firmware::V15];

/// One drive in the middle of a long homing.
fn homing(firmware: Firmware) -> Home {
    homing_of(1, firmware)
}

fn homing_of(n: usize, firmware: Firmware) -> Home {
    let mut home = Home::ready_of(n, firmware, None);
    home.drives.iter().for_each(|drive| drive.script(Script { takes: 5000, ..Script::default() }));
    home.host.build(|frame, size| {
        (1..=n).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::GoHome.into()));
    });
    home.host.drained().cycles(20);
    assert!((1..=n).all(|slave| home.phase(slave) == HomingPhase::Homing));
    home.drives.iter().for_each(|drive| drop(drive.words()));
    home
}

/// SK-7.21 Bit 13 ends homing; the drive stays on.
#[test]
fn an_error_ends_homing() {
    for firmware in PROFILES {
        for error in [BIT_13, BIT_13 | BIT_10, BIT_13 | BIT_12 | BIT_10] {
            let mut home = homing(firmware);
            let mark = home.host.mark();
            home.drive().script(Script { takes: 1, result: error, ..Script::default() });
            home.host.cycles(30);
            assert_eq!(home.ends(mark), [(1, HomingEnd::Error)], "{firmware:?} {error:04x}");
            assert_eq!(home.drive().words(), [0x1F, 0x0F], "{firmware:?}: bit 4 falls");
            home.host.cycles(600);
            assert_eq!(home.phase(1), HomingPhase::Idle);
        }
    }
}

/// SK-7.21 A fault ends homing, and so does any other way out of Operation enabled; it does not go on later.
#[test]
fn leaving_operation_enabled_ends_homing() {
    for firmware in PROFILES {
        for word in [FAULT, FAULT_REACTION, DISABLED, READY, SWITCHED_ON, QUICK_STOP] {
            let mut home = homing(firmware);
            let mark = home.host.mark();
            home.drive().fall(word);
            home.host.cycles(30);
            assert_eq!(home.ends(mark), [(1, HomingEnd::NotEnabled)], "{firmware:?} {word:04x}");
            assert_eq!(home.phase(1), HomingPhase::Idle);
            home.drive().fall(DISABLED);
            home.host.cycles(5);
            home.switch_on();
            home.host.cycles(100);
            assert_eq!((home.phase(1), home.drive().words()), (HomingPhase::Idle, vec![]), "{firmware:?}");
            assert_eq!(home.drive().jump(), 0);
        }
    }
}

/// SK-7.21 SK-7.43 SV_OFF ends homing; the drive walks down as usual.
#[test]
fn servo_off_ends_homing() {
    for firmware in PROFILES {
        let mut home = homing(firmware);
        let mark = home.host.mark();
        home.host.slave(1, SlaveCommand::ServoOff).drained().cycles(30);
        assert_eq!(home.ends(mark), [(1, HomingEnd::ServoOff)]);
        let words = home.drive().words();
        assert_eq!(words.last(), Some(&0x00), "{words:02x?}");
        assert!(words[1..].iter().all(|word| word & BIT_4 == 0), "{words:02x?}");
        assert_eq!((home.phase(1), home.ignored()), (HomingPhase::Idle, 0));
        home.switch_on();
    }
}

/// SK-4.30 ABORT_HOME in any drive slot ends the homing of all slaves; SK-7.21 bit 4 falls and the drives stay on.
/// SK-4.29 Its answer is the drive's slot with its id, also where nothing is homing.
#[test]
fn abort_home_in_any_slot_ends_all() {
    for firmware in PROFILES {
        for slot in 1..=4 {
            let mut home = homing_of(3, firmware);
            let mark = home.host.mark();
            // The fourth slot has no slave: the command is rejected and ends no homing.
            home.host.slave(slot, SlaveCommand::AbortHome).drained().cycles(3);
            if slot == 4 {
                assert_eq!((home.ends(mark), home.phase(2)), (vec![], HomingPhase::Homing));
                continue;
            }
            assert_eq!(home.host.drive(slot).head.id, 0x19, "{firmware:?}");
            assert_eq!(home.ends(mark), [1, 2, 3].map(|slave| (slave, HomingEnd::Aborted)), "{firmware:?} {slot}");
            home.host.cycles(100);
            for (n, drive) in home.drives.iter().enumerate() {
                let words = drive.words();
                assert!(words.is_empty() || words == [0x1F, 0x0F], "{firmware:?} {slot}: bit 4 falls: {words:02x?}");
                assert_eq!(drive.state().last.controlword.0, 0x0F);
                assert!(home.host.drive(n + 1).statusword.is_enabled());
                assert_eq!((drive.jump(), home.phase(n + 1)), (0, HomingPhase::Idle));
            }
            home.host.slave(slot, SlaveCommand::AbortHome).drained();
            assert_eq!(home.host.drive(slot).head.id, 0x19);
            assert_eq!(home.host.counters().rejected_total(), 0, "{firmware:?}");
        }
    }
}

/// SK-4.30 ABORT_HOME in the frame after GO_HOME leaves no homing behind, however short bit 4 was up.
#[test]
fn an_abort_right_after_go_home() {
    for how in std::iter::once(None).chain(ahead().map(Some)) {
        for firmware in PROFILES {
            for gap in 0..4 {
                let mut home = Home::ready(firmware, how);
                home.host.slave(1, SlaveCommand::GoHome).cycles(gap).slave(1, SlaveCommand::AbortHome);
                home.host.drained().cycles(700);
                assert_eq!(home.phase(1), HomingPhase::Idle, "{firmware:?} {how:?} {gap}");
                let words = home.drive().words();
                assert!(words.is_empty() || words == [0x1F, 0x0F], "{words:02x?}");
                assert!(home.drive().jump() == 0, "{words:02x?}");
            }
        }
    }
}

/// SK-7.56 ABORT_HOME in any slot of a frame, the first or the last, keeps each GO_HOME of that frame from starting, and ends what
/// was homing. Those are answered and counted, and the drives stay in mode 6: the next GO_HOME is one like any other.
#[test]
fn an_abort_in_the_frame_of_go_home() {
    for how in std::iter::once(None).chain(ahead().map(Some)) {
        for firmware in PROFILES {
            for abort in 1..=3 {
                let mut home = Home::ready_of(3, firmware, how);
                home.drives.iter().for_each(|drive| drive.script(Script { takes: 5000, ..Script::default() }));
                home.host.build(|frame, size| {
                    for slave in 1..=3 {
                        let command = if slave == abort { SlaveCommand::AbortHome } else { SlaveCommand::GoHome };
                        frame.put_slave(size, slave, &command.into());
                    }
                });
                home.host.drained().cycles(30);
                let what = format!("{firmware:?} {how:?} {abort}");
                for slave in 1..=3 {
                    let drive = &home.drives[slave - 1];
                    assert_eq!((home.phase(slave), drive.begun(), drive.mode()), (HomingPhase::Idle, 0, 6), "{what}");
                    let id = if slave == abort { CommandId::AbortHome } else { CommandId::GoHome };
                    assert_eq!(home.host.drive(slave).head.id, id.code(), "{what}");
                }
                let counters = home.host.counters();
                assert_eq!((counters.ignored_homing, counters.rejected_total()), (2, 0), "{what}");
                home.go_home(1).drained().cycles(40);
                assert_eq!((home.phase(1), home.drives[0].begun()), (HomingPhase::Homing, 1), "{what}");
            }
        }
    }
}

/// SK-7.56 The same with ABORT_HOME in the slot of a lost slave, the first or the last (ecm-sk 13: "ABORT_HOME in any slot").
#[test]
fn an_abort_in_a_lost_slot_in_the_frame_of_go_home() {
    for how in buses() {
        for firmware in PROFILES {
            for lost in [1, 3] {
                let mut home = Home::ready_of(3, firmware, how);
                home.drives.iter().for_each(|drive| drive.script(Script { takes: 5000, ..Script::default() }));
                home.network.silence(lost, true);
                home.host.until("the loss", |host| host.state().0 == 0x18);
                home.host.build(|frame, size| {
                    for slave in 1..=3 {
                        let is_lost = slave == usize::from(lost);
                        let command = if is_lost { SlaveCommand::AbortHome } else { SlaveCommand::GoHome };
                        frame.put_slave(size, slave, &command.into());
                    }
                });
                home.host.drained().cycles(30);
                let what = format!("{firmware:?} {how:?} {lost}");
                for slave in (1..=3).filter(|slave| *slave != usize::from(lost)) {
                    let state = (home.phase(slave), home.drives[slave - 1].begun());
                    assert_eq!(state, (HomingPhase::Idle, 0), "{what}: no axis moves");
                    assert_eq!(home.host.drive(slave).head.id, CommandId::GoHome.code(), "{what}");
                }
                let counters = home.host.counters();
                assert_eq!((counters.ignored_homing, counters.rejected_total()), (2, 0), "{what}");
            }
        }
    }
}

/// Two drives of which one is homing, and then a frame with a command for that one and one for the other.
fn beside_a_homing(firmware: Firmware, how: Option<Ahead>, homing: usize, commands: [SlaveCommand; 2]) -> Home {
    let mut home = Home::ready_of(2, firmware, how);
    home.drives.iter().for_each(|drive| drive.script(Script { takes: 5000, ..Script::default() }));
    home.go_home(homing).drained().cycles(20);
    assert_eq!(home.phase(homing), HomingPhase::Homing);
    home.host.build(|frame, size| {
        for (slave, command) in [homing, 3 - homing].into_iter().zip(commands) {
            frame.put_slave(size, slave, &command.into());
        }
    });
    home.host.drained().cycles(30);
    home
}

/// SK-7.27 Homing of all slaves must have ended before a GO_HOME for another one: an SV_OFF in the same frame ends it too
/// late, whichever slot is first. In profile 1.5 (SK-3.9) the other slave starts, also whichever is first.
#[test]
fn a_servo_off_in_the_frame_of_another_go_home() {
    for how in buses() {
        for firmware in PROFILES {
            for homing in [1, 2] {
                let other = 3 - homing;
                let home = beside_a_homing(firmware, how, homing, [SlaveCommand::ServoOff, SlaveCommand::GoHome]);
                let refused = firmware == Firmware::V17;
                let what = format!("{firmware:?} {how:?} {homing}");
                assert_eq!(home.host.drive(homing).head.id, CommandId::ServoOff.code(), "{what}");
                assert_ne!(home.phase(homing), HomingPhase::Homing, "{what}");
                let id = if refused { CommandId::GetStatus } else { CommandId::GoHome };
                let shown = (home.host.drive(other).head.id, home.drives[other - 1].begun());
                assert_eq!(shown, (id.code(), u32::from(!refused)), "{what}");
                let counters = home.host.counters();
                let told = (counters.rejected[Reason::HomingElsewhere.kind()], counters.rejected_total());
                assert_eq!(told, (refused.into(), refused.into()), "{what}");
                assert_eq!(counters.ignored_homing, 0, "{what}");
            }
        }
    }
}

/// SK-7.56 An ABORT_HOME that ends a homing, and a GO_HOME for another slave in its frame: the GO_HOME is answered and
/// counted and does not start, whichever slot is first.
#[test]
fn an_abort_of_a_homing_in_the_frame_of_another_go_home() {
    for how in buses() {
        for firmware in PROFILES {
            for homing in [1, 2] {
                let other = 3 - homing;
                let home = beside_a_homing(firmware, how, homing, [SlaveCommand::AbortHome, SlaveCommand::GoHome]);
                let what = format!("{firmware:?} {how:?} {homing}");
                assert_ne!(home.phase(homing), HomingPhase::Homing, "{what}");
                let shown = (home.host.drive(other).head.id, home.drives[other - 1].begun(), home.phase(other));
                assert_eq!(shown, (CommandId::GoHome.code(), 0, HomingPhase::Idle), "{what}");
                let counters = home.host.counters();
                assert_eq!((counters.ignored_homing, counters.rejected_total()), (1, 0), "{what}");
            }
        }
    }
}

/// SK-7.37 SK-7.29 A command for a slave that is homing counts as ignored, and never as rejected, also beside the ABORT_HOME
/// in another slot that ends this homing, whichever slot is first.
#[test]
fn a_command_beside_the_abort_of_its_homing() {
    for how in buses() {
        for firmware in PROFILES {
            for homing in [1, 2] {
                for command in [SlaveCommand::Csp(Motion::to(7)), SlaveCommand::GoHome] {
                    let home = beside_a_homing(firmware, how, homing, [command, SlaveCommand::AbortHome]);
                    let what = format!("{firmware:?} {how:?} {homing} {command:?}");
                    assert_ne!(home.phase(homing), HomingPhase::Homing, "{what}");
                    assert_eq!(home.drives[homing - 1].begun(), 1, "{what}");
                    let counters = home.host.counters();
                    assert_eq!((counters.ignored_homing, counters.rejected_total()), (1, 0), "{what}");
                }
            }
        }
    }
}

/// SK-7.21 Leaving OP ends homing, and it does not go on in the next OP.
#[test]
fn leaving_op_ends_homing() {
    for firmware in PROFILES {
        for state in [MasterState::SafeOp, MasterState::PreOp, MasterState::Init] {
            let mut home = homing(firmware);
            let mark = home.host.mark();
            home.host.go(state).cycles(30);
            assert_eq!(home.ends(mark), [(1, HomingEnd::LeftOp)], "{firmware:?} {state}");
            assert_eq!(home.phase(1), HomingPhase::Idle, "{firmware:?} {state}");
            if state == MasterState::Init {
                home.host.go(MasterState::PreOp);
            }
            home.host.go(MasterState::Op).cycles(5);
            home.switch_on();
            home.host.cycles(100);
            assert_eq!((home.drive().words(), home.phase(1)), (vec![], HomingPhase::Idle), "{firmware:?}");
        }
    }
}

/// SK-4.33 SW_RESET ends homing.
#[test]
fn a_reset_forgets_homing() {
    for firmware in PROFILES {
        let mut home = homing(firmware);
        home.host.soft_reset().cycles(20);
        assert_eq!(home.phase(1), HomingPhase::Idle);
        home.host.op(1);
        home.switch_on();
        home.mode(1, 6);
        home.go_home(1).drained().cycles(20);
        assert_eq!((home.phase(1), home.drive().begun()), (HomingPhase::Homing, 2), "{firmware:?}");
    }
}

/// SK-7.21 Loss of a slave ends its homing, and no other one's. SK-7.42 Its mode is not restored, which is counted.
#[test]
fn a_lost_slave_is_not_homing() {
    for firmware in PROFILES {
        let mut home = homing_of(3, firmware);
        let mark = home.host.mark();
        home.network.silence(2, true);
        home.host.cycles(30);
        assert_eq!(home.ends(mark), [(2, HomingEnd::Lost)], "{firmware:?}");
        let phases = [1, 2, 3].map(|slave| home.phase(slave));
        assert_eq!(phases, [HomingPhase::Homing, HomingPhase::Idle, HomingPhase::Homing], "{firmware:?}");
        let given_up = u64::from(firmware == Firmware::V17);
        assert_eq!(home.host.counters().modes_not_restored, given_up);
    }
}

/// SK-6.5 A host's write of 0x6060 ends that slave's homing, whatever it writes; SK-7.21 bit 4 falls before the mode
/// changes. Other objects and other slaves are not concerned.
#[test]
fn the_hosts_write_of_the_mode_ends_homing() {
    for firmware in PROFILES {
        for mode in [8, 6, 9] {
            let mut home = homing_of(2, firmware);
            let mark = home.host.mark();
            home.host.write_object(1, 0x6098, 0, SdoSize::One, 17).unwrap();
            home.host.read_object(1, 0x6060, 0).unwrap();
            assert_eq!(home.ends(mark), [], "{firmware:?}");
            let begun = home.host.mark();
            assert_eq!(home.host.write_object(1, 0x6060, 0, SdoSize::One, mode), Ok(mode));
            assert_eq!(home.ends(begun), [(1, HomingEnd::ModeWritten)], "{firmware:?} {mode}");
            assert_eq!(home.phase(2), HomingPhase::Homing);
            let words = home.drives[0].words();
            assert_eq!(words, [0x1F, 0x0F], "{firmware:?}");
            home.host.cycles(700);
            assert_eq!((home.phase(1), home.drives[0].mode()), (HomingPhase::Idle, mode as u8), "{firmware:?}");
            assert_eq!(home.drives[0].jump(), 0);
        }
    }
}

/// SK-7.21 The end of one slave's homing does not end the others'.
#[test]
fn each_slave_has_its_own_end() {
    for firmware in PROFILES {
        let mut home = homing_of(3, firmware);
        let mark = home.host.mark();
        home.drives[0].script(Script { takes: 1, ..Script::default() });
        home.drives[1].fall(FAULT);
        home.host.cycles(40).master(MasterCommand::GetStatus);
        let ends = home.ends(mark);
        assert!(ends.contains(&(1, HomingEnd::Attained)) && ends.contains(&(2, HomingEnd::NotEnabled)), "{ends:?}");
        assert_eq!((ends.len(), home.phase(3)), (2, HomingPhase::Homing), "{firmware:?}");
        home.drives[2].script(Script { takes: 1, result: BIT_10 | BIT_12, ..Script::default() });
        home.host.cycles(40);
        assert_eq!(home.ends(mark).last(), Some(&(3, HomingEnd::Attained)));
    }
}

/// SK-7.21 Each end has a text, as a log shows it.
#[test]
fn every_end_is_worded() {
    use HomingEnd::*;
    let ends = [Attained, Error, NotEnabled, ServoOff, Aborted, ModeWritten, LeftOp, Lost];
    let words = ends.map(|end| end.to_string());
    for (n, text) in words.iter().enumerate() {
        assert!(text.len() > 5 && !words[..n].contains(text), "{:?}: {text:?}", ends[n]);
    }
    assert!(words[1].contains("bit 13") && words[7].contains("cable"), "what to look at");
}
