//! The process data of a DP3CL: tables, assignment, the limit of 24 bytes.

use ecmsk::coe::AbortCode;
use ecmsk::ethercat::AlState;
use ecmsk::slave::{AlStatus, Slave};

use super::bench::{list, read, usual, write};

/// DP3CL-4.1 The tables of power-on.
#[test]
fn tables_at_power_on() {
    let tables: [(u16, &[i64]); 8] = [
        (0x1600, &[0x6040_0010, 0x607A_0020, 0x60B8_0010]),
        (0x1601, &[0x6040_0010, 0x607A_0020, 0x6081_0020, 0x6083_0020, 0x6084_0020, 0x6060_0008]),
        (0x1602, &[0x6040_0010, 0x60FF_0020, 0x6083_0020, 0x6084_0020, 0x6060_0008]),
        (
            0x1603,
            &[0x6040_0010, 0x6098_0008, 0x6099_0120, 0x6099_0220, 0x609A_0020, 0x607C_0020, 0x6060_0008, 0x60FE_0120],
        ),
        (0x1A00, &[0x603F_0010, 0x6041_0010, 0x6061_0008, 0x6064_0020, 0x60B9_0010, 0x60BA_0020, 0x60FD_0020]),
        (0x1A01, &[0x6041_0010, 0x6064_0020, 0x606C_0020]),
        (0x1A02, &[0x6041_0010, 0x6064_0020, 0x606C_0020]),
        (0x1A03, &[0x6041_0010, 0x6064_0020, 0x606C_0020]),
    ];
    let mut drive = usual();
    for (index, entries) in tables {
        assert_eq!(read(&mut drive, index, 0), Ok(entries.len() as i64));
        for (sub, entry) in (1..).zip(entries) {
            assert_eq!(read(&mut drive, index, sub), Ok(*entry), "{index:04X}:{sub}");
        }
    }
    for (index, first) in [(0x1C12, 0x1600), (0x1C13, 0x1A00)] {
        assert_eq!([0, 1, 2, 4].map(|sub| read(&mut drive, index, sub)), [Ok(1), Ok(first), Ok(0), Ok(0)]);
    }
    assert_eq!([0, 1, 2, 3, 4].map(|sub| read(&mut drive, 0x1C00, sub)), [4, 1, 2, 3, 4].map(Ok));
}

/// DP3CL-4.2 24 sub-indices, and no more. DP3CL-4.3 Valid entries, and when they can be written. DP3CL-4.5 Valid
/// assignments.
#[test]
fn entries() {
    let mut drive = usual();
    assert_eq!(read(&mut drive, 0x1600, 24), Ok(0));
    assert_eq!(read(&mut drive, 0x1600, 25), Err(AbortCode::NO_SUB_INDEX));
    assert_eq!(write(&mut drive, 0x1600, 0, 25), Err(AbortCode(0x0609_0031)));
    for (table, entry, code) in [
        (0x1600, 0x6040_0020, 0x0604_0041),
        (0x1600, 0x6041_0010, 0x0604_0041),
        (0x1600, 0x605A_0010, 0x0604_0041),
        (0x1600, 0x0000_0008, 0x0604_0041),
        (0x1A00, 0x0000_0010, 0x0604_0041),
        (0x1600, 0x6101_0010, 0x0602_0000),
        (0x1600, 0x6099_0320, 0x0609_0011),
    ] {
        assert_eq!(list(&mut drive, table, &[entry]).map_err(|code| code.0), Err(code), "{entry:08X}");
    }
    assert_eq!(list(&mut drive, 0x1C12, &[0x1600, 0x1601, 0x1602, 0x1603]), Ok(()));
    for (assignment, tables) in [(0x1C12, &[0x1A00][..]), (0x1C12, &[0x1604]), (0x1C13, &[0x1600])] {
        assert_eq!(list(&mut drive, assignment, tables), Err(AbortCode::NOT_MAPPABLE));
    }
    assert_eq!(list(&mut drive, 0x1C13, &[0x1A01, 0x1A01]), Err(AbortCode::PARAMETER_INCOMPATIBLE));
    assert_eq!(write(&mut drive, 0x1C12, 0, 5), Err(AbortCode::VALUE_HIGH));
    let mut drive = usual();
    drive.set_sync_managers(8, 19);
    drive.enter(AlState::SafeOp).unwrap();
    assert_eq!(write(&mut drive, 0x1600, 0, 0), Err(AbortCode(0x0800_0022)));
}

/// DP3CL-4.4 24 bytes a direction go to SafeOP and 25 do not, however many tables they are in.
#[test]
fn the_limit_of_24_bytes() {
    let long: &[u32] = &[0x607A_0020, 0x6081_0020, 0x6083_0020, 0x6084_0020, 0x6085_0020, 0x60FF_0020];
    let mut drive = usual();
    assert_eq!(list(&mut drive, 0x1600, long), Ok(()));
    drive.set_sync_managers(24, 19);
    assert_eq!(drive.enter(AlState::SafeOp), Ok(()));
    drive.enter(AlState::PreOp).unwrap();
    assert_eq!(list(&mut drive, 0x1601, &[0x6060_0008]), Ok(()));
    assert_eq!(list(&mut drive, 0x1C12, &[0x1600, 0x1601]), Ok(()));
    drive.set_sync_managers(25, 19);
    assert_eq!(drive.enter(AlState::SafeOp), Err(AlStatus(0x0025)));
    assert_eq!((drive.state(), drive.alarm().map(|alarm| alarm.number())), (AlState::PreOp, Some(851)));
    assert_eq!(read(&mut drive, 0x603F, 0), Ok(0xFF55));
    let mut drive = usual();
    let inputs: &[u32] = &[0x6064_0020, 0x6062_0020, 0x6063_0020, 0x606C_0020, 0x60BA_0020, 0x60FD_0020, 0x6061_0008];
    assert_eq!(list(&mut drive, 0x1A00, inputs), Ok(()));
    drive.set_sync_managers(8, 25);
    assert_eq!(drive.enter(AlState::SafeOp), Err(AlStatus(0x0024)));
    assert_eq!(drive.alarm().map(|alarm| alarm.number()), Some(850));
}

