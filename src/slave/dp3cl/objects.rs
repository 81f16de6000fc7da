//! The object dictionary of the DP3CL, its PDOs, and the settings that its axis reads from them. Positions are in command
//! units, speeds in command units/s unless the row says otherwise.
//!
//! \[OURS] The dictionary contains the objects of the manual and those that only the manufacturer's ESI file has. For
//! 0x6000 to 0x6FFF the manual gives no power-on values; the defaults of the rows are used instead.

use super::monitors::MONITOR_ROWS;
use super::parameters::{COMMANDS, ENCODER_COUNTS, PARAMETER_ROWS, SUBDIVISION};
use super::{DEVICE_NAME, Dp3cl, Dp3clMode};
use crate::ethercat::cia402::Controlword;
use crate::ethercat::coe::AbortCode;
use crate::slave::axis::{NO_FOLLOWING_WINDOW, Settings, rounded};
use crate::slave::device::{Identity, Model, both, identity};
use crate::slave::dictionary::{Object, Slot, Values, check, join, rows, slot};
use crate::slave::homing::HomingSettings;
use crate::slave::process_data::{IMAGE_BYTES_MAX, MappingLimits, Pdo, rx_pdo, tx_pdo};
use crate::slave::state_machine::OptionCodes;

/// The identity of the drive. \[OURS] The manufacturer's ESI file contradicts itself: this is the identity in its
/// device type element; its defaults for object 0x1018 differ.
pub(super) const IDENTITY: Identity = Identity {
    // The device profile is 402 (0x0192); 0x0004 stands for a stepper.
    device_type: 0x0004_0192,
    name: DEVICE_NAME,
    vendor_id: 0x0000_0556,
    product_code: 0x3030_5070,
    revision: 0x2021_1108,
};

/// The maximum number of process data bytes per direction. \[OURS] It limits the sum of the assigned PDOs and is checked on
/// the change to SafeOP.
const PROCESS_DATA_BYTES_MAX: usize = 24;
/// \[OURS] A PDO has sub-indices 1 to 24, as in the manual; padding entries are refused.
pub(super) const LIMITS: MappingLimits = MappingLimits {
    entries: 24,
    pdos: 4,
    image_bytes: PROCESS_DATA_BYTES_MAX,
    padding: false,
    long_pdos_refused: false,
};
/// The same limits with 10 sub-indices, as in the manufacturer's ESI file.
pub(super) const TEN_ENTRIES: MappingLimits = MappingLimits { entries: 10, ..LIMITS };
const _: () = assert!(PROCESS_DATA_BYTES_MAX <= IMAGE_BYTES_MAX, "the image has room");

/// 0x6502, supported modes. \[OURS] Profile position, profile velocity, homing, CSP.
const SUPPORTED_MODES: i64 = 0xA5;
/// The synchronization type SYNC0 for 0x1C32:1 and 0x1C33:1.
pub(super) const DC_SYNC0: u16 = 2;
/// The supported synchronization types, 0x1C32:4 and 0x1C33:4: the value 0x8007 of the manufacturer's ESI file. Bits 0
/// to 2 are free run, sync manager event and SYNC0; bit 15 is only copied from that file.
const SYNC_TYPES: i64 = 0x8007;

