//! The monitors U0 to U4: read-only values of the drive. The index is 0x3000, plus 0x100 for each group, plus the
//! number: U1-10 is 0x310A. Monitors that the manual only lists read 0; \[OURS] so do machine type, series, production
//! date and firmware date, which belong to an individual drive.

use super::Dp3cl;
use crate::slave::dictionary::Object;

/// The modelled firmware version, 5.11, for object 0x100A and U2-07.
const SOFTWARE_VERSION: u16 = 511;
/// The hardware version, 1.0, for object 0x1009 and U2-08.
const HARDWARE_VERSION: u16 = 10;
/// \[OURS] Electrical turns per turn of the motor: the value of a stepper with steps of 1.8 degrees.
const ELECTRICAL_TURNS: f64 = 50.0;

/// The values of the motion that the monitors show.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Monitored {
    /// Motor speed, rpm.
    pub(super) speed_rpm: i16,
    /// Command pulses since power-on, with their sign.
    pub(super) pulses: i64,
    /// Position within the turn, pulses, from 0.
    pub(super) single_turn: u32,
    /// Whole turns of the position, counted from position 0; negative below 0.
    pub(super) turns: i64,
    /// Electrical angle, degrees.
    pub(super) electric_angle: i16,
    /// The currents of phases A and B, and the magnitude of their vector, mA.
    pub(super) phase_a_ma: i16,
    pub(super) phase_b_ma: i16,
    pub(super) current_ma: i16,
}

impl Monitored {
    /// The values for a position (command units), a velocity (command units/s), `turn` command units per turn, and a motor
    /// current (mA).
    pub(super) fn of(pulses: i64, velocity: f64, turn: u16, current_ma: u32) -> Self {
        let turn_units = i64::from(turn.max(1));
        let single_turn = pulses.rem_euclid(turn_units);
        let turns = single_turn as f64 / turn_units as f64 * ELECTRICAL_TURNS;
        let angle = turns - (turns as i64) as f64;
        let degrees = angle * 360.0;
        let current = f64::from(current_ma);
        Self {
            speed_rpm: (velocity * 60.0 / turn_units as f64) as i16,
            pulses,
            single_turn: single_turn as u32,
            turns: pulses.div_euclid(turn_units),
            electric_angle: degrees as i16,
            phase_a_ma: (current * sine((degrees + 90.0) % 360.0)) as i16,
            phase_b_ma: (current * sine(degrees)) as i16,
            current_ma: current as i16,
        }
    }
}

/// The sine of an angle from 0 to 360 degrees, exact to 0.2 %, by Bhaskara's formula: it gives the same bits on every
/// target.
fn sine(degrees: f64) -> f64 {
    let half = degrees % 180.0;
    let product = half * (180.0 - half);
    let sine = 4.0 * product / (40_500.0 - product);
    if degrees < 180.0 { sine } else { -sine }
}

/// 16 bits of a number as the value of a monitor: word `place`, where 0 is the lowest word.
const fn words(number: i64, place: u32) -> i64 {
    (number >> (16 * place)) & 0xFFFF
}

/// U0-10 to U0-13: the magnitude of the command pulses in 63 bits; the top bit is 1 for the negative direction.
fn command_pulses(drive: &Dp3cl, place: u32) -> i64 {
    let pulses = drive.monitored().pulses;
    let bits = pulses.unsigned_abs() & !(1 << 63) | u64::from(pulses < 0) << 63;
    words(bits as i64, place)
}

fn set_speed_rpm(drive: &Dp3cl) -> i64 {
    drive.monitored().speed_rpm.into()
}

type Row = Object<Dp3cl>;

