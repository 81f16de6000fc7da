//! The object dictionary of servo drives and steppers (CiA 402-2, ETG.1000.6). Positions in counts, speeds in counts/s.

use super::{Drive, DriveKind};
use crate::cia402::Controlword;
use crate::ethercat::AlState;
use crate::slave::axis::rounded;
use crate::slave::device::{Identity, VENDOR_ID, identity, synchronization};
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

pub(super) const QUICK_STOP_OPTION: Slot<i16> = slot(OBJECTS, 0x605A, 0);
pub(super) const SHUTDOWN_OPTION: Slot<i16> = slot(OBJECTS, 0x605B, 0);
pub(super) const DISABLE_OPTION: Slot<i16> = slot(OBJECTS, 0x605C, 0);
pub(super) const FAULT_OPTION: Slot<i16> = slot(OBJECTS, 0x605E, 0);
pub(super) const FOLLOWING_WINDOW: Slot<u32> = slot(OBJECTS, 0x6065, 0);
pub(super) const FOLLOWING_TIMEOUT: Slot<u16> = slot(OBJECTS, 0x6066, 0);
pub(super) const MAX_TORQUE: Slot<u16> = slot(OBJECTS, 0x6072, 0);
pub(super) const MIN_POSITION: Slot<i32> = slot(OBJECTS, 0x607D, 1);
pub(super) const MAX_POSITION: Slot<i32> = slot(OBJECTS, 0x607D, 2);
pub(super) const MAX_VELOCITY: Slot<u32> = slot(OBJECTS, 0x607F, 0);
pub(super) const PROFILE_DECELERATION: Slot<u32> = slot(OBJECTS, 0x6084, 0);
pub(super) const QUICK_STOP_DECELERATION: Slot<u32> = slot(OBJECTS, 0x6085, 0);
const PROFILE_VELOCITY: Slot<u32> = slot(OBJECTS, 0x6081, 0);
const PROFILE_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x6083, 0);
pub(super) const HALT_OPTION: Slot<i16> = slot(OBJECTS, 0x605D, 0);
pub(super) const HOME_OFFSET: Slot<i32> = slot(OBJECTS, 0x607C, 0);
pub(super) const HOMING_METHOD: Slot<i8> = slot(OBJECTS, 0x6098, 0);
pub(super) const HOMING_SPEED_SWITCH: Slot<u32> = slot(OBJECTS, 0x6099, 1);
pub(super) const HOMING_SPEED_ZERO: Slot<u32> = slot(OBJECTS, 0x6099, 2);
pub(super) const HOMING_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x609A, 0);

/// The default values of the table, and \[OURS] those that depend on the motor.
pub(super) fn defaults(motor: &Motor) -> Values {
    let mut values = Values::new(OBJECTS);
    let turn = motor.counts_per_turn.max(1);
    values.set(FOLLOWING_WINDOW, turn.saturating_mul(3));
    values.set(MAX_TORQUE, motor.peak_torque);
    values.set(MAX_VELOCITY, motor.max_velocity);
    values.set(PROFILE_VELOCITY, turn.saturating_mul(10));
    for ramp in [PROFILE_ACCELERATION, PROFILE_DECELERATION, HOMING_ACCELERATION] {
        values.set(ramp, turn.saturating_mul(100));
    }
    values.set(QUICK_STOP_DECELERATION, turn.saturating_mul(1000));
    values.set(HOMING_SPEED_SWITCH, turn.saturating_mul(2));
    values.set(HOMING_SPEED_ZERO, turn / 5);
    values
}

type Row = Object<Drive>;

/// The object dictionary. The objects of profile modes have no effect; 0x605D, halt, acts in homing. 0x6098 takes any value: a
/// method that is not supported ends in a homing error when it is started \[OURS]. 0x60C2 has no effect, since the demand
/// follows the actual cycle.
pub(super) const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 3] = [&identity(), &synchronization(), CIA402];

/// The PDOs at power-on: for CSP, CSV and CST. \[OURS] The RxPDO of CSP is assigned.
pub(super) const PDOS: &[Pdo<Drive>] = &[
    tx_pdo!(OBJECTS, 0x1A00, true, [0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010]),
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020]),
    rx_pdo!(OBJECTS, 0x1601, false, [0x6040_0010, 0x60FF_0020]),
    rx_pdo!(OBJECTS, 0x1602, false, [0x6040_0010, 0x6071_0010]),
];

pub(super) const fn pdos_of(kind: DriveKind) -> &'static [Pdo<Drive>] {
    match kind {
        DriveKind::Servo => PDOS,
        DriveKind::Stepper => PDOS.split_at(2).0,
    }
}