pub(super) const OUTPUT_SYNC_TYPE: Slot<u16> = slot(OBJECTS, 0x1C32, 1);
pub(super) const INPUT_SYNC_TYPE: Slot<u16> = slot(OBJECTS, 0x1C33, 1);
pub(super) const SYNC_ERROR_LIMIT: Slot<u16> = slot(OBJECTS, 0x10F1, 2);
pub(super) const POLARITY: Slot<u8> = slot(OBJECTS, 0x607E, 0);
pub(super) const FOLLOWING_WINDOW: Slot<u32> = slot(OBJECTS, 0x6065, 0);
pub(super) const FOLLOWING_TIMEOUT: Slot<u16> = slot(OBJECTS, 0x6066, 0);
pub(super) const POSITION_WINDOW: Slot<u32> = slot(OBJECTS, 0x6067, 0);
pub(super) const POSITION_WINDOW_TIME: Slot<u16> = slot(OBJECTS, 0x6068, 0);
pub(super) const VELOCITY_WINDOW: Slot<u16> = slot(OBJECTS, 0x606D, 0);
pub(super) const VELOCITY_WINDOW_TIME: Slot<u16> = slot(OBJECTS, 0x606E, 0);
pub(super) const VELOCITY_THRESHOLD: Slot<u16> = slot(OBJECTS, 0x606F, 0);
pub(super) const VELOCITY_THRESHOLD_TIME: Slot<u16> = slot(OBJECTS, 0x6070, 0);
pub(super) const MAX_PROFILE_VELOCITY: Slot<u32> = slot(OBJECTS, 0x607F, 0);
pub(super) const MAX_MOTOR_SPEED: Slot<u32> = slot(OBJECTS, 0x6080, 0);
pub(super) const PROFILE_VELOCITY: Slot<u32> = slot(OBJECTS, 0x6081, 0);
pub(super) const PROFILE_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x6083, 0);
pub(super) const PROFILE_DECELERATION: Slot<u32> = slot(OBJECTS, 0x6084, 0);
pub(super) const QUICK_STOP: Slot<u32> = slot(OBJECTS, 0x6085, 0);
pub(super) const MAX_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x60C5, 0);
pub(super) const MAX_DECELERATION: Slot<u32> = slot(OBJECTS, 0x60C6, 0);
pub(super) const POSITION_OFFSET: Slot<i32> = slot(OBJECTS, 0x60B0, 0);
pub(super) const HALT_OPTION: Slot<i16> = slot(OBJECTS, 0x605D, 0);
const QUICK_STOP_OPTION: Slot<i16> = slot(OBJECTS, 0x605A, 0);
const SHUTDOWN_OPTION: Slot<i16> = slot(OBJECTS, 0x605B, 0);
const DISABLE_OPTION: Slot<i16> = slot(OBJECTS, 0x605C, 0);
const FAULT_OPTION: Slot<i16> = slot(OBJECTS, 0x605E, 0);
const HOMING_METHOD: Slot<i8> = slot(OBJECTS, 0x6098, 0);
const HOMING_SWITCH_SPEED: Slot<u32> = slot(OBJECTS, 0x6099, 1);
const HOMING_ZERO_SPEED: Slot<u32> = slot(OBJECTS, 0x6099, 2);
const HOMING_ACCELERATION: Slot<u32> = slot(OBJECTS, 0x609A, 0);
const HOME_OFFSET: Slot<i32> = slot(OBJECTS, 0x607C, 0);

/// The objects with the lower and the upper limit of a range of positions.
pub(super) struct Limits {
    pub(super) min: Slot<i32>,
    pub(super) max: Slot<i32>,
}

pub(super) const POSITION_RANGE: Limits = Limits { min: slot(OBJECTS, 0x607B, 1), max: slot(OBJECTS, 0x607B, 2) };
pub(super) const SOFTWARE_LIMITS: Limits = Limits { min: slot(OBJECTS, 0x607D, 1), max: slot(OBJECTS, 0x607D, 2) };

/// The settings for the axis. Limits and windows are not among them, because the drive itself checks those. \[OURS] A ramp
/// of 0 counts as 1, so that every motion ends.
pub(super) fn settings(values: &Values) -> Settings {
    let ramp = |slot: Slot<u32>| values.get(slot).max(1);
    // The home offset has the sign of object positions (polarity, 0x607E), but home is a position of the shaft. [OURS]
    // At home 0x6064 becomes the offset with its sign.
    let reversed = values.get(POLARITY) & 1 << 7 != 0;
    let offset = values.get(HOME_OFFSET);
    Settings {
        following_window: NO_FOLLOWING_WINDOW,
        following_timeout_ms: 0,
        position_limits: (0, 0),
        max_velocity: u32::MAX,
        max_torque: 0,
        slow_down: ramp(PROFILE_DECELERATION),
        quick_stop: ramp(QUICK_STOP),
        options: OptionCodes {
            quick_stop: values.get(QUICK_STOP_OPTION),
            shutdown: values.get(SHUTDOWN_OPTION),
            disable_operation: values.get(DISABLE_OPTION),
            fault_reaction: values.get(FAULT_OPTION),
        },
        homing: HomingSettings {
            method: values.get(HOMING_METHOD),
            offset: if reversed { offset.wrapping_neg() } else { offset },
            switch_speed: values.get(HOMING_SWITCH_SPEED),
            zero_speed: values.get(HOMING_ZERO_SPEED),
            acceleration: values.get(HOMING_ACCELERATION),
            halt_option: values.get(HALT_OPTION),
            stays_beyond_home: true,
        },
        homing_exit: Some(ramp(QUICK_STOP)),
    }
}

