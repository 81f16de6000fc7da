//! The object dictionary of a DP3CL: identity, types, access, mapping, values at power-on.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::slave::Slave;
use ecmsk::slave::dp3cl::{Dp3clConfig, Dp3clVariants};

use super::bench::{Bench, MS, in_preop, list, read, usual, write};

/// DP3CL-1.1 The identity of the maker's slave description.
#[test]
fn identity() {
    let mut drive = in_preop(Dp3clConfig { serial: 0x1234_5678, ..Dp3clConfig::default() });
    for (sub, value) in [(0, 4), (1, 0x556), (2, 0x3030_5070), (3, 0x2021_1108), (4, 0x1234_5678)] {
        assert_eq!(read(&mut drive, 0x1018, sub), Ok(value));
    }
    assert_eq!(read(&mut drive, 0x1000, 0), Ok(0x0004_0192));
    for (index, text) in [(0x1008, "VH3C"), (0x1009, "1.0"), (0x100A, "5.11")] {
        let mut value = [0; 16];
        let len = drive.read(ObjectAddress::new(index, 0), SdoScope::Entry, &mut value).unwrap();
        assert_eq!(&value[..len], text.as_bytes());
    }
}

/// The kind of PDO into which an object may be mapped.
#[derive(Clone, Copy, PartialEq)]
enum Pdo {
    No,
    Rx,
    Tx,
}
use crate::wired::jam;
use Pdo::{No, Rx, Tx};

/// Index, sub-index, bytes, whether it can be written, mapping, value at power-on.
const TABLE: &[(u16, u8, usize, bool, Pdo, i64)] = &[
    (0x1001, 0, 1, false, Tx, 0),
    (0x10F1, 1, 4, true, No, 1),
    (0x10F1, 2, 2, true, No, 4),
    (0x603F, 0, 2, false, Tx, 0),
    (0x6040, 0, 2, true, Rx, 0),
    (0x6041, 0, 2, false, Tx, 0),
    (0x605A, 0, 2, true, No, 2),
    (0x605B, 0, 2, true, No, 0),
    (0x605C, 0, 2, true, No, 1),
    (0x605D, 0, 2, true, No, 1),
    (0x605E, 0, 2, true, No, 2),
    (0x6060, 0, 1, true, Rx, 0),
    (0x6061, 0, 1, false, Tx, 0),
    (0x6062, 0, 4, false, Tx, 0),
    (0x6063, 0, 4, false, Tx, 0),
    (0x6064, 0, 4, false, Tx, 0),
    (0x6065, 0, 4, true, Rx, 30_000),
    (0x6066, 0, 2, true, Rx, 10),
    (0x6067, 0, 4, true, Rx, 20),
    (0x6068, 0, 2, true, Rx, 1),
    (0x606B, 0, 4, false, Tx, 0),
    (0x606C, 0, 4, false, Tx, 0),
    (0x606D, 0, 2, true, Rx, 10),
    (0x606E, 0, 2, true, Rx, 1),
    (0x606F, 0, 2, true, Rx, 10),
    (0x6070, 0, 2, true, Rx, 0),
    (0x6071, 0, 2, true, Rx, 0),
    (0x6072, 0, 2, true, Rx, 1000),
    (0x6073, 0, 2, false, No, 0),
    (0x6074, 0, 2, false, Tx, 0),
    (0x6075, 0, 4, false, No, 0),
    (0x6076, 0, 4, false, No, 0),
    (0x6077, 0, 2, false, Tx, 0),
    (0x6078, 0, 2, false, Tx, 0),
    (0x6079, 0, 4, false, Tx, 36_000),
    (0x607A, 0, 4, true, Rx, 0),
    (0x607B, 1, 4, true, Rx, 0),
    (0x607B, 2, 4, true, Rx, 0),
    (0x607C, 0, 4, true, Rx, 0),
    (0x607D, 1, 4, true, Rx, 0),
    (0x607D, 2, 4, true, Rx, 0),
    (0x607E, 0, 1, true, No, 0),
    (0x607F, 0, 4, true, Rx, 500_000),
    (0x6080, 0, 4, true, Rx, 3000),
    (0x6081, 0, 4, true, Rx, 0),
    (0x6083, 0, 4, true, Rx, 1_000_000),
    (0x6084, 0, 4, true, Rx, 1_000_000),
    (0x6085, 0, 4, true, Rx, 1_000_000),
    (0x6086, 0, 2, true, Rx, 0),
    (0x6087, 0, 4, true, Rx, 0),
    (0x6088, 0, 2, true, Rx, 0),
    (0x608F, 1, 4, false, No, 4000),
    (0x608F, 2, 4, false, No, 1),
    (0x6091, 1, 4, true, No, 1),
    (0x6091, 2, 4, true, No, 1),
    (0x6092, 1, 4, true, No, 10_000),
    (0x6092, 2, 4, true, No, 1),
    (0x6093, 1, 4, true, No, 0),
    (0x6093, 2, 4, true, No, 0),
    (0x6098, 0, 1, true, Rx, 35),
    (0x6099, 1, 4, true, Rx, 50_000),
    (0x6099, 2, 4, true, Rx, 5000),
    (0x609A, 0, 4, true, Rx, 1_000_000),
    (0x60A4, 1, 4, true, No, 0),
    (0x60A4, 2, 4, true, No, 0),
    (0x60B0, 0, 4, true, Rx, 0),
    (0x60B1, 0, 4, true, Rx, 0),
    (0x60B2, 0, 2, true, Rx, 0),
    (0x60B8, 0, 2, true, Rx, 0),
    (0x60B9, 0, 2, false, Tx, 0),
    (0x60BA, 0, 4, false, Tx, 0),
    (0x60BB, 0, 4, false, Tx, 0),
    (0x60BC, 0, 4, false, Tx, 0),
    (0x60BD, 0, 4, false, Tx, 0),
    (0x60C0, 0, 2, true, No, 0),
    (0x60C1, 1, 4, true, No, 0),
    (0x60C2, 1, 1, true, No, 1),
    (0x60C2, 2, 1, true, No, 0xFD),
    (0x60C5, 0, 4, true, Rx, 1_000_000),
    (0x60C6, 0, 4, true, Rx, 1_000_000),
    (0x60E0, 0, 2, true, Rx, 0),
    (0x60E1, 0, 2, true, Rx, 0),
    (0x60F2, 0, 2, true, Rx, 0),
    (0x60F4, 0, 4, false, Tx, 0),
    (0x60FA, 0, 4, false, Tx, 0),
    (0x60FC, 0, 4, false, Tx, 0),
    (0x60FD, 0, 4, false, Tx, 4),
    (0x60FE, 1, 4, true, Rx, 0),
    (0x60FE, 2, 4, true, Rx, 0),
    (0x60FF, 0, 4, true, Rx, 0),
    (0x6502, 0, 4, false, Tx, 0xA5),
];

