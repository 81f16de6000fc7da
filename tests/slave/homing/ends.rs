//! The course of a run by the statusword: its table in CiA 402-2, start, halt, interruption, and the state afterwards.

use ecmsk::cia402::{Controlword, DriveState, Mode, Statusword};
use ecmsk::coe::SdoSize;
use ecmsk::slave::Slave;
use ecmsk::slave::homing::HomingError;

use super::bench::{Bench, Bits, CAM, FAST, FIRST, LAST, RAMP, SLOW, travel};
use crate::wired::alarm;

const HALT: u16 = 1 << 8;
const START: u16 = Controlword::HOMING_START;

fn running(method: i8, start: i64, for_ms: u32) -> Bench {
    let mut bench = Bench::new(travel(CAM), start);
    bench.start(method);
    bench.run_for_ms(for_ms);
    assert_eq!(bench.bits(), Bits::Running);
    assert!(bench.rig.velocity().abs() > 0.1 * FAST as f64);
    bench
}

/// Runs cycles until the bits change from these; returns the new bits.
fn after(bench: &mut Bench, bits: Bits) -> Bits {
    (0..20_000).map(|_| bench.cycle()).find(|now| *now != bits).expect("it ends")
}

/// SK-7.20 Bits 13, 12, 10 of a run that finds home: not started, running, done; and they stay. SK-7.44 It is done when
/// the axis is at rest at home, to the count, where the switch changed, and not at the end of its ramp: it runs back at
/// the speed of the search for zero.
#[test]
fn bits_of_a_run() {
    let mut bench = Bench::new(travel(CAM), -100_000);
    assert_eq!(bench.cycle(), Bits::NotRunning);
    bench.start(20);
    assert_eq!(bench.cycle(), Bits::Running);
    let (mut farthest, mut fastest_back) = (bench.shaft(), 0.0_f64);
    let end = (0..20_000).map(|_| {
        let bits = bench.cycle();
        (farthest, fastest_back) = (farthest.max(bench.shaft()), fastest_back.min(bench.rig.velocity()));
        bits
    });
    assert_eq!({ end }.find(|bits| *bits != Bits::Running), Some(Bits::Done));
    // It passes the switch by the braking distance, v^2 / 2a, and then back.
    assert!((farthest - FIRST - FAST * FAST / (2 * RAMP)).abs() < 1_500, "{farthest}");
    assert!(-fastest_back > 0.9 * SLOW as f64 && -fastest_back < 1.25 * SLOW as f64, "{fastest_back}");
    assert!(bench.rig.velocity().abs() < 1.0);
    assert_eq!((bench.home_count(), bench.steps), (FIRST, 1));
    let stands = bench.shaft();
    assert_eq!((stands, bench.rig.status().0, bench.rig.read(0x6064, 0)), (FIRST, 0x1637, 0));
    for bits in [START, 0, 0, HALT, 0] {
        bench.controlword(bits);
        bench.run_for_ms(50);
        assert_eq!((bench.bits(), bench.shaft()), (Bits::Done, stands));
    }
    assert_eq!(bench.rig.status().0 & 0xFF, 0x37);
}

/// Without a rising edge of bit 4 no run starts: not by a bit that is set when the mode is entered, nor when the drive
/// is switched on.
#[test]
fn the_edge_starts() {
    let mut bench = Bench::in_csp(travel(CAM), -100_000);
    bench.set_method(20);
    bench.controlword(START);
    bench.run_for_ms(3);
    bench.set_mode(Mode::Homing);
    bench.run_for_ms(100);
    assert_eq!((bench.bits(), bench.shaft()), (Bits::NotRunning, -100_000));
    // The same for a bit that rises while the drive is off.
    bench.controlword(0);
    bench.run_for_ms(10);
    bench.rig.out.controlword = Controlword(0);
    bench.run_for_ms(10);
    bench.rig.out.controlword = Controlword(START);
    bench.run_for_ms(10);
    for word in [0x06, 0x07, 0x0F] {
        bench.rig.out.controlword = Controlword(START | word);
        bench.run_for_ms(100);
    }
    assert_eq!(bench.rig.state(), DriveState::OperationEnabled);
    assert_eq!((bench.bits(), bench.shaft()), (Bits::NotRunning, -100_000));
    assert_eq!(bench.home(20).end, Ok(FIRST));
}

