//! The parameter groups P0 to P8 (the manual prints an address for each parameter; its object index is 0x2000 plus that
//! address) and the command group F0 (from 0x4000): their objects, their saved values, and when a written value takes effect.
//!
//! A parameter has up to three values: the value that SDOs read and write; the saved value, which F0-02 stores and a
//! restart restores; and, for P0-01 and P0-02, the active value, which only a restart changes. Parameters that the manual
//! lists without a meaning, or not at all, store what is written.

use super::objects::OBJECTS;
use super::{Dp3cl, Rating};
use crate::ethercat::cia402::DriveState;
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::slave::dictionary::{Object, Slot, Values, slot};

/// P0-01, factory value: command units per turn of the motor.
pub(super) const SUBDIVISION_DEFAULT: u16 = 10_000;
/// P4-01: encoder counts per turn (after multiplication by 4) for the positions in encoder counts.
pub(super) const ENCODER_COUNTS: u16 = 4000;
/// The index range of the parameters, which the commands F0-01 and F0-02 restore and save.
const PARAMETERS: std::ops::RangeInclusive<u16> = 0x2000..=0x2FFF;

pub(super) const SUBDIVISION: Slot<u16> = slot(OBJECTS, 0x2001, 0);
const FILTER_TIME: Slot<u16> = slot(OBJECTS, 0x2002, 0);
pub(super) const RUNNING_CURRENT: Slot<u16> = slot(OBJECTS, 0x2005, 0);
pub(super) const HOLDING_CURRENT: Slot<u16> = slot(OBJECTS, 0x2008, 0);
pub(super) const HOLDING_DELAY: Slot<u16> = slot(OBJECTS, 0x200C, 0);
pub(super) const AUTO_TUNING: Slot<u16> = slot(OBJECTS, 0x2100, 0);
pub(super) const ALARM_OUTPUT: Slot<u16> = slot(OBJECTS, 0x2202, 0);
pub(super) const BRAKE_OUTPUT: Slot<u16> = slot(OBJECTS, 0x2203, 0);
pub(super) const ALARM_CLEAR: Slot<u16> = slot(OBJECTS, 0x2205, 0);
pub(super) const POSITIVE_LIMIT: Slot<u16> = slot(OBJECTS, 0x2206, 0);
pub(super) const NEGATIVE_LIMIT: Slot<u16> = slot(OBJECTS, 0x2207, 0);
pub(super) const HOME: Slot<u16> = slot(OBJECTS, 0x2208, 0);
pub(super) const UNDER_VOLTAGE: Slot<u16> = slot(OBJECTS, 0x2302, 0);
pub(super) const PEAK_CURRENT: Slot<u16> = slot(OBJECTS, 0x2400, 0);
pub(super) const SET_ADDRESS: Slot<u16> = slot(OBJECTS, 0x2700, 0);

/// The factory values of all objects for a rating.
pub(super) fn factory(rating: Rating) -> Values {
    let mut values = Values::new(OBJECTS);
    values.set(PEAK_CURRENT, rating.peak_default_100ma());
    values
}

/// The non-volatile memory of the drive (`saved`), and the active values of P0-01 and P0-02 (`subdivision`, `filter_time`).
/// These are the values at the last power-on: the drive uses a new value only from the next power-on.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    saved: Values,
    subdivision: u16,
    filter_time: u16,
}

impl Memory {
    /// The memory of a drive with factory parameters.
    pub(super) fn new(factory: Values) -> Self {
        let (subdivision, filter_time) = (factory.get(SUBDIVISION), factory.get(FILTER_TIME));
        Self { saved: factory, subdivision, filter_time }
    }

    /// F0-02: saves the parameters in the memory.
    pub(super) fn save(&mut self, values: &Values) {
        self.saved.copy(values, OBJECTS, PARAMETERS);
    }

