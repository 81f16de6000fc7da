//! Everything that ends a run in a homing error: bit 13 of the statusword, an axis that brakes to rest.

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::coe::SdoSize;
use ecmsk::slave::homing::HomingError;
use ecmsk::slave::{HomeSwitch, Input, Slave, Travel};
use support::homing_tables::METHODS;

use super::bench::{Bench, Bits, CAM, FIRST, LAST, Outcome, travel};
use crate::wired::{jam, stick};

const INPUTS: [Input; 4] = [Input::NegativeLimit, Input::PositiveLimit, Input::Home, Input::Index];

/// Refused at the start: the axis has not moved, and stays in Operation enabled.
fn refused(mut bench: Bench, method: i8, error: HomingError) {
    let start = bench.shaft();
    assert_eq!(bench.home(method), Outcome { first: '.', end: Err(error) }, "method {method}");
    bench.run_for_ms(50);
    assert_eq!((bench.bits(), bench.shaft(), bench.steps), (Bits::Error, start, 0), "method {method}");
    assert_eq!(bench.rig.status().0 & 0xFF, 0x37);
}

/// An unknown method.
#[test]
fn unsupported_methods() {
    for method in i8::MIN..=i8::MAX {
        if !METHODS.contains(&method) {
            refused(Bench::new(travel(CAM), 0), method, HomingError::UnsupportedMethod(method));
        }
    }
}

/// The inputs that each method needs, by the table of CiA 402-2: negative limit, positive limit, home, index.
fn needs(method: i8) -> [bool; 4] {
    let (negative, positive, home) = match method {
        1 | 17 => (true, false, false),
        2 | 18 => (false, true, false),
        3..=6 | 19..=22 => (false, false, true),
        7..=10 | 23..=26 => (false, true, true),
        11..=14 | 27..=30 => (true, false, true),
        _ => (false, false, false),
    };
    [negative, positive, home, matches!(method, 1..=14 | 33 | 34)]
}

/// An input that the method needs is not wired: an error at the start. One that it does not need may be missing.
#[test]
fn missing_inputs() {
    for method in METHODS {
        for (input, needed) in INPUTS.into_iter().zip(needs(method)) {
            let mut without = travel(CAM);
            match input {
                Input::NegativeLimit => without.negative_limit = None,
                Input::PositiveLimit => without.positive_limit = None,
                Input::Home => without.home = None,
                Input::Index => without.index = None,
            }
            let mut bench = Bench::new(without, 0);
            if needed {
                refused(bench, method, HomingError::NotWired { method, input });
            } else {
                assert!(bench.home(method).end.is_ok(), "method {method} without {input:?}");
            }
        }
    }
}

/// Methods 35 and 37 need nothing at all.
#[test]
fn nothing_wired() {
    for method in METHODS {
        let mut bench = Bench::new(Travel::NONE, 4711);
        let end = bench.home(method).end;
        assert_eq!(end.ok(), matches!(method, 35 | 37).then_some(4711), "method {method}");
    }
}

/// Both limit switches active at once: no run begins, and one under way ends.
#[test]
fn both_limits() {
    for method in METHODS.into_iter().filter(|method| *method < 35) {
        let mut bench = Bench::new(travel(CAM), 0);
        for input in [Input::NegativeLimit, Input::PositiveLimit] {
            assert!(bench.rig.drive.apply_fault(stick(input, Some(true))));
        }
        assert_eq!(bench.rig.read(0x60FD, 0) & 0b11, 0b11);
        refused(bench, method, HomingError::BothLimits);
    }
    let mut bench = Bench::new(travel(CAM), -210_000);
    bench.start(18);
    bench.run_for_ms(20);
    bench.rig.drive.apply_fault(stick(Input::NegativeLimit, Some(true)));
    assert_eq!(bench.bits(), Bits::Running, "on its own it leads off the switch");
    bench.rig.drive.apply_fault(stick(Input::PositiveLimit, Some(true)));
    bench.run_for_ms(100);
    assert_eq!((bench.bits(), bench.error()), (Bits::Error, HomingError::BothLimits));
}

