//! The simulated stepper as a slave: a drive with CSP only.

use crate::rig::{MS, Rig, read, write};
use crate::wired::{config, configure, in_preop};
use ecmsk::cia402::{DriveState, Mode};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::{Refusal, Role};
use ecmsk::slave::{Drive, DriveConfig};

/// SK-4.58 A stepper refuses a configuration for another kind of slave. It counts as a drive in CSP, since it has those
/// process data (SK-7.1, SK-7.2); and a servo drive has those of a stepper. SK-7.36 It has no other mode than CSP.
#[test]
fn roles() {
    let refused = |al_status, abort| Err(Refusal { slave: 0, al_status, abort });
    let mut step = in_preop(Drive::new(DriveConfig::stepper()));
    assert_eq!(configure(&mut step, &config(Role::Io)), refused(0x001D, None));
    for mode in [Mode::Csv, Mode::Cst, Mode::Homing] {
        let no_mode = Some((ObjectAddress::new(0x6060, 0), AbortCode::VALUE_RANGE));
        for role in [Role::Step(mode), Role::Drive(mode), Role::Hsp(mode)] {
            assert_eq!(configure(&mut step, &config(role)), refused(0, no_mode), "{role:?}");
        }
    }
    let mut servo = in_preop(Drive::new(DriveConfig::default()));
    for role in [Role::Drive(Mode::Csp), Role::Step(Mode::Csp)] {
        for slave in [&mut step, &mut servo] {
            assert_eq!(configure(slave, &config(role)), Ok(()), "{role:?}");
            assert_eq!([1, 2].map(|n| read(slave, 0x1600, n)), [Ok(0x6040_0010), Ok(0x607A_0020)]);
            assert_eq!(read(slave, 0x6061, 0), Ok(8));
        }
    }
}

/// SK-3.20 Its process data are those of a drive in CSP, and it has a drive's objects except those of other modes.
#[test]
fn objects() {
    let mut step = in_preop(Drive::new(DriveConfig::stepper()));
    configure(&mut step, &config(Role::Step(Mode::Csp))).unwrap();
    assert_eq!((read(&mut step, 0x1C12, 1), read(&mut step, 0x1C13, 1)), (Ok(0x1600), Ok(0x1A00)));
    assert_eq!([1, 2].map(|n| read(&mut step, 0x1600, n)), [Ok(0x6040_0010), Ok(0x607A_0020)]);
    let measured = [0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010].map(Ok);
    assert_eq!([1, 2, 3, 4].map(|n| read(&mut step, 0x1A00, n)), measured);
    assert_eq!(read(&mut step, 0x1000, 0), Ok(0x0004_0192), "device profile 402, stepper");
    assert_eq!(read(&mut step, 0x1008, 0), Ok(u32::from_le_bytes(*b"STEP")));
    assert_eq!(read(&mut step, 0x1018, 2), Ok(0x5354_4550));
    assert_eq!(read(&mut step, 0x6502, 0), Ok(1 << 5 | 1 << 7), "homing, CSP");
    let mut servo = in_preop(Drive::new(DriveConfig::default()));
    for (index, sub) in [(0x6071, 0), (0x60B1, 0), (0x60B2, 0), (0x60FF, 0)] {
        assert!(read(&mut servo, index, sub).is_ok());
        assert_eq!(read(&mut step, index, sub), Err(AbortCode::NO_OBJECT), "{index:04X}");
    }
    assert_eq!(write(&mut step, 0x6071, 0, SdoSize::Two, 5), Err(AbortCode::NO_OBJECT));
    for code in [9, 10] {
        assert_eq!(write(&mut step, 0x6060, 0, SdoSize::One, code), Err(AbortCode::VALUE_RANGE));
    }
    assert_eq!(write(&mut step, 0x6060, 0, SdoSize::One, 8), Ok(()));
}

/// SK-3.20 It follows positions: evenly, without a following error, to within the thousandth of a turn that bit 10 means.
#[test]
fn it_follows_positions() {
    for cycle_ns in [MS / 4, MS, 4 * MS] {
        let mut rig = Rig::enabled(DriveConfig::stepper(), Mode::Csp, cycle_ns);
        let turns = 5;
        let way = turns * 10_000;
        let cycles = 500 * MS / cycle_ns;
        for n in 1..=cycles {
            // An approximation of a raised cosine: a parabola up, a parabola down.
            let x = n as f64 / cycles as f64;
            let s = if x < 0.5 { 2.0 * x * x } else { 1.0 - 2.0 * (1.0 - x) * (1.0 - x) };
            rig.out.target = (s * f64::from(way)) as i32;
            rig.cycle();
            let lag = i64::from(rig.out.target) - rig.position();
            assert!(lag.abs() <= 500, "{cycle_ns}: {lag} counts behind");
        }
        rig.run_for(200 * MS);
        assert_eq!(rig.state(), DriveState::OperationEnabled);
        assert!((rig.position() - i64::from(way)).abs() <= 10, "{}", rig.position());
        assert_eq!(rig.status().0 & 0x1400, 0x1400, "follows, and has reached");
    }
}

/// A load that it cannot hold makes it lose its target, which it reports as a drive does: 0x8611.
#[test]
fn it_has_a_following_error() {
    let mut rig = Rig::enabled(DriveConfig::stepper(), Mode::Csp, MS);
    rig.out.target = 1_000_000;
    rig.run_for(300 * MS);
    assert_eq!((rig.seen.error_code, rig.state()), (0x8611, DriveState::Fault));
}
