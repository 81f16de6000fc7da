//! CSP of a DP3CL, changes of mode, limit switches and software limits in every mode.

use allocation_counter::measure;
use ecmsk::cia402::DriveState;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::AlState;
use ecmsk::slave::dp3cl::{Dp3clConfig, Dp3clMode};
use ecmsk::slave::{Fault, Input, Slave, Travel};

use super::bench::{Bench, MS};
use crate::wired::{force, jam, stick};

/// DP3CL-6.14 The demand follows the targets, with the offset, whatever the cycle.
#[test]
fn targets() {
    for cycle_ns in [MS / 2, MS, 2 * MS, 4 * MS] {
        let mut bench = Bench::in_op(Dp3clConfig::default(), 8, cycle_ns);
        assert!(!bench.bit(12), "without power it does not follow");
        bench.enable();
        for step in 1..=100 {
            bench.target = step * 100;
            bench.cycle();
            assert_eq!((bench.read(0x6062, 0), bench.bit(12)), (i64::from(step) * 100, true));
        }
        assert_eq!(bench.velocity(), (100 * 1_000_000_000 / cycle_ns) as i64);
        bench.write(0x60B0, 0, -250);
        bench.run_for(2 * cycle_ns);
        assert_eq!((bench.read(0x6062, 0), bench.position(), bench.read(0x607A, 0)), (9750, 9750, 10_000));
    }
}

/// DP3CL-6.14 A target beyond the ends of 32 bits is the next position that has those bits.
#[test]
fn targets_wrap() {
    let travel = Travel { negative_limit: None, positive_limit: None, ..Travel::for_turn(10_000) };
    let mut bench = Bench::enabled_with(Dp3clConfig { travel, ..Dp3clConfig::default() }, 8);
    for _ in 0..1100 {
        bench.target = bench.target.wrapping_add(1 << 21);
        bench.cycle();
    }
    assert_eq!(bench.shaft(), 1100 << 21);
}

/// DP3CL-6.9 The following error in CSP: over the window for longer than the time, each time anew; a window of the greatest value is off.
#[test]
fn following_error() {
    for window in [100, u32::MAX] {
        let mut bench = Bench::enabled(8);
        bench.write(0x6065, 0, window.into());
        bench.write(0x6066, 0, 30);
        assert!(bench.drive.apply_fault(jam(true)));
        bench.target = 101;
        bench.run_for(25 * MS);
        bench.target = 0;
        bench.run_for(5 * MS);
        bench.target = 101;
        bench.run_for(30 * MS);
        assert!(!bench.bit(13), "{window}");
        bench.run_for(5 * MS);
        assert_eq!((bench.bit(13), bench.read(0x60F4, 0)), (window == 100, 101), "{window}");
        assert_eq!(bench.state(), Some(DriveState::OperationEnabled));
    }
}

/// DP3CL-6.15 An axis that moves stops on the quick-stop ramp before its mode changes; a drive that is off changes at once.
#[test]
fn changes_of_mode() {
    let mut bench = Bench::enabled(3);
    bench.write(0x60FF, 0, 600);
    bench.write(0x6085, 0, 100_000);
    bench.run_for(100 * MS);
    bench.write(0x6060, 0, 1);
    bench.cycle();
    assert_eq!((bench.read(0x6061, 0), bench.drive.mode()), (3, Dp3clMode::ProfileVelocity));
    let cycles = bench.run_until(200, |bench| bench.read(0x6061, 0) == 1);
    assert!((98..=103).contains(&cycles), "{cycles}");
    assert_eq!(bench.velocity(), 0);
    bench.word = 0;
    bench.run_for(50 * MS);
    for mode in [6, 8, 3, 1, 0] {
        bench.write(0x6060, 0, mode);
        bench.cycle();
        assert_eq!(bench.read(0x6061, 0), mode);
    }
}

fn with_limits_at(end: i64) -> Dp3clConfig {
    let travel = Travel { negative_limit: Some(-end), positive_limit: Some(end), ..Travel::for_turn(10_000) };
    Dp3clConfig { travel, ..Dp3clConfig::default() }
}

