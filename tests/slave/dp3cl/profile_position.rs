//! Profile position of a DP3CL: handshake, speeds, target reached, following error, halt.

use ecmsk::cia402::DriveState;
use ecmsk::slave::Slave;
use ecmsk::slave::dp3cl::{Dp3clConfig, Dp3clVariants};

use super::bench::{Bench, MS};
use crate::wired::jam;

const NEW: u16 = 0x10;
const AT_ONCE: u16 = 0x20;
const RELATIVE: u16 = 0x40;
const HALT: u16 = 0x100;
const REACHED: u16 = 10;
const ACKNOWLEDGED: u16 = 12;

/// An enabled drive with ramps on which a turn takes a few tenths of a second.
fn bench() -> Bench {
    let mut bench = Bench::enabled(1);
    usual_profile(&mut bench);
    bench
}

fn usual_profile(bench: &mut Bench) {
    for (index, value) in [(0x6081, 20_000), (0x6083, 200_000), (0x6084, 100_000)] {
        bench.write(index, 0, value);
    }
}

/// Gives a set-point: bit 4 rises, and falls again a cycle later. Returns whether it was acknowledged.
fn set_point(bench: &mut Bench, target: i32, bits: u16) -> bool {
    bench.target = target;
    bench.word = 0x0F | bits;
    bench.cycle();
    bench.word = 0x0F | bits | NEW;
    bench.cycle();
    let acknowledged = bench.bit(ACKNOWLEDGED);
    bench.word = 0x0F | bits;
    bench.cycle();
    assert!(!bench.bit(ACKNOWLEDGED) || !acknowledged || bench.drive.config().variants.one_deep_buffer);
    acknowledged
}

fn arrive(bench: &mut Bench) -> usize {
    bench.run_until(20_000, |bench| bench.bit(REACHED))
}

/// DP3CL-6.1 06h, 07h, 0Fh in each mode.
#[test]
fn enabling() {
    for mode in [1, 3, 6, 8] {
        let mut bench = Bench::enabled(mode);
        assert_eq!((bench.state(), bench.read(0x6061, 0)), (Some(DriveState::OperationEnabled), mode));
    }
}

/// DP3CL-6.2 The handshake, step by step.
#[test]
fn handshake() {
    let mut bench = bench();
    bench.target = 10_000;
    bench.run_for(5 * MS);
    assert_eq!((bench.bit(ACKNOWLEDGED), bench.shaft()), (false, 0), "nothing moves before bit 4");
    assert!(bench.bit(REACHED), "nothing is left to do");
    bench.word = 0x1F;
    bench.cycle();
    assert!(bench.bit(ACKNOWLEDGED) && !bench.bit(REACHED));
    bench.run_for(20 * MS);
    assert!(bench.bit(ACKNOWLEDGED), "as long as bit 4 is set");
    bench.word = 0x0F;
    bench.cycle();
    assert!(!bench.bit(ACKNOWLEDGED));
    assert!((1..10_000).contains(&bench.shaft()), "{}", bench.shaft());
    arrive(&mut bench);
    assert_eq!((bench.position(), bench.shaft()), (10_000, 10_000));
    bench.target = 0;
    bench.run_for(50 * MS);
    assert_eq!(bench.shaft(), 10_000, "without a new edge nothing moves");
}

/// DP3CL-6.3 With bit 5 = 0 a set-point during a motion is not taken. A variant keeps one.
#[test]
fn a_set_point_during_a_motion() {
    let mut bench = bench();
    assert!(set_point(&mut bench, 10_000, 0));
    bench.run_for(50 * MS);
    assert!(!set_point(&mut bench, 3000, 0));
    arrive(&mut bench);
    assert_eq!(bench.position(), 10_000);
    bench.run_for(100 * MS);
    assert_eq!(bench.position(), 10_000, "it needs a new edge");
    assert!(set_point(&mut bench, 3000, 0));
    arrive(&mut bench);
    assert_eq!(bench.position(), 3000);

    let variants = Dp3clVariants { one_deep_buffer: true, ..Dp3clVariants::default() };
    let mut bench = Bench::enabled_with(Dp3clConfig { variants, ..Dp3clConfig::default() }, 1);
    usual_profile(&mut bench);
    assert!(set_point(&mut bench, 10_000, 0));
    bench.run_for(50 * MS);
    assert!(set_point(&mut bench, 3000, 0));
    assert!(bench.bit(ACKNOWLEDGED), "the buffer is full");
    bench.target = 777;
    bench.run_until(5000, |bench| bench.shaft() == 10_000);
    arrive(&mut bench);
    assert_eq!((bench.position(), bench.bit(ACKNOWLEDGED)), (3000, false));
}

