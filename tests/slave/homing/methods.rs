//! Every method, from every place, with every kind of home switch.
//!
//! The expectations come only from the tables of CiA 402-2: where each method ends, and for each start position its
//! first direction and whether it finds home.

use ecmsk::cia402::Mode;
use ecmsk::coe::SdoSize;
use ecmsk::slave::homing::HomingError;
use ecmsk::slave::{DriveConfig, HomeSwitch, Input};
use support::homing_tables::METHODS;

use super::bench::{
    Bench, Bits, CAM, FAST, FIRST, INDEX, LAST, NEGATIVE_LIMIT, Outcome, POSITIVE_LIMIT, SLOW, TURN, travel,
};
use crate::rig::{MS, Rig};

/// On the negative limit switch, left of the cam, on it, right of it, on the positive limit switch.
const STARTS: [i64; 5] = [-210_000, -100_000, 10_000, 150_000, 310_000];

/// The edge by which a method finds home: the count at which it is seen, and the direction of the shaft there.
pub fn final_edge(method: i8, first: i64, last: i64, negative_limit: i64, positive_limit: i64) -> (i64, i64) {
    match method {
        1 | 17 => (negative_limit + 1, 1),
        2 | 18 => (positive_limit - 1, -1),
        3 | 7 | 14 | 19 | 23 | 30 => (first - 1, -1),
        4 | 8 | 13 | 20 | 24 | 29 => (first, 1),
        5 | 10 | 11 | 21 | 26 | 27 => (last + 1, 1),
        6 | 9 | 12 | 22 | 25 | 28 => (last, -1),
        _ => panic!("method {method} has no edge"),
    }
}

/// The first index pulse beyond a count.
pub fn pulse_beyond(mut count: i64, direction: i64) -> i64 {
    loop {
        count += direction;
        if (count - i64::from(INDEX)) % TURN == 0 {
            return count;
        }
    }
}

fn home_of(method: i8, start: i64) -> i64 {
    match method {
        33 => pulse_beyond(start, -1),
        34 => pulse_beyond(start, 1),
        35 | 37 => start,
        _ => {
            let (edge, direction) = final_edge(method, FIRST, LAST, NEGATIVE_LIMIT, POSITIVE_LIMIT);
            if method < 15 { pulse_beyond(edge, direction) } else { edge }
        }
    }
}

/// For each place of [`STARTS`], the first direction, and `!` if the run ends in an error.
type Row = (&'static [i8], [&'static str; 5]);

const WITH_CAM: [Row; 10] = [
    (&[1, 17], ["+", "-", "-", "-", "-"]),
    (&[2, 18], ["+", "+", "+", "+", "-"]),
    (&[3, 4, 19, 20], ["+", "+", "-", "+!", ".!"]),
    (&[5, 6, 21, 22], [".!", "-!", "+", "-", "-"]),
    (&[7, 8, 23, 24], ["+", "+", "-", "+", "-"]),
    (&[9, 10, 25, 26], ["+", "+", "+", "+", "-"]),
    (&[11, 12, 27, 28], ["+", "-", "+", "-", "-"]),
    (&[13, 14, 29, 30], ["+", "-", "-", "-", "-"]),
    (&[33], [".!", "-", "-", "-", "-"]),
    (&[34], ["+", "+", "+", "+", ".!"]),
];

/// The switch is active from its left edge to the positive end: there is no right edge.
const WITH_STEP_UP: [Row; 9] = [
    (&[1, 17], ["+", "-", "-", "-", "-"]),
    (&[2, 18], ["+", "+", "+", "+", "-"]),
    (&[3, 4, 19, 20], ["+", "+", "-", "-", "-"]),
    (&[5, 6, 21, 22], [".!", "-!", "+!", "+!", ".!"]),
    (&[7, 8, 23, 24], ["+", "+", "-", "-", "-"]),
    (&[9, 10, 25, 26], ["+!", "+!", "+!", "+!", "-!"]),
    (&[11, 27], ["+!", "-!", "+!", "+!", ".!"]),
    (&[12, 28], ["+!", "-!", "+!", "+!", ".!"]),
    (&[13, 14, 29, 30], ["+", "-", "-", "-", "-"]),
];

