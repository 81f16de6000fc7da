//! Into mode 6 and out of it: the axis holds its position, and a target in old coordinates has no effect.

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::coe::SdoSize;

use super::bench::{Bench, Bits, CAM, FIRST, RAMP, TURN, travel};

/// The largest motion of the shaft meanwhile, counts: the settling of the position loop.
const STILL: i64 = 2;

fn homed(offset: i64) -> Bench {
    let mut bench = Bench::new(travel(CAM), -100_000);
    bench.rig.write(0x607C, 0, SdoSize::Four, offset);
    assert_eq!(bench.home(20).end.map(|at| at + offset), Ok(FIRST));
    bench.run_for_ms(50);
    bench
}

/// SK-7.22 SK-7.24 Back in CSP with the position that the board sends: the axis does not move, and follows the next
/// targets.
#[test]
fn back_in_csp() {
    for offset in [0, 900_000, -5] {
        let mut bench = homed(offset);
        let stands = bench.shaft();
        bench.set_mode(Mode::Csp);
        for _ in 0..200 {
            bench.rig.out.target = bench.rig.seen.position;
            bench.rig.cycle();
            assert!((bench.shaft() - stands).abs() <= STILL);
        }
        assert_eq!(bench.rig.status().0 & Statusword::BIT12, Statusword::BIT12);
        let target = bench.rig.seen.position;
        for step in 1..=500 {
            bench.rig.out.target = target + step * 100;
            bench.rig.cycle();
        }
        bench.rig.run_for(100_000_000);
        assert_eq!((bench.shaft() - stands, bench.rig.seen.position), (50_000, target + 50_000));
    }
}

/// The target of the exchange right after a home event was made before the master could see it: it is not taken, even
/// if the mode is CSP by then.
#[test]
fn a_target_in_old_coordinates() {
    let mut bench = Bench::new(travel(CAM), -100_000);
    bench.rig.write(0x607C, 0, SdoSize::Four, 3 * TURN);
    bench.start(35);
    assert_eq!(bench.cycle(), Bits::Done);
    bench.set_mode(Mode::Csp);
    assert_eq!((bench.rig.seen.position, bench.shaft()), (-100_000, -100_000), "seen before home");
    for _ in 0..100 {
        bench.rig.out.target = bench.rig.seen.position;
        bench.rig.cycle();
        assert!((bench.shaft() + 100_000).abs() <= STILL, "{}", bench.shaft());
    }
    assert_eq!(i64::from(bench.rig.seen.position), 3 * TURN);
}

/// The mode is left while the axis moves, and then while it is at rest past home: it brakes, with the ramp of homing,
/// and holds.
#[test]
fn left_in_motion() {
    for (mode, wait) in [(Mode::Csp, 100), (Mode::Csp, 200), (Mode::Csv, 100), (Mode::Cst, 30)] {
        let mut bench = Bench::new(travel(CAM), -190_000);
        bench.start(20);
        bench.run_for_ms(wait);
        bench.set_mode(mode);
        let (mut last, mut way) = (bench.shaft(), bench.way_limit);
        for cycle in 0..500 {
            bench.rig.out.target = if mode == Mode::Csp { bench.rig.seen.position } else { 0 };
            bench.rig.cycle();
            let now = (bench.shaft() - last) as f64;
            // At the end of the ramp the loop corrects its lag: 26 counts in the first millisecond.
            assert!(now >= -26.0 && now <= way + 2.0, "{mode}, cycle {cycle}: {now} after {way}");
            (last, way) = (bench.shaft(), now.max(0.0));
        }
        assert_eq!((bench.rig.velocity(), bench.rig.mode()), (0.0, mode), "{mode}");
        let bits = Statusword::BIT12 | Statusword::TARGET_REACHED;
        assert_eq!(bench.rig.status().0 & bits, bits, "{mode}");
    }
}

/// The mode is changed again while the axis brakes after mode 6: it goes on braking, and the new mode's target counts
/// when it is at rest.
#[test]
fn left_in_motion_for_one_mode_after_the_other() {
    let mut bench = Bench::new(travel(CAM), -190_000);
    bench.start(20);
    bench.run_for_ms(100);
    bench.set_mode(Mode::Csv);
    bench.cycle();
    bench.set_mode(Mode::Cst);
    bench.cycle();
    bench.set_mode(Mode::Csv);
    // Backwards: an axis that followed this at once would brake far harder than with the ramp of homing.
    bench.rig.out.target = -3 * TURN as i32;
    let start = bench.rig.velocity();
    bench.rig.cycle();
    let lost = start - bench.rig.velocity();
    assert!(start > 0.0 && lost <= 2.0 * RAMP as f64 / 1000.0, "from {start} by {lost} in a cycle");
}