/// Bit 4 falls during a run: the axis brakes to rest, interrupted. The next edge begins a new run.
#[test]
fn interrupted() {
    let mut bench = running(22, 290_000, 300);
    bench.controlword(0);
    assert_eq!(bench.cycle(), Bits::Running, "it still moves");
    assert_eq!(after(&mut bench, Bits::Running), Bits::NotRunning);
    let stands = bench.shaft();
    bench.run_for_ms(100);
    assert_eq!((bench.bits(), bench.shaft(), bench.steps), (Bits::NotRunning, stands, 0));
    assert!(stands > LAST);
    assert_eq!(bench.home(22).end, Ok(LAST));
}

/// Whenever bit 4 falls: once bit 10 shows a standstill the axis does not move any more, also where it only turned.
#[test]
fn interrupted_at_any_time() {
    for ms in (2..80).step_by(3) {
        let mut bench = Bench::new(travel(CAM), 290_000);
        bench.rig.write(0x6099, 1, SdoSize::Four, 2 << 17);
        bench.rig.write(0x609A, 0, SdoSize::Four, 100 << 17);
        bench.way_limit = 1e9;
        bench.start(18);
        bench.run_for_ms(ms);
        bench.controlword(0);
        bench.cycle();
        (0..20_000).find(|_| bench.cycle() == Bits::NotRunning).expect("it stands");
        let stands = bench.shaft();
        bench.run_for_ms(200);
        assert!((bench.shaft() - stands).abs() <= 1, "after {ms} ms: {stands}, then {}", bench.shaft());
    }
}

/// Bit 8: the axis brakes by 0x605D and stands, with bit 10; when it is taken back the run goes on to its home.
#[test]
fn halted() {
    for (option, ramp) in [(1, RAMP), (2, 60 * RAMP / 200), (3, 495_000_000), (4, 495_000_000)] {
        let mut bench = Bench::new(travel(CAM), 290_000);
        bench.rig.write(0x605D, 0, SdoSize::Two, option);
        bench.rig.write(0x6085, 0, SdoSize::Four, 60 * RAMP / 200);
        bench.start(5);
        bench.run_for_ms(200);
        let (speed, from) = (bench.rig.velocity().abs(), bench.shaft());
        bench.controlword(START | HALT);
        assert_eq!(bench.cycle(), Bits::Running);
        assert_eq!(after(&mut bench, Bits::Running), Bits::NotRunning);
        // The braking distance from that speed, and a margin for the cycle in which the word comes.
        let (way, expected) = ((from - bench.shaft()) as f64, speed * speed / (2.0 * ramp as f64));
        assert!(way > 0.98 * expected && way < expected + 0.004 * speed, "option {option}: {way}, not {expected}");
        let stands = bench.shaft();
        bench.run_for_ms(100);
        assert_eq!((bench.bits(), bench.shaft()), (Bits::NotRunning, stands));
        bench.controlword(START);
        assert_eq!(after(&mut bench, Bits::NotRunning), Bits::Running);
        assert_eq!(after(&mut bench, Bits::Running), Bits::Done);
        assert_eq!((bench.home_count(), bench.shaft()), (143_417, 143_417), "option {option}");
    }
}

/// A run that is started under halt begins when halt is taken back; one whose bit 4 falls under halt is over.
#[test]
fn started_and_ended_under_halt() {
    let mut bench = Bench::new(travel(CAM), -100_000);
    bench.set_method(20);
    bench.controlword(START | HALT);
    bench.run_for_ms(50);
    assert_eq!((bench.bits(), bench.shaft()), (Bits::NotRunning, -100_000));
    bench.controlword(START);
    bench.run_for_ms(20);
    assert_eq!(bench.bits(), Bits::Running);
    bench.controlword(START | HALT);
    bench.run_for_ms(100);
    bench.controlword(HALT);
    bench.run_for_ms(2);
    bench.controlword(0);
    let stands = bench.shaft();
    bench.run_for_ms(100);
    assert_eq!((bench.bits(), bench.shaft()), (Bits::NotRunning, stands));
}

