//! A CiA 402 drive of one axis: a servo drive in CSP, CSV and CST, or a stepper, which is a drive that has CSP alone. Both do
//! homing.

mod objects;

use std::slice;

use super::axis::{Axis, Settings};
use super::device::{Base, Model};
use super::dictionary::{Object, Values};
use super::homing::HomingSettings;
use super::plant::Motor;
use super::process_data::Pdo;
use super::state_machine::{OptionCodes, TransitionTimes};
use super::switches::Travel;
use crate::cia402::Mode;
use crate::coe::AbortCode;

pub use objects::{PRODUCT_CODE, REVISION, STEPPER_PRODUCT_CODE};

/// Which kind of drive a [`Drive`] is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveKind {
    /// A servo drive with CSP, CSV and CST.
    #[default]
    Servo,
    /// A stepper with an encoder, which has CSP alone.
    Stepper,
}

/// The configuration of a [`Drive`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveConfig {
    /// The name that people know it by.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// Servo drive or stepper.
    pub kind: DriveKind,
    /// Where the shaft stands at power-on, counts.
    pub position: i64,
    /// The motor and its load.
    pub motor: Motor,
    /// How long the transitions of its state machine take.
    pub times: TransitionTimes,
    /// Its switches and end stops, in counts of the shaft. For another motor than the default one use [`Travel::for_turn`].
    pub travel: Travel,
}

impl Default for DriveConfig {
    fn default() -> Self {
        Self {
            name: "drive".into(),
            serial: 0,
            kind: DriveKind::Servo,
            position: 0,
            motor: Motor::default(),
            times: TransitionTimes::default(),
            travel: Travel::default(),
        }
    }
}

impl DriveConfig {
    /// The default configuration of a stepper.
    pub fn stepper() -> Self {
        let motor = Motor::stepper();
        let travel = Travel::for_turn(motor.counts_per_turn);
        Self { name: "step".into(), kind: DriveKind::Stepper, motor, travel, ..Self::default() }
    }
}

/// A simulated servo drive or stepper.
///
/// \[OURS] An object that is mapped into the RxPDO can be written by SDO too; the next cycle overwrites it. When the drive
/// leaves OP while it moves (by a change of state, or by the watchdog of its outputs, 100 ms) it brakes on the quick-stop ramp
/// and ends in Switch on disabled; this is no fault.
#[derive(Clone, Debug)]
#[repr(C)] // What a cycle uses lies side by side: the end of `base` and the beginning of `axis`.
pub struct Drive {
    base: Base<Drive>,
    axis: Axis,
    kind: DriveKind,
    motor: Motor,
}

impl Drive {
    /// A drive that is switched on now.
    pub fn new(config: DriveConfig) -> Self {
        let DriveConfig { name, serial, kind, position, motor, times, travel } = config;
        let values = objects::defaults(&motor);
        let axis = Axis::new(&motor, times, settings(&values), position).with_travel(&travel, motor.counts_per_turn);
        Self {
            base: Base::new(name, serial, objects::identity_of(kind), values, objects::pdos_of(kind)),
            kind,
            motor,
            axis,
        }
    }

    /// The axis, for tests that measure what no object shows.
    pub const fn axis(&self) -> &Axis {
        &self.axis
    }

    /// Gives the axis its settings after an object that it reads was written.
    fn settings_changed(&mut self) {
        self.axis.apply_settings(settings(&self.base.values));
    }

    fn set_mode(&mut self, code: i64) -> Result<(), AbortCode> {
        match (u8::try_from(code).ok().and_then(Mode::from_code), self.kind) {
            (Some(mode @ (Mode::Homing | Mode::Csp)), _) | (Some(mode @ (Mode::Csv | Mode::Cst)), DriveKind::Servo) => {
                self.axis.set_mode(mode);
                Ok(())
            }
            _ => Err(AbortCode::VALUE_RANGE),
        }
    }
}

fn settings(values: &Values) -> Settings {
    use objects::*;
    Settings {
        following_window: values.get(FOLLOWING_WINDOW),
        following_timeout_ms: values.get(FOLLOWING_TIMEOUT),
        position_limits: (values.get(MIN_POSITION), values.get(MAX_POSITION)),
        max_velocity: values.get(MAX_VELOCITY),
        max_torque: values.get(MAX_TORQUE),
        slow_down: values.get(PROFILE_DECELERATION),
        quick_stop: values.get(QUICK_STOP_DECELERATION),
        options: OptionCodes {
            quick_stop: values.get(QUICK_STOP_OPTION),
            shutdown: values.get(SHUTDOWN_OPTION),
            disable_operation: values.get(DISABLE_OPTION),
            fault_reaction: values.get(FAULT_OPTION),
        },
        homing: HomingSettings {
            method: values.get(HOMING_METHOD),
            offset: values.get(HOME_OFFSET),
            switch_speed: values.get(HOMING_SPEED_SWITCH),
            zero_speed: values.get(HOMING_SPEED_ZERO),
            acceleration: values.get(HOMING_ACCELERATION),
            halt_option: values.get(HALT_OPTION),
        },
    }
}

impl Model for Drive {
    fn objects() -> &'static [Object<Self>] {
        objects::OBJECTS
    }

    fn pdos() -> &'static [Pdo<Self>] {
        objects::PDOS
    }

    fn base(&self) -> &Base<Self> {
        &self.base
    }

    fn base_mut(&mut self) -> &mut Base<Self> {
        &mut self.base
    }

    fn axes(&self) -> &[Axis] {
        slice::from_ref(&self.axis)
    }

    fn axes_mut(&mut self) -> &mut [Axis] {
        slice::from_mut(&mut self.axis)
    }
}