    /// F0-01: resets the parameters to their factory values. \[OURS] Saves them too.
    pub(super) fn restore(&mut self, values: &mut Values, rating: Rating) {
        values.copy(&factory(rating), OBJECTS, PARAMETERS);
        self.save(values);
    }

    /// The object values at power-on. If the dial switch gives a `station` number, it is stored in P7-00 permanently.
    pub(super) fn load(&mut self, rating: Rating, station: Option<u16>) -> Values {
        if let Some(station) = station {
            self.saved.set(SET_ADDRESS, station);
        }
        let mut values = factory(rating);
        values.copy(&self.saved, OBJECTS, PARAMETERS);
        (self.subdivision, self.filter_time) = (values.get(SUBDIVISION), values.get(FILTER_TIME));
        values
    }

    /// The active value of P0-01: command units per turn.
    pub(super) const fn subdivision(&self) -> u16 {
        self.subdivision
    }

    /// The active value of P0-02: the time of the command filter. \[OURS] The manual gives no unit, and the simulated
    /// filter has no effect.
    pub(super) const fn filter_time(&self) -> u16 {
        self.filter_time
    }
}

/// A command that the drive executes when 1 is written to its object: F0-00 to F0-02 in the manual, objects 0x4000 to 0x4002,
/// in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Command {
    ClearAlarm,
    RestoreFactory,
    Save,
}

/// Defines the object of a command. \[OURS] The object reads 0. The command is executed when 1 is written after 0. In Operation
/// enabled only "clear alarm" is allowed.
const fn command(index: u16, name: &'static str, set: fn(&mut Dp3cl, i64) -> Result<(), AbortCode>) -> Row {
    Row::bool(index, 0, name).rw().live(|_| 0).setter(set)
}

fn execute(drive: &mut Dp3cl, command: Command, value: i64) -> Result<(), AbortCode> {
    let is_enabled = drive.axis.machine().state() == DriveState::OperationEnabled;
    if command != Command::ClearAlarm && is_enabled {
        return Err(AbortCode::DEVICE_STATE);
    }
    let was_set = std::mem::replace(&mut drive.commands[command as usize], value != 0);
    if value == 0 || was_set {
        return Ok(());
    }
    let rating = drive.config.rating;
    match command {
        Command::ClearAlarm => drive.clear_alarm(),
        Command::RestoreFactory => {
            drive.memory.restore(&mut drive.base.values, rating);
            rewire(drive);
        }
        Command::Save => drive.memory.save(&drive.base.values),
    }
    Ok(())
}

/// Checks the peak current against the maximum of the rating.
fn accept_peak_current(drive: &Dp3cl, _at: ObjectAddress, value: i64) -> Result<(), AbortCode> {
    if value > drive.config.rating.peak_max_100ma().into() { Err(AbortCode::VALUE_HIGH) } else { Ok(()) }
}

/// Connects the input functions to the terminals that P2-05 to P2-08 select. Called after each write of one of these
/// parameters, so that the new value acts at once.
fn rewire(drive: &mut Dp3cl) {
    drive.rewire();
}

type Row = Object<Dp3cl>;

/// The objects of the command group F0.
pub(super) const COMMANDS: &[Row] = &[
    command(0x4000, "F0-00 Clear alarm", |drive, value| execute(drive, Command::ClearAlarm, value)),
    command(0x4001, "F0-01 Restore factory settings", |drive, value| execute(drive, Command::RestoreFactory, value)),
    command(0x4002, "F0-02 Save parameters", |drive, value| execute(drive, Command::Save, value)),
];

