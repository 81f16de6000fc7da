//! The object dictionary of servo drives and steppers (CiA 402-2, ETG.1000.6). Positions are in counts, speeds in counts/s.

use super::{Drive, DriveKind};
use crate::ethercat::AlState;
use crate::slave::axis::Settings;
use crate::slave::axis_objects::{AxisSlots, axis_objects, changed, target_velocity, velocity_offset};
use crate::slave::device::{Identity, VENDOR_ID, description, identity, synchronization};
use crate::slave::dictionary::{Object, Slot, Values, check, join, rows, slot};
use crate::slave::plant::Motor;
use crate::slave::process_data::{Pdo, rx_pdo, tx_pdo};

/// Product code, 0x1018:2, of a servo drive. \[OURS] The letters "SERV" in ASCII.
pub const PRODUCT_CODE: u32 = 0x5345_5256;
/// Product code, 0x1018:2, of a stepper. \[OURS] The letters "STEP" in ASCII.
pub const STEPPER_PRODUCT_CODE: u32 = 0x5354_4550;
/// Revision, 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

/// The identity of a servo drive.
const SERVO: Identity = Identity {
    // The device profile is 402 (0x0192); 0x0002 stands for a servo drive.
    device_type: 0x0002_0192,
    name: "SRVO simulated servo drive",
    vendor_id: VENDOR_ID,
    product_code: PRODUCT_CODE,
    revision: REVISION,
};
/// The identity of a stepper.
const STEPPER: Identity = Identity {
    // The device profile is 402 (0x0192); 0x0004 stands for a stepper.
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
const POSITIVE_TORQUE: Slot<u16> = slot(OBJECTS, 0x60E0, 0);
const NEGATIVE_TORQUE: Slot<u16> = slot(OBJECTS, 0x60E1, 0);
const MIN_POSITION: Slot<i32> = slot(OBJECTS, 0x607D, 1);
const MAX_POSITION: Slot<i32> = slot(OBJECTS, 0x607D, 2);
const PROFILE_VELOCITY: Slot<u32> = slot(OBJECTS, 0x6081, 0);
const PROFILE_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x6083, 0);

/// The settings of the axis, such as limits and ramps, from the values of the objects.
pub(super) fn settings(values: &Values) -> Settings {
    Settings {
        following_window: values.get(FOLLOWING_WINDOW),
        following_timeout_ms: values.get(FOLLOWING_TIMEOUT),
        position_limits: (values.get(MIN_POSITION), values.get(MAX_POSITION)),
        // [OURS] The lowest of the three torque limits applies in both directions.
        max_torque: values.get(MAX_TORQUE).min(values.get(POSITIVE_TORQUE)).min(values.get(NEGATIVE_TORQUE)),
        ..AXIS.settings(values)
    }
}

/// The default values of all objects. \[OURS] Limits, velocities and ramps follow from the motor.
pub(super) fn defaults(motor: &Motor) -> Values {
    let mut values = Values::new(OBJECTS);
    let turn = motor.counts_per_turn.max(1);
    values.set(FOLLOWING_WINDOW, turn.saturating_mul(3));
    for limit in [MAX_TORQUE, POSITIVE_TORQUE, NEGATIVE_TORQUE] {
        values.set(limit, motor.peak_torque);
    }
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

/// The object dictionary: the objects of CiA 402-2 and ETG.6010 for the modes of a drive, and other objects that masters
/// map or write.
///
/// The objects of profile modes have no effect. 0x60C2 has no effect either, because the demand follows the actual cycle.
/// \[OURS] An object that would change the motion in a way that is not simulated accepts only its neutral value, so that a
/// master notices: no polarity (0x607E), no gear (0x6091), no touch probe (0x60B8).
pub(super) const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 5] = [&description(), &identity(), &synchronization(), &axis_objects::<_, 0>(), DRIVE];

/// The PDOs at power-on: for CSP, CSV and CST, and \[OURS] five empty ones per direction for masters that map objects into
/// other PDOs than the first ones. \[OURS] The PDOs for CSP are assigned.
pub(super) const PDOS: &[Pdo<Drive>] = &[
    tx_pdo!(OBJECTS, 0x1A00, true, [0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010]),
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020]),
    rx_pdo!(OBJECTS, 0x1601, false, [0x6040_0010, 0x60FF_0020]),
    tx_pdo!(OBJECTS, 0x1A01, false, [0x6041_0010, 0x6064_0020, 0x606C_0020]),
    rx_pdo!(OBJECTS, 0x1602, false, [0x6040_0010, 0x6071_0010]),
    tx_pdo!(OBJECTS, 0x1A02, false, [0x6041_0010, 0x6064_0020, 0x6077_0010]),
    Pdo::empty(0x1603),
    Pdo::empty(0x1604),
    Pdo::empty(0x1605),
    Pdo::empty(0x1606),
    Pdo::empty(0x1607),
    Pdo::empty(0x1A03),
    Pdo::empty(0x1A04),
    Pdo::empty(0x1A05),
    Pdo::empty(0x1A06),
    Pdo::empty(0x1A07),
];

