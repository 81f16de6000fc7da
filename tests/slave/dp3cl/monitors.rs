//! The monitors U0 to U3 of a DP3CL.

use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::RequestedState;
use ecmsk::slave::dp3cl::{Dp3clConfig, Rating};
use ecmsk::slave::{AlStatus, Slave};

use super::bench::{Bench, MS, in_preop, read, restarted, usual};
use crate::wired::jam;

/// DP3CL-2.8 U0 shows the motion.
/// DP3CL-2.10 U2 and U3 show the device and its cycle.
#[test]
fn monitors() {
    let mut bench = Bench::enabled_with(Dp3clConfig { serial: 0x0002_0003, ..Dp3clConfig::default() }, 8);
    for step in 1..=250 {
        bench.target = step * 100;
        bench.cycle();
    }
    for (index, value) in [
        (0x3001, 600),
        (0x300A, 25_000),
        (0x300B, 0),
        (0x300D, 0),
        (0x3012, 5000),
        (0x3013, 0),
        (0x3014, 2),
        (0x3015, 0),
        (0x3020, 36),
        (0x301C, 7000),
        (0x301F, 7000),
        (0x3200, 1),
        (0x3201, 0),
        (0x3202, 0),
        (0x3204, 0),
        (0x3205, 0),
        (0x3206, 0),
        (0x3207, 511),
        (0x3208, 10),
        (0x320E, 0),
        (0x320F, 0),
        (0x3210, 0),
        (0x3203, 705),
        (0x320C, 3),
        (0x320D, 2),
        (0x3300, 1000),
        (0x3302, 1000),
        (0x3303, 1000),
        (0x3304, 0),
        (0x3305, 0),
        (0x3306, 0),
        (0x3307, 0),
        (0x3308, 1000),
        (0x3309, 0),
        (0x330A, 0),
        (0x330B, 0),
    ] {
        assert_eq!(bench.read(index, 0), value, "{index:04X}");
    }
    let (a, b) = (bench.read(0x301A, 0) as u16 as i16, bench.read(0x301B, 0) as u16 as i16);
    let vector = f64::from(a).hypot(f64::from(b));
    assert!((vector - 7000.0).abs() < 50.0, "{a} {b}");
    // An open loop drive outputs its set current.
    assert_eq!([0x301D, 0x301E].map(|index| bench.read(index, 0) as u16 as i16), [a, b]);
    for step in (-500..250).rev() {
        bench.target = step * 100;
        bench.cycle();
    }
    let words = [0x300A, 0x300B, 0x300C, 0x300D].map(|index| bench.read(index, 0));
    assert_eq!(words, [50_000, 0, 0, 0x8000], "minus 50000");
    let turns = [0x3012, 0x3013, 0x3014, 0x3015].map(|index| bench.read(index, 0));
    assert_eq!(turns, [0, 0, 0xFFFB, 0xFFFF], "minus 5 turns");
    assert_eq!(bench.read(0x3001, 0) as u16 as i16, -600);
    bench.run_for(62_000 * MS);
    assert_eq!([0x3209, 0x320A, 0x320B].map(|index| bench.read(index, 0)), [0, 1, 3]);
    bench.drive.step(3_600_000 * MS);
    assert_eq!([0x3209, 0x320A, 0x320B].map(|index| bench.read(index, 0)), [1, 1, 3]);
    let mut drive = restarted(bench.drive);
    assert_eq!((read(&mut drive, 0x3200, 0), read(&mut drive, 0x320A, 0)), (Ok(2), Ok(0)));
}

/// DP3CL-2.8 The electric angle: a step of 1.8 degrees is a quarter of its turn, and the phases follow it.
#[test]
fn electric_angle() {
    let mut bench = Bench::enabled(8);
    // A turn of 10000 u has 50 electric ones of 200 u.
    for (target, angle, a, b) in [(200, 0, 7000, 0), (50, 90, 0, 7000), (100, 180, -7000, 0), (150, 270, 0, -7000)] {
        bench.target = target;
        bench.run_for(3 * MS);
        assert_eq!(bench.read(0x3019, 0), angle, "{target}");
        let phases = [0x301A, 0x301B].map(|index| i64::from(bench.read(index, 0) as u16 as i16));
        assert_eq!(phases, [a, b], "{target}");
    }
}

