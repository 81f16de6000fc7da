//! The native API's homing of several axes at once.

use std::time::Duration;

use crate::common::{SIZE, Tap, enable, open, script};
use ecmsk::cia402::MODES_OF_OPERATION;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Config, Ecm, EcmError, Homing, HomingPhase, Options, Slave};
use ecmsk::link::Link;
use ecmsk::sk::CommandId;

fn modes(ecm: &Ecm, slaves: &[u8]) -> Vec<u8> {
    let object = ObjectAddress::new(MODES_OF_OPERATION, 0);
    slaves.iter().map(|slave| ecm.sdo_read(*slave, object).unwrap()).collect()
}

fn homed(slave: u8, offset: i32) -> (u8, Homing) {
    (slave, Homing { offset: Some(offset), ..Homing::method(33) })
}

/// Moves axes away from where they began.
fn away(ecm: &Ecm, slaves: &[u8]) {
    let mut stream = ecm.stream(8).unwrap();
    for n in 0..200 {
        slaves.iter().for_each(|slave| stream.csp(*slave, n * 10 * i32::from(*slave)).unwrap());
        stream.step().unwrap();
    }
}

/// SK-7.27 Several GO_HOME are sent in one frame and in no other, on either firmware; each axis is homed and takes
/// targets again, although one is homed sooner than another.
#[test]
fn several_axes_home_from_one_frame() {
    for keys in ["slaves=drive*3,io", "slaves=drive*3,io&fw=1.5", "slaves=drive*3,io&slot=16"] {
        let slaves = [vec![Slave::Drive(Axis::CSP); 3], vec![Slave::Io]].concat();
        let (tap, ecm) = Tap::enabled(keys, &Config { slaves, ..Config::default() });
        away(&ecm, &[1, 2, 3]);
        tap.take();
        let mut phases = [const { Vec::new() }; 4];
        let slow = (2, Homing { switch_speed: Some(2000), ..homed(2, 700).1 });
        ecm.home_all(&[homed(1, 0), slow, homed(3, -500)], |progress| {
            let phases = &mut phases[usize::from(progress.slave)];
            if phases.last() != Some(&progress.phase) {
                phases.push(progress.phase);
            }
        })
        .unwrap_or_else(|error| panic!("{keys}: {error}"));
        if !keys.contains("slot=16") {
            let frames = tap.take();
            let go = |slot| frames.iter().filter(|f| f.slot(SIZE, slot).id == CommandId::GoHome.code()).count();
            assert_eq!([go(1), go(2), go(3)], [1, 1, 1]);
            let together = frames.iter().find(|f| f.slot(SIZE, 1).id == CommandId::GoHome.code()).unwrap();
            assert!((1..=3).all(|slot| together.slot(SIZE, slot).id == CommandId::GoHome.code()));
        }
        let each = [HomingPhase::Preparing, HomingPhase::Moving, HomingPhase::Restoring];
        assert!(phases[1..].iter().all(|phases| phases == &each), "{keys}: {phases:?}");
        let snapshot = ecm.snapshot().unwrap();
        for (slave, home) in [(1, 0), (2, 700), (3, -500)] {
            let position = snapshot.position(slave).unwrap();
            assert!((position - home).abs() < 300, "{keys}: slave {slave} is at {position}");
        }
        assert_eq!(modes(&ecm, &[1, 2, 3]), [8, 8, 8]);
        let at = [1, 2, 3].map(|slave| snapshot.position(slave).unwrap());
        let mut stream = ecm.stream(8).unwrap();
        for n in 0..100 {
            (1..).zip(at).for_each(|(slave, at)| stream.csp(slave, at + n * 20).unwrap());
            stream.step().unwrap();
        }
        drop(stream);
        let there = ecm.snapshot().unwrap();
        assert!((1..).zip(at).all(|(slave, at)| there.position(slave).unwrap() > at + 1500), "{keys}");
        let board = tap.stats().board.unwrap();
        assert_eq!((board.rejected_total(), board.ignored_homing), (0, 0), "{keys}");
    }
}

/// One that fails ends the homing of all: when the call is back no axis homes, and all are in their mode.
#[test]
fn a_homing_that_fails_ends_the_homing_of_all_axes() {
    for keys in ["slaves=drive*2", "slaves=drive*2&fw=1.5"] {
        let (tap, ecm) = Tap::enabled(keys, &Config::drives(2));
        let slow = Homing { switch_speed: Some(1), ..Homing::method(17) };
        tap.take();
        let error = ecm.home_all(&[(1, slow), (2, Homing::method(99))], |_| {}).unwrap_err();
        assert!(matches!(error, EcmError::HomingFailed { slave: 2, .. }), "{keys}: {error}");
        // Before the modes are set back, one after the other.
        let frames = tap.take();
        let at = |code: u8, slot| frames.iter().rposition(|frame| frame.slot(SIZE, slot).id == code).unwrap();
        let abort = at(CommandId::AbortHome.code(), 1);
        let before = frames[..abort].iter().rev().find(|frame| !frame.slot(SIZE, 1).is_zero()).unwrap();
        assert_eq!(before.slot(SIZE, 1).id, CommandId::GoHome.code(), "{keys}");
        assert!(frames[abort..].iter().filter(|frame| frame.slot(SIZE, 41).id != 0).count() >= 2, "{keys}");
        assert_eq!(modes(&ecm, &[1, 2]), [8, 8], "{keys}");
        away(&ecm, &[1, 2]);
        ecm.home_all(&[homed(1, 0), homed(2, 0)], |_| {}).unwrap_or_else(|error| panic!("{keys}: {error}"));
        assert_eq!(tap.stats().board.unwrap().rejected_total(), 0, "{keys}");
    }
}

