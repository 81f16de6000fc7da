//! The object dictionary of servo drives and steppers (CiA 402-2, ETG.1000.6). Positions in counts, speeds in counts/s.

use super::{Drive, DriveKind};
use crate::ethercat::AlState;
use crate::slave::axis::Settings;
use crate::slave::axis_objects::{AxisSlots, axis_objects, changed, target_velocity};
use crate::slave::device::{Identity, VENDOR_ID, description, identity, synchronization};
use crate::slave::dictionary::{Object, Slot, Values, check, join, rows, slot};
use crate::slave::plant::Motor;
use crate::slave::process_data::{Pdo, rx_pdo, tx_pdo};

/// Product code, 0x1018:2, of a servo drive. \[OURS] "SERV".
pub const PRODUCT_CODE: u32 = 0x5345_5256;
/// Product code, 0x1018:2, of a stepper. \[OURS] "STEP".
pub const STEPPER_PRODUCT_CODE: u32 = 0x5354_4550;
/// Revision, 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

/// The identity of a servo drive.
const SERVO: Identity = Identity {
    // Device profile 402, servo drive.
    device_type: 0x0002_0192,
    name: "SRVO simulated servo drive",
    vendor_id: VENDOR_ID,
    product_code: PRODUCT_CODE,
    revision: REVISION,
};
/// The identity of a stepper.
const STEPPER: Identity = Identity {
    // Device profile 402, stepper.
    device_type: 0x0004_0192,
    name: "STEP simulated stepper",
    product_code: STEPPER_PRODUCT_CODE,
    ..SERVO
};

pub(super) const fn identity_of(kind: DriveKind) -> &'static Identity {
    match kind {
        DriveKind::Servo => &SERVO,
        DriveKind::Stepper => &STEPPER,
    }
}

const AXIS: AxisSlots = AxisSlots::of::<_, 0>(OBJECTS);
const FOLLOWING_WINDOW: Slot<u32> = slot(OBJECTS, 0x6065, 0);
const FOLLOWING_TIMEOUT: Slot<u16> = slot(OBJECTS, 0x6066, 0);
const MAX_TORQUE: Slot<u16> = slot(OBJECTS, 0x6072, 0);
const MIN_POSITION: Slot<i32> = slot(OBJECTS, 0x607D, 1);
const MAX_POSITION: Slot<i32> = slot(OBJECTS, 0x607D, 2);
const PROFILE_VELOCITY: Slot<u32> = slot(OBJECTS, 0x6081, 0);
const PROFILE_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x6083, 0);

/// The settings that the axis reads from the stored values.
pub(super) fn settings(values: &Values) -> Settings {
    Settings {
        following_window: values.get(FOLLOWING_WINDOW),
        following_timeout_ms: values.get(FOLLOWING_TIMEOUT),
        position_limits: (values.get(MIN_POSITION), values.get(MAX_POSITION)),
        max_torque: values.get(MAX_TORQUE),
        ..AXIS.settings(values)
    }
}

/// The default values of the table, and \[OURS] those that depend on the motor.
pub(super) fn defaults(motor: &Motor) -> Values {
    let mut values = Values::new(OBJECTS);
    let turn = motor.counts_per_turn.max(1);
    values.set(FOLLOWING_WINDOW, turn.saturating_mul(3));
    values.set(MAX_TORQUE, motor.peak_torque);
    values.set(AXIS.max_velocity, motor.max_velocity);
    values.set(PROFILE_VELOCITY, turn.saturating_mul(10));
    for ramp in [PROFILE_ACCELERATION, AXIS.slow_down, AXIS.homing_acceleration] {
        values.set(ramp, turn.saturating_mul(100));
    }
    values.set(AXIS.quick_stop, turn.saturating_mul(1000));
    values.set(AXIS.homing_speed_switch, turn.saturating_mul(2));
    values.set(AXIS.homing_speed_zero, turn / 5);
    values
}

type Row = Object<Drive>;

/// The object dictionary. The objects of profile modes have no effect. 0x60C2 has none either, since the demand follows the
/// actual cycle.
pub(super) const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 5] = [&description(), &identity(), &synchronization(), &axis_objects::<_, 0>(), DRIVE];