/// The objects of the parameters. An object whose name is only a number is a parameter that the manual does not explain.
/// \[OURS] All are unsigned 16-bit values, as in the manufacturer's ESI file, since their ranges exceed the INTEGER16 of the
/// manual.
pub(super) const PARAMETER_ROWS: &[Row] = &[
    Row::u16(0x2000, 0, "P0-00").rw().backup(),
    Row::u16(0x2001, 0, "P0-01 Subdivision").rw().backup().range(200, 51200).default(SUBDIVISION_DEFAULT as i64),
    Row::u16(0x2002, 0, "P0-02 Filter time").rw().backup().range(0, 50),
    Row::u16(0x2003, 0, "P0-03").rw().backup(),
    Row::u16(0x2004, 0, "P0-04").rw().backup(),
    Row::u16(0x2005, 0, "P0-05 Open loop current").rw().backup().range(1, 100).default(100),
    Row::u16(0x2006, 0, "P0-06").rw().backup(),
    Row::u16(0x2007, 0, "P0-07").rw().backup(),
    Row::u16(0x2008, 0, "P0-08 Open loop holding current").rw().backup().range(0, 100).default(50),
    Row::u16(0x2009, 0, "P0-09").rw().backup(),
    Row::u16(0x200A, 0, "P0-10").rw().backup(),
    Row::u16(0x200B, 0, "P0-11 Panel display").rw().backup().range(0, 2),
    Row::u16(0x200C, 0, "P0-12 Delay to holding current").rw().backup().range(1, 10_000).default(100),
    Row::u16(0x200D, 0, "P0-13").rw().backup(),
    Row::u16(0x200E, 0, "P0-14").rw().backup(),
    Row::u16(0x200F, 0, "P0-15").rw().backup(),
    Row::u16(0x2010, 0, "P0-16").rw().backup(),
    Row::u16(0x2011, 0, "P0-17").rw().backup(),
    Row::u16(0x2012, 0, "P0-18").rw().backup(),
    Row::u16(0x2013, 0, "P0-19").rw().backup(),
    Row::u16(0x2100, 0, "P1-00 Auto tuning").rw().backup().range(0, 1).default(1),
    Row::u16(0x2101, 0, "P1-01 Current loop Kp").rw().backup().range(1, 65535).default(1500),
    Row::u16(0x2102, 0, "P1-02 Current loop Ki").rw().backup().range(1, 65535).default(800),
    Row::u16(0x2103, 0, "P1-03").rw().backup(),
    Row::u16(0x2104, 0, "P1-04").rw().backup(),
    Row::u16(0x2105, 0, "P1-05").rw().backup(),
    Row::u16(0x2106, 0, "P1-06").rw().backup(),
    Row::u16(0x2107, 0, "P1-07").rw().backup(),
    Row::u16(0x2108, 0, "P1-08").rw().backup(),
    Row::u16(0x2109, 0, "P1-09").rw().backup(),
    Row::u16(0x210A, 0, "P1-10").rw().backup(),
    Row::u16(0x210B, 0, "P1-11").rw().backup(),
    Row::u16(0x210C, 0, "P1-12").rw().backup(),
    Row::u16(0x210D, 0, "P1-13 In place delay").rw().backup().range(0, 100).default(3),
    Row::u16(0x210E, 0, "P1-14").rw().backup(),
    Row::u16(0x2200, 0, "P2-00").rw().backup(),
    Row::u16(0x2201, 0, "P2-01").rw().backup(),
    Row::u16(0x2202, 0, "P2-02 Alarm output").rw().backup().default(1),
    Row::u16(0x2203, 0, "P2-03 Brake output").rw().backup().default(2),
    Row::u16(0x2204, 0, "P2-04").rw().backup(),
    Row::u16(0x2205, 0, "P2-05 Alarm clear").rw().backup().default(1).changed(rewire),
    Row::u16(0x2206, 0, "P2-06 POT").rw().backup().default(2).changed(rewire),
    Row::u16(0x2207, 0, "P2-07 NOT").rw().backup().default(3).changed(rewire),
    Row::u16(0x2208, 0, "P2-08 HOME").rw().backup().default(4).changed(rewire),
    Row::u16(0x2209, 0, "P2-09 Probe 1 input").default(1),
    Row::u16(0x220A, 0, "P2-10 Probe 2 input").default(2),
    Row::u16(0x220B, 0, "P2-11").rw().backup(),
    Row::u16(0x220C, 0, "P2-12").rw().backup(),
    Row::u16(0x220D, 0, "P2-13").rw().backup(),
    Row::u16(0x220E, 0, "P2-14").rw().backup(),
    Row::u16(0x220F, 0, "P2-15").rw().backup(),
    Row::u16(0x2210, 0, "P2-16").rw().backup(),
    Row::u16(0x2211, 0, "P2-17").rw().backup(),
    Row::u16(0x2212, 0, "P2-18").rw().backup(),
    Row::u16(0x2213, 0, "P2-19").rw().backup(),
    Row::u16(0x2300, 0, "P3-00").rw().backup(),
    Row::u16(0x2301, 0, "P3-01 Fault detection selection").rw().backup().range(0, 255).default(255),
    Row::u16(0x2302, 0, "P3-02 Under voltage threshold").rw().backup().range(0, 20),
    Row::u16(0x2303, 0, "P3-03").rw().backup(),
    Row::u16(0x2304, 0, "P3-04").rw().backup(),
    Row::u16(0x2305, 0, "P3-05").rw().backup(),
    Row::u16(0x2306, 0, "P3-06").rw().backup(),
    Row::u16(0x2307, 0, "P3-07").rw().backup(),
    Row::u16(0x2308, 0, "P3-08").rw().backup(),
    Row::u16(0x2309, 0, "P3-09").rw().backup(),
    Row::u16(0x2400, 0, "P4-00 Peak current").rw().backup().range(1, 84).default(70).accept(accept_peak_current),
    Row::u16(0x2401, 0, "P4-01 Encoder resolution").default(ENCODER_COUNTS as i64),
    Row::u16(0x2402, 0, "P4-02").rw().backup().range(0, 1),
    Row::u16(0x2403, 0, "P4-03").rw().backup(),
    Row::u16(0x2404, 0, "P4-04").rw().backup(),
    Row::u16(0x2405, 0, "P4-05").rw().backup(),
    Row::u16(0x2406, 0, "P4-06").rw().backup(),
    Row::u16(0x2407, 0, "P4-07").rw().backup(),
    Row::u16(0x2408, 0, "P4-08").rw().backup(),
    Row::u16(0x2409, 0, "P4-09").rw().backup(),
    Row::u16(0x2500, 0, "P5-00").rw().backup(),
    Row::u16(0x2501, 0, "P5-01").rw().backup(),
    Row::u16(0x2502, 0, "P5-02").rw().backup(),
    Row::u16(0x2503, 0, "P5-03").rw().backup(),
    Row::u16(0x2504, 0, "P5-04").rw().backup(),
    Row::u16(0x2505, 0, "P5-05").rw().backup(),
    Row::u16(0x2506, 0, "P5-06").rw().backup(),
    Row::u16(0x2507, 0, "P5-07").rw().backup(),
    Row::u16(0x2508, 0, "P5-08").rw().backup(),
    Row::u16(0x2509, 0, "P5-09").rw().backup(),
    Row::u16(0x250A, 0, "P5-10").rw().backup(),
    Row::u16(0x250B, 0, "P5-11").rw().backup(),
    Row::u16(0x250C, 0, "P5-12").rw().backup(),
    Row::u16(0x250D, 0, "P5-13").rw().backup(),
    Row::u16(0x250E, 0, "P5-14").rw().backup(),
    Row::u16(0x2600, 0, "P6-00").rw().backup(),
    Row::u16(0x2601, 0, "P6-01").rw().backup(),
    Row::u16(0x2602, 0, "P6-02").rw().backup(),
    Row::u16(0x2603, 0, "P6-03").rw().backup(),
    Row::u16(0x2604, 0, "P6-04").rw().backup(),
    Row::u16(0x2605, 0, "P6-05").rw().backup(),
    Row::u16(0x2606, 0, "P6-06").rw().backup(),
    Row::u16(0x2607, 0, "P6-07").rw().backup(),
    Row::u16(0x2608, 0, "P6-08").rw().backup(),
    Row::u16(0x2609, 0, "P6-09").rw().backup(),
    Row::u16(0x260A, 0, "P6-10").rw().backup(),
    Row::u16(0x260B, 0, "P6-11").rw().backup(),
    Row::u16(0x260C, 0, "P6-12").rw().backup(),
    Row::u16(0x260D, 0, "P6-13").rw().backup(),
    Row::u16(0x260E, 0, "P6-14").rw().backup(),
    Row::u16(0x2700, 0, "P7-00 Set address").rw().backup(),
    Row::u16(0x2701, 0, "P7-01").rw().backup(),
    Row::u16(0x2702, 0, "P7-02").rw().backup(),
    Row::u16(0x2703, 0, "P7-03").rw().backup(),
    Row::u16(0x2704, 0, "P7-04").rw().backup(),
    // [OURS] P8-00 to P8-15 select the values to sample by their addresses, so the digits of the defaults in the manual are
    // taken as hexadecimal. The model stores these parameters and samples nothing.
    Row::u16(0x2800, 0, "P8-00 Sampling channel 1").rw().backup().default(0x8001),
    Row::u16(0x2801, 0, "P8-01 Sampling channel 2").rw().backup().default(0x8003),
    Row::u16(0x2802, 0, "P8-02 Sampling channel 3").rw().backup(),
    Row::u16(0x2803, 0, "P8-03 Sampling channel 4").rw().backup(),
    Row::u16(0x2804, 0, "P8-04 Sampling channel 5").rw().backup().default(0x8002),
    Row::u16(0x2805, 0, "P8-05 Sampling channel 6").rw().backup().default(0x8004),
    Row::u16(0x2806, 0, "P8-06 Sampling channel 7").rw().backup(),
    Row::u16(0x2807, 0, "P8-07 Sampling channel 8").rw().backup(),
    Row::u16(0x2808, 0, "P8-08 Sampling channel 9").rw().backup().default(0x1008),
    Row::u16(0x2809, 0, "P8-09 Sampling channel 10").rw().backup().default(0x1009),
    Row::u16(0x280A, 0, "P8-10 Sampling channel 11").rw().backup(),
    Row::u16(0x280B, 0, "P8-11 Sampling channel 12").rw().backup(),
    Row::u16(0x280C, 0, "P8-12 Sampling channel 13").rw().backup(),
    Row::u16(0x280D, 0, "P8-13 Sampling channel 14").rw().backup(),
    Row::u16(0x280E, 0, "P8-14 Sampling channel 15").rw().backup(),
    Row::u16(0x280F, 0, "P8-15 Sampling channel 16").rw().backup(),
    Row::u16(0x2810, 0, "P8-16 Sampling mode").rw().backup().range(0, 8).default(1),
    Row::u16(0x2811, 0, "P8-17 Sampling interval").rw().backup().range(1, 65535).default(36),
    Row::u16(0x2812, 0, "P8-18 Sampling time").rw().backup().default(1024),
    Row::u16(0x2813, 0, "P8-19 Trigger channel").rw().backup(),
    Row::u16(0x2814, 0, "P8-20 Trigger threshold low").rw().backup(),
    Row::u16(0x2815, 0, "P8-21 Trigger threshold high").rw().backup(),
    Row::u16(0x2816, 0, "P8-22 Trigger slope").rw().backup(),
    Row::u16(0x2817, 0, "P8-23 Sampling proportion").rw().backup().range(0, 100).default(100),
    Row::u16(0x2818, 0, "P8-24").rw().backup().range(0, 1),
    Row::u16(0x2819, 0, "P8-25").rw().backup().range(0, 1),
    Row::u16(0x281A, 0, "P8-26").rw().backup().range(0, 1),
];
