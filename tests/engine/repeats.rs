//! A bus that owns its cycle repeats the newest outputs by itself: it gets none while no axis has new ones.

use ecmsk::cia402::Mode;
use ecmsk::engine::{Firmware, HomingPhase};
use ecmsk::sk::{DriveSync, SlaveCommand};

use crate::homer::{BIT_4, Home, Script};
use crate::puppet::{DISABLED, FAULT};
use crate::rig::ahead;
use support::ahead_bus::Ahead;

/// One drive, on and in mode 6, whose targets in its own mode do not follow its position.
fn ready(firmware: Firmware, how: Ahead) -> Home {
    let mut home = Home::in_preop(1, firmware, Some(how));
    home.host.slave(1, SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync }).op(1);
    home.switch_on();
    home.mode(1, 6);
    home
}

/// The number of sets of outputs that the bus gets in that many cycles.
fn given(home: &mut Home, cycles: usize) -> u64 {
    let before = home.jobs.pushes();
    home.host.cycles(cycles);
    home.jobs.pushes() - before
}

/// SK-5.3 A drive that stands, is homing, has homed, or whose fault was reset, needs no new outputs.
#[test]
fn nothing_new_is_not_given_again() {
    for how in ahead() {
        let mut home = ready(Firmware::V15, how);
        home.host.cycles(100);
        assert_eq!(given(&mut home, 200), 0, "{how:?}: it stands");
        home.drive().script(Script { takes: 300, ..Script::default() });
        home.go_home(1).drained().cycles(60);
        assert_eq!(home.phase(1), HomingPhase::Homing, "{how:?}");
        assert_eq!(given(&mut home, 100), 0, "{how:?}: it goes home");
        home.until_phase(1, HomingPhase::Idle);
        home.host.cycles(60);
        assert_eq!(given(&mut home, 200), 0, "{how:?}: it is home");
        home.drive().fall(FAULT);
        home.host.cycles(20);
        home.host.slave(1, SlaveCommand::AlarmClear).drained().cycles(10);
        home.drive().fall(DISABLED);
        home.host.cycles(60);
        assert_eq!(given(&mut home, 200), 0, "{how:?}: its fault is gone");
    }
}

/// SK-7.40 Bit 4 has been low for long enough when no outputs are left to be sent: the next homing begins with the
/// outputs of its GO_HOME.
#[test]
fn bit_4_has_rested_meanwhile() {
    for how in ahead() {
        let mut home = ready(Firmware::V15, how);
        for begun in 1..=3 {
            home.host.cycles(100);
            home.drive().state().words.clear();
            home.go_home(1);
            home.host.cycles(30);
            assert_eq!(home.drive().begun(), begun, "{how:?}");
            let low = home.drive().state().words.iter().take_while(|word| **word & BIT_4 == 0).count();
            assert!(low <= 2, "{how:?}: {low} sets of outputs before bit 4, homing {begun}");
            home.until_phase(1, HomingPhase::Idle);
        }
    }
}

/// SK-5.3 One entry is taken in each cycle of OP: cycles that found none are counted, and no others.
#[test]
fn cycles_without_an_entry_are_counted() {
    let mut home = Home::in_preop(1, Firmware::V17, None);
    let idle = |home: &Home| home.host.counters().idle_cycles;
    home.host.cycles(50);
    assert_eq!(idle(&home), 0, "before OP");
    home.host.op(1).drained();
    for (entries, cycles) in [(0, 25), (1, 25), (7, 7), (10, 40)] {
        let before = idle(&home);
        (0..entries).for_each(|_| home.arrive_idle());
        home.host.cycles(cycles);
        assert_eq!(idle(&home) - before, (cycles - entries) as u64, "{entries} entries in {cycles} cycles");
    }
}