/// DP3CL-3.1 Type, access and mapping of each object.
/// DP3CL-3.2 The values at power-on.
/// DP3CL-3.3 The supported modes.
#[test]
fn table() {
    let mut drive = usual();
    for (index, sub, bytes, writable, pdo, value) in TABLE.iter().copied() {
        let (at, name) = (ObjectAddress::new(index, sub), format!("{index:04X}:{sub}"));
        assert_eq!(drive.read(at, SdoScope::Entry, &mut [0; 8]), Ok(bytes), "{name}");
        assert_eq!(read(&mut drive, index, sub), Ok(value), "{name}");
        let written = write(&mut drive, index, sub, value);
        assert_eq!(written, if writable { Ok(()) } else { Err(AbortCode::READ_ONLY) }, "{name}");
        let entry = u32::from(index) << 16 | u32::from(sub) << 8 | (bytes as u32 * 8);
        for (direction, table) in [(Rx, 0x1600), (Tx, 0x1A00)] {
            let mapped = list(&mut drive, table, &[entry]);
            let expected = if pdo == direction { Ok(()) } else { Err(AbortCode::NOT_MAPPABLE) };
            assert_eq!(mapped, expected, "{name} in {table:04X}");
        }
    }
}

/// DP3CL-3.4 The supported homing methods. DP3CL-3.7 The interpolation period is 1 to 20 ms.
#[test]
fn ranges() {
    let mut drive = usual();
    for method in -128..128_i64 {
        let is_there = matches!(method, 1..=14 | 17..=30 | 33..=35 | 37);
        let expected = if is_there { Ok(()) } else { Err(AbortCode(0x0609_0030)) };
        assert_eq!(write(&mut drive, 0x6098, 0, method), expected, "{method}");
    }
    for (sub, value, expected) in [
        (1, 0, Err(AbortCode::VALUE_LOW)),
        (1, 1, Ok(())),
        (1, 20, Ok(())),
        (1, 21, Err(AbortCode::VALUE_HIGH)),
        (2, -3, Ok(())),
        (2, -4, Err(AbortCode::VALUE_LOW)),
        (2, 0, Err(AbortCode::VALUE_HIGH)),
    ] {
        assert_eq!(write(&mut drive, 0x60C2, sub, value), expected, "{sub} {value}");
    }
}