/// DP3CL-6.4 With bit 5 = 1 a set-point interrupts the motion, also backwards and with another speed.
#[test]
fn a_set_point_at_once() {
    let mut bench = bench();
    assert!(set_point(&mut bench, 100_000, AT_ONCE));
    bench.run_for(300 * MS);
    assert_eq!(bench.velocity(), 20_000);
    bench.write(0x6081, 0, 5000);
    assert!(set_point(&mut bench, 100_000, AT_ONCE));
    bench.run_for(300 * MS);
    assert_eq!(bench.velocity(), 5000);
    assert!(set_point(&mut bench, -2000, AT_ONCE));
    arrive(&mut bench);
    assert_eq!(bench.position(), -2000);
}

/// DP3CL-6.5 Relative targets are added to the last target, wherever the axis is.
#[test]
fn relative_targets() {
    let mut bench = bench();
    // The positioning option code, which could change that, is only stored.
    bench.write(0x60F2, 0, 0x0002);
    assert!(set_point(&mut bench, 4000, RELATIVE));
    arrive(&mut bench);
    assert!(set_point(&mut bench, -500, RELATIVE));
    arrive(&mut bench);
    assert_eq!(bench.position(), 3500);
    assert!(set_point(&mut bench, 10_000, RELATIVE | AT_ONCE));
    bench.run_for(100 * MS);
    assert!(set_point(&mut bench, 1000, RELATIVE | AT_ONCE));
    arrive(&mut bench);
    assert_eq!(bench.position(), 14_500);
}

/// DP3CL-6.6 With a speed of 0 nothing moves, and a running motion ends.
#[test]
fn without_speed() {
    let mut bench = bench();
    bench.write(0x6081, 0, 0);
    assert!(!set_point(&mut bench, 4000, 0));
    bench.run_for(100 * MS);
    assert_eq!(bench.shaft(), 0);
    bench.write(0x6081, 0, 20_000);
    assert!(set_point(&mut bench, 50_000, 0));
    bench.run_for(100 * MS);
    bench.write(0x6081, 0, 0);
    assert!(!set_point(&mut bench, 60_000, AT_ONCE));
    bench.run_for(400 * MS);
    let stands = bench.shaft();
    bench.run_for(100 * MS);
    assert_eq!((bench.shaft(), bench.velocity()), (stands, 0));
    assert!((1..20_000).contains(&stands), "{stands}");
}

/// DP3CL-6.7 The speed and the ramps in force, and when they are read.
#[test]
fn limits_of_speed_and_ramps() {
    for (index, value, speed) in [(0x6081, 20_000, 20_000), (0x607F, 7000, 7000), (0x6080, 60, 10_000)] {
        let mut bench = bench();
        bench.write(index, 0, value);
        assert!(set_point(&mut bench, 100_000, 0));
        bench.run_for(200 * MS);
        assert_eq!(bench.velocity(), speed, "{index:04X}");
        bench.write(0x607F, 0, 1000);
        bench.run_for(200 * MS);
        assert_eq!(bench.velocity(), speed, "a change during the motion is ignored");
    }
    // The braking distance from 20000 u/s: by 0x6084, or by 0x60C6 if that is less. A value written during a motion is
    // for the next one, which bit 5 begins at once.
    for (index, value, at_once, ms) in [
        (0x6084, 100_000, false, 200),
        (0x60C6, 50_000, false, 400),
        (0x6084, 50_000, true, 400),
        (0x60C6, 20_000, true, 1000),
    ] {
        let mut bench = bench();
        if !at_once {
            bench.write(index, 0, value);
        }
        assert!(set_point(&mut bench, 40_000, AT_ONCE));
        bench.run_for(300 * MS);
        assert_eq!(bench.velocity(), 20_000);
        if at_once {
            bench.write(index, 0, value);
            assert!(set_point(&mut bench, 40_000, AT_ONCE));
        } else {
            bench.write(index, 0, 7000);
        }
        bench.run_until(5000, |bench| bench.velocity() < 20_000);
        let cycles = bench.run_until(5000, |bench| bench.velocity() == 0) as i64;
        assert!((cycles - ms).abs() < 15, "{index:04X} {at_once}: {cycles} ms");
        assert_eq!(bench.shaft(), 40_000, "{index:04X} {at_once}");
    }
    for (index, value, after) in [(0x6083, 100_000, 5000), (0x60C5, 20_000, 1000)] {
        let mut bench = bench();
        bench.write(index, 0, value);
        assert!(set_point(&mut bench, 100_000, 0));
        bench.run_for(48 * MS);
        assert_eq!(bench.velocity(), after, "{index:04X}");
    }
}