/// And the other way round: there is no left edge.
const WITH_STEP_DOWN: [Row; 9] = [
    (&[1, 17], ["+", "-", "-", "-", "-"]),
    (&[2, 18], ["+", "+", "+", "+", "-"]),
    (&[3, 4, 19, 20], [".!", "-!", "-!", "+!", ".!"]),
    (&[5, 6, 21, 22], ["+", "+", "+", "-", "-"]),
    (&[7, 23], [".!", "-!", "-!", "+!", "-!"]),
    (&[8, 24], [".!", "-!", "-!", "+!", "-!"]),
    (&[9, 10, 25, 26], ["+", "+", "+", "+", "-"]),
    (&[11, 12, 27, 28], ["+", "+", "+", "-", "-"]),
    (&[13, 14, 29, 30], ["+!", "-!", "-!", "-!", "-!"]),
];

fn check(home: HomeSwitch, rows: &[Row]) {
    for (methods, places) in rows {
        for (method, (start, expected)) in methods.iter().flat_map(|m| STARTS.iter().zip(places).map(move |p| (*m, p)))
        {
            let mut bench = Bench::new(travel(home), *start);
            let Outcome { first, end } = bench.home(method);
            let name = format!("method {method} from {start} with {home:?}: {first} {end:?}");
            assert!(expected.starts_with(first), "{name}, not {expected}");
            if expected.ends_with('!') {
                assert!(matches!(end, Err(HomingError::WrongLimit(_))), "{name}");
                assert_eq!((bench.steps, bench.bits()), (0, Bits::Error), "{name}");
            } else {
                assert_eq!(end, Ok(home_of(method, *start)), "{name}");
            }
        }
    }
}

/// SK-7.20 Homing by a cam: each method ends at its edge or pulse, to the count.
#[test]
fn by_a_cam() {
    check(CAM, &WITH_CAM);
}

/// SK-7.20 The same with a switch that stays active to the positive end of the travel.
#[test]
fn by_a_step_up() {
    check(HomeSwitch::From(FIRST), &WITH_STEP_UP);
}

/// SK-7.20 The same with a switch that stays active to the negative end of the travel.
#[test]
fn by_a_step_down() {
    check(HomeSwitch::UpTo(LAST), &WITH_STEP_DOWN);
}

/// SK-7.20 Methods 35 and 37 take the present position as home, at once.
#[test]
fn where_it_stands() {
    for (method, start) in [(35, -210_000), (37, 10_000), (35, 310_000), (37, 12_345)] {
        let mut bench = Bench::new(travel(CAM), start);
        bench.start(method);
        assert_eq!((bench.cycle(), bench.home_count(), bench.shaft()), (Bits::Done, start, start));
    }
}

/// A pulse beyond a limit switch is not reached: the run ends there.
#[test]
fn no_pulse_before_the_limit() {
    for (method, start) in [(33, -119_000), (34, 275_000)] {
        let mut bench = Bench::new(travel(CAM), start);
        assert!(matches!(bench.home(method).end, Err(HomingError::WrongLimit(_))), "method {method}");
    }
}

/// A cam that is narrower than the braking distance is overrun in either direction, and found all the same.
#[test]
fn by_a_narrow_cam() {
    let (first, last) = (-1_000, 300);
    for method in [3, 4, 7, 8, 9, 10, 11, 12, 13, 14, 19, 20, 23, 24, 25, 26, 27, 28, 29, 30] {
        let mut bench = Bench::new(travel(HomeSwitch::Cam { first, last }), -100_000);
        let (edge, direction) = final_edge(method, first, last, NEGATIVE_LIMIT, POSITIVE_LIMIT);
        let expected = if method < 15 { pulse_beyond(edge, direction) } else { edge };
        assert_eq!(bench.home(method).end, Ok(expected), "method {method}");
    }
}

/// A cam that ends where the limit switch begins: an edge that the axis passes on its ramp at the limit is not yet the
/// sought one, and after the turn it cannot be reached.
#[test]
fn by_a_cam_that_ends_at_the_limit() {
    let home = HomeSwitch::Cam { first: 168_599, last: POSITIVE_LIMIT };
    for method in [10, 26] {
        let mut bench = Bench::new(travel(home), 0);
        let end = bench.home(method).end;
        assert_eq!((end, bench.steps), (Err(HomingError::WrongLimit(Input::PositiveLimit)), 0), "method {method}");
    }
    assert_eq!(Bench::new(travel(home), 0).home(25).end, Ok(POSITIVE_LIMIT));
    assert_eq!(Bench::new(travel(home), 0).home(24).end, Ok(168_599));
}