/// An alarm of one axis ends all, too, and is the error.
#[test]
fn an_alarm_of_one_axis_ends_the_homing_of_all() {
    let file = script("homing-alarm", "at 1s alarm 1 0x7500\n");
    let ecm = enable(open(&format!("slaves=drive*2&script={file}")), &Config::drives(2));
    let slow = Homing { switch_speed: Some(1), ..Homing::method(17) };
    let error = ecm.home_all(&[(1, slow), (2, slow)], |_| {}).unwrap_err();
    assert_eq!(error, EcmError::Alarm { slave: 1, code: 0x7500 });
    ecm.clear_alarm(&[1]).unwrap();
    ecm.servo_on(&[1]).unwrap();
    ecm.home_all(&[homed(1, 0), homed(2, 0)], |_| {}).unwrap();
}

/// For invalid slaves nothing is sent: a slave named twice, one that is no axis, one that is off.
#[test]
fn an_invalid_list_of_axes_sends_nothing() {
    let tap = Tap::open("slaves=drive*2,io");
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSP), Slave::Io];
    let ecm = tap.ecm(Options::default()).unwrap();
    crate::common::in_op(&ecm, &Config { slaves, ..Config::default() });
    ecm.servo_on(&[1]).unwrap();
    tap.take();
    let home = |slaves: &[u8]| {
        let axes: Vec<_> = slaves.iter().map(|slave| homed(*slave, 0)).collect();
        ecm.home_all(&axes, |_| {})
    };
    assert!(matches!(home(&[1, 2, 1]), Err(EcmError::Setting { .. })));
    assert!(matches!(home(&[1, 3]), Err(EcmError::WrongKind { slave: 3, .. })));
    assert!(matches!(home(&[1, 2]), Err(EcmError::NotEnabled { slave: 2, .. })));
    assert!(matches!(home(&[9]), Err(EcmError::NoSuchSlave { slave: 9, .. })));
    assert_eq!(home(&[]), Ok(()));
    assert!(tap.take().is_empty());
    // Nothing of a refused list stays: axis 1 takes targets.
    ecm.stream(4).unwrap().csp(1, 0).unwrap();
}

/// The longest limit holds for all, and an axis that is not home by then ends it.
#[test]
fn the_longest_limit_holds() {
    let ecm = enable(open("slaves=drive*2"), &Config::drives(2));
    let second = Duration::from_secs(1);
    let slow = |limit| Homing { switch_speed: Some(1), limit, ..Homing::method(17) };
    let error = ecm.home_all(&[(1, slow(second)), (2, slow(second * 3))], |_| {}).unwrap_err();
    let EcmError::Timeout { what: "homing", waited, seen, .. } = error else { panic!("{error}") };
    assert!(waited >= second * 3 && waited < second * 4, "{waited:?}");
    assert!(seen.contains("slave 1") && seen.contains("slave 2"), "{seen}");
    assert_eq!(modes(&ecm, &[1, 2]), [8, 8]);
}

/// A mode that cannot be set back is an error, of the slave that it is; the others are in theirs.
#[test]
fn a_mode_that_stays_is_told() {
    let file = script("homing-stays", "at 1s sdo-abort 1 0x6060:0 0x08000022 for 20s\n");
    let ecm = enable(open(&format!("slaves=drive*2&fw=1.5&script={file}")), &Config::drives(2));
    let error = ecm.home_all(&[(1, Homing::method(17)), (2, Homing::method(17))], |_| {}).unwrap_err();
    let mode = ObjectAddress::new(MODES_OF_OPERATION, 0);
    assert!(matches!(error, EcmError::SdoAborted { slave: 1, object, .. } if object == mode), "{error}");
    assert_eq!(modes(&ecm, &[2]), [8]);
}

/// API-14 An axis that homes during an open stream gets none of the stream's targets, neither then nor afterwards.
#[test]
fn homing_beside_a_stream() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2", &Config::drives(2));
    let mut stream = ecm.stream(8).unwrap();
    for n in 0..100 {
        stream.csp(1, n * 10).unwrap();
        stream.csp(2, n * 10).unwrap();
        stream.step().unwrap();
    }
    ecm.home(1, &homed(1, 0).1, |_| {}).unwrap();
    assert_eq!(tap.stats().board.unwrap().ignored_homing, 0);
    tap.take();
    stream.step().unwrap();
    let frame = tap.take().remove(0);
    assert!(frame.slot(SIZE, 1).is_zero());
    assert_eq!(frame.slot(SIZE, 2).data1, 990);
}