const CIA402: &[Row] = &[
    Row::u16(0x603F, 0, "Error code").tx().live(|drive| drive.axis.measured().error_code.into()),
    Row::u16(0x6040, 0, "Controlword").rw().rx().live(|drive| drive.axis.machine().controlword().0.into()).setter(
        |drive, word| {
            drive.axis.machine_mut().command(Controlword(word as u16));
            Ok(())
        },
    ),
    Row::u16(0x6041, 0, "Statusword").tx().live(|drive| drive.axis.measured().statusword.0.into()),
    Row::i16(0x605A, 0, "Quick stop option code").rw().range(0, 8).default(2).changed(Drive::settings_changed),
    Row::i16(0x605B, 0, "Shutdown option code").rw().range(0, 1).changed(Drive::settings_changed),
    Row::i16(0x605C, 0, "Disable operation option code").rw().range(0, 1).default(1).changed(Drive::settings_changed),
    Row::i16(0x605D, 0, "Halt option code").rw().range(1, 4).default(1).changed(Drive::settings_changed),
    Row::i16(0x605E, 0, "Fault reaction option code").rw().range(0, 4).default(2).changed(Drive::settings_changed),
    Row::i8(0x6060, 0, "Modes of operation")
        .rw()
        .rx()
        .live(|drive| drive.axis.mode().code().into())
        .setter(Drive::set_mode),
    Row::i8(0x6061, 0, "Modes of operation display").tx().live(|drive| drive.axis.mode().code().into()),
    Row::i32(0x6062, 0, "Position demand value").tx().live(|drive| drive.axis.demand()),
    Row::i32(0x6064, 0, "Position actual value").tx().live(|drive| drive.axis.measured().position.into()),
    Row::u32(0x6065, 0, "Following error window").rw().rx().changed(Drive::settings_changed),
    Row::u16(0x6066, 0, "Following error time out").rw().rx().default(10).changed(Drive::settings_changed),
    Row::i32(0x606C, 0, "Velocity actual value").tx().live(|drive| rounded(drive.axis.plant().velocity())),
    Row::i16(0x6071, 0, "Target torque")
        .only_if(is_servo)
        .rw()
        .rx()
        .live(|drive| drive.axis.targets().torque.into())
        .setter(|drive, torque| {
            drive.axis.targets_mut().torque = torque as i16;
            Ok(())
        }),
    Row::u16(0x6072, 0, "Max torque").rw().rx().changed(Drive::settings_changed),
    Row::u32(0x6076, 0, "Motor rated torque").live(|drive| drive.motor.rated_torque.into()),
    Row::i16(0x6077, 0, "Torque actual value").tx().live(|drive| drive.axis.measured().torque.into()),
    Row::i32(0x607A, 0, "Target position")
        .rw()
        .rx_by(|drive, position| drive.axis.take_target_position(position as i32))
        .live(|drive| drive.axis.targets().position.into())
        .setter(|drive, position| {
            drive.axis.targets_mut().position = position as i32;
            Ok(())
        }),
    Row::i32(0x607C, 0, "Home offset").rw().changed(Drive::settings_changed),
    Row::u8(0x607D, 0, "Software position limit").default(2),
    Row::i32(0x607D, 1, "Min position limit").rw().default(i32::MIN as i64).changed(Drive::settings_changed),
    Row::i32(0x607D, 2, "Max position limit").rw().default(i32::MAX as i64).changed(Drive::settings_changed),
    Row::u32(0x607F, 0, "Max profile velocity").rw().rx().changed(Drive::settings_changed),
    Row::u32(0x6081, 0, "Profile velocity").rw().rx(),
    Row::u32(0x6083, 0, "Profile acceleration").rw().rx().range(1, u32::MAX as i64).default(1),
    Row::u32(0x6084, 0, "Profile deceleration")
        .rw()
        .rx()
        .range(1, u32::MAX as i64)
        .default(1)
        .changed(Drive::settings_changed),
    Row::u32(0x6085, 0, "Quick stop deceleration")
        .rw()
        .rx()
        .range(1, u32::MAX as i64)
        .default(1)
        .changed(Drive::settings_changed),
    Row::i8(0x6098, 0, "Homing method").rw().rx().default(35).changed(Drive::settings_changed),
    Row::u8(0x6099, 0, "Homing speeds").default(2),
    Row::u32(0x6099, 1, "Speed during search for switch").rw().rx().changed(Drive::settings_changed),
    Row::u32(0x6099, 2, "Speed during search for zero").rw().rx().changed(Drive::settings_changed),
    Row::u32(0x609A, 0, "Homing acceleration")
        .rw()
        .rx()
        .range(1, u32::MAX as i64)
        .default(1)
        .changed(Drive::settings_changed),
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
    Row::i32(0x60FF, 0, "Target velocity")
        .only_if(is_servo)
        .rw()
        .rx()
        .live(|drive| drive.axis.targets().velocity.into())
        .setter(|drive, velocity| {
            drive.axis.targets_mut().velocity = velocity as i32;
            Ok(())
        }),
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