/// The rows of the monitors U0 to U4 in the object dictionary.
pub(super) const MONITOR_ROWS: &[Row] = &[
    Row::i16(0x3000, 0, "U0-00"),
    Row::i16(0x3001, 0, "U0-01 Set speed").live(set_speed_rpm),
    Row::u16(0x3002, 0, "U0-02"),
    Row::u16(0x3003, 0, "U0-03"),
    Row::u16(0x3004, 0, "U0-04"),
    Row::u16(0x3005, 0, "U0-05"),
    Row::u16(0x3006, 0, "U0-06"),
    Row::u16(0x3007, 0, "U0-07"),
    Row::u16(0x3008, 0, "U0-08"),
    Row::u16(0x3009, 0, "U0-09"),
    Row::u16(0x300A, 0, "U0-10 Command pulses, bits 0 to 15").live(|d| command_pulses(d, 0)),
    Row::u16(0x300B, 0, "U0-11 Command pulses, bits 16 to 31").live(|d| command_pulses(d, 1)),
    Row::u16(0x300C, 0, "U0-12 Command pulses, bits 32 to 47").live(|d| command_pulses(d, 2)),
    Row::u16(0x300D, 0, "U0-13 Command pulses, bits 48 to 62, and direction").live(|d| command_pulses(d, 3)),
    Row::u16(0x300E, 0, "U0-14"),
    Row::u16(0x300F, 0, "U0-15"),
    Row::u16(0x3010, 0, "U0-16"),
    Row::u16(0x3011, 0, "U0-17"),
    Row::u16(0x3012, 0, "U0-18 Single turn pulses, low").live(|d| words(d.monitored().single_turn.into(), 0)),
    Row::u16(0x3013, 0, "U0-19 Single turn pulses, high").live(|d| words(d.monitored().single_turn.into(), 1)),
    Row::u16(0x3014, 0, "U0-20 Pulse turns, low").live(|d| words(d.monitored().turns, 0)),
    Row::u16(0x3015, 0, "U0-21 Pulse turns, high").live(|d| words(d.monitored().turns, 1)),
    Row::u16(0x3016, 0, "U0-22"),
    Row::u16(0x3017, 0, "U0-23"),
    Row::i16(0x3018, 0, "U0-24"),
    Row::i16(0x3019, 0, "U0-25 Set electric angle").live(|d| d.monitored().electric_angle.into()),
    Row::i16(0x301A, 0, "U0-26 Phase A feedback current").live(|d| d.monitored().phase_a_ma.into()),
    Row::i16(0x301B, 0, "U0-27 Phase B feedback current").live(|d| d.monitored().phase_b_ma.into()),
    Row::u16(0x301C, 0, "U0-28 Reference feedback current").live(|d| d.monitored().current_ma.into()),
    Row::i16(0x301D, 0, "U0-29 Phase A set current").live(|d| d.monitored().phase_a_ma.into()),
    Row::i16(0x301E, 0, "U0-30 Phase B set current").live(|d| d.monitored().phase_b_ma.into()),
    Row::u16(0x301F, 0, "U0-31 Reference set current").live(|d| d.monitored().current_ma.into()),
    Row::u16(0x3020, 0, "U0-32 Bus voltage").live(|d| (d.config.supply_mv / 1000).into()),
    Row::u16(0x3021, 0, "U0-33"),
    Row::u16(0x3022, 0, "U0-34"),
    Row::u16(0x3023, 0, "U0-35"),
    Row::u16(0x3024, 0, "U0-36"),
    Row::u16(0x3025, 0, "U0-37"),
    Row::u16(0x3026, 0, "U0-38"),
    Row::u16(0x3027, 0, "U0-39"),
    Row::u16(0x3028, 0, "U0-40"),
    Row::u16(0x3029, 0, "U0-41"),
    Row::u16(0x302A, 0, "U0-42"),
    Row::u16(0x302B, 0, "U0-43"),
    Row::u16(0x302C, 0, "U0-44"),
    Row::u16(0x302D, 0, "U0-45"),
    Row::u16(0x302E, 0, "U0-46"),
    Row::u16(0x302F, 0, "U0-47"),
    Row::u16(0x3030, 0, "U0-48"),
    Row::u16(0x3031, 0, "U0-49"),
    Row::u16(0x3100, 0, "U1-00 Current alarm code").live(|d| d.alarms.current().into()),
    Row::i16(0x3101, 0, "U1-01 Phase A current when the alarm occurred").live(|d| d.alarms.record().phase_a_ma.into()),
    Row::i16(0x3102, 0, "U1-02 Phase B current when the alarm occurred").live(|d| d.alarms.record().phase_b_ma.into()),
    Row::i16(0x3103, 0, "U1-03 Reference current when the alarm occurred")
        .live(|d| d.alarms.record().current_ma.into()),
    Row::i16(0x3104, 0, "U1-04 Bus voltage when the alarm occurred").live(|d| d.alarms.record().voltage_v.into()),
    Row::i16(0x3105, 0, "U1-05 Position offset when the alarm occurred")
        .live(|d| d.alarms.record().position_offset.into()),
    Row::i16(0x3106, 0, "U1-06 Speed when the alarm occurred").live(|d| d.alarms.record().speed_rpm.into()),
    Row::i16(0x3107, 0, "U1-07 Time when the alarm occurred, low").live(|d| (d.alarms.record().seconds as i16).into()),
    Row::i16(0x3108, 0, "U1-08 Time when the alarm occurred, high")
        .live(|d| ((d.alarms.record().seconds >> 16) as i16).into()),
    Row::i16(0x3109, 0, "U1-09 Number of alarms of this run").live(|d| d.alarms.count().into()),
    Row::i16(0x310A, 0, "U1-10 Last alarm but one").live(|d| (d.alarms.earlier(0) as i16).into()),
    Row::i16(0x310B, 0, "U1-11 Last alarm but two").live(|d| (d.alarms.earlier(1) as i16).into()),
    Row::i16(0x310C, 0, "U1-12 Last alarm but three").live(|d| (d.alarms.earlier(2) as i16).into()),
    Row::u16(0x310D, 0, "U1-13 Last alarm but four").live(|d| d.alarms.earlier(3).into()),
    Row::u16(0x310E, 0, "U1-14 Last alarm but five").live(|d| d.alarms.earlier(4).into()),
    Row::u16(0x310F, 0, "U1-15"),
    Row::u16(0x3110, 0, "U1-16"),
    Row::u16(0x3111, 0, "U1-17"),
    Row::u16(0x3112, 0, "U1-18"),
    Row::u16(0x3113, 0, "U1-19"),
    Row::u16(0x3114, 0, "U1-20"),
    Row::u16(0x3115, 0, "U1-21"),
    Row::u16(0x3116, 0, "U1-22"),
    Row::u16(0x3117, 0, "U1-23"),
    Row::u16(0x3118, 0, "U1-24"),
    Row::u16(0x3119, 0, "U1-25"),
    Row::u16(0x311A, 0, "U1-26"),
    Row::u16(0x311B, 0, "U1-27"),
    Row::u16(0x311C, 0, "U1-28"),
    Row::u16(0x311D, 0, "U1-29"),
    Row::u16(0x3200, 0, "U2-00 Power-on count").live(|d| d.power_on_count.into()),
    Row::u16(0x3201, 0, "U2-01 Machine type"),
    Row::u16(0x3202, 0, "U2-02 Series"),
    Row::u16(0x3203, 0, "U2-03 Model").live(|d| d.config.rating.number().into()),
    Row::u16(0x3204, 0, "U2-04 Production year"),
    Row::u16(0x3205, 0, "U2-05 Production month"),
    Row::u16(0x3206, 0, "U2-06 Production day"),
    Row::u16(0x3207, 0, "U2-07 Software version").live(|_| SOFTWARE_VERSION.into()),
    Row::u16(0x3208, 0, "U2-08 Hardware version").live(|_| HARDWARE_VERSION.into()),
    Row::u16(0x3209, 0, "U2-09 On-time, hours").live(|d| (d.on_seconds() / 3600 % 0x1_0000) as i64),
    Row::u16(0x320A, 0, "U2-10 On-time, minutes").live(|d| (d.on_seconds() / 60 % 60) as i64),
    Row::u16(0x320B, 0, "U2-11 On-time, seconds").live(|d| (d.on_seconds() % 60) as i64),
    Row::u16(0x320C, 0, "U2-12 Serial number, low").live(|d| words(d.config.serial.into(), 0)),
    Row::u16(0x320D, 0, "U2-13 Serial number, high").live(|d| words(d.config.serial.into(), 1)),
    Row::u16(0x320E, 0, "U2-14 Firmware year"),
    Row::u16(0x320F, 0, "U2-15 Firmware month and day"),
    Row::u16(0x3210, 0, "U2-16 Firmware hour and minute"),
    Row::u16(0x3211, 0, "U2-17"),
    Row::u16(0x3212, 0, "U2-18"),
    Row::u16(0x3213, 0, "U2-19"),
    Row::u16(0x3300, 0, "U3-00 PDI period").live(|d| d.timing.pdi.periods().shown()[0].into()),
    Row::u16(0x3301, 0, "U3-01 PDI time").live(|d| d.timing.pdi.time().into()),
    Row::u16(0x3302, 0, "U3-02 PDI period, greatest").live(|d| d.timing.pdi.periods().shown()[1].into()),
    Row::u16(0x3303, 0, "U3-03 PDI period, least").live(|d| d.timing.pdi.periods().shown()[2].into()),
    Row::u16(0x3304, 0, "U3-04 Sync0 period").live(|d| d.timing.sync0.periods().shown()[0].into()),
    Row::u16(0x3305, 0, "U3-05 Sync0 time").live(|d| d.timing.sync0.time().into()),
    Row::u16(0x3306, 0, "U3-06 Sync0 period, greatest").live(|d| d.timing.sync0.periods().shown()[1].into()),
    Row::u16(0x3307, 0, "U3-07 Sync0 period, least").live(|d| d.timing.sync0.periods().shown()[2].into()),
    Row::u16(0x3308, 0, "U3-08 ECAT timer period").live(|d| d.cycle_us()),
    Row::u16(0x3309, 0, "U3-09 PDI to Sync0").live(|d| d.timing.pdi_to_sync0.shown()[0].into()),
    Row::u16(0x330A, 0, "U3-10 PDI to Sync0, greatest").live(|d| d.timing.pdi_to_sync0.shown()[1].into()),
    Row::u16(0x330B, 0, "U3-11 PDI to Sync0, least").live(|d| d.timing.pdi_to_sync0.shown()[2].into()),
    Row::u16(0x3400, 0, "U4-00"),
    Row::u16(0x3401, 0, "U4-01"),
    Row::u16(0x3402, 0, "U4-02"),
    Row::u16(0x3403, 0, "U4-03"),
    Row::u16(0x3404, 0, "U4-04"),
    Row::u16(0x3405, 0, "U4-05"),
    Row::u16(0x3406, 0, "U4-06"),
    Row::u16(0x3407, 0, "U4-07"),
    Row::u16(0x3408, 0, "U4-08"),
    Row::u16(0x3409, 0, "U4-09"),
];
