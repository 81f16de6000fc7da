//! Homing of a DP3CL. The tables of CiA 402-2 give the ends of the methods.

use ecmsk::slave::dp3cl::{Dp3clConfig, Dp3clVariants};
use ecmsk::slave::{HomeSwitch, Travel};
use support::homing_tables::{METHODS, Places};

use super::bench::{Bench, MS};

const PLACES: Places = Places { limits: (-60_000, 50_000), cam: (-3000, 1000), index: 1234, turn: 10_000 };
const OFFSET: i64 = 777;

fn config(start: i64) -> Dp3clConfig {
    let travel = Travel {
        negative_limit: Some(PLACES.limits.0),
        positive_limit: Some(PLACES.limits.1),
        home: Some(HomeSwitch::Cam { first: PLACES.cam.0, last: PLACES.cam.1 }),
        index: Some(1234),
        ..Travel::for_turn(10_000)
    };
    Dp3clConfig { position: start, travel, ..Dp3clConfig::default() }
}

/// An enabled drive in homing mode with a method, at a position of the travel.
fn bench(config: Dp3clConfig, method: i64) -> Bench {
    let mut bench = Bench::enabled_with(config, 6);
    bench.write(0x6098, 0, method);
    bench.write(0x607C, 0, OFFSET);
    bench
}

/// Statusword bits 13, 12, 10.
fn bits(bench: &Bench) -> (bool, bool, bool) {
    (bench.bit(13), bench.bit(12), bench.bit(10))
}

/// Raises bit 4 and runs to the end. Returns the shaft count of home; `None`: a homing error.
fn home(bench: &mut Bench) -> Option<i64> {
    bench.word = 0x1F;
    bench.cycle();
    bench.run_until(60_000, |bench| bench.bit(10) && (bench.bit(12) || bench.bit(13)));
    bench.run_for(2 * MS);
    let at = bench.shaft() - bench.position() + OFFSET;
    bench.bit(12).then_some(at)
}

/// DP3CL-7.1 Each method from both sides of the cam, from the cam and from both limit switches.
#[test]
fn methods() {
    for method in METHODS {
        for (start, on_cam) in [(-30_000, false), (20_000, false), (-500, true)] {
            // On the cam, methods that need one of its sides start from the right one.
            let side = if on_cam && matches!(method, 5 | 6 | 21 | 22) { 20_000 } else { -30_000 };
            let from = if on_cam && !matches!(method, 33..=37) { side } else { start };
            let expected = PLACES.home(method, from);
            assert_eq!(home(&mut bench(config(start), method.into())), expected, "method {method} from {start}");
        }
        let (left, right) = PLACES.limits;
        for start in [left - 500, right + 500] {
            let (from_left, towards_left) = (start < 0, matches!(method, 33));
            let expected = match method {
                3..=6 | 19..=22 => {
                    let rises_there = matches!(method, 3 | 4 | 19 | 20) == from_left;
                    if rises_there { PLACES.home(method, start) } else { None }
                }
                33 | 34 if from_left == towards_left => None,
                _ => PLACES.home(method, start),
            };
            assert_eq!(home(&mut bench(config(start), method.into())), expected, "method {method} from {start}");
        }
    }
}

/// DP3CL-7.2 The statusword during a run, and the position of the axis afterwards.
#[test]
fn a_run() {
    let mut bench = bench(config(20_000), 21);
    assert_eq!(bits(&bench), (false, false, true), "not started");
    bench.word = 0x1F;
    bench.run_for(10 * MS);
    assert_eq!(bits(&bench), (false, false, false), "under way");
    bench.run_until(60_000, |bench| bench.bit(12));
    assert_eq!(bits(&bench), (false, true, false), "attained, and still moving");
    assert!((OFFSET..OFFSET + 100).contains(&bench.read(0x6062, 0)), "{}", bench.read(0x6062, 0));
    bench.run_until(100, |bench| bench.bit(10));
    bench.run_for(2 * MS);
    let stands = bench.position();
    assert!((OFFSET + 1..OFFSET + 50).contains(&stands), "beyond home: {stands}");
    assert_eq!(bench.shaft() - (PLACES.cam.1 + 1), stands - OFFSET);
    bench.run_for(500 * MS);
    assert_eq!((bench.position(), bits(&bench)), (stands, (false, true, true)), "it is not driven back");
}

/// DP3CL-7.2 In the mode after it the axis holds until a target comes.
#[test]
fn the_mode_after_homing() {
    let mut bench = bench(config(20_000), 35);
    assert_eq!(home(&mut bench), Some(20_000));
    bench.target = -5000;
    bench.write(0x6060, 0, 8);
    bench.cycle();
    bench.target = OFFSET as i32;
    bench.run_for(5 * MS);
    assert_eq!((bench.shaft(), bench.position()), (20_000, OFFSET));
    bench.target = OFFSET as i32 + 10;
    bench.run_for(2 * MS);
    assert_eq!(bench.shaft(), 20_010);
}

/// DP3CL-7.3 An input without a terminal, each in turn.
#[test]
fn inputs_that_are_not_assigned() {
    for method in METHODS {
        let needs = |parameter| match parameter {
            0x2206 => matches!(method, 2 | 18 | 7..=10 | 23..=26),
            0x2207 => matches!(method, 1 | 17 | 11..=14 | 27..=30),
            _ => matches!(method, 3..=14 | 19..=30),
        };
        for parameter in [0x2206, 0x2207, 0x2208] {
            let mut bench = bench(config(-30_000), method.into());
            bench.write(parameter, 0, 0);
            let is_refused = home(&mut bench).is_none() && bench.shaft() == -30_000;
            assert_eq!(is_refused, needs(parameter), "{parameter:04X} {method}");
        }
    }
}

