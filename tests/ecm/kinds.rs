//! The native API with steppers and pulse modules.

use crate::common::{Tap, config, cycles, enabled, follow, steps};
use ecmsk::ecm::{Axis, Homing, Slave, SlaveView};
use ecmsk::link::Link;
use ecmsk::sk::AxisTarget;

/// SK-3.20 SK-7.36 A stepper follows its targets, and homes.
#[test]
fn a_stepper_moves_and_homes() {
    for keys in ["slaves=step", "slaves=step&slot=16", "slaves=step&fw=1.5"] {
        let (tap, ecm) = Tap::enabled(keys, &config(vec![Slave::Step(Axis::CSP)]));
        let start = ecm.snapshot().unwrap().position(1).unwrap();
        let mut stream = ecm.stream(8).unwrap();
        follow(&mut stream, 1, start, 2, 500);
        drop(stream);
        let position = ecm.snapshot().unwrap().position(1).unwrap();
        assert!((position - start - 998).abs() < 400, "{keys}: {position}");
        ecm.home(1, &Homing { offset: Some(0), ..Homing::method(35) }, |_| {}).unwrap();
        assert!(ecm.snapshot().unwrap().position(1).unwrap().abs() < 50, "{keys}");
        assert_eq!(tap.stats().board.unwrap().rejected_total(), 0, "{keys}");
    }
}

/// SK-7.35 SK-3.23 A pulse module in CSV: both channels turn at their velocities, outputs come back as inputs, and the ramp
/// brings both to a standstill.
#[test]
fn both_channels_of_a_pulse_module_run_by_velocity() {
    let ecm = enabled("slaves=hsp2&slot=16", &config(vec![Slave::Hsp(Axis::CSV)]));
    let hsp = || match ecm.snapshot().unwrap().slave(1) {
        Some(SlaveView::Hsp(hsp)) => hsp,
        other => panic!("{other:?}"),
    };
    let start = hsp();
    let mut stream = ecm.stream(8).unwrap();
    let of = |target, outputs| AxisTarget { target, outputs };
    stream.csv_hsp(1, of(20_000, 1), of(-10_000, 2)).unwrap();
    steps(&mut stream, 1000);
    let turning = hsp();
    let (first, second) =
        (turning.first.position - start.first.position, turning.second.position - start.second.position);
    assert!((18_000..=20_000).contains(&first) && (-10_000..=-9_000).contains(&second), "{first} {second}");
    assert_eq!((turning.first.inputs & 3, turning.second.inputs & 3), (1, 2));
    stream.finish().unwrap();
    let rest = hsp();
    cycles(&ecm, 50);
    let later = hsp();
    let moved = |a: i32, b: i32| (a - b).abs();
    assert!(moved(rest.first.position, later.first.position) <= 1, "{rest:?} {later:?}");
    assert!(moved(rest.second.position, later.second.position) <= 1, "{rest:?} {later:?}");
    assert!(rest.first.position - turning.first.position < 20_000 / 4, "it ramps in 250 ms");
}

/// SK-7.35 One channel in 12-byte slots, too.
#[test]
fn one_channel_of_a_pulse_module_runs_by_velocity() {
    for keys in ["slaves=hsp", "slaves=hsp&slot=16", "slaves=hsp2"] {
        let ecm = enabled(keys, &config(vec![Slave::Hsp(Axis::CSV)]));
        let start = ecm.snapshot().unwrap().position(1).unwrap();
        let mut stream = ecm.stream(8).unwrap();
        stream.csv(1, -5000).unwrap();
        steps(&mut stream, 1000);
        let moved = stream.snapshot().unwrap().position(1).unwrap() - start;
        assert!((-5000..=-4500).contains(&moved), "{keys}: {moved}");
    }
}