/// The PDOs at power-on: for CSP, CSV and CST. \[OURS] The RxPDO of CSP is assigned.
pub(super) const PDOS: &[Pdo<Drive>] = &[
    tx_pdo!(OBJECTS, 0x1A00, true, [0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010]),
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020]),
    rx_pdo!(OBJECTS, 0x1601, false, [0x6040_0010, 0x60FF_0020]),
    rx_pdo!(OBJECTS, 0x1602, false, [0x6040_0010, 0x6071_0010]),
];

/// The PDOs of masters that change between the cyclic modes in OP: all targets, all actual values.
pub(super) const OFTEN_MAPPED: &[Pdo<Drive>] = &[
    tx_pdo!(OBJECTS, 0x1A00, false, [0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010]),
    rx_pdo!(OBJECTS, 0x1600, false, [0x6040_0010, 0x607A_0020, 0x60FF_0020, 0x6071_0010]),
];

pub(super) const fn pdos_of(kind: DriveKind) -> &'static [Pdo<Drive>] {
    match kind {
        DriveKind::Servo => PDOS,
        DriveKind::Stepper => PDOS.split_at(2).0,
    }
}

/// The objects that other CiA 402 axes do not have, or have otherwise.
const DRIVE: &[Row] = &[
    Row::u32(0x6065, 0, "Following error window").rw().rx().changed(changed::<_, 0>),
    Row::u16(0x6066, 0, "Following error time out").rw().rx().default(10).changed(changed::<_, 0>),
    Row::i16(0x6071, 0, "Target torque")
        .only_if(is_servo)
        .rw()
        .rx()
        .live(|drive| drive.axis.targets().torque.into())
        .setter(|drive, torque| {
            drive.axis.targets_mut().torque = torque as i16;
            Ok(())
        }),
    Row::u16(0x6072, 0, "Max torque").rw().rx().changed(changed::<_, 0>),
    Row::u32(0x6076, 0, "Motor rated torque").live(|drive| drive.motor.rated_torque.into()),
    Row::i16(0x6077, 0, "Torque actual value").tx().live(|drive| drive.axis.measured().torque.into()),
    Row::u8(0x607D, 0, "Software position limit").default(2),
    Row::i32(0x607D, 1, "Min position limit").rw().default(i32::MIN as i64).changed(changed::<_, 0>),
    Row::i32(0x607D, 2, "Max position limit").rw().default(i32::MAX as i64).changed(changed::<_, 0>),
    Row::u32(0x6081, 0, "Profile velocity").rw().rx(),
    Row::u32(0x6083, 0, "Profile acceleration").rw().rx().range(1, u32::MAX as i64).default(1),
    Row::u8(0x60C2, 0, "Interpolation time period").default(2),
    Row::u8(0x60C2, 1, "Period").rw_up_to(AlState::PreOp).range(1, 255).default(1),
    Row::i8(0x60C2, 2, "Index").rw_up_to(AlState::PreOp).range(-6, 0).default(-3),
    Row::i32(0x60F4, 0, "Following error actual value")
        .tx()
        .live(|drive| drive.axis.following_error().clamp(i32::MIN.into(), i32::MAX.into())),
    Row::u32(0x60FD, 0, "Digital inputs").tx().live(|drive| drive.axis.inputs().bits().into()),
    Row::u8(0x60FE, 0, "Digital outputs").default(2),
    // [OURS] Digital outputs of a drive are not wired, and cannot be mapped.
    Row::u32(0x60FE, 1, "Physical outputs").rw(),
    Row::u32(0x60FE, 2, "Bit mask").rw(),
    target_velocity::<_, 0>().only_if(is_servo),
    Row::u32(0x6502, 0, "Supported drive modes").live(supported_modes),
];

fn is_servo(drive: &Drive) -> bool {
    drive.kind == DriveKind::Servo
}

/// 0x6502: homing, CSP, and of a servo drive CSV and CST.
fn supported_modes(drive: &Drive) -> i64 {
    match drive.kind {
        DriveKind::Servo => 1 << 5 | 1 << 7 | 1 << 8 | 1 << 9,
        DriveKind::Stepper => 1 << 5 | 1 << 7,
    }
}