impl Dp3cl {
    /// The value of an object with a ramp, command units/s²; at least 1, so that every motion ends.
    pub(super) fn ramp(&self, slot: Slot<u32>) -> f64 {
        self.base().values.get(slot).max(1).into()
    }
}

/// Passes new settings to the axis after one of its objects was written.
fn changed(drive: &mut Dp3cl) {
    let settings = settings(&drive.base.values);
    drive.axis.apply_settings(settings);
}

type Row = Object<Dp3cl>;

/// The object dictionary of the drive, sorted by index.
pub(super) const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 10] = [
    DESCRIPTION,
    &identity(),
    // [OURS] The synchronization types at power-on are those of the manufacturer's ESI file.
    &both(
        Row::u16(0x1C32, 1, "Synchronization type").rw().default(0x0001),
        Row::u16(0x1C33, 1, "Synchronization type").rw().default(0x0022),
        SYNC_TYPES,
    ),
    PARAMETER_ROWS,
    MONITOR_ROWS,
    COMMANDS,
    CONTROL,
    MOTION,
    HOMING_AND_OFFSETS,
    PROBES_AND_INPUTS,
];

/// The PDOs at power-on, as in the manufacturer's ESI file. \[OURS] The first PDO of each direction is assigned.
pub(super) const PDOS: &[Pdo<Dp3cl>] = &[
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020, 0x60B8_0010]),
    rx_pdo!(OBJECTS, 0x1601, false, [0x6040_0010, 0x607A_0020, 0x6081_0020, 0x6083_0020, 0x6084_0020, 0x6060_0008]),
    rx_pdo!(OBJECTS, 0x1602, false, [0x6040_0010, 0x60FF_0020, 0x6083_0020, 0x6084_0020, 0x6060_0008]),
    rx_pdo!(
        OBJECTS,
        0x1603,
        false,
        [0x6040_0010, 0x6098_0008, 0x6099_0120, 0x6099_0220, 0x609A_0020, 0x607C_0020, 0x6060_0008, 0x60FE_0120]
    ),
    tx_pdo!(
        OBJECTS,
        0x1A00,
        true,
        [0x603F_0010, 0x6041_0010, 0x6061_0008, 0x6064_0020, 0x60B9_0010, 0x60BA_0020, 0x60FD_0020]
    ),
    tx_pdo!(OBJECTS, 0x1A01, false, [0x6041_0010, 0x6064_0020, 0x606C_0020]),
    tx_pdo!(OBJECTS, 0x1A02, false, [0x6041_0010, 0x6064_0020, 0x606C_0020]),
    tx_pdo!(OBJECTS, 0x1A03, false, [0x6041_0010, 0x6064_0020, 0x606C_0020]),
];

const DESCRIPTION: &[Row] = &[
    Row::u32(0x1000, 0, "Device type").default(IDENTITY.device_type as i64),
    // [OURS] 8 bits wide, as chapter 8 of the manual says, and mappable, as chapter 5 says.
    Row::u8(0x1001, 0, "Error register").tx().live(error_register),
    Row::text(0x1008, 0, "Device name", |_| DEVICE_NAME),
    Row::text(0x1009, 0, "Hardware version", |_| "1.0"),
    Row::text(0x100A, 0, "Software version", |_| "5.11"),
    Row::u8(0x10F1, 0, "Error settings").default(2),
    Row::u32(0x10F1, 1, "Local error reaction").rw().default(1),
    Row::u16(0x10F1, 2, "Sync error counter limit").rw().default(4),
];

fn error_register(drive: &Dp3cl) -> i64 {
    match (drive.axis.machine().fault(), drive.alarm()) {
        (None, _) => 0,
        (Some(_), Some(alarm)) => alarm.error_register().into(),
        (Some(_), None) => 1 << 7,
    }
}

const I32_RANGE: std::ops::RangeInclusive<i64> = i32::MIN as i64..=i32::MAX as i64;

/// The low 32 bits of a position, as the value of an object.
fn as_i32(value: i64) -> i64 {
    value as i32 as i64
}

