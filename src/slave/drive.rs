//! A CiA 402 drive with one axis: a servo drive with CSP, CSV and CST, or a stepper, which has only CSP. Both support
//! homing.

mod objects;

use std::slice;

use super::axis::{Axis, Settings};
use super::axis_objects::AxisModel;
use super::device::{Base, Model};
use super::dictionary::Object;
use super::plant::Motor;
use super::process_data::Pdo;
use super::state_machine::TransitionTimes;
use super::switches::Travel;
use crate::ethercat::cia402::Mode;

pub use objects::{PRODUCT_CODE, REVISION, STEPPER_PRODUCT_CODE};

/// The type of a [`Drive`]: it determines the modes, the identity and the PDOs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveKind {
    /// A servo drive with CSP, CSV and CST.
    #[default]
    Servo,
    /// A stepper with an encoder, which has only CSP.
    Stepper,
}

/// The configuration of a [`Drive`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveConfig {
    /// The display name of the drive.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// Servo drive or stepper.
    pub kind: DriveKind,
    /// The position of the shaft at power-on, counts.
    pub position: i64,
    /// The motor and its load.
    pub motor: Motor,
    /// The durations of the transitions of the CiA 402 state machine.
    pub times: TransitionTimes,
    /// The switches and end stops, in counts of the shaft. For another motor than the default one, use
    /// [`Travel::for_turn`].
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
/// \[OURS] SDOs can also write an object that is mapped into an RxPDO; the next cycle overwrites the value. When a
/// moving drive leaves OP (by a change of state, or by its watchdog for outputs, 100 ms), it brakes on the quick-stop
/// ramp and ends in Switch on disabled, without a fault.
#[derive(Clone, Debug)]
#[repr(C)] // The fields that a cycle uses are adjacent: the end of `base` and the beginning of `axis`.
pub struct Drive {
    base: Base<Drive>,
    axis: Axis,
    kind: DriveKind,
    motor: Motor,
}

impl Drive {
    /// A drive in its power-on state.
    pub fn new(config: DriveConfig) -> Self {
        let DriveConfig { name, serial, kind, position, motor, times, travel } = config;
        let values = objects::defaults(&motor);
        let axis =
            Axis::new(&motor, times, objects::settings(&values), position).with_travel(&travel, motor.counts_per_turn);
        Self {
            base: Base::new(name, serial, objects::identity_of(kind), values, objects::pdos_of(kind)),
            kind,
            motor,
            axis,
        }
    }

    /// The axis, for tests that need values which no object shows.
    pub const fn axis(&self) -> &Axis {
        &self.axis
    }
}

impl AxisModel for Drive {
    fn has_mode(&self, mode: Mode) -> bool {
        match mode {
            Mode::Homing | Mode::Csp => true,
            Mode::Csv | Mode::Cst => self.kind == DriveKind::Servo,
        }
    }

    fn settings(&self, _axis: usize) -> Settings {
        objects::settings(&self.base.values)
    }
}

impl Model for Drive {
    const FIRMWARE: Option<&'static str> = Some("firmware of a simulated drive\n");

    fn objects() -> &'static [Object<Self>] {
        objects::OBJECTS
    }

    fn pdos() -> &'static [Pdo<Self>] {
        objects::PDOS
    }

    fn often_mapped() -> &'static [Pdo<Self>] {
        objects::OFTEN_MAPPED
    }

    fn base(&self) -> &Base<Self> {
        &self.base
    }

    fn base_mut(&mut self) -> &mut Base<Self> {
        &mut self.base
    }

    #[inline]
    fn axes(&self) -> &[Axis] {
        slice::from_ref(&self.axis)
    }

    #[inline]
    fn axes_mut(&mut self) -> &mut [Axis] {
        slice::from_mut(&mut self.axis)
    }
}