/// The PDOs of a stepper, which has neither CSV nor CST.
const STEPPER_PDOS: &[Pdo<Drive>] = &[
    tx_pdo!(OBJECTS, 0x1A00, true, [0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010]),
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020]),
    Pdo::empty(0x1601),
    Pdo::empty(0x1602),
    Pdo::empty(0x1603),
    Pdo::empty(0x1604),
    Pdo::empty(0x1605),
    Pdo::empty(0x1606),
    Pdo::empty(0x1607),
    tx_pdo!(OBJECTS, 0x1A01, false, [0x6041_0010, 0x6064_0020, 0x606C_0020]),
    tx_pdo!(OBJECTS, 0x1A02, false, [0x6041_0010, 0x6064_0020, 0x6077_0010]),
    Pdo::empty(0x1A03),
    Pdo::empty(0x1A04),
    Pdo::empty(0x1A05),
    Pdo::empty(0x1A06),
    Pdo::empty(0x1A07),
];

/// PDOs that a master maps if it changes between the cyclic modes in OP: all targets and all actual values. One function copies
/// a PDO with exactly these entries, which is faster than entry by entry.
pub(super) const OFTEN_MAPPED: &[Pdo<Drive>] = &[
    tx_pdo!(OBJECTS, 0x1A00, false, [0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010]),
    rx_pdo!(OBJECTS, 0x1600, false, [0x6040_0010, 0x607A_0020, 0x60FF_0020, 0x6071_0010]),
];

pub(super) const fn pdos_of(kind: DriveKind) -> &'static [Pdo<Drive>] {
    match kind {
        DriveKind::Servo => PDOS,
        DriveKind::Stepper => STEPPER_PDOS,
    }
}