/// A switch that sticks: no edge comes, and the run ends on a limit switch or on the bound of its way.
#[test]
fn stuck_switches() {
    use Input::*;
    let too_far = HomingError::TooFar(2_000_000);
    for (method, input, value, error) in [
        (1, NegativeLimit, false, too_far),
        (17, NegativeLimit, true, HomingError::WrongLimit(PositiveLimit)),
        (18, PositiveLimit, true, HomingError::WrongLimit(NegativeLimit)),
        (2, PositiveLimit, false, too_far),
        (3, Home, false, HomingError::WrongLimit(PositiveLimit)),
        (20, Home, true, HomingError::WrongLimit(NegativeLimit)),
        (21, Home, true, HomingError::WrongLimit(PositiveLimit)),
        (6, Home, false, HomingError::WrongLimit(NegativeLimit)),
        (7, Home, false, HomingError::WrongLimit(NegativeLimit)),
        (24, Home, true, HomingError::WrongLimit(NegativeLimit)),
        (25, Home, true, HomingError::WrongLimit(NegativeLimit)),
        (11, Home, false, HomingError::WrongLimit(PositiveLimit)),
        (30, Home, true, HomingError::WrongLimit(PositiveLimit)),
        (10, PositiveLimit, true, HomingError::WrongLimit(PositiveLimit)),
        (1, Index, true, HomingError::WrongLimit(PositiveLimit)),
        (11, Index, false, HomingError::WrongLimit(PositiveLimit)),
        (33, Index, false, HomingError::WrongLimit(NegativeLimit)),
        (34, Index, true, HomingError::WrongLimit(PositiveLimit)),
    ] {
        let mut bench = Bench::new(travel(CAM), -100_000);
        assert!(bench.rig.drive.apply_fault(stick(input, Some(value))));
        let end = bench.home(method).end;
        // A run that a stuck limit sends to the other limit sees both limits at once.
        let both = value && matches!(input, NegativeLimit | PositiveLimit) && end == Err(HomingError::BothLimits);
        assert!(end == Err(error) || both, "method {method}, {input:?} at {value}: {end:?}");
        assert_eq!((bench.bits(), bench.steps), (Bits::Error, 0));
        // The switch works again, and so does homing.
        bench.rig.drive.apply_fault(stick(input, None));
        let nearest = if bench.shaft() < 0 { (17, -199_999) } else { (18, 299_999) };
        assert_eq!(bench.home(nearest.0).end, Ok(nearest.1));
    }
}

/// No run goes towards a limit switch that is active: not at its start, not after a turn.
#[test]
fn towards_an_active_limit() {
    let with_stuck_limit = || {
        let mut bench = Bench::new(travel(CAM), 10_000);
        bench.rig.drive.apply_fault(stick(Input::PositiveLimit, Some(true)));
        bench
    };
    // The run goes off the cam to the left, to come back to its edge: there the switch shows the end of the travel.
    for method in [4, 8, 20, 24] {
        let mut bench = with_stuck_limit();
        let end = bench.home(method).end;
        assert_eq!((end, bench.steps), (Err(HomingError::WrongLimit(Input::PositiveLimit)), 0), "method {method}");
        assert!(bench.shaft() < FIRST);
    }
    refused(with_stuck_limit(), 34, HomingError::WrongLimit(Input::PositiveLimit));
}

/// A limit switch turns a run back once.
#[test]
fn the_same_limit_twice() {
    for (method, start, limit) in [(26, 150_000, Input::PositiveLimit), (30, -100_000, Input::NegativeLimit)] {
        let mut bench = Bench::new(travel(CAM), start);
        bench.start(method);
        // To the limit switch and back to the cam, whose switch then sticks.
        while bench.rig.read(0x60FD, 0) != 0b100 {
            assert_eq!(bench.cycle(), Bits::Running, "method {method}");
        }
        bench.rig.drive.apply_fault(stick(Input::Home, Some(true)));
        bench.run_for_ms(3_000);
        assert_eq!((bench.bits(), bench.error()), (Bits::Error, HomingError::WrongLimit(limit)), "method {method}");
    }
}