/// DP3CL-3.5 No complete access, whatever the object.
/// DP3CL-3.6 The other abort codes.
#[test]
fn abort_codes() {
    let mut drive = usual();
    for index in [0x1018, 0x1600, 0x1C12, 0x6099, 0x2001, 0x7777] {
        let at = ObjectAddress::new(index, 0);
        assert_eq!(drive.read(at, SdoScope::Complete, &mut [0; 64]).map_err(|code| code.0), Err(0x0601_0000));
        assert_eq!(drive.write(at, SdoScope::Complete, &[0; 4]).map_err(|code| code.0), Err(0x0601_0000));
    }
    for (index, sub, value, code) in [
        (0x6100, 0, &[0, 0][..], 0x0602_0000),
        (0x6099, 3, &[0; 4], 0x0609_0011),
        (0x6041, 0, &[0; 2], 0x0601_0002),
        (0x6081, 0, &[0; 2], 0x0607_0013),
        (0x6040, 0, &[0; 4], 0x0607_0012),
    ] {
        let written = drive.write(ObjectAddress::new(index, sub), SdoScope::Entry, value);
        assert_eq!(written.map_err(|code| code.0), Err(code), "{index:04X}");
    }
}

/// DP3CL-3.8 Increments are 4000 a turn, whatever the subdivision; 0x6092:1 is the subdivision.
/// DP3CL-3.10 The actual position is the demand of the cycle before; a jammed shaft stays.
#[test]
fn positions() {
    let mut bench = Bench::enabled(8);
    bench.target = 2500;
    bench.cycle();
    assert_eq!((bench.read(0x6062, 0), bench.position(), bench.read(0x60F4, 0)), (2500, 0, 2500));
    bench.cycle();
    assert_eq!((bench.position(), bench.read(0x6063, 0), bench.read(0x60FC, 0)), (2500, 1000, 1000));
    assert_eq!(bench.read(0x6092, 1), 10_000);
    bench.write(0x6092, 1, 20_000);
    assert_eq!(bench.read(0x2001, 0), 20_000);
    bench.write(0x2001, 0, 10_000);
    assert!(bench.drive.apply_fault(jam(true)));
    bench.target = 3000;
    bench.run_for(5 * MS);
    assert_eq!((bench.read(0x6062, 0), bench.position(), bench.shaft()), (3000, 2500, 2500));
    assert!(bench.drive.apply_fault(jam(false)));
    bench.run_for(2 * MS);
    assert_eq!((bench.position(), bench.shaft()), (3000, 3000));
    let stops = ecmsk::slave::Travel { stops: Some((-100, 100)), ..Dp3clConfig::default().travel };
    let mut bench = Bench::enabled_with(Dp3clConfig { travel: stops, ..Dp3clConfig::default() }, 8);
    for (target, seen) in [(300, 100), (-300, -100), (50, 50)] {
        bench.target = target;
        bench.run_for(3 * MS);
        assert_eq!((bench.position(), bench.shaft()), (seen, seen));
    }
}

/// DP3CL-3.9 The polarity changes the sign of positions and of velocities.
#[test]
fn polarity() {
    let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
    bench.write(0x607E, 0, 0xC0);
    bench.enable();
    for step in 1..=10 {
        bench.target = step * 100;
        bench.cycle();
    }
    assert_eq!(bench.velocity(), 100_000);
    bench.run_for(2 * MS);
    assert_eq!((bench.position(), bench.read(0x6062, 0), bench.shaft()), (1000, 1000, -1000));
}

/// DP3CL-4.2 A variant has 10 sub-indices.
#[test]
fn ten_entries() {
    let variants = Dp3clVariants { ten_entries: true, ..Dp3clVariants::default() };
    let mut drive = in_preop(Dp3clConfig { variants, ..Dp3clConfig::default() });
    assert_eq!(read(&mut drive, 0x1600, 10), Ok(0));
    assert_eq!(read(&mut drive, 0x1600, 11), Err(AbortCode::NO_SUB_INDEX));
    drive.restart();
    drive.enter(ecmsk::ethercat::AlState::PreOp).unwrap();
    assert_eq!(read(&mut drive, 0x1600, 11), Err(AbortCode::NO_SUB_INDEX));
}

/// DP3CL-3.11 The position is 0 at power-on.
#[test]
fn position_at_power_on() {
    let mut bench = Bench::enabled_with(Dp3clConfig { position: 20_000, ..Dp3clConfig::default() }, 8);
    assert_eq!((bench.position(), bench.shaft()), (0, 20_000));
    bench.target = -700;
    bench.run_for(3 * MS);
    assert_eq!((bench.position(), bench.shaft()), (-700, 19_300));
    bench.drive.restart();
    bench.drive.enter(ecmsk::ethercat::AlState::PreOp).unwrap();
    assert_eq!((bench.position(), bench.shaft()), (0, 19_300));
}