/// DP3CL-6.16 A limit switch stops each mode, and leaves the way back free.
#[test]
fn limit_switches() {
    let mut bench = Bench::enabled_with(with_limits_at(10_000), 8);
    for step in 1..=150 {
        bench.target = step * 100;
        bench.cycle();
    }
    let stands = bench.shaft();
    assert!((10_000..15_200).contains(&stands) && bench.bit(11), "{stands}");
    bench.target = stands as i32 - 100;
    bench.run_for(2 * MS);
    assert_eq!((bench.shaft(), bench.bit(11)), (stands - 100, false));

    let mut bench = Bench::enabled_with(with_limits_at(10_000), 3);
    bench.write(0x60FF, 0, -600);
    bench.run_for(3000 * MS);
    let stands = bench.shaft();
    assert!((-10_200..=-10_000).contains(&stands) && bench.bit(11), "{stands}");
    bench.write(0x60FF, 0, 600);
    bench.run_for(100 * MS);
    assert!(bench.shaft() > stands && !bench.bit(11));

    let mut bench = Bench::enabled_with(with_limits_at(10_000), 1);
    bench.write(0x6081, 0, 20_000);
    (bench.target, bench.word) = (50_000, 0x1F);
    bench.run_for(2000 * MS);
    let stands = bench.shaft();
    assert!((10_000..10_400).contains(&stands), "{stands}");
    assert!(!bench.bit(10), "the target was not reached");
    bench.word = 0x0F;
    bench.cycle();
    (bench.target, bench.word) = (0, 0x1F);
    bench.run_until(5000, |bench| bench.bit(10));
    assert_eq!(bench.shaft(), 0);
}

/// DP3CL-6.16 The same in CSP at any speed, one count in a cycle or a thousand: the demand is never faster than its
/// targets, never passes the present one, and the way back begins at its position.
#[test]
fn limit_switches_at_any_speed() {
    const END: i64 = 10_000;
    for step in [1, 3, 10, 99, 1000] {
        for (last, direction) in [(2 * END, 1), (END + 7, 1), (2 * END, -1)] {
            let start = END - 20 * step.min(400);
            let mut bench = Bench::enabled_with(with_limits_at(END), 8);
            let follow = |bench: &mut Bench, target: i64| {
                let before = bench.drive.axis().demand();
                bench.target = (direction * target) as i32;
                bench.cycle();
                let moved = bench.drive.axis().demand() - before;
                let beyond = (bench.drive.axis().demand() - direction * target) * direction;
                assert!(beyond <= 0 || moved * direction <= 0, "{step}: {beyond} beyond the target");
                moved
            };
            for target in (0..=start).step_by(500) {
                follow(&mut bench, target);
            }
            let mut target = start;
            for _ in 0..300 {
                target = last.min(target + step);
                let moved = follow(&mut bench, target);
                assert!(moved.abs() <= step.max(500), "{step}: {moved} in a cycle");
            }
            let stands = bench.shaft() * direction;
            // v^2 / 2a, with a = 0x6085, and the distance of a cycle until the switch is seen.
            let ramp = (step * step / 2 + 2 * step + 2).min(last - END);
            assert!((END..=END + ramp).contains(&stands), "{step}: stands at {stands}");
            assert_eq!(bench.bit(11), stands < target, "{step}");
            while target > stands {
                target -= step.min(target - stands);
                assert_eq!(follow(&mut bench, target), 0, "{step}");
            }
            assert_eq!(follow(&mut bench, target - 1), -direction, "{step}");
            assert!(!bench.bit(11), "{step}");
        }
    }
}

/// DP3CL-6.15 A mode is left from CSP at any speed, too.
#[test]
fn csp_is_left_at_any_speed() {
    for step in [1, 10, 99] {
        let mut bench = Bench::enabled(8);
        for n in 1..=100 {
            bench.target = n * step;
            bench.cycle();
        }
        bench.write(0x6060, 0, 1);
        let cycles = bench.run_until(200, |bench| bench.read(0x6061, 0) == 1);
        assert!(cycles <= step as usize + 3, "{step}: {cycles}");
    }
}