/// The objects that a drive has in addition to the objects of every CiA 402 axis.
const DRIVE: &[Row] = &[
    // [OURS] A simulated drive reports version 1.0 of its hardware and its software.
    Row::text(0x1009, 0, "Hardware version", |_| "1.0"),
    Row::text(0x100A, 0, "Software version", |_| "1.0"),
    Row::u32(0x6065, 0, "Following error window").rw().rx().changed(changed::<_, 0>),
    Row::u16(0x6066, 0, "Following error time out").rw().rx().default(10).changed(changed::<_, 0>),
    Row::u32(0x6067, 0, "Position window").rw().rx(),
    Row::u16(0x6068, 0, "Position window time").rw().rx(),
    Row::u16(0x606D, 0, "Velocity window").rw().rx(),
    Row::u16(0x606E, 0, "Velocity window time").rw().rx(),
    Row::u16(0x606F, 0, "Velocity threshold").rw().rx(),
    Row::u16(0x6070, 0, "Velocity threshold time").rw().rx(),
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
    Row::u16(0x6073, 0, "Max current").rw().rx().default(MAX_CURRENT),
    Row::i16(0x6074, 0, "Torque demand value").tx().live(|drive| drive.axis.measured().torque.into()),
    Row::u32(0x6075, 0, "Motor rated current").rw().default(RATED_CURRENT_MA),
    Row::u32(0x6076, 0, "Motor rated torque").live(|drive| drive.motor.rated_torque.into()),
    Row::i16(0x6077, 0, "Torque actual value").tx().live(|drive| drive.axis.measured().torque.into()),
    // [OURS] The current is proportional to the torque, each relative to its rated value.
    Row::i16(0x6078, 0, "Current actual value").tx().live(|drive| drive.axis.measured().torque.into()),
    Row::u32(0x6079, 0, "DC link circuit voltage").tx().default(DC_LINK_MV),
    Row::u8(0x607D, 0, "Software position limit").default(2),
    Row::i32(0x607D, 1, "Min position limit").rw().rx().default(i32::MIN as i64).changed(changed::<_, 0>),
    Row::i32(0x607D, 2, "Max position limit").rw().rx().default(i32::MAX as i64).changed(changed::<_, 0>),
    Row::u8(0x607E, 0, "Polarity").rw().rx().range(0, 0),
    Row::u32(0x6080, 0, "Max motor speed").live(|drive| rpm(&drive.motor)),
    Row::u32(0x6081, 0, "Profile velocity").rw().rx(),
    Row::u32(0x6082, 0, "End velocity").rw().rx(),
    Row::u32(0x6083, 0, "Profile acceleration").rw().rx().range(1, u32::MAX as i64).default(1),
    Row::i16(0x6086, 0, "Motion profile type").rw().rx().range(0, 0),
    Row::u32(0x6087, 0, "Torque slope").rw().rx(),
    Row::u8(0x608F, 0, "Position encoder resolution").default(2),
    Row::u32(0x608F, 1, "Encoder increments").live(|drive| drive.motor.counts_per_turn.into()),
    Row::u32(0x608F, 2, "Motor revolutions").default(1),
    Row::u8(0x6091, 0, "Gear ratio").default(2),
    Row::u32(0x6091, 1, "Motor revolutions").rw().range(1, 1).default(1),
    Row::u32(0x6091, 2, "Shaft revolutions").rw().range(1, 1).default(1),
    Row::u8(0x6092, 0, "Feed constant").default(2),
    Row::u32(0x6092, 1, "Feed").live(|drive| drive.motor.counts_per_turn.into()),
    Row::u32(0x6092, 2, "Shaft revolutions").default(1),
    velocity_offset::<_, 0>().only_if(is_servo),
    Row::i16(0x60B2, 0, "Torque offset")
        .only_if(is_servo)
        .rw()
        .rx()
        .live(|drive| drive.axis.offsets().torque.into())
        .setter(|drive, torque| {
            drive.axis.offsets_mut().torque = torque as i16;
            Ok(())
        }),
    Row::u16(0x60B8, 0, "Touch probe function").rw().rx().range(0, 0),
    Row::u16(0x60B9, 0, "Touch probe status").tx(),
    Row::i32(0x60BA, 0, "Touch probe 1 positive edge").tx(),
    Row::i32(0x60BB, 0, "Touch probe 1 negative edge").tx(),
    Row::i32(0x60BC, 0, "Touch probe 2 positive edge").tx(),
    Row::i32(0x60BD, 0, "Touch probe 2 negative edge").tx(),
    Row::u8(0x60C2, 0, "Interpolation time period").default(2),
    Row::u8(0x60C2, 1, "Period").rw_up_to(AlState::PreOp).range(1, 255).default(1),
    Row::i8(0x60C2, 2, "Index").rw_up_to(AlState::PreOp).range(-6, 0).default(-3),
    Row::u32(0x60C5, 0, "Max acceleration").rw().rx().default(u32::MAX as i64),
    Row::u32(0x60C6, 0, "Max deceleration").rw().rx().default(u32::MAX as i64),
    Row::u16(0x60E0, 0, "Positive torque limit value").rw().rx().changed(changed::<_, 0>),
    Row::u16(0x60E1, 0, "Negative torque limit value").rw().rx().changed(changed::<_, 0>),
    Row::u16(0x60F2, 0, "Positioning option code").rw().rx(),
    Row::i32(0x60F4, 0, "Following error actual value")
        .tx()
        .live(|drive| drive.axis.following_error().clamp(i32::MIN.into(), i32::MAX.into())),
    Row::u32(0x60FD, 0, "Digital inputs").tx().live(|drive| drive.axis.inputs().bits().into()),
    Row::u8(0x60FE, 0, "Digital outputs").default(2),
    // [OURS] The digital outputs of a drive are not connected; a written value is read back.
    Row::u32(0x60FE, 1, "Physical outputs").rw().rx(),
    Row::u32(0x60FE, 2, "Bit mask").rw().rx(),
    target_velocity::<_, 0>().only_if(is_servo),
    Row::u16(0x6402, 0, "Motor type").live(motor_type),
    Row::u32(0x6502, 0, "Supported drive modes").live(supported_modes),
];

/// \[OURS] Maximum current of the motor (0.1 % of rated), rated current (mA) and DC link voltage (mV): the values of a
/// drive with the default motor (1.27 N m rated torque) on 230 V AC.
const MAX_CURRENT: i64 = 3000;
const RATED_CURRENT_MA: i64 = 2800;
const DC_LINK_MV: i64 = 325_000;

/// The maximum speed, rpm.
fn rpm(motor: &Motor) -> i64 {
    i64::from(motor.max_velocity) * 60 / i64::from(motor.counts_per_turn.max(1))
}

/// 0x6402, motor type: a sinusoidal PM brushless motor, or a micro-step stepper.
fn motor_type(drive: &Drive) -> i64 {
    match drive.kind {
        DriveKind::Servo => 10,
        DriveKind::Stepper => 9,
    }
}

fn is_servo(drive: &Drive) -> bool {
    drive.kind == DriveKind::Servo
}

/// 0x6502, supported drive modes: homing and CSP; a servo drive also CSV and CST.
fn supported_modes(drive: &Drive) -> i64 {
    match drive.kind {
        DriveKind::Servo => 1 << 5 | 1 << 7 | 1 << 8 | 1 << 9,
        DriveKind::Stepper => 1 << 5 | 1 << 7,
    }
}
