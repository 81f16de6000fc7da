//! Axes and network after the end of a program.

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::coe::ObjectAddress;
use ecmsk::ethercat::AlState;
use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{FifoEnable, Slaves};
use ecmsk::xf_api::{FieldType, XfError};

use super::{Kept, POSITION, TARGET, enabled, safe_op, started};

pub const S: u64 = 1_000_000_000;
/// The last target of [`moving`], and the velocity of [`moving_in_csv`].
pub const LAST_TARGET: i32 = 2000;
pub const SPEED: i32 = 50_000;
const VELOCITY: ObjectAddress = ObjectAddress::new(0x606C, 0);

pub fn drive_state(chip: &Kept, slave: u8) -> Option<DriveState> {
    Statusword(chip.object(slave, ObjectAddress::new(0x6041, 0)) as u16).state()
}

/// Two axes that move at 10 counts per cycle.
pub fn moving() -> (ecmsk::Xf<Kept>, Kept, ecmsk::xf_api::ProcessData) {
    let (mut xf, chip) = started("drive*2");
    let mut data = enabled(&mut xf).unwrap();
    for n in 1..=200 {
        for slave in 0..2 {
            data.set(data.output::<i32>(slave, TARGET).unwrap(), 10 * n);
        }
        xf.cycle(&mut data).unwrap();
    }
    assert_ne!(chip.object(0, VELOCITY), 0);
    (xf, chip, data)
}

pub fn stands_and_is_off(chip: &Kept) {
    for slave in 0..2 {
        assert_eq!(chip.state(slave), Some(AlState::SafeOp));
        let at = chip.object(slave, POSITION);
        chip.alone(S);
        assert_eq!(chip.object(slave, POSITION), at, "it stands");
        assert_eq!(drive_state(chip, slave), Some(DriveState::SwitchOnDisabled));
    }
}

/// XF-17.10 A program that ends, by `close`, by dropping or by a panic, leaves axes at rest and off, and a network in
/// SafeOP.
#[test]
fn an_end_stops_the_axes() {
    let (xf, chip, _) = moving();
    xf.close().unwrap();
    stands_and_is_off(&chip);

    let (xf, chip, _) = moving();
    drop(xf);
    stands_and_is_off(&chip);

    let (xf, chip, _) = moving();
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(move || {
        let _xf = xf;
        panic!("a program's own fault");
    }));
    assert!(panicked.is_err());
    stands_and_is_off(&chip);
}

/// Two axes in a mode that is not the chip's usual one, whose outputs have that object in place of 0x607A. They have this
/// value for 100 cycles.
fn moving_in<T: FieldType>(mode: i8, object: ObjectAddress, value: T) -> (ecmsk::Xf<Kept>, Kept) {
    let (mut xf, chip) = started("drive*2");
    let mut data = {
        xf.start_network(&ecmsk::xf_api::NetworkConfig::default()).unwrap();
        xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
        for slave in 0..2 {
            let at = |sub| ObjectAddress::new(0x1600, sub);
            xf.sdo_write(slave, at(0), 0_u8).unwrap();
            xf.sdo_write(slave, at(2), (u32::from(object.index) << 16) | (8 * T::BYTES as u32)).unwrap();
            xf.sdo_write(slave, at(0), 2_u8).unwrap();
        }
        safe_op_in(&mut xf, mode).unwrap()
    };
    xf.set_state(Slaves::All, EtherCatState::Op).unwrap();
    xf.run(&FifoEnable { on: true }).unwrap();
    xf.cycle(&mut data).unwrap();
    for motor in 0..2 {
        xf.enable(motor).unwrap();
    }
    for slave in 0..2 {
        data.set(data.output::<T>(slave, object).unwrap(), value);
    }
    for _ in 0..100 {
        xf.cycle(&mut data).unwrap();
    }
    (xf, chip)
}

/// Two axes in CSV at [`SPEED`].
pub fn moving_in_csv() -> (ecmsk::Xf<Kept>, Kept) {
    moving_in(9, ObjectAddress::new(0x60FF, 0), SPEED)
}

/// XF-17.10 The same in CSV, where an axis would go on forever, since the chip repeats the last outputs.
#[test]
fn an_end_stops_an_axis_in_csv() {
    let (xf, chip) = moving_in_csv();
    chip.alone(S);
    assert_ne!(chip.object(0, VELOCITY), 0, "the chip repeats the last outputs");
    drop(xf);
    stands_and_is_off(&chip);
}