/// DP3CL-2.10 The model of each rating.
#[test]
fn ratings() {
    for (rating, model) in [(Rating::A3, 305), (Rating::A7, 705), (Rating::A8, 808)] {
        assert_eq!(read(&mut in_preop(Dp3clConfig { rating, ..Dp3clConfig::default() }), 0x3203, 0), Ok(model));
    }
}

/// DP3CL-2.9 U1 keeps the values at the moment of the alarm: currents, voltage, position offset, speed, time.
#[test]
fn the_moment_of_an_alarm() {
    let mut drive = usual();
    drive.step(70_000_000 * MS);
    let mut bench = Bench::of(drive, 8, MS);
    bench.enable();
    // The shaft is held; 50 u each ms are 300 rpm, and 30 of them are 50 u after an electric turn of 200 u.
    assert!(bench.drive.apply_fault(jam(true)));
    for step in 1..=30 {
        bench.target = step * 50;
        bench.cycle();
    }
    let seconds = bench.read(0x3209, 0) * 3600 + bench.read(0x320A, 0) * 60 + bench.read(0x320B, 0);
    assert!(bench.drive.enter(AlState::Init).is_ok());
    bench.drive.enter(AlState::PreOp).unwrap();
    let u1 = |bench: &mut Bench, index: u16| i64::from(bench.read(index, 0) as u16 as i16);
    assert_eq!(bench.read(0x3100, 0), 882);
    let shown = [0x3101, 0x3102, 0x3103, 0x3104, 0x3105, 0x3106].map(|index| u1(&mut bench, index));
    assert_eq!(shown, [-7000, 0, 7000, 36, 1500, 300]);
    assert_eq!(bench.read(0x3107, 0) | bench.read(0x3108, 0) << 16, seconds);
    assert!(seconds > 0x1_0000, "the upper word counts");
    // The values stay when the alarm is cleared.
    bench.drive.step(200 * MS);
    bench.write(0x4000, 0, 1);
    bench.drive.step(10 * MS);
    assert_eq!((bench.read(0x3100, 0), u1(&mut bench, 0x3105)), (0, 1500));
}

/// DP3CL-2.9 U1 shows the alarms.
#[test]
fn alarm_monitors() {
    let mut drive = usual();
    assert_eq!([0x3100, 0x3109, 0x310A].map(|index| read(&mut drive, index, 0)), [Ok(0); 3]);
    for _ in 0..2 {
        assert_eq!(drive.enter(AlState::Op), Err(AlStatus(0x0011)));
        assert_eq!(drive.request_state(RequestedState::from_code(7)), Err(AlStatus(0x0012)));
    }
    let shown = [0x3100, 0x3109, 0x310A, 0x310B, 0x310C, 0x310D].map(|index| read(&mut drive, index, 0));
    assert_eq!(shown, [801, 4, 800, 801, 800, 0].map(Ok));
    assert_eq!(drive.enter(AlState::Op), Err(AlStatus(0x0011)));
    assert_eq!(drive.request_state(RequestedState::from_code(7)), Err(AlStatus(0x0012)));
    let shown = [0x3100, 0x3109, 0x310A, 0x310B, 0x310C, 0x310D, 0x310E].map(|index| read(&mut drive, index, 0));
    assert_eq!(shown, [801, 6, 800, 801, 800, 801, 800].map(Ok), "the second to the sixth last one");
    assert!((0x310F..=0x3115).all(|index| read(&mut drive, index, 0) == Ok(0)), "reserved");
    assert_eq!(read(&mut drive, 0x3104, 0), Ok(36));
    let mut drive = restarted(drive);
    let shown = [0x3100, 0x3109, 0x310A].map(|index| read(&mut drive, index, 0));
    assert_eq!(shown, [0, 0, 800].map(Ok));
}
