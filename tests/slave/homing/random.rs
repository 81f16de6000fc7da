//! Random travels, starts, speeds and defects: every run ends, and a found home is the right one.

use ecmsk::coe::SdoSize;
use ecmsk::slave::homing::HomingError;
use ecmsk::slave::{HomeSwitch, Input, Slave, Travel};
use proptest::prelude::*;
use support::homing_tables::METHODS;

use super::bench::{Bench, INDEX, TURN};
use super::methods::{final_edge, pulse_beyond};
use crate::wired::stick;

#[derive(Debug)]
struct Case {
    method: i8,
    travel: Travel,
    start: i64,
    fast: i64,
    slow: i64,
    ramp: i64,
    stuck: Option<(Input, bool)>,
}

fn home_switch() -> impl Strategy<Value = Option<HomeSwitch>> {
    let cam = (-250_000_i64..250_000, 0_i64..200_000)
        .prop_map(|(first, width)| HomeSwitch::Cam { first, last: first + width });
    prop_oneof![
        1 => Just(None),
        8 => cam.prop_map(Some),
        2 => (-250_000_i64..250_000).prop_map(|first| Some(HomeSwitch::From(first))),
        2 => (-250_000_i64..250_000).prop_map(|last| Some(HomeSwitch::UpTo(last))),
    ]
}

fn travels() -> impl Strategy<Value = Travel> {
    let limit = |range: std::ops::Range<i64>| proptest::option::weighted(0.9, range);
    let index = proptest::option::weighted(0.9, Just(INDEX));
    (limit(-400_000..-150_000), limit(150_000..400_000), home_switch(), index).prop_map(
        |(negative_limit, positive_limit, home, index)| Travel {
            negative_limit,
            positive_limit,
            home,
            index,
            stops: Some((-600_000, 600_000)),
            search_limit: 3_000_000,
            limits_stop_motion: true,
        },
    )
}

fn cases() -> impl Strategy<Value = Case> {
    let input =
        prop_oneof![Just(Input::NegativeLimit), Just(Input::PositiveLimit), Just(Input::Home), Just(Input::Index)];
    let stuck = proptest::option::weighted(0.2, (input, any::<bool>()));
    let speeds = (TURN..20 * TURN, TURN / 2..4 * TURN, 20 * TURN..2_000 * TURN);
    (proptest::sample::select(&METHODS[..]), travels(), -500_000_i64..500_000, speeds, stuck).prop_map(
        |(method, travel, start, (fast, slow, ramp), stuck)| Case { method, travel, start, fast, slow, ramp, stuck },
    )
}

/// The only possible place of home.
fn home_of(case: &Case) -> i64 {
    let (first, last) = match case.travel.home {
        Some(HomeSwitch::Cam { first, last }) => (first, last),
        Some(HomeSwitch::From(first)) => (first, i64::MAX - 1),
        Some(HomeSwitch::UpTo(last)) => (i64::MIN + 1, last),
        None => (i64::MIN + 1, i64::MAX - 1),
    };
    match case.method {
        33 => pulse_beyond(case.start, -1),
        34 => pulse_beyond(case.start, 1),
        35 | 37 => case.start,
        method => {
            let negative = case.travel.negative_limit.unwrap_or(i64::MIN);
            let positive = case.travel.positive_limit.unwrap_or(i64::MAX);
            let (edge, direction) = final_edge(method, first, last, negative, positive);
            if method < 15 { pulse_beyond(edge, direction) } else { edge }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// SK-7.20 A run ends at the home of its method or in an error; the shaft never jumps and is never faster than the
    /// speeds and ramps allow, and the position steps at home alone.
    #[test]
    fn every_run_ends(case in cases()) {
        let mut bench = Bench::new(case.travel, case.start);
        for (sub, speed) in [(1, case.fast), (2, case.slow)] {
            bench.rig.write(0x6099, sub, SdoSize::Four, speed);
        }
        bench.rig.write(0x609A, 0, SdoSize::Four, case.ramp);
        if let Some((input, value)) = case.stuck {
            let stuck = stick(input, Some(value));
            prop_assert!(bench.rig.drive.apply_fault(stuck));
        }
        // A 20th for the overshoot of the loops at the end of a ramp, and the ramp during their lag.
        bench.way_limit = (case.fast.max(case.slow) as f64 * 1.05 + case.ramp as f64 * 4e-3) / 1000.0;
        let end = bench.home(case.method).end;
        match end {
            Ok(home) => prop_assert_eq!((home, bench.steps > 0 || home == 0), (home_of(&case), true)),
            Err(error) => {
                prop_assert_eq!(bench.steps, 0);
                let here = matches!(case.method, 35 | 37);
                prop_assert!(!here && error != HomingError::Moving, "{}", error);
            }
        }
    }
}
