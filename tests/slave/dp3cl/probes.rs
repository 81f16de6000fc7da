//! The touch probes of a DP3CL.

use ecmsk::slave::dp3cl::Dp3clConfig;
use ecmsk::slave::{Fault, HomeSwitch, Input, Slave, Travel};

use super::bench::{Bench, MS};
use crate::wired::force;

/// SI1 is the home switch here, on from 105 to 205, SI2 the positive limit switch, on from 1005 on, out of the way of the axis as a
/// limit; the index pulse comes at 33 and every turn after it.
fn bench() -> Bench {
    let travel = Travel {
        negative_limit: None,
        positive_limit: Some(1005),
        home: Some(HomeSwitch::Cam { first: 105, last: 205 }),
        index: Some(33),
        ..Travel::for_turn(10_000)
    };
    let wiring = [Some(Input::Home), Some(Input::PositiveLimit), None, None];
    let mut bench = Bench::enabled_with(Dp3clConfig { travel, wiring, ..Dp3clConfig::default() }, 8);
    for parameter in [0x2205, 0x2206, 0x2207, 0x2208] {
        bench.write(parameter, 0, 0);
    }
    bench
}

/// Moves there with 100 u a cycle.
fn go(bench: &mut Bench, target: i32) {
    while bench.target != target {
        bench.target += (target - bench.target).clamp(-100, 100);
        bench.cycle();
    }
    bench.cycle();
}

/// 0x60B9, and the four positions.
fn shown(bench: &mut Bench) -> (i64, [i64; 4]) {
    (bench.read(0x60B9, 0), [0x60BA, 0x60BB, 0x60BC, 0x60BD].map(|index| bench.read(index, 0)))
}

/// DP3CL-8.1 Enable, edges and status of both probes.
/// DP3CL-8.2 Their inputs, and the index pulse.
/// DP3CL-8.3 The positions are those of the edges.
#[test]
fn edges() {
    let mut bench = bench();
    go(&mut bench, 2000);
    assert_eq!(shown(&mut bench), (0, [0; 4]), "both are off");
    go(&mut bench, 0);
    for (function, up, down) in [
        (0x0011, (0x0003, [105, 0, 0, 0]), (0x0003, [105, 0, 0, 0])),
        (0x0021, (0x0005, [0, 206, 0, 0]), (0x0005, [0, 206, 0, 0])),
        (0x1100, (0x0300, [0, 0, 1005, 0]), (0x0300, [0, 0, 1005, 0])),
        (0x2100, (0x0100, [0, 0, 0, 0]), (0x0500, [0, 0, 0, 1004])),
        (0x0015, (0x0003, [33, 0, 0, 0]), (0x0003, [33, 0, 0, 0])),
        (0x0025, (0x0001, [0; 4]), (0x0001, [0; 4])),
        (0x1700, (0x0300, [0, 0, 33, 0]), (0x0300, [0, 0, 33, 0])),
        (0x1511, (0x0303, [105, 0, 33, 0]), (0x0303, [105, 0, 33, 0])),
        (0x0010, (0, [0; 4]), (0, [0; 4])),
    ] {
        let mut bench = self::bench();
        bench.probes = function;
        bench.cycle();
        assert_eq!(shown(&mut bench), (i64::from(function & 0x0101), [0; 4]), "{function:04X}");
        go(&mut bench, 1500);
        assert_eq!(shown(&mut bench), up, "{function:04X} up");
        go(&mut bench, 0);
        assert_eq!(shown(&mut bench), down, "{function:04X} down");
    }
}

/// DP3CL-8.4 The first event, every event, and the state after disabling.
#[test]
fn events() {
    let mut bench = bench();
    bench.probes = 0x0011;
    go(&mut bench, 1000);
    go(&mut bench, 0);
    assert_eq!(shown(&mut bench), (3, [105, 0, 0, 0]), "at 205 on the way back there was another one");
    bench.probes = 0x0010;
    bench.cycle();
    assert_eq!(shown(&mut bench), (0, [105, 0, 0, 0]));
    go(&mut bench, 1000);
    bench.probes = 0x0011;
    go(&mut bench, 0);
    assert_eq!(shown(&mut bench), (3, [205, 0, 0, 0]), "enabled anew");
    bench.probes = 0x0033;
    go(&mut bench, 1000);
    assert_eq!(shown(&mut bench), (7, [105, 206, 0, 0]), "both edges");
    go(&mut bench, 0);
    assert_eq!(shown(&mut bench), (7, [205, 104, 0, 0]), "continuous");
    // Probe 2 alike: SI2 goes on at 1005.
    let mut second = self::bench();
    second.probes = 0x3100;
    go(&mut second, 1500);
    go(&mut second, 900);
    assert_eq!(shown(&mut second), (0x0700, [0, 0, 1005, 1004]));
    second.probes = 0x3300;
    go(&mut second, 1500);
    go(&mut second, 0);
    assert_eq!(shown(&mut second), (0x0700, [0, 0, 1005, 1004]), "continuous, at the same places");
    second.probes = 0;
    second.cycle();
    assert_eq!(shown(&mut second), (0, [0, 0, 1005, 1004]));
    // Reserved bits select nothing and show nothing.
    let mut reserved = self::bench();
    reserved.probes = 0xC8C8;
    go(&mut reserved, 1500);
    assert_eq!(shown(&mut reserved), (0, [0; 4]));
    let mut many = self::bench();
    many.probes = 0x0017;
    many.cycle();
    many.target = 1_000_000;
    many.run_for(2 * MS);
    assert_eq!(shown(&mut many), (3, [990_033, 0, 0, 0]), "the last index pulse of a cycle with many");
}

/// DP3CL-8.2 A terminal that is forced has edges, too. DP3CL-8.3 The position is the axis's position then.
#[test]
fn forced_terminals() {
    let mut bench = bench();
    bench.probes = 0x3333;
    go(&mut bench, 50);
    bench.drive.apply_fault(force(0b01));
    bench.cycle();
    assert_eq!(shown(&mut bench), (0x0103, [50, 0, 0, 0]));
    go(&mut bench, 70);
    bench.drive.apply_fault(force(0b10));
    bench.cycle();
    assert_eq!(shown(&mut bench), (0x0307, [50, 70, 70, 0]));
}

/// DP3CL-8.2 With the terminals of the factory SI1 clears alarms and SI2 is POT: both functions see the terminal of a probe.
#[test]
fn terminals_with_two_functions() {
    let travel = Travel { negative_limit: None, positive_limit: Some(1005), ..Travel::for_turn(10_000) };
    let mut bench = Bench::enabled_with(Dp3clConfig { travel, ..Dp3clConfig::default() }, 8);
    bench.probes = 0x1111;
    bench.cycle();
    go(&mut bench, 1010);
    bench.run_for(3 * MS);
    assert_eq!((bench.read(0x60FD, 0) & 0b011, shown(&mut bench)), (0b010, (0x0301, [0, 0, 1005, 0])));
    let fault = ecmsk::slave::DeviceFault { code: 0x3220, resettable: true };
    bench.drive.apply_fault(Fault::Alarm { axis: 0, fault });
    bench.run_for(5 * MS);
    assert!(bench.drive.alarm().is_some());
    bench.drive.apply_fault(force(0b0011));
    bench.run_for(5 * MS);
    assert_eq!((bench.drive.alarm(), bench.read(0x60B9, 0)), (None, 0x0303));
}
