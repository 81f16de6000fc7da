//! Limit switches that act in CSP, CSV and CST: the axis stops at one, reports it, and can move back, without a jump.

use ecmsk::cia402::{DriveState, Mode, Statusword};
use ecmsk::slave::{DriveConfig, Input, Slave, Travel};

use crate::rig::{MS, Rig};
use crate::wired::stick;

const TURN: i64 = 1 << 17;
const END: i64 = 100_000;

fn limited(config: DriveConfig) -> DriveConfig {
    let travel = Travel {
        negative_limit: Some(-END),
        positive_limit: Some(END),
        limits_stop_motion: true,
        ..Travel::for_turn(config.motor.counts_per_turn)
    };
    DriveConfig { travel, ..config }
}

fn says_limited(rig: &Rig) -> bool {
    rig.status().0 & Statusword::INTERNAL_LIMIT != 0
}

/// A motion into a switch stops there on 0x6085, the quick-stop ramp. The demand passes no target, is never faster than
/// the targets, and the way back begins at the axis' position: its first count is one count.
#[test]
fn csp_stops_at_a_switch() {
    for config in [DriveConfig::default(), DriveConfig::stepper()] {
        for cycle_ns in [250_000, MS, 4 * MS] {
            for direction in [1, -1] {
                let mut rig = Rig::enabled(limited(config.clone()), Mode::Csp, cycle_ns);
                // A stepper's turn has 10000 counts; both get there within a second.
                let step = (i64::from(config.motor.counts_per_turn) * 2 * cycle_ns as i64 / 1_000_000_000) as i32;
                let what = format!("{} {cycle_ns} ns {direction}", config.name);
                let mut target = 0;
                let follow = |rig: &mut Rig, target: i32| {
                    let before = rig.drive.axis().demand();
                    rig.out.target = direction * target;
                    rig.cycle();
                    let moved = rig.drive.axis().demand() - before;
                    assert!(moved.abs() <= i64::from(step) + 1, "{what}: {moved} counts in a cycle");
                    let beyond = (rig.drive.axis().demand() - i64::from(rig.out.target)) * i64::from(direction);
                    assert!(beyond <= 0 || moved * i64::from(direction) <= 0, "{what}: {beyond} beyond its target");
                };
                while target < 2 * END as i32 {
                    target += step;
                    follow(&mut rig, target);
                    let inside = rig.position().abs() < END;
                    assert!(!inside || !says_limited(&rig), "{what}: at {}", rig.position());
                }
                let stands = rig.position() * i64::from(direction);
                let speed = f64::from(step) / (cycle_ns as f64 / 1e9);
                let ramp = f64::from(rig.read(0x6085, 0));
                let way = speed * speed / (2.0 * ramp) + 2.0 * f64::from(step) + 100.0;
                assert!((END..=END + way as i64).contains(&stands), "{what}: stands at {stands}");
                assert!(says_limited(&rig) && rig.velocity() == 0.0, "{what}");
                assert_eq!(rig.status().0 & Statusword::TARGET_REACHED, 0, "{what}");
                assert_eq!(rig.state(), DriveState::OperationEnabled, "{what}");
                // Back, from where the targets had got.
                let held = rig.drive.axis().demand() * i64::from(direction);
                while target > 0 {
                    target -= step;
                    follow(&mut rig, target);
                    let way_back = i64::from(target) < held;
                    assert_eq!(says_limited(&rig), i64::from(target) > held, "{what}: {target}, held at {held}");
                    assert!(way_back || rig.drive.axis().demand() * i64::from(direction) == held, "{what}: {target}");
                }
                rig.run_for(200 * MS);
                assert!((rig.position() - i64::from(rig.out.target)).abs() <= 1, "{what}");
            }
        }
    }
}

/// A target just beyond a switch is not passed by the ramp, and is reached from there without a step back.
#[test]
fn a_target_just_beyond_a_switch_is_not_passed() {
    let mut rig = Rig::enabled(limited(DriveConfig::default()), Mode::Csp, MS);
    let mut furthest = 0;
    for n in 0..3000 {
        rig.out.target = (n * 2 * TURN as i32 / 1000).min(END as i32 + 30);
        rig.cycle();
        furthest = furthest.max(rig.drive.axis().demand());
    }
    assert!((END..=END + 30).contains(&furthest), "{furthest}");
    assert_eq!(furthest, rig.drive.axis().demand());
}

/// In CSV and CST, too. Outputs that move the axis back are effective, and a switch that is wired but does not act lets
/// it pass.
#[test]
fn velocities_and_torques_stop_at_a_switch() {
    for (mode, target) in [(Mode::Csv, 2 * TURN as i32), (Mode::Cst, 100)] {
        for direction in [1, -1] {
            let mut rig = Rig::enabled(limited(DriveConfig::default()), mode, MS);
            rig.out.target = direction * target;
            rig.run_for(3000 * MS);
            let stands = rig.position() * i64::from(direction);
            assert!((END..END + TURN / 2).contains(&stands) && says_limited(&rig), "{mode}: {stands}");
            rig.run_for(1000 * MS);
            assert_eq!((rig.position() * i64::from(direction), rig.velocity()), (stands, 0.0), "{mode}");
            rig.out.target = -rig.out.target;
            rig.run_for(50 * MS);
            let back = rig.position() * i64::from(direction);
            assert!(back < stands && !says_limited(&rig), "{mode}: {back}");

            let config = limited(DriveConfig::default());
            let travel = Travel { limits_stop_motion: false, ..config.travel };
            let mut rig = Rig::enabled(DriveConfig { travel, ..config }, mode, MS);
            rig.out.target = direction * target;
            rig.run_for(3000 * MS);
            assert!(rig.position() * i64::from(direction) > 2 * END, "{mode}: {}", rig.position());
        }
    }
}

/// A sensor that sticks acts as the switch that it is; an axis that is switched on there moves away from it alone.
#[test]
fn a_switch_that_sticks_holds_the_axis() {
    let mut rig = Rig::in_op(limited(DriveConfig::default()), Mode::Csp, MS);
    assert!(rig.drive.apply_fault(stick(Input::PositiveLimit, Some(true))));
    rig.enable();
    let ramp = |rig: &mut Rig, to: i32| {
        while rig.out.target != to {
            rig.out.target += 10 * (to - rig.out.target).signum();
            rig.cycle();
        }
    };
    ramp(&mut rig, 500);
    assert!(rig.position().abs() <= 1 && says_limited(&rig), "{}", rig.position());
    ramp(&mut rig, -500);
    rig.run_for(100 * MS);
    assert!((rig.position() + 500).abs() <= 1 && !says_limited(&rig), "{}", rig.position());
}
