//! The option codes 0x605A to 0x605E of a DP3CL, in profile velocity at one turn a second: 200 ms on the ramp of 0x6084, 100 ms on that of
//! 0x6085.

use ecmsk::cia402::DriveState::{self, Fault, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
use ecmsk::coe::AbortCode;
use ecmsk::slave::Slave;

use super::bench::{Bench, MS, read, usual, write};

/// A drive that turns.
fn turning() -> Bench {
    let mut bench = Bench::enabled(3);
    for (index, value) in [(0x6083, 1_000_000), (0x6084, 50_000), (0x6085, 100_000), (0x60FF, 600)] {
        bench.write(index, 0, value);
    }
    bench.run_for(100 * MS);
    assert_eq!(bench.velocity(), 10_000);
    bench
}

/// How the drive stops.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// At once.
    Off,
    /// On 0x6084.
    Slow,
    /// On 0x6085.
    Quick,
}
use crate::wired::alarm;
use Way::{Off, Quick, Slow};

/// Checks that the drive stops in that way and ends in that state, and that it shows its velocity while it brakes.
fn stops(bench: &mut Bench, way: Way, state: DriveState, name: &str) {
    let from = bench.shaft();
    bench.cycle();
    bench.cycle();
    let moves = bench.velocity() > 0;
    let mut last = bench.shaft();
    let mut cycles = 2;
    // A count takes some cycles at the end of a ramp.
    for cycle in 3..400 {
        bench.cycle();
        if bench.shaft() != last {
            (last, cycles) = (bench.shaft(), cycle);
        }
    }
    // Half of the speed for the time of the ramp.
    let (ms, units) = match way {
        Off => (0..=3, 0..=20),
        Slow => (190..=206, 980..=1030),
        Quick => (92..=106, 490..=530),
    };
    assert!(ms.contains(&cycles), "{name}: {cycles} ms");
    assert!(units.contains(&(last - from)), "{name}: {} u", last - from);
    assert_eq!((moves, bench.velocity()), (way != Off, 0), "{name}");
    bench.run_for(10 * MS);
    assert_eq!(bench.state(), Some(state), "{name}");
}

/// DP3CL-6.20 0x605A: how a quick stop brakes, and whether the drive stays in Quick stop active.
#[test]
fn quick_stop() {
    for (code, way, state) in [
        (0, Off, SwitchOnDisabled),
        (1, Slow, SwitchOnDisabled),
        (2, Quick, SwitchOnDisabled),
        // The stop is as fast as the current or the voltage allows.
        (3, Off, SwitchOnDisabled),
        (4, Off, SwitchOnDisabled),
        (5, Slow, QuickStopActive),
        (6, Quick, QuickStopActive),
        (7, Off, QuickStopActive),
        (8, Off, QuickStopActive),
    ] {
        let mut bench = turning();
        bench.write(0x605A, 0, code);
        bench.word = 0x02;
        stops(&mut bench, way, state, &format!("605A = {code}"));
    }
}

/// DP3CL-6.20 0x605B and 0x605C: how a drive brakes that is shut down or disabled.
#[test]
fn shutdown_and_disabling() {
    for (index, code, word, way, state) in [
        (0x605B, 0, 0x06, Off, ReadyToSwitchOn),
        (0x605B, 1, 0x06, Slow, ReadyToSwitchOn),
        (0x605C, 0, 0x07, Off, SwitchedOn),
        (0x605C, 1, 0x07, Slow, SwitchedOn),
    ] {
        let mut bench = turning();
        bench.write(index, 0, code);
        bench.word = word;
        stops(&mut bench, way, state, &format!("{index:04X} = {code}"));
    }
    let mut bench = turning();
    bench.word = 0x00;
    stops(&mut bench, Off, SwitchOnDisabled, "disable voltage");
}

/// DP3CL-6.20 0x605D: how halt brakes, in Operation enabled.
#[test]
fn halt() {
    for (code, way) in [(1, Slow), (2, Quick), (3, Quick), (4, Quick)] {
        let mut bench = turning();
        bench.write(0x605D, 0, code);
        bench.word = 0x010F;
        stops(&mut bench, way, DriveState::OperationEnabled, &format!("605D = {code}"));
    }
}

/// DP3CL-6.20 0x605E: how an alarm brakes. DP3CL-5.1 The drive is in Fault reaction active meanwhile.
#[test]
fn fault_reaction() {
    for (code, way) in [(0, Off), (1, Slow), (2, Quick), (3, Off), (4, Off)] {
        let mut bench = turning();
        bench.write(0x605E, 0, code);
        bench.drive.apply_fault(alarm(0x3220));
        if way != Off {
            bench.cycle();
            assert_eq!(bench.state(), Some(DriveState::FaultReactionActive));
        }
        stops(&mut bench, way, Fault, &format!("605E = {code}"));
    }
}

/// DP3CL-3.2 The valid codes, and those at power-on.
#[test]
fn ranges() {
    let mut drive = usual();
    for (index, usual, least, most) in
        [(0x605A, 2, 0, 8), (0x605B, 0, 0, 1), (0x605C, 1, 0, 1), (0x605D, 1, 1, 4), (0x605E, 2, 0, 4)]
    {
        assert_eq!(read(&mut drive, index, 0), Ok(usual));
        assert_eq!(write(&mut drive, index, 0, least - 1), Err(AbortCode::VALUE_LOW), "{index:04X}");
        assert_eq!(write(&mut drive, index, 0, most + 1), Err(AbortCode::VALUE_HIGH), "{index:04X}");
        assert_eq!((write(&mut drive, index, 0, least), write(&mut drive, index, 0, most)), (Ok(()), Ok(())));
    }
}
