//! The native API's targets between two steps: the report by which they are checked, targets of an axis that is
//! switched off, and allocations.

use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, enable, script};
use ecmsk::ecm::{Axis, Config, Ecm, EcmError, Guard, Slave, SoftLimits};
use ecmsk::link::Link;
use ecmsk::sk::CommandId;

/// A target is sent with the step that follows it and with no other frame; a stream that ends before it steps has not
/// sent it.
#[test]
fn a_target_waits_for_its_step() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    let mut stream = ecm.stream(8).unwrap();
    stream.csp(1, 0).unwrap();
    stream.step().unwrap();
    tap.take();
    stream.csp(1, 500).unwrap();
    ecm.local_inputs().unwrap();
    let slots = tap.take_slots(1);
    assert!(!slots.is_empty() && slots.iter().all(|slot| (slot.id, slot.data1) == (CommandId::Csp.code(), 0)));
    drop(stream);
    assert!(tap.take_slots(1).iter().all(|slot| slot.data1 != 500));
}

/// The guard uses the newest report, whichever thread has read it.
#[test]
fn the_guard_goes_by_the_newest_report() {
    let axis = Axis { guard: Guard::Within(1000), ..Axis::CSP };
    let config = Config { slaves: vec![Slave::Drive(axis)], ..Config::default() };
    let (tap, ecm) = Tap::enabled("slaves=drive", &config);
    let mut stream = ecm.stream(8).unwrap();
    tap.bend_slot(1, |_, slot| slot.data1 = 5000);
    stream.csp(1, 1000).unwrap();
    ecm.next_cycle(SECOND).unwrap();
    assert_eq!(stream.csp(1, 1000), Err(EcmError::TooFar { slave: 1, target: 1000, actual: 5000, limit: 1000 }));
    stream.csp(1, 6000).unwrap();
}

/// Soft limits: a target beyond them is refused and nothing of it is sent, so that the axis keeps its last one; an axis beyond
/// them may come back, and go no further out. The same for axes of a machine file, whatever that says of other programs.
#[test]
fn soft_limits_hold() {
    let limits = SoftLimits { min: 100, max: 300 };
    let axis = Axis { limits, ..Axis::CSP };
    let config = Config { slaves: vec![Slave::Drive(axis)], ..Config::default() };
    let (tap, ecm) = Tap::enabled("slaves=drive", &config);
    let refused = |target| Err(EcmError::SoftLimit { slave: 1, target, limits });
    let mut stream = ecm.stream(8).unwrap();
    // The axis is at 0, so it is beyond the lower limit.
    assert_eq!(stream.csp(1, -1), refused(-1));
    for target in (0..=300).step_by(10) {
        stream.csp(1, target).unwrap();
        stream.step().unwrap();
    }
    tap.take();
    assert_eq!(stream.csp(1, 301), refused(301));
    assert_eq!(stream.csp(1, i32::MIN), refused(i32::MIN));
    stream.step().unwrap();
    assert!(tap.take_slots(1).iter().all(|slot| slot.data1 == 300));
    stream.csp(1, 299).unwrap();
    // The report of an axis that was pushed out.
    tap.bend_slot(1, |_, slot| slot.data1 = 340);
    ecm.next_cycle(SECOND).unwrap();
    assert_eq!(stream.csp(1, 341), refused(341));
    stream.csp(1, 339).unwrap();
    drop(stream);

    let file = script(
        "limits",
        "format = 1\nlink = \"sim:?clock=virtual\"\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.01, max = 3 }\n",
    );
    let (ecm, machine) = Ecm::open_machine(file.as_ref()).unwrap();
    let ecm = enable(ecm, &Config::of_machine(&machine));
    let mut stream = ecm.stream(8).unwrap();
    stream.csp_units(1, 3.0).unwrap();
    let beyond = stream.csp_units(1, 3.01).unwrap_err();
    assert!(beyond.to_string().contains("beyond its soft limits -2147483648 to 300 (counts)"), "{beyond}");
}

/// API-14 SK-7.15 An axis that was off between a target and its step gets no target, though it is on again.
#[test]
fn an_axis_that_was_off_does_not_jump() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2", &Config::drives(2));
    let mut stream = ecm.stream(8).unwrap();
    for slave in [1, 2] {
        stream.csp(slave, 40).unwrap();
    }
    ecm.servo_off(&[1]).unwrap();
    ecm.servo_on(&[1]).unwrap();
    tap.take();
    stream.step().unwrap();
    let frame = tap.take().remove(0);
    assert!(frame.slot(SIZE, 1).is_zero(), "{:?}", frame.slot(SIZE, 1));
    assert_eq!(frame.slot(SIZE, 2).data1, 40);
    stream.csp(1, 41).unwrap();
    stream.step().unwrap();
    assert_eq!(tap.take()[0].slot(SIZE, 1).data1, 41);
}

/// API-14 The same where an alarm took it off and the program steps on.
#[test]
fn an_axis_with_an_alarm_is_left_out() {
    let file = script("targets-alarm", "at 1s alarm 1 0x7500\n");
    let (tap, ecm) = Tap::enabled(&format!("slaves=drive*2&script={file}"), &Config::drives(2));
    let mut stream = ecm.stream(8).unwrap();
    stream.csp(1, 7).unwrap();
    stream.csp(2, 7).unwrap();
    while stream.snapshot().unwrap().drive(1).unwrap().statusword.is_enabled() {
        stream.step().unwrap();
    }
    tap.take();
    stream.step().unwrap();
    let frame = tap.take().remove(0);
    assert!(frame.slot(SIZE, 1).is_zero());
    assert_eq!(frame.slot(SIZE, 2).data1, 7);
}

/// On the real clock a stream of 40 axes allocates nothing, either.
#[test]
fn a_stream_on_the_real_clock_allocates_nothing() {
    let ecm = enable(Ecm::open("sim:?slaves=drive*40&clock=real").unwrap(), &Config::drives(40));
    let mut stream = ecm.stream(100).unwrap();
    let mut run = |from: i32| {
        for n in from..from + 200 {
            (1..=40).for_each(|slave| stream.csp(slave, n).unwrap());
            stream.step().unwrap();
            assert!(stream.snapshot().unwrap().drive(40).is_some());
        }
    };
    run(0);
    let counted = allocation_counter::measure(|| run(200));
    assert_eq!((counted.count_total, counted.count_current), (0, 0), "{counted:?}");
    assert_eq!(stream.stats().unwrap().losses, 0);
}

/// SK-5.11 A stream of any depth, against a board that pauses and goes on: it never overfills.
#[test]
fn credit_never_overfills() {
    for depth in [1, 2, 16, 149, 150] {
        let file = script(&format!("targets-full-{depth}"), "at 1s full for 300ms\nat 2s full for 5ms\n");
        let (tap, ecm) = Tap::enabled(&format!("slaves=drive&host_us=0&script={file}"), &Config::drives(1));
        let mut stream = ecm.stream(depth).unwrap();
        for n in 0..2500_u64 {
            if n % 7 == 0 {
                tap.pass(Duration::from_micros(n % 3000)).unwrap();
            }
            stream.step().unwrap();
        }
        let stats = stream.finish().unwrap();
        assert_eq!((stats.losses, tap.stats().board.unwrap().full), (0, 0), "depth {depth}");
    }
}