/// A run goes fast until it seeks its edge after having seen the switch; its first leg, from outside over the edge, is
/// fast; the search for the pulse is slow.
#[test]
fn speeds() {
    let (fast, slow) = (FAST as f64, SLOW as f64);
    for (method, start, expected) in [
        (17, -100_000, slow),
        (17, -210_000, slow),
        (18, 10_000, slow),
        (19, -100_000, slow),
        (19, 59_000, slow),
        (20, -100_000, fast),
        (20, 10_000, slow),
        (21, 10_000, slow),
        (22, 150_000, fast),
        (23, -100_000, slow),
        (23, 150_000, slow),
        (24, -100_000, fast),
        (25, -100_000, slow),
        (25, 150_000, fast),
        (26, -100_000, fast),
        (26, 10_000, slow),
        (1, -100_000, slow),
        (8, -100_000, slow),
        (33, 12_000, slow),
    ] {
        let mut bench = Bench::new(travel(CAM), start);
        bench.start(method);
        let mut way = vec![(bench.shaft(), 0.0)];
        while bench.cycle() == Bits::Running {
            way.push((bench.shaft(), bench.rig.velocity().abs()));
        }
        // It comes back to home slowly: home was found at its last crossing at a higher speed.
        let home = bench.home_count();
        let crossed = |step: &&[(i64, f64)]| (step[0].0 <= home) != (step[1].0 <= home) && step[1].1 > 0.8 * slow;
        let speed = way.windows(2).rfind(crossed).map_or(0.0, |step| step[1].1);
        assert!((speed / expected - 1.0).abs() < 0.06, "method {method} from {start}: {speed}, not {expected}");
    }
}

/// The leg off the switch that only leads to the side from which the edge is sought is fast; one that ends at the edge
/// is slow from its start.
#[test]
fn speeds_off_the_switch() {
    for (method, start, expected) in [
        (20, 59_000, FAST),
        (22, -39_000, FAST),
        (24, 59_000, FAST),
        (25, -39_000, FAST),
        (19, 59_000, SLOW),
        (21, -39_000, SLOW),
        (26, -39_000, SLOW),
    ] {
        let mut bench = Bench::new(travel(CAM), start);
        bench.start(method);
        let mut fastest = 0.0_f64;
        while bench.cycle() == Bits::Running {
            fastest = fastest.max(bench.rig.velocity().abs());
        }
        assert!((fastest / expected as f64 - 1.0).abs() < 0.1, "method {method}: {fastest}, not {expected}");
    }
}

/// 0x607F is a limit in homing too, of the demand: there is no lag, whatever 0x6099 says.
#[test]
fn speed_limit_of_the_drive() {
    let mut bench = Bench::new(travel(CAM), -190_000);
    bench.rig.write(0x607F, 0, SdoSize::Four, SLOW);
    bench.start(20);
    while bench.cycle() == Bits::Running {
        assert!(bench.rig.velocity() < 1.01 * SLOW as f64);
        assert!(bench.rig.drive.axis().following_error().abs() < 1_000);
    }
    assert_eq!(bench.home_count(), FIRST);
}

/// SK-7.19 SK-7.20 A drive out of the box finds home by every method, with its own speeds, whatever its cycle.
#[test]
fn out_of_the_box() {
    for method in METHODS {
        let cycle_ns = if method % 2 == 0 { MS } else { (MS / 4) << (method % 5) };
        let mut rig = Rig::enabled(DriveConfig::default(), Mode::Csp, cycle_ns);
        rig.write(0x6060, 0, SdoSize::One, 6);
        rig.write(0x6098, 0, SdoSize::One, method.into());
        rig.out.controlword.0 |= 1 << 4;
        let cycles = 60_000 * MS / cycle_ns;
        let end = (0..cycles).find(|_| {
            rig.cycle();
            !matches!(Bits::of(rig.status()), Bits::Running | Bits::AttainedMoving)
        });
        assert!(end.is_some() && Bits::of(rig.status()) == Bits::Done, "method {method}: {:?}", rig.status());
    }
}