/// DP3CL-4.6 Mapped tables move their entries, in their order.
#[test]
fn images() {
    let mut drive = usual();
    list(&mut drive, 0x1602, &[0x6060_0008, 0x60FE_0120, 0x6040_0010]).unwrap();
    list(&mut drive, 0x1603, &[0x6098_0008]).unwrap();
    list(&mut drive, 0x1C12, &[0x1603, 0x1602]).unwrap();
    list(&mut drive, 0x1A02, &[0x1001_0008, 0x6061_0008, 0x6502_0020]).unwrap();
    list(&mut drive, 0x1C13, &[0x1A02]).unwrap();
    drive.set_sync_managers(8, 6);
    for state in [AlState::SafeOp, AlState::Op] {
        drive.enter(state).unwrap();
    }
    let mut inputs = [0xA5; 6];
    drive.exchange(Some(&[17, 3, 0x78, 0x56, 0x34, 0x12, 0x06, 0x00]), &mut inputs);
    drive.step(1_000_000);
    drive.exchange(Some(&[99, 3, 0x78, 0x56, 0x34, 0x12, 0x06, 0x00]), &mut inputs);
    assert_eq!(inputs, [0, 3, 0xA5, 0, 0, 0]);
    assert_eq!(read(&mut drive, 0x6098, 0), Ok(17), "a method that is not supported is not taken");
    assert_eq!((read(&mut drive, 0x60FE, 1), read(&mut drive, 0x6040, 0)), (Ok(0x1234_5678), Ok(6)));
}

/// DP3CL-4.2, DP3CL-4.6 The example that the manual prints: four entries, 9 bytes.
#[test]
fn the_example_of_the_manual() {
    let mut drive = usual();
    let entries = [0x6040_0010, 0x6060_0008, 0x607A_0020, 0x60B8_0010];
    assert_eq!(list(&mut drive, 0x1600, &entries), Ok(()));
    for (sub, entry) in (1..).zip(entries.into_iter().chain([0; 20])) {
        assert_eq!(read(&mut drive, 0x1600, sub), Ok(entry.into()), "{sub}");
    }
    drive.set_sync_managers(9, 19);
    for state in [AlState::SafeOp, AlState::Op] {
        drive.enter(state).unwrap();
    }
    drive.exchange(Some(&[6, 0, 1, 0x44, 0x33, 0x22, 0x11, 0x13, 0]), &mut [0; 19]);
    let written = [0x6040, 0x6060, 0x607A, 0x60B8].map(|index| read(&mut drive, index, 0));
    assert_eq!(written, [6, 1, 0x1122_3344, 0x13].map(Ok));
    // The next process data overwrite a value that an SDO writes.
    write(&mut drive, 0x607A, 0, 77).unwrap();
    assert_eq!(read(&mut drive, 0x607A, 0), Ok(77));
    drive.exchange(Some(&[6, 0, 1, 0x44, 0x33, 0x22, 0x11, 0x13, 0]), &mut [0; 19]);
    assert_eq!(read(&mut drive, 0x607A, 0), Ok(0x1122_3344));
}

/// DP3CL-4.1, DP3CL-4.4 Each table of power-on goes to SafeOP with the length of its entries, 0x1603 with all 24 bytes.
#[test]
fn each_table_of_power_on() {
    for (table, len) in [(0x1600, 8), (0x1601, 19), (0x1602, 15), (0x1603, 24)] {
        let mut drive = usual();
        list(&mut drive, 0x1C12, &[table]).unwrap();
        drive.set_sync_managers(len, 19);
        assert_eq!(drive.enter(AlState::SafeOp), Ok(()), "{table:04X}");
    }
    for (table, len) in [(0x1A00, 19), (0x1A01, 10), (0x1A02, 10), (0x1A03, 10)] {
        let mut drive = usual();
        list(&mut drive, 0x1C13, &[table]).unwrap();
        drive.set_sync_managers(8, len);
        assert_eq!(drive.enter(AlState::SafeOp), Ok(()), "{table:04X}");
    }
}

/// DP3CL-4.3 Tables and assignments are written in PreOP alone, and entries while the count is 0.
#[test]
fn when_tables_are_written() {
    let mut drive = usual();
    assert!(write(&mut drive, 0x1600, 1, 0x6040_0010).is_err(), "the count is 3");
    assert!(write(&mut drive, 0x1C12, 1, 0x1601).is_err(), "the count is 1");
    drive.set_sync_managers(8, 19);
    for state in [AlState::SafeOp, AlState::Op] {
        drive.enter(state).unwrap();
        for index in [0x1600, 0x1603, 0x1A00, 0x1C12, 0x1C13] {
            assert_eq!(write(&mut drive, index, 0, 0), Err(AbortCode(0x0800_0022)), "{index:04X} {state:?}");
        }
    }
}
