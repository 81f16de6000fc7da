//! Inputs and outputs of a DP3CL, by their parameters.

use ecmsk::slave::dp3cl::{Dp3clConfig, Dp3clOutputs};
use ecmsk::slave::{Fault, HomeSwitch, InputPattern, Slave, Travel};

use super::bench::{Bench, MS, write};
use crate::wired::{alarm, force};

fn config() -> Dp3clConfig {
    let travel = Travel {
        negative_limit: Some(-100),
        positive_limit: Some(300),
        home: Some(HomeSwitch::Cam { first: 50, last: 60 }),
        ..Travel::for_turn(10_000)
    };
    Dp3clConfig { travel, ..Dp3clConfig::default() }
}

/// 0x60FD with the shaft at a position. The drive gets there by homing without a switch in its way, so that no limit
/// holds it.
fn inputs_at(position: i64, parameters: &[(u16, i64)]) -> i64 {
    let mut bench = Bench::in_op(Dp3clConfig { position, ..config() }, 8, MS);
    for (index, value) in parameters {
        bench.write(*index, 0, *value);
    }
    bench.run_for(2 * MS);
    bench.read(0x60FD, 0)
}

/// DP3CL-9.1 The bits of 0x60FD.
/// DP3CL-9.2 Terminals of the functions, inverted and not assigned.
#[test]
fn inputs() {
    for (position, bits) in
        [(-101, 0b001), (-100, 0b001), (-99, 0), (49, 0), (50, 0b100), (60, 0b100), (61, 0), (300, 0b010)]
    {
        assert_eq!(inputs_at(position, &[]), bits, "{position}");
    }
    assert_eq!(inputs_at(300, &[(0x2206, 0x12)]), 0, "POT inverted");
    assert_eq!(inputs_at(0, &[(0x2206, 0x12)]), 0b010);
    assert_eq!(inputs_at(50, &[(0x2206, 4), (0x2207, 4)]), 0b111, "all three at SI4");
    assert_eq!((inputs_at(-101, &[(0x2207, 0x13)]), inputs_at(0, &[(0x2207, 0x13)])), (0, 0b001), "NOT inverted");
    assert_eq!(inputs_at(55, &[(0x2208, 0x14)]), 0);
    assert_eq!(inputs_at(61, &[(0x2208, 0x14)]), 0b100, "on both sides of the cam");
    for unassigned in [0, 5, 15, 0x10, 0x15] {
        assert_eq!(inputs_at(300, &[(0x2206, unassigned)]), 0, "{unassigned}");
    }
    assert_eq!(inputs_at(300, &[(0x2206, 1)]), 0, "nothing is wired to SI1");
    assert_eq!(inputs_at(300, &[(0x2206, 0x11)]), 0b010);
}

/// DP3CL-9.2 P2-05: an alarm is cleared when its terminal goes on, or off if it is inverted, and not while it stays.
#[test]
fn the_terminal_that_clears_alarms() {
    for (parameter, levels, clears) in [
        (0x01, [0b0000, 0b0001], true),
        (0x01, [0b0001, 0b0001], false),
        (0x01, [0b0001, 0b0000], false),
        (0x11, [0b0001, 0b0000], true),
        (0x11, [0b0000, 0b0001], false),
        (0x04, [0b0000, 0b1000], true),
        (0x04, [0b0000, 0b0001], false),
        (0x00, [0b0000, 0b1111], false),
    ] {
        let mut bench = Bench::in_op(config(), 8, MS);
        bench.write(0x2205, 0, parameter);
        bench.drive.apply_fault(force(levels[0]));
        bench.run_for(5 * MS);
        bench.drive.apply_fault(alarm(0x3220));
        bench.run_for(5 * MS);
        bench.drive.apply_fault(force(levels[1]));
        bench.run_for(5 * MS);
        assert_eq!(bench.drive.alarm().is_none(), clears, "{parameter:02X} {levels:?}");
    }
}

/// DP3CL-9.3 Alarm and brake at ERR and BRK.
#[test]
fn outputs() {
    let seen = |parameters: &[(u16, i64)]| {
        let mut bench = Bench::in_op(config(), 8, MS);
        for (index, value) in parameters {
            write(&mut bench.drive, *index, 0, *value).unwrap();
        }
        let off = bench.drive.outputs();
        bench.enable();
        let enabled = bench.drive.outputs();
        bench.drive.apply_fault(alarm(0x3220));
        bench.run_for(5 * MS);
        [off, enabled, bench.drive.outputs()].map(|Dp3clOutputs { err, brk }| (err, brk))
    };
    assert_eq!(seen(&[]), [(false, false), (false, true), (true, false)]);
    assert_eq!(seen(&[(0x2202, 0x11), (0x2203, 0x12)]), [(true, true), (true, false), (false, true)]);
    assert_eq!(seen(&[(0x2202, 2), (0x2203, 1)]), [(false, false), (true, false), (false, true)]);
    assert_eq!(seen(&[(0x2202, 0), (0x2203, 0)]), [(false, false); 3]);
    assert_eq!(seen(&[(0x2202, 2), (0x2203, 2)]), [(false, false), (false, true), (false, true)]);
}

/// DP3CL-9.4 Forced inputs are the terminals.
#[test]
fn forced_inputs() {
    let mut bench = Bench::in_op(config(), 8, MS);
    for (bits, inputs) in [(0b0000, 0), (0b0010, 0b010), (0b0100, 0b001), (0b1000, 0b100), (0b1110, 0b111), (0b0001, 0)]
    {
        assert!(bench.drive.apply_fault(force(bits)));
        bench.cycle();
        assert_eq!(bench.read(0x60FD, 0), inputs, "{bits:04b}");
    }
    assert!(
        bench
            .drive
            .apply_fault(Fault::ForceInputs { channel: 0, pattern: Some(InputPattern::Walk { step_ns: 10 * MS }) })
    );
    let mut seen = Vec::new();
    for _ in 0..45 {
        bench.cycle();
        let inputs = bench.read(0x60FD, 0);
        if seen.last() != Some(&inputs) {
            seen.push(inputs);
        }
    }
    assert_eq!(seen, [0, 0b010, 0b001, 0b100, 0]);
    assert!(bench.drive.apply_fault(force(0).end()));
    bench.cycle();
    assert_eq!(bench.read(0x60FD, 0), 0);
    assert!(!bench.drive.apply_fault(Fault::ForceInputs { channel: 1, pattern: None }));
}