/// DP3CL-3.1 The data types of the manual and of the maker's slave description: those that are signed, those of one byte, and all
/// others.
#[test]
fn types() {
    const SIGNED: &[u16] = &[
        0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x6060, 0x6061, 0x6062, 0x6063, 0x6064, 0x606B, 0x606C, 0x6071, 0x6074,
        0x6077, 0x6078, 0x607A, 0x607B, 0x607C, 0x607D, 0x6086, 0x6088, 0x6098, 0x60B0, 0x60B1, 0x60B2, 0x60BA, 0x60BB,
        0x60BC, 0x60BD, 0x60C0, 0x60F4, 0x60FA, 0x60FC, 0x60FF,
    ];
    let drive = usual();
    for (index, sub, bytes, ..) in TABLE.iter().copied() {
        let is_signed = SIGNED.contains(&index) || (index, sub) == (0x60C2, 2);
        let data_type = match (bytes, is_signed) {
            (1, true) => 2,
            (2, true) => 3,
            (_, true) => 4,
            (1, false) => 5,
            (2, false) => 6,
            (_, false) => 7,
        };
        let entry = drive.describe_entry(ObjectAddress::new(index, sub)).unwrap();
        assert_eq!(entry.data_type.0, data_type, "{index:04X}:{sub}");
    }
    // Every object from 0x6000 on is in the table.
    let known = |index: &u16| TABLE.iter().any(|(known, ..)| known == index);
    let objects = drive.object_list(ecmsk::coe::ObjectListType::All);
    assert!(objects.iter().filter(|index| **index >= 0x6000).all(known));
}

/// DP3CL-3.12 The start-up commands of the maker's slave description are taken in PreOP, and a period that differs from
/// SYNC0's raises no alarm.
#[test]
fn start_up_commands() {
    let mut drive = usual();
    for (index, sub, value) in [(0x6060, 0, 8), (0x60C2, 1, 1), (0x60C2, 2, -3)] {
        assert_eq!(write(&mut drive, index, sub, value), Ok(()), "{index:04X}:{sub}");
    }
    write(&mut drive, 0x60C2, 1, 20).unwrap();
    drive.set_sync_managers(8, 19);
    drive.set_sync_cycle(Some(MS));
    drive.enter(ecmsk::ethercat::AlState::SafeOp).unwrap();
    assert_eq!((drive.alarm(), read(&mut drive, 0x60C2, 1)), (None, Ok(20)));
}

/// DP3CL-3.13 Objects that are only stored have no effect, and linear ramps are the only profile.
#[test]
fn stored_only() {
    let mut bench = Bench::enabled(3);
    let mut plain = Bench::enabled(3);
    for bench in [&mut bench, &mut plain] {
        bench.write(0x60FF, 0, 600);
    }
    for (index, sub, value) in [
        (0x6071, 0, 500),
        (0x6072, 0, 1),
        (0x6087, 0, 3),
        (0x6088, 0, 1),
        (0x6091, 1, 7),
        (0x6093, 1, 9),
        (0x60A4, 1, 1),
        (0x60A4, 2, 2),
        (0x60B1, 0, 5000),
        (0x60B2, 0, 50),
        (0x60C0, 0, 1),
        (0x60C1, 1, 4),
        (0x60E0, 0, 1),
        (0x60E1, 0, 1),
        (0x60F2, 0, 0x00C0),
        (0x60FE, 1, 0x0001_0001),
        (0x60FE, 2, 0xFFFF_FFFF_u32.cast_signed().into()),
        (0x2101, 0, 1),
        (0x2102, 0, 1),
        (0x210D, 0, 100),
        (0x200B, 0, 2),
        (0x2301, 0, 0),
    ] {
        bench.write(index, sub, value);
        assert_eq!(bench.read(index, sub), value, "{index:04X}:{sub}");
    }
    for bench in [&mut bench, &mut plain] {
        bench.run_for(200 * MS);
    }
    assert_eq!((bench.shaft(), bench.velocity()), (plain.shaft(), plain.velocity()));
    assert_eq!((bench.drive.outputs(), bench.status()), (plain.drive.outputs(), plain.status()));
    for value in [-1, 1] {
        assert!(write(&mut bench.drive, 0x6086, 0, value).is_err(), "{value}");
    }
}

/// DP3CL-3.14 0x6078 is the current in 0.1 % of the peak current, 0x60FA the velocity in u/s, 0x6079 the supply in mV; there is no torque.
#[test]
fn readings() {
    let mut bench = Bench::enabled(3);
    bench.write(0x2005, 0, 80);
    bench.write(0x60FF, 0, -600);
    bench.run_for(200 * MS);
    let shown = [0x6078, 0x60FA, 0x606C, 0x606B, 0x6074, 0x6077].map(|index| match index {
        0x60FA | 0x606C | 0x606B => bench.read(index, 0),
        _ => i64::from(bench.read(index, 0) as u16 as i16),
    });
    assert_eq!(shown, [800, -10_000, -10_000, -600, 0, 0]);
    bench.drive.set_supply(24_000);
    assert_eq!(bench.read(0x6079, 0), 24_000);
}