/// A start while the shaft moves: bit 13, and it brakes.
#[test]
fn started_in_motion() {
    let mut bench = Bench::new(travel(CAM), -190_000);
    bench.start(20);
    bench.run_for_ms(100);
    bench.controlword(0);
    bench.cycle();
    bench.controlword(Controlword::HOMING_START);
    bench.cycle();
    assert_eq!((bench.cycle(), bench.error()), (Bits::ErrorMoving, HomingError::Moving));
    bench.run_for_ms(200);
    assert_eq!((bench.bits(), bench.steps), (Bits::Error, 0));
    assert!(bench.shaft() < FIRST);
}

/// A start while the shaft is still commanded to move is an error, too, although it is jammed and at rest.
#[test]
fn started_while_it_is_asked_to_move() {
    let mut bench = Bench::new(travel(CAM), -190_000);
    bench.start(20);
    bench.run_for_ms(100);
    assert!(bench.rig.drive.apply_fault(jam(true)));
    bench.cycle();
    bench.controlword(0);
    bench.cycle();
    assert_eq!(bench.rig.velocity(), 0.0);
    bench.controlword(Controlword::HOMING_START);
    bench.cycle();
    assert_eq!((bench.cycle(), bench.error()), (Bits::ErrorMoving, HomingError::Moving));
}

/// A speed of 0 is an error.
#[test]
fn no_speed() {
    for sub in [1, 2] {
        let mut bench = Bench::new(travel(CAM), 0);
        bench.rig.write(0x6099, sub, SdoSize::Four, 0);
        refused(bench, 20, HomingError::NoSpeed);
        let mut bench = Bench::new(travel(CAM), 0);
        bench.rig.write(0x6099, sub, SdoSize::Four, 0);
        assert_eq!(bench.home(35).end, Ok(0), "it needs none");
    }
}

/// A run without switches at the ends of its way ends on the bound of its way.
#[test]
fn too_far() {
    let open = Travel { negative_limit: None, positive_limit: None, search_limit: 700_000, ..travel(CAM) };
    for (method, direction) in [(20, 1), (22, -1)] {
        let start = if direction > 0 { LAST + 100 } else { FIRST - 100 };
        let mut bench = Bench::new(open, start);
        assert_eq!(bench.home(method).end, Err(HomingError::TooFar(700_000)));
        let way = (bench.shaft() - start) * direction;
        assert!((700_000..720_000).contains(&way), "{way}");
    }
}

/// A limit switch that comes while the axis slows down after having found the home switch is an error for a method
/// without limits, and none for a method that turns there.
#[test]
fn a_limit_on_the_ramp() {
    let home = HomeSwitch::From(299_000);
    let end = Bench::new(travel(home), 0).home(19).end;
    assert_eq!(end, Err(HomingError::WrongLimit(Input::PositiveLimit)));
    assert_eq!(Bench::new(travel(home), 0).home(23).end, Ok(298_999));
}

/// The error is gone with the next start, and with the mode.
#[test]
fn what_ends_an_error() {
    let mut bench = Bench::new(travel(CAM), 0);
    assert!(bench.home(15).end.is_err());
    bench.set_mode(Mode::Csp);
    bench.rig.cycle();
    assert_eq!(bench.rig.status().0 & 0x3000, 0x1000, "it follows its target");
    bench.set_mode(Mode::Homing);
    assert_eq!(bench.cycle(), Bits::NotRunning);
    assert!(bench.home(15).end.is_err());
    assert_eq!(bench.home(35).end, Ok(0));
}

/// Every error text has the next step.
#[test]
fn messages() {
    let error = HomingError::NotWired { method: 7, input: Input::PositiveLimit };
    assert_eq!(
        error.to_string(),
        "homing method 7 needs the positive limit switch, which is not wired; choose another method"
    );
    assert!(HomingError::UnsupportedMethod(15).to_string().contains("1..14, 17..30, 33, 34, 35, 37"));
}
