//! Drives that are home at once (methods 35 and 37): what the slot shows, what the board accepts, and when the next
//! slave may go home.

use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, Firmware, HomingEnd, HomingPhase, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{CommandId, SlaveCommand};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use crate::homer::{BIT_10, BIT_12, BIT_13, Home, Script};
use crate::host::Host;
use crate::network_rig::buses;

const DONE: u16 = BIT_10 | BIT_12;
/// On, before bits 10, 12 and 13.
const ON: u16 = 0x0237;

/// Whether a slave's slot shows GO_HOME, and a result.
fn says(host: &Host, slave: usize, result: u16) -> bool {
    let drive = host.drive(slave);
    drive.head.id == CommandId::GoHome.code() && drive.statusword.0 & result == result
}

/// SK-7.20 SK-7.27 Bits 10 and 12 under GO_HOME, or bit 13, are the end: the next slave may go home with the very next
/// frame, whatever the drive showed before, and however long the board itself waits with the mode.
#[test]
fn the_next_one_goes_as_soon_as_the_slot_says_so() {
    for how in buses() {
        for (old, result) in [(DONE, DONE), (0, DONE), (BIT_10, DONE), (BIT_13 | BIT_10, BIT_13 | BIT_10), (0, BIT_13)]
        {
            let mut home = Home::ready_of(2, Firmware::V17, how);
            let what = format!("{how:?} {old:04x} {result:04x}");
            home.drives[0].fall(ON | old);
            home.drives[0].script(Script { takes: 0, result, ..Script::default() });
            home.host.cycles(60);
            home.go_home(1).until("the result", |host| says(host, 1, result));
            home.go_home(2).drained().cycles(8);
            assert_eq!(home.host.counters().rejected[Reason::HomingElsewhere.kind()], 0, "{what}");
            assert_eq!([0, 1].map(|n| home.drives[n].begun()), [1, 1], "{what}: each is asked once");
            home.until_phase(1, HomingPhase::Idle);
            home.until_phase(2, HomingPhase::Idle);
            assert_eq!([0, 1].map(|n| home.drives[n].mode()), [8, 8], "{what}: both modes come back");
        }
    }
}

/// SK-7.27 The same with the simulated drive and each method that ends where it begins: a program that homes one after
/// another, as soon as the slot allows it.
#[test]
fn drives_one_after_another() {
    for method in [35, 37] {
        let drives = (0..4).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>);
        let mut host = Host::new(EngineConfig::default(), SimBus::new(drives.collect()));
        host.op(4);
        for slave in 1..=4 {
            host.servo_on(slave);
            host.write_object(slave as u8, 0x6060, 0, SdoSize::One, 6).unwrap();
            host.write_object(slave as u8, 0x6098, 0, SdoSize::One, method).unwrap();
        }
        let mark = host.mark();
        for slave in 1..=4 {
            host.slave(slave, SlaveCommand::GoHome).until("home", |host| says(host, slave, DONE));
        }
        assert_eq!(host.rejections(mark), [], "method {method}");
        for slave in 1..=4 {
            host.until("the mode", |host| host.board.engine().homing_phase(slave) == HomingPhase::Idle);
            assert_eq!(host.read_object(slave, 0x6061, 0), Ok(8), "method {method}");
        }
    }
}

/// SK-7.39 If a drive has shown no result in mode 6 for 20 ms, its first answer after bit 4 counts.
#[test]
fn without_an_old_result_a_new_one_counts_at_once() {
    for (result, end) in [(DONE, HomingEnd::Attained), (BIT_13, HomingEnd::Error)] {
        let mut home = Home::ready(Firmware::V17, None);
        home.drive().fall(ON);
        home.drive().script(Script { takes: 0, result, ..Script::default() });
        home.host.cycles(25);
        let mark = home.host.mark();
        home.go_home(1).until("the result", |host| host.drive(1).statusword.0 & result == result);
        assert_eq!(home.ends(mark), [(1, end)]);
    }
}

/// SK-7.39 An old result does not count: neither one that appears within 20 ms after the mode was written, nor one that
/// appears, by itself or with SV_ON, in the last cycle before bit 4.
#[test]
fn an_old_result_that_comes_up_late_is_none() {
    type Late = fn(&mut Home);
    let cases: [(&str, Late); 5] = [
        ("the mode is new", |home| home.mode(1, 6)),
        ("the mode is 10 ms old", |home| {
            home.mode(1, 6);
            home.host.cycles(10);
        }),
        ("by itself", |home| home.drive().fall(ON | DONE)),
        ("by itself, an error", |home| home.drive().fall(ON | BIT_13)),
        ("off and on", |home| {
            home.host.slave(1, SlaveCommand::ServoOff).cycles(30);
            home.host.servo_on(1).cycles(1);
        }),
    ];
    for how in buses() {
        for (what, late) in cases {
            let mut home = Home::ready(Firmware::V17, how);
            home.drive().fall(ON);
            home.host.cycles(100);
            home.drive().script(Script { deaf: 12, takes: 400, ..Script::default() });
            late(&mut home);
            let (mark, begun) = (home.host.mark(), home.drive().begun());
            home.go_home(1);
            home.until_phase(1, HomingPhase::Homing);
            // The statusword until the drive has seen bit 4.
            home.drive().fall(ON | DONE);
            home.host.until("an end", |host| host.board.engine().homing_phase(1) != HomingPhase::Homing);
            let state = (home.drive().position(), home.drive().begun() - begun);
            assert_eq!((state, home.ends(mark)), ((-700_000, 1), vec![(1, HomingEnd::Attained)]), "{what}, {how:?}");
        }
    }
}