/// DP3CL-7.4 Without an index pulse the run goes on to the limit switch.
#[test]
fn without_index() {
    let variants = Dp3clVariants { without_index: true, ..Dp3clVariants::default() };
    for (method, beyond) in [(33, PLACES.limits.0), (34, PLACES.limits.1), (2, PLACES.limits.0)] {
        let mut bench = bench(Dp3clConfig { variants, ..config(0) }, method);
        assert_eq!(home(&mut bench), None, "{method}");
        assert!((bench.shaft() - beyond).abs() < 2000, "{method}: {}", bench.shaft());
    }
    assert!(home(&mut bench(Dp3clConfig { variants, ..config(0) }, 18)).is_some());
}

/// DP3CL-7.5 Other ends of a run.
#[test]
fn errors() {
    for (index, sub) in [(0x6099, 1), (0x6099, 2), (0x609A, 0)] {
        let mut bench = bench(config(-30_000), 17);
        bench.write(index, sub, 0);
        assert_eq!((home(&mut bench), bench.shaft()), (None, -30_000), "{index:04X}");
    }
    let mut bench = bench(config(20_000), 19);
    assert_eq!(home(&mut bench), None, "the cam is on the other side");
    assert!((bench.shaft() - PLACES.limits.1).abs() < 2000, "{}", bench.shaft());
    // While it brakes there is an error and no standstill yet.
    let mut bench = self::bench(config(20_000), 19);
    bench.write(0x609A, 0, 200_000);
    bench.word = 0x1F;
    bench.run_until(60_000, |bench| bench.bit(13));
    assert_eq!(bits(&bench), (true, false, false));
    assert!(bench.velocity() != 0);
    bench.run_until(1000, |bench| bench.bit(10));
    assert_eq!((bits(&bench), bench.velocity()), ((true, false, true), 0));
    let mut bench = self::bench(config(-30_000), 18);
    bench.word = 0x1F;
    bench.run_for(100 * MS);
    bench.word = 0x06;
    bench.run_for(100 * MS);
    assert_eq!(bits(&bench), (true, false, true));
}

/// DP3CL-6.13 Halt stops a run, and the run goes on without it.
#[test]
fn halt() {
    let mut bench = bench(config(-30_000), 18);
    bench.word = 0x1F;
    bench.run_for(200 * MS);
    bench.word = 0x011F;
    bench.run_for(200 * MS);
    let stands = bench.shaft();
    bench.run_for(100 * MS);
    assert_eq!((bench.shaft(), bits(&bench)), (stands, (false, false, true)));
    assert_eq!(home(&mut bench), PLACES.home(18, -30_000));
}

/// DP3CL-7.6 The present position, without a motion.
#[test]
fn here() {
    for method in [35, 37] {
        let mut bench = bench(config(20_000), method);
        assert_eq!(bench.position(), 0, "at power-on");
        assert_eq!((home(&mut bench), bench.shaft(), bench.position()), (Some(20_000), 20_000, OFFSET));
    }
}

/// DP3CL-6.15 A run that is left while the axis moves stops on the quick-stop ramp, and CSP begins after it.
#[test]
fn leaving_homing_while_it_moves() {
    let mut bench = bench(config(-30_000), 18);
    bench.write(0x6085, 0, 100_000);
    bench.word = 0x1F;
    bench.run_for(200 * MS);
    let from = bench.shaft();
    bench.write(0x6060, 0, 8);
    let cycles = bench.run_until(2000, |bench| {
        bench.target = bench.position() as i32;
        bench.velocity() == 0 && bench.bit(12)
    });
    let way = bench.shaft() - from;
    assert!((490..=520).contains(&cycles) && (12_400..=12_700).contains(&way), "{cycles} {way}");
    bench.target += 100;
    let stood = bench.shaft();
    bench.run_for(3 * MS);
    assert_eq!((bench.shaft() - stood, bench.read(0x6061, 0)), (100, 8));
}

/// DP3CL-7.7 Which legs are fast and which are slow: the greatest speed until home was found in each direction, negative and positive.
#[test]
fn speeds_of_the_legs() {
    const FAST: i64 = 50_000;
    const SLOW: i64 = 5_000;
    for (method, start, negative, positive) in [
        // Fast to the switch, slow from there to its edge and to the index pulse.
        (1, -30_000, FAST, SLOW),
        (17, -30_000, FAST, SLOW),
        (2, 20_000, SLOW, FAST),
        (18, 20_000, SLOW, FAST),
        (19, -30_000, SLOW, FAST),
        (21, 20_000, FAST, SLOW),
        // Fast through the cam and back to it slowly.
        (25, -30_000, SLOW, FAST),
        (29, 20_000, FAST, SLOW),
        // The first leg has the edge: fast up to it.
        (20, -30_000, 0, FAST),
        (24, -30_000, 0, FAST),
        (28, 20_000, FAST, 0),
        // On the switch, with the edge ahead: slow.
        (19, -500, SLOW, 0),
        (21, -500, 0, SLOW),
        (23, -500, SLOW, 0),
        (27, -500, 0, SLOW),
        (33, -30_000, SLOW, 0),
        (34, -30_000, 0, SLOW),
    ] {
        let mut bench = bench(config(start), method);
        bench.write(0x609A, 0, 20_000_000);
        bench.word = 0x1F;
        let (mut least, mut most) = (0, 0);
        bench.run_until(60_000, |bench| {
            let velocity = bench.velocity();
            (least, most) = (least.min(velocity), most.max(velocity));
            bench.bit(12)
        });
        assert_eq!((-least, most), (negative, positive), "method {method} from {start}");
    }
}