/// DP3CL-6.8 Bit 10 needs the window for longer than its time.
#[test]
fn target_reached() {
    let mut bench = bench();
    bench.write(0x6068, 0, 50);
    assert!(set_point(&mut bench, 5000, 0));
    bench.run_until(5000, |bench| bench.position() == 5000 && bench.velocity() == 0);
    let waited = arrive(&mut bench);
    assert!((48..=51).contains(&waited), "{waited}");
    bench.write(0x6067, 0, 0);
    assert!(bench.drive.apply_fault(jam(true)));
    assert!(set_point(&mut bench, 5010, 0));
    bench.run_for(500 * MS);
    assert!(!bench.bit(REACHED), "10 u are outside of a window of 0");
}

/// DP3CL-6.9 Bit 13 is set after the time, and is no alarm.
#[test]
fn following_error() {
    let mut bench = bench();
    for (index, value) in [(0x6065, 1000), (0x6066, 20)] {
        bench.write(index, 0, value);
    }
    assert!(bench.drive.apply_fault(jam(true)));
    assert!(set_point(&mut bench, 2000, 0));
    bench.run_until(5000, |bench| bench.read(0x60F4, 0) > 1000);
    let waited = bench.run_until(100, |bench| bench.bit(13));
    assert!((19..=21).contains(&waited), "{waited}");
    assert_eq!((bench.state(), bench.read(0x603F, 0)), (Some(DriveState::OperationEnabled), 0));
    assert!(bench.drive.apply_fault(jam(false)));
    bench.run_for(3 * MS);
    assert!(!bench.bit(13));
}

/// DP3CL-6.10 A motion has the time of its trapezoid, with any cycle.
#[test]
fn trapezoid() {
    for cycle_ns in [MS / 2, MS, 2 * MS, 4 * MS] {
        let mut bench = Bench::in_op(Dp3clConfig::default(), 1, cycle_ns);
        bench.enable();
        usual_profile(&mut bench);
        assert!(set_point(&mut bench, 20_000, 0));
        let cycles = bench.run_until(20_000, |bench| bench.shaft() == 20_000);
        // 1 s at full speed, and half of the time of each ramp more.
        let seconds = cycles as f64 * cycle_ns as f64 / 1e9;
        assert!((seconds - 1.15).abs() < 0.02, "{seconds}");
    }
}

/// DP3CL-6.13 Halt brakes, and the motion goes on after it; a drive that is switched off meanwhile has no motion left.
#[test]
fn halt() {
    let mut bench = bench();
    assert!(set_point(&mut bench, 50_000, 0));
    bench.run_for(200 * MS);
    bench.word = 0x0F | HALT;
    bench.cycle();
    assert!(!bench.bit(REACHED));
    let cycles = bench.run_until(500, |bench| bench.bit(REACHED));
    assert!((195..=205).contains(&cycles), "20000 u/s at 100000 u/s^2, {cycles}");
    let halted = bench.shaft();
    bench.run_for(100 * MS);
    assert_eq!(bench.shaft(), halted);
    bench.word = 0x0F;
    bench.cycle();
    arrive(&mut bench);
    assert_eq!(bench.position(), 50_000);
    assert!(set_point(&mut bench, 0, 0));
    bench.run_for(200 * MS);
    bench.write(0x605D, 0, 2);
    bench.word = 0x0F | HALT;
    let cycles = bench.run_until(500, |bench| bench.bit(REACHED));
    assert!((18..=23).contains(&cycles), "the quick-stop ramp, {cycles}");
    bench.word = 0x06 | HALT;
    bench.run_for(100 * MS);
    let stands = bench.shaft();
    bench.enable();
    bench.run_for(100 * MS);
    assert_eq!((bench.shaft(), bench.bit(REACHED)), (stands, true));
}