fn within_i32(value: i64) -> i64 {
    value.clamp(*I32_RANGE.start(), *I32_RANGE.end())
}

fn error_code(drive: &Dp3cl) -> i64 {
    drive.axis.machine().fault().map_or(0, |fault| fault.code).into()
}

fn set_controlword(drive: &mut Dp3cl, word: i64) -> Result<(), AbortCode> {
    drive.axis.machine_mut().command(Controlword(word as u16));
    Ok(())
}

/// Writes 0x6060. \[OURS] An unsupported mode is accepted and raises E-881 when the drive is enabled.
fn set_mode(drive: &mut Dp3cl, mode: i64) -> Result<(), AbortCode> {
    drive.motion.requested = mode as i8;
    Ok(())
}

/// Writes 0x6092:1, which sets P0-01.
fn set_feed(drive: &mut Dp3cl, units: i64) -> Result<(), AbortCode> {
    match units {
        ..200 => Err(AbortCode::VALUE_LOW),
        200..=51_200 => {
            drive.base.values.set(SUBDIVISION, units as u16);
            Ok(())
        }
        _ => Err(AbortCode::VALUE_HIGH),
    }
}

/// The objects 0x603F to 0x6079 of CiA 402 that the drive has: states, option codes, modes, actual values and windows.
const CONTROL: &[Row] = &[
    Row::u16(0x603F, 0, "Error code").tx().live(error_code),
    Row::u16(0x6040, 0, "Controlword")
        .rw()
        .rx()
        .live(|drive| drive.axis.machine().controlword().0.into())
        .setter(set_controlword),
    Row::u16(0x6041, 0, "Statusword").tx().live(|drive| drive.statusword().0.into()),
    // [OURS] The manual gives no values for the option codes; these are the values of CiA 402.
    Row::i16(0x605A, 0, "Quick stop option code").rw().range(0, 8).default(2).changed(changed),
    Row::i16(0x605B, 0, "Shutdown option code").rw().range(0, 1).changed(changed),
    Row::i16(0x605C, 0, "Disable operation option code").rw().range(0, 1).default(1).changed(changed),
    Row::i16(0x605D, 0, "Halt option code").rw().range(1, 4).default(1).changed(changed),
    Row::i16(0x605E, 0, "Fault reaction option code").rw().range(0, 4).default(2).changed(changed),
    Row::i8(0x6060, 0, "Modes of operation").rw().rx().live(|drive| drive.motion.requested.into()).setter(set_mode),
    Row::i8(0x6061, 0, "Modes of operation display").tx().live(|drive| Dp3clMode::code(drive.motion.active).into()),
    Row::i32(0x6062, 0, "Position demand value").tx().live(|drive| as_i32(drive.demand_value())),
    Row::i32(0x6063, 0, "Position actual internal value")
        .tx()
        .live(|drive| as_i32(drive.as_increments(drive.actual_value()))),
    Row::i32(0x6064, 0, "Position actual value").tx().live(|drive| as_i32(drive.actual_value())),
    Row::u32(0x6065, 0, "Following error window").rw().rx().default(30_000),
    Row::u16(0x6066, 0, "Following error time out").rw().rx().default(10),
    Row::u32(0x6067, 0, "Position window").rw().rx().default(20),
    Row::u16(0x6068, 0, "Position window time").rw().rx().default(1),
    Row::i32(0x606B, 0, "Velocity demand value")
        .tx()
        .live(|drive| within_i32(rounded(drive.as_speed(drive.velocity_value())))),
    Row::i32(0x606C, 0, "Velocity actual value").tx().live(|drive| within_i32(rounded(drive.velocity_value()))),
    Row::u16(0x606D, 0, "Velocity window").rw().rx().default(10),
    Row::u16(0x606E, 0, "Velocity window time").rw().rx().default(1),
    Row::u16(0x606F, 0, "Velocity threshold").rw().rx().default(10),
    Row::u16(0x6070, 0, "Velocity threshold time").rw().rx(),
    Row::i16(0x6071, 0, "Target torque").rw().rx(),
    Row::u16(0x6072, 0, "Max torque").rw().rx().default(1000),
    Row::u16(0x6073, 0, "Max current"),
    Row::i16(0x6074, 0, "Torque demand").tx(),
    Row::u32(0x6075, 0, "Motor rated current"),
    Row::u32(0x6076, 0, "Motor rated torque"),
    // [OURS] An open-loop drive does not measure torque, so this reads 0.
    Row::i16(0x6077, 0, "Torque actual value").tx(),
    Row::i16(0x6078, 0, "Current actual value").tx().live(current_permille),
    // [OURS] The unit is mV, since the manual gives none.
    Row::u32(0x6079, 0, "DC link voltage").tx().live(|drive| drive.config.supply_mv.into()),
];