/// DP3CL-6.17 Software limits hold targets back.
#[test]
fn software_limits() {
    for index in [0x607D, 0x607B] {
        let mut bench = Bench::enabled(8);
        bench.write(index, 1, -100);
        bench.write(index, 2, 300);
        for (target, reached) in [(200, 200), (500, 300), (-500, -100), (0, 0)] {
            bench.target = target;
            bench.run_for(2 * MS);
            assert_eq!((bench.shaft(), bench.bit(11)), (reached, i64::from(target) != reached), "{index:04X} {target}");
        }
        bench.write(index, 1, 300);
        bench.target = 500;
        bench.run_for(2 * MS);
        assert_eq!(bench.shaft(), 500, "a range without a place is off");
    }
    let mut bench = Bench::enabled(1);
    bench.write(0x607D, 1, -100);
    bench.write(0x607D, 2, 300);
    bench.write(0x6081, 0, 20_000);
    (bench.target, bench.word) = (5000, 0x1F);
    bench.run_for(500 * MS);
    assert_eq!(bench.shaft(), 300);
}

/// DP3CL-6.18 A quick stop brakes on 0x6085 and ends in Switch on disabled.
#[test]
fn quick_stop() {
    let mut bench = Bench::enabled(3);
    bench.write(0x60FF, 0, 600);
    bench.write(0x6085, 0, 50_000);
    bench.run_for(100 * MS);
    let from = bench.shaft();
    bench.word = 0x02;
    let cycles = bench.run_until(500, |bench| bench.state() == Some(DriveState::SwitchOnDisabled));
    assert!((195..=210).contains(&cycles), "{cycles}");
    let way = bench.shaft() - from;
    assert!((990..=1020).contains(&way), "{way}");
}

/// DP3CL-9.4 A sensor that sticks acts as its limit switch.
#[test]
fn a_sensor_that_sticks() {
    let mut bench = Bench::enabled(8);
    assert!(bench.drive.apply_fault(stick(Input::PositiveLimit, Some(true))));
    bench.target = 100;
    bench.run_for(3 * MS);
    assert_eq!((bench.shaft(), bench.bit(11), bench.read(0x60FD, 0) & 2), (0, true, 2));
    assert!(bench.drive.apply_fault(stick(Input::PositiveLimit, None)));
    bench.run_for(3 * MS);
    assert_eq!((bench.shaft(), bench.bit(11), bench.read(0x60FD, 0) & 2), (100, false, 0));
}

/// DP3CL-10.4 Neither a cycle nor a master's SDO during it allocates.
#[test]
fn nothing_allocates() {
    for mode in [1, 3, 6, 8] {
        let mut bench = Bench::enabled(mode);
        bench.write(0x60FF, 0, 300);
        bench.write(0x6081, 0, 5000);
        bench.write(0x6098, 0, 1);
        let counted = measure(|| {
            bench.probes = 0x3737;
            for n in 0..500 {
                bench.word = if n % 100 < 50 { 0x1F } else { 0x0F };
                bench.target = n * 10;
                bench.cycle();
            }
            for fault in [force(0xF), Fault::Stick { axis: 0, input: None, value: Some(true) }] {
                bench.drive.apply_fault(fault);
                bench.run_for(50 * MS);
            }
            for index in [0x6065, 0x2005, 0x1008, 0x5555, 0x4002] {
                let at = ObjectAddress::new(index, 0);
                let mut value = [0; 8];
                let read = bench.drive.read(at, SdoScope::Entry, &mut value);
                let _ = bench.drive.write(at, SdoScope::Entry, &value[..read.unwrap_or(1).min(8)]);
            }
            for state in [AlState::PreOp, AlState::SafeOp, AlState::Op] {
                bench.drive.set_sync_managers(8, 19);
                let _ = bench.drive.enter(state);
                bench.run_for(5 * MS);
            }
        });
        assert_eq!((counted.count_total, counted.count_current), (0, 0), "mode {mode}: {counted:?}");
    }
}
