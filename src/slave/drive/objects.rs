//! The servo drive's object dictionary (CiA 402-2, ETG.1000.6). Positions in counts, speeds in counts/s.

use super::Drive;
use crate::cia402::Controlword;
use crate::fieldbus::AlState;
use crate::sk::DriveSync;
use crate::slave::axis::rounded;
use crate::slave::dictionary::{Device, Object, Slot, Values, check, slot};
use crate::slave::plant::Motor;

/// 0x1018:1. \[OURS] "ECMS": no vendor's number.
pub const VENDOR_ID: u32 = 0x4543_4D53;
/// 0x1018:2. \[OURS] "SERV".
pub const PRODUCT_CODE: u32 = 0x5345_5256;
/// 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

/// 0x1000: device profile 402, servo drive.
const DEVICE_TYPE: i64 = 0x0002_0192;
/// 0x6502: homing, CSP, CSV, CST.
const SUPPORTED_MODES: i64 = 1 << 5 | 1 << 7 | 1 << 8 | 1 << 9;

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

/// The table's defaults, and \[OURS] those that go by the motor.
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

/// Every object. Those of profile modes are kept for what will use them; 0x605D, halt, acts in homing. 0x6098 takes any
/// value: a method that there is not ends in a homing error when it is started \[OURS]. 0x60C2 is kept: the demand goes
/// by the cycle as it is.
const OBJECTS: &[Row] = &[
    Row::u32(0x1000, 0, "Device type").default(DEVICE_TYPE),
    Row::u8(0x1001, 0, "Error register").live(|drive| error_register(drive.axis.measured().error_code)),
    Row::text(0x1008, 0, "Device name", "SRVO simulated servo drive"),
    Row::u8(0x1018, 0, "Identity").default(4),
    Row::u32(0x1018, 1, "Vendor ID").default(VENDOR_ID as i64),
    Row::u32(0x1018, 2, "Product code").default(PRODUCT_CODE as i64),
    Row::u32(0x1018, 3, "Revision").default(REVISION as i64),
    Row::u32(0x1018, 4, "Serial number").live(|drive| drive.serial.into()),
    Row::u8(0x1600, 0, "RxPDO CSP").default(2),
    Row::u32(0x1600, 1, "Controlword").default(0x6040_0010),
    Row::u32(0x1600, 2, "Target position").default(0x607A_0020),
    Row::u8(0x1601, 0, "RxPDO CSV").default(2),
    Row::u32(0x1601, 1, "Controlword").default(0x6040_0010),
    Row::u32(0x1601, 2, "Target velocity").default(0x60FF_0020),
    Row::u8(0x1602, 0, "RxPDO CST").default(2),
    Row::u32(0x1602, 1, "Controlword").default(0x6040_0010),
    Row::u32(0x1602, 2, "Target torque").default(0x6071_0010),
    Row::u8(0x1A00, 0, "TxPDO").default(4),
    Row::u32(0x1A00, 1, "Statusword").default(0x6041_0010),
    Row::u32(0x1A00, 2, "Position actual value").default(0x6064_0020),
    Row::u32(0x1A00, 3, "Torque actual value").default(0x6077_0010),
    Row::u32(0x1A00, 4, "Error code").default(0x603F_0010),
    Row::u8(0x1C12, 0, "RxPDO assign").live(|drive| drive.mapped.is_some().into()),
    Row::u16(0x1C12, 1, "RxPDO").live(|drive| drive.mapped.map_or(0, |mode| 0x1600 + i64::from(mode.code() - 8))),
    Row::u8(0x1C13, 0, "TxPDO assign").live(|drive| drive.mapped.is_some().into()),
    Row::u16(0x1C13, 1, "TxPDO").live(|drive| drive.mapped.map_or(0, |_| 0x1A00)),
    Row::u8(0x1C32, 0, "SM output parameter").default(1),
    Row::u16(0x1C32, 1, "Synchronization type").live(synchronization_type),
    Row::u8(0x1C33, 0, "SM input parameter").default(1),
    Row::u16(0x1C33, 1, "Synchronization type").live(synchronization_type),
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
    Row::i32(0x6064, 0, "Position actual value").tx().live(|drive| drive.axis.position()),
    Row::u32(0x6065, 0, "Following error window").rw().rx().changed(Drive::settings_changed),
    Row::u16(0x6066, 0, "Following error time out").rw().rx().default(10).changed(Drive::settings_changed),
    Row::i32(0x606C, 0, "Velocity actual value").tx().live(|drive| rounded(drive.axis.plant().velocity())),
    Row::i16(0x6071, 0, "Target torque").rw().rx().live(|drive| drive.axis.targets().torque.into()).setter(
        |drive, torque| {
            drive.axis.targets_mut().torque = torque as i16;
            Ok(())
        },
    ),
    Row::u16(0x6072, 0, "Max torque").rw().rx().changed(Drive::settings_changed),
    Row::u32(0x6076, 0, "Motor rated torque").live(|drive| drive.motor.rated_torque.into()),
    Row::i16(0x6077, 0, "Torque actual value").tx().live(|drive| drive.axis.measured().torque.into()),
    Row::i32(0x607A, 0, "Target position").rw().rx().live(|drive| drive.axis.targets().position.into()).setter(
        |drive, position| {
            drive.axis.targets_mut().position = position as i32;
            Ok(())
        },
    ),
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
    Row::u32(0x60FE, 1, "Physical outputs").rw().rx(),
    Row::u32(0x60FE, 2, "Bit mask").rw(),
    Row::i32(0x60FF, 0, "Target velocity").rw().rx().live(|drive| drive.axis.targets().velocity.into()).setter(
        |drive, velocity| {
            drive.axis.targets_mut().velocity = velocity as i32;
            Ok(())
        },
    ),
    Row::u32(0x6502, 0, "Supported drive modes").default(SUPPORTED_MODES),
];
const _: () = check(OBJECTS);

impl Device for Drive {
    fn objects() -> &'static [Object<Self>] {
        OBJECTS
    }

    fn values(&self) -> &Values {
        &self.values
    }

    fn values_mut(&mut self) -> &mut Values {
        &mut self.values
    }

    fn al_state(&self) -> AlState {
        self.al.state()
    }
}

/// 0x1C32:1 and 0x1C33:1: 0 free run, 2 DC with SYNC0.
fn synchronization_type(drive: &Drive) -> i64 {
    match drive.sync {
        DriveSync::FreeRun => 0,
        DriveSync::DcSync => 2,
    }
}

/// Error register (CiA 301 7.5.2.2) of an error code: bit 0 for any, and the bit of its group.
fn error_register(code: u16) -> i64 {
    let group = match code >> 12 {
        0 => return 0,
        2 => 1 << 1,
        3 => 1 << 2,
        4 => 1 << 3,
        _ if code >> 8 == 0x81 => 1 << 4,
        0xF => 1 << 7,
        _ => 1 << 5,
    };
    1 | group
}