/// 0x6078, motor current in 0.1 % \[OURS] of the peak current.
fn current_permille(drive: &Dp3cl) -> i64 {
    i64::from(drive.motor_ma()) * 1000 / i64::from(drive.peak_ma().max(1))
}

/// Targets, ramps and limits: 0x607A to 0x6093.
const MOTION: &[Row] = &[
    Row::i32(0x607A, 0, "Target position").rw().rx().live(|drive| drive.motion.target_position.into()).setter(
        |drive, position| {
            drive.take_target_position(position as i32);
            Ok(())
        },
    ),
    Row::u8(0x607B, 0, "Position range limit").default(2),
    Row::i32(0x607B, 1, "Min position range limit").rw().rx(),
    Row::i32(0x607B, 2, "Max position range limit").rw().rx(),
    Row::i32(0x607C, 0, "Home offset").rw().rx().changed(changed),
    Row::u8(0x607D, 0, "Software position limit").default(2),
    Row::i32(0x607D, 1, "Min position limit").rw().rx(),
    Row::i32(0x607D, 2, "Max position limit").rw().rx(),
    Row::u8(0x607E, 0, "Polarity").rw().changed(changed),
    Row::u32(0x607F, 0, "Max profile velocity").rw().rx().default(500_000),
    Row::u32(0x6080, 0, "Max motor speed").rw().rx().default(3000),
    Row::u32(0x6081, 0, "Profile velocity").rw().rx(),
    Row::u32(0x6083, 0, "Profile acceleration").rw().rx().default(1_000_000),
    Row::u32(0x6084, 0, "Profile deceleration").rw().rx().default(1_000_000).changed(changed),
    Row::u32(0x6085, 0, "Quick stop deceleration").rw().rx().default(1_000_000).changed(changed),
    // [OURS] Linear ramps are the only profile, so only the value 0 is accepted.
    Row::i16(0x6086, 0, "Motion profile type").rw().rx().range(0, 0),
    Row::u32(0x6087, 0, "Torque slope").rw().rx(),
    Row::i16(0x6088, 0, "Torque profile type").rw().rx(),
    Row::u8(0x608F, 0, "Position encoder resolution").default(2),
    Row::u32(0x608F, 1, "Encoder increments").default(ENCODER_COUNTS as i64),
    Row::u32(0x608F, 2, "Motor revolutions").default(1),
    Row::u8(0x6091, 0, "Gear ratio").default(2),
    Row::u32(0x6091, 1, "Motor revolutions").rw().default(1),
    Row::u32(0x6091, 2, "Shaft revolutions").rw().default(1),
    Row::u8(0x6092, 0, "Feed constant").default(2),
    Row::u32(0x6092, 1, "Feed").rw().live(|drive| drive.base.values.get(SUBDIVISION).into()).setter(set_feed),
    Row::u32(0x6092, 2, "Shaft revolutions").rw().default(1),
    // [OURS] The manual lists 0x6093, 0x60C0 and 0x60C1, but the manufacturer's ESI file does not. So the drive has
    // them, and because a mapping follows the ESI file, they cannot be mapped.
    Row::u8(0x6093, 0, "Position factor").default(2),
    Row::u32(0x6093, 1, "Numerator").rw(),
    Row::u32(0x6093, 2, "Divisor").rw(),
    Row::i32(0x60FF, 0, "Target velocity").rw().rx().live(|drive| drive.motion.target_velocity.into()).setter(
        |drive, velocity| {
            drive.motion.target_velocity = velocity as i32;
            Ok(())
        },
    ),
    Row::u32(0x6502, 0, "Supported drive modes").tx().default(SUPPORTED_MODES),
];