/// The position actual value at home is 0x607C, whatever it was before; homing again gives the same place.
#[test]
fn offset_and_homing_again() {
    let mut bench = Bench::new(travel(CAM), -100_000);
    let offsets = [0, 5_000, -7, i32::MAX, i32::MIN, 0];
    for (offset, method) in offsets.into_iter().zip([24, 7, 14, 8, 30, 24]) {
        bench.rig.write(0x607C, 0, SdoSize::Four, offset.into());
        bench.home(method).end.expect("there is a home");
        bench.run_for_ms(100);
        let at = match method {
            24 => FIRST,
            30 => FIRST - 1,
            8 => 12_345,
            _ => -118_727,
        };
        let shown = bench.rig.drive.axis().measured().position;
        assert_eq!((bench.shaft(), shown), (at, offset), "method {method}, offset {offset}");
        let [actual, demand, error] = [0x6064, 0x6062, 0x60F4].map(|index| bench.rig.read(index, 0) as i32);
        assert_eq!((actual, demand, error), (shown, shown, 0), "method {method}, offset {offset}");
    }
}

/// 0x6098 to 0x609A and 0x607C are read at the start; values written during a run are for the next one.
#[test]
fn a_run_keeps_its_settings() {
    let mut bench = running(20, -190_000, 100);
    bench.set_method(99);
    for (index, sub) in [(0x6099, 1), (0x6099, 2), (0x607C, 0)] {
        bench.rig.write(index, sub, SdoSize::Four, 0x7FFF);
    }
    assert_eq!(after(&mut bench, Bits::Running), Bits::Done);
    assert_eq!(bench.home_count(), FIRST);
    assert_eq!(bench.home(99).end, Err(HomingError::UnsupportedMethod(99)));
}

/// SK-7.21 A fault, SV_OFF, a quick stop, disabling and leaving OP end a run without a home: bit 13, and it stays.
#[test]
fn ended_by_the_power_stage() {
    type Ender = fn(&mut Bench);
    let enders: [(&str, Ender, DriveState); 6] = [
        ("SV_OFF", |bench| bench.rig.out.controlword = Controlword(0), DriveState::SwitchOnDisabled),
        ("shutdown", |bench| bench.rig.out.controlword = Controlword(0x16), DriveState::ReadyToSwitchOn),
        ("disable", |bench| bench.rig.out.controlword = Controlword(0x17), DriveState::SwitchedOn),
        ("quick stop", |bench| bench.rig.out.controlword = Controlword(0x1B), DriveState::SwitchOnDisabled),
        ("leaving OP", Bench::leave_op, DriveState::SwitchOnDisabled),
        ("fault", |bench| assert!(bench.rig.drive.apply_fault(alarm(0x2310))), DriveState::Fault),
    ];
    for (name, end, state) in enders {
        let mut bench = running(20, -190_000, 100);
        end(&mut bench);
        bench.cycle();
        assert_eq!(bench.cycle(), Bits::ErrorMoving, "{name}");
        assert_eq!(after(&mut bench, Bits::ErrorMoving), Bits::Error, "{name}");
        bench.run_for_ms(100);
        assert_eq!((bench.bits(), bench.rig.state(), bench.steps), (Bits::Error, state, 0), "{name}");
        assert_eq!(bench.error(), HomingError::PowerLost, "{name}");
    }
}

/// SK-7.21 After such an end the drive is switched on again and finds its home.
#[test]
fn after_an_error_it_starts_again() {
    let mut bench = running(20, -190_000, 100);
    bench.rig.out.controlword = Controlword(0);
    // Friction alone stops it.
    bench.run_for_ms(4_000);
    for word in [0x06, 0x07, 0x0F] {
        bench.rig.out.controlword = Controlword(word);
        bench.run_for_ms(100);
        assert_eq!(bench.bits(), Bits::Error);
    }
    let end = bench.home(18).end;
    assert_eq!(end, Ok(299_999));
}

/// A cycle of homing allocates nothing, home and errors included.
#[test]
fn a_run_allocates_nothing() {
    let mut bench = Bench::new(travel(CAM), -100_000);
    let allocated = allocation_counter::measure(|| {
        assert_eq!(bench.home(7).end, Ok(-118_727));
        assert!(bench.home(15).end.is_err() && bench.home(34).end.is_ok());
    });
    assert_eq!((allocated.count_total, allocated.bytes_total), (0, 0));
}

/// Bit 11 still shows limits of torque and speed, bit 9 is remote; in Operation enabled the low byte is 37h.
#[test]
fn the_rest_of_the_statusword() {
    let bench = running(20, -190_000, 100);
    assert_eq!(bench.rig.status(), Statusword(0x0237));
}