/// The axis ignores targets while it brakes after mode 6, and targets that are in transit when it is at rest: a master
/// that sends positions once it has seen bit 12 moves nothing.
#[test]
fn targets_while_it_brakes() {
    let mut bench = Bench::new(travel(CAM), -190_000);
    bench.start(20);
    bench.run_for_ms(100);
    bench.set_mode(Mode::Csp);
    let from = bench.shaft();
    for _ in 0..500 {
        let follows = bench.rig.seen.statusword.0 & 0x1400 == 0x1400;
        bench.rig.out.target = if follows { bench.rig.seen.position } else { 5_000_000 };
        bench.rig.cycle();
        assert!(bench.rig.velocity() <= 1.05 * 4.0 * TURN as f64);
    }
    // v^2 / 2a from 4 turns/s with 200 turns/s^2, and the distance of a cycle or two.
    let way = bench.shaft() - from;
    assert!((way - 16 * TURN / 400).abs() < 2_000, "{way}");
    assert_eq!((bench.rig.velocity(), bench.rig.status().0 & 0x3C00), (0.0, 0x1400));
}

/// The mode is entered while the axis follows its targets: it brakes first. 0x6061 says 6 at once.
#[test]
fn entered_in_motion() {
    for mode in [Mode::Csp, Mode::Csv] {
        let mut bench = Bench::in_csp(travel(CAM), 0);
        if mode == Mode::Csv {
            bench = Bench { rig: crate::rig::Rig::enabled(Default::default(), mode, 1_000_000), ..bench };
            bench.rig.write(0x609A, 0, SdoSize::Four, 200 * TURN);
            bench.rig.out.target = 3 * TURN as i32;
            bench.rig.run_for(300_000_000);
        } else {
            for _ in 0..200 {
                bench.rig.out.target += 3 * TURN as i32 / 1000;
                bench.rig.cycle();
            }
        }
        assert!(bench.rig.velocity() > 2.9 * TURN as f64);
        bench.set_mode(Mode::Homing);
        assert_eq!(bench.cycle(), Bits::Running, "not yet at a standstill");
        let from = bench.shaft();
        while bench.bits() == Bits::Running {
            bench.cycle();
            assert!(bench.rig.velocity() <= 3.05 * TURN as f64);
        }
        assert_eq!((bench.bits(), bench.steps), (Bits::NotRunning, 0), "{mode}");
        let stands = bench.shaft();
        // v^2 / 2a from 3 turns/s with 200 turns/s^2.
        assert!((stands - from - 9 * TURN / 400).abs() < 1_000, "{}", stands - from);
        bench.run_for_ms(100);
        assert!((bench.shaft() - stands).abs() <= STILL);
    }
}

/// In mode 6 the axis takes no target, whatever process data hold.
#[test]
fn targets_are_not_taken() {
    let mut bench = homed(0);
    let stands = bench.shaft();
    for target in [0, 5_000_000, -5_000_000] {
        bench.rig.out.target = target;
        bench.rig.run_for(50_000_000);
        assert_eq!((bench.shaft(), bench.bits()), (stands, Bits::Done));
    }
}

/// Software position limits (0x607D) are in the coordinates that homing has set.
#[test]
fn software_limits_go_with_the_origin() {
    let mut bench = homed(1_000_000);
    bench.rig.write(0x607D, 1, SdoSize::Four, 990_000);
    bench.rig.write(0x607D, 2, SdoSize::Four, 1_020_000);
    bench.set_mode(Mode::Csp);
    for (target, held) in [(1_500_000, 1_020_000), (0, 990_000)] {
        for _ in 0..6_000 {
            bench.rig.out.target += (target - bench.rig.out.target).clamp(-300, 300);
            bench.rig.cycle();
        }
        assert_eq!(bench.rig.out.target, target);
        assert_eq!(bench.rig.seen.position, held);
    }
}