/// Homing, offsets, and objects without an effect: 0x6098 to 0x60F2.
const HOMING_AND_OFFSETS: &[Row] = &[
    Row::i8(0x6098, 0, "Homing method")
        .rw()
        .rx()
        .default(35)
        .accept(
            // DP3CL-3.4: the methods of this drive, whatever others the model of homing has.
            |_, _, method| match method as i8 {
                1..=14 | 17..=30 | 33..=35 | 37 => Ok(()),
                _ => Err(AbortCode::VALUE_RANGE),
            },
        )
        .changed(changed),
    Row::u8(0x6099, 0, "Homing speeds").default(2),
    Row::u32(0x6099, 1, "Speed during search for switch").rw().rx().default(50_000).changed(changed),
    Row::u32(0x6099, 2, "Speed during search for zero").rw().rx().default(5000).changed(changed),
    Row::u32(0x609A, 0, "Homing acceleration").rw().rx().default(1_000_000).changed(changed),
    Row::u8(0x60A4, 0, "Profile jerk").default(2),
    Row::u32(0x60A4, 1, "Profile jerk 1").rw(),
    Row::u32(0x60A4, 2, "Profile jerk 2").rw(),
    Row::i32(0x60B0, 0, "Position offset").rw().rx(),
    Row::i32(0x60B1, 0, "Velocity offset").rw().rx(),
    Row::i16(0x60B2, 0, "Torque offset").rw().rx(),
    Row::i16(0x60C0, 0, "Interpolation sub mode").rw(),
    Row::u8(0x60C1, 0, "Interpolation data record").default(1),
    Row::u32(0x60C1, 1, "Interpolation data record 1").rw(),
    // [OURS] The drive uses the cycle time of SYNC0. These values are only stored, and a different value raises no
    // alarm.
    Row::u8(0x60C2, 0, "Interpolation time period").default(2),
    Row::u8(0x60C2, 1, "Period").rw().range(1, 20).default(1),
    Row::i8(0x60C2, 2, "Index").rw().range(-3, -3).default(-3),
    Row::u32(0x60C5, 0, "Max acceleration").rw().rx().default(1_000_000),
    Row::u32(0x60C6, 0, "Max deceleration").rw().rx().default(1_000_000),
    Row::u16(0x60E0, 0, "Positive torque limit").rw().rx(),
    Row::u16(0x60E1, 0, "Negative torque limit").rw().rx(),
    // [OURS] Mappable, and without effect: relative targets are always added to the last target.
    Row::u16(0x60F2, 0, "Positioning option code").rw().rx(),
];

/// Touch probes, following error, inputs and outputs: 0x60B8 to 0x60FE.
const PROBES_AND_INPUTS: &[Row] = &[
    Row::u16(0x60B8, 0, "Touch probe function").rw().rx().live(|drive| drive.probes.function().into()).setter(
        |drive, function| {
            drive.probes.set_function(function as u16);
            Ok(())
        },
    ),
    Row::u16(0x60B9, 0, "Touch probe status").tx().live(|drive| drive.probes.status().into()),
    Row::i32(0x60BA, 0, "Touch probe 1 positive edge").tx().live(|drive| drive.probes.position(0).into()),
    Row::i32(0x60BB, 0, "Touch probe 1 negative edge").tx().live(|drive| drive.probes.position(1).into()),
    Row::i32(0x60BC, 0, "Touch probe 2 positive edge").tx().live(|drive| drive.probes.position(2).into()),
    Row::i32(0x60BD, 0, "Touch probe 2 negative edge").tx().live(|drive| drive.probes.position(3).into()),
    Row::i32(0x60F4, 0, "Following error actual value").tx().live(|drive| within_i32(drive.following_error())),
    Row::i32(0x60FA, 0, "Control effort").tx().live(|drive| within_i32(rounded(drive.velocity_value()))),
    Row::i32(0x60FC, 0, "Position demand internal value")
        .tx()
        .live(|drive| as_i32(drive.as_increments(drive.demand_value()))),
    Row::u32(0x60FD, 0, "Digital inputs").tx().live(|drive| drive.axis.inputs().bits().into()),
    Row::u8(0x60FE, 0, "Digital outputs").default(2),
    // [OURS] The values are stored but have no effect on the outputs of the drive.
    Row::u32(0x60FE, 1, "Physical outputs").rw().rx(),
    Row::u32(0x60FE, 2, "Bit mask").rw().rx(),
];