/// How far both axes move in that time, without a host.
fn ways(chip: &Kept, ns: u64) -> [i32; 2] {
    let positions = || [0, 1].map(|slave| chip.object(slave, POSITION) as i32);
    let before = positions();
    chip.alone(ns);
    let after = positions();
    [0, 1].map(|axis| after[axis] - before[axis])
}

/// XF-11.17 A program that is killed stops nothing: in CSP an axis goes to its last target and stands there, enabled; in
/// CSV and CST it goes on without end.
#[test]
fn a_killed_program_leaves_the_chip_as_it_is() {
    let (xf, chip, _) = moving();
    std::mem::forget(xf);
    chip.alone(S);
    assert_eq!(ways(&chip, S), [0; 2]);
    for slave in 0..2 {
        assert!((chip.object(slave, POSITION) as i32 - LAST_TARGET).abs() <= 2, "{}", chip.object(slave, POSITION));
        assert_eq!(drive_state(&chip, slave), Some(DriveState::OperationEnabled));
    }

    let (xf, chip) = moving_in_csv();
    std::mem::forget(xf);
    chip.alone(S);
    for _ in 0..2 {
        let way = ways(&chip, S);
        assert!(way.iter().all(|way| (way - SPEED).abs() < SPEED / 100), "{way:?}");
    }

    let (xf, chip) = moving_in(10, ObjectAddress::new(0x6071, 0), 100_i16);
    std::mem::forget(xf);
    let (first, later) = (ways(&chip, S / 10), ways(&chip, S / 10));
    assert!(first.iter().zip(&later).all(|(first, later)| *first > 0 && later > first), "{first:?} {later:?}");
}

/// Sets the mode without a start of the network, which would undo the mapping.
fn safe_op_in(xf: &mut ecmsk::Xf<Kept>, mode: i8) -> Result<ecmsk::xf_api::ProcessData, XfError> {
    for slave in 0..2 {
        xf.sdo_write(slave, super::MODE, mode)?;
    }
    xf.run(&ecmsk::xf::request::Reconfig)?;
    xf.set_state(Slaves::All, EtherCatState::SafeOp)?;
    let data = xf.process_data()?;
    for slave in 0..2 {
        xf.add_axis(slave, slave, &data)?;
    }
    Ok(data)
}

/// XF-17.10 An axis that was commanded on, without an answer yet, is stopped like one that is on.
#[test]
fn an_axis_on_its_way_up_is_stopped() {
    let (mut xf, chip) = started("drive*2");
    let mut data = safe_op(&mut xf, 8).unwrap();
    xf.set_state(Slaves::All, EtherCatState::Op).unwrap();
    xf.run(&FifoEnable { on: true }).unwrap();
    xf.cycle(&mut data).unwrap();
    chip.cut_after(1);
    let error = xf.enable(0).unwrap_err();
    assert!(matches!(error, XfError::Link(_)), "{error}");
    chip.cut_after(u32::MAX);
    drop(xf);
    chip.alone(S);
    assert_eq!(drive_state(&chip, 0), Some(DriveState::SwitchOnDisabled));
    assert_eq!(chip.state(0), Some(AlState::SafeOp));
}

/// XF-17.10 A program that has moved nothing, or announces that it returns, leaves the network unchanged.
#[test]
fn what_was_not_moved_is_left_alone() {
    let (mut xf, chip) = started("drive*2");
    let data = safe_op(&mut xf, 8).unwrap();
    xf.set_state(Slaves::All, EtherCatState::Op).unwrap();
    drop(data);
    drop(xf);
    chip.alone(S / 10);
    assert_eq!(chip.state(1), Some(AlState::Op));

    let (xf, chip, _) = moving();
    xf.leave();
    assert_eq!((chip.state(0), drive_state(&chip, 0)), (Some(AlState::Op), Some(DriveState::OperationEnabled)));
}

/// XF-17.10 With cut wires `close` reports that it could not stop the axes.
#[test]
fn without_wires_close_is_an_error() {
    let (xf, chip, _) = moving();
    chip.cut_after(0);
    assert!(matches!(xf.close(), Err(XfError::Link(_))));
    assert_eq!(drive_state(&chip, 0), Some(DriveState::OperationEnabled));
}
