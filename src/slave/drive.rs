//! A CiA 402 servo drive: CSP, CSV, CST and homing on one axis, with process data fixed by its role.

mod objects;

use super::al::ApplicationLayer;
use super::axis::{Axis, Settings};
use super::dictionary::{self, Values};
use super::homing::HomingSettings;
use super::plant::Motor;
use super::state_machine::{DeviceFault, OptionCodes, TransitionTimes};
use super::switches::{Input, Travel};
use super::{AlStatus, SdoValue, Slave};
use crate::cia402::{Controlword, MODES_OF_OPERATION, Mode};
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{AlState, Ns, Refusal, Role, SlaveConfig, SlaveIn, SlaveOut};
use crate::sk::DriveSync;

pub use objects::{PRODUCT_CODE, REVISION, VENDOR_ID};

/// How a [`Drive`] differs from the one it is by default.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveConfig {
    /// Its name for people.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// Where the shaft stands at power-on, counts.
    pub position: i64,
    /// The motor and its load.
    pub motor: Motor,
    /// How long its transitions take.
    pub times: TransitionTimes,
    /// Its switches, in counts of the shaft: with another motor than the default one, [`Travel::for_motor`].
    pub travel: Travel,
}

impl Default for DriveConfig {
    fn default() -> Self {
        Self {
            name: "drive".into(),
            serial: 0,
            position: 0,
            motor: Motor::default(),
            times: TransitionTimes::default(),
            travel: Travel::default(),
        }
    }
}

/// The drive.
///
/// \[OURS] It keeps what process data and SDOs write in one place: an object mapped into the RxPDO can be written by
/// SDO too, and the next cycle writes over it. When it leaves OP while it moves (a change of state, or the watchdog of
/// its outputs, 100 ms) it brakes on the quick-stop ramp and ends in Switch on disabled; this is no fault.
#[derive(Clone, Debug)]
pub struct Drive {
    name: String,
    serial: u32,
    motor: Motor,
    al: ApplicationLayer,
    values: Values,
    axis: Axis,
    /// The mode whose target the RxPDO carries; `None`: no process data are mapped.
    mapped: Option<Mode>,
    sync: DriveSync,
}

impl Drive {
    /// A drive that is switched on now.
    pub fn new(config: DriveConfig) -> Self {
        let DriveConfig { name, serial, position, motor, times, travel } = config;
        let values = objects::defaults(&motor);
        let axis = Axis::new(&motor, times, settings(&values), position).on(&travel, &motor);
        let (al, sync) = (ApplicationLayer::default(), DriveSync::default());
        Self { name, serial, motor, al, values, axis, mapped: None, sync }
    }

    /// The axis, for measurements that no object shows.
    pub const fn axis(&self) -> &Axis {
        &self.axis
    }

    /// Objects that the axis works with are new.
    fn settings_changed(&mut self) {
        self.axis.set(settings(&self.values));
    }

    fn set_mode(&mut self, code: i64) -> Result<(), AbortCode> {
        match u8::try_from(code).ok().and_then(Mode::from_code) {
            Some(mode) => {
                self.axis.set_mode(mode);
                Ok(())
            }
            None => Err(AbortCode::VALUE_RANGE),
        }
    }

    /// Without a mailbox nothing answers, and the master's transfer times out.
    fn mailbox(&self) -> Result<(), AbortCode> {
        if self.al.state() == AlState::Init { Err(AbortCode::TIMEOUT) } else { Ok(()) }
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

impl Slave for Drive {
    fn name(&self) -> &str {
        &self.name
    }

    fn state(&self) -> AlState {
        self.al.state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let was = self.al.state();
        let ready = if self.mapped.is_some() { Ok(()) } else { Err(AlStatus::INVALID_OUTPUTS) };
        self.al.enter(target, ready)?;
        if was == AlState::Op && target != AlState::Op {
            self.axis.machine_mut().lose_master();
        }
        if target == AlState::Init {
            self.mapped = None;
        }
        Ok(())
    }

    fn configure(&mut self, config: &SlaveConfig) -> Result<(), Refusal> {
        let refusal = |AlStatus(al_status), abort| Err(Refusal { slave: 0, al_status, abort });
        if self.al.state() != AlState::PreOp {
            return refusal(AlStatus::INVALID_CHANGE, None);
        }
        match config.role {
            Role::Unused => {
                self.mapped = None;
                return Ok(());
            }
            // It has no outputs of its own: a drive enters it by 0x6060.
            Role::Drive(Mode::Homing) => {
                return refusal(AlStatus(0), Some((ObjectAddress::new(MODES_OF_OPERATION, 0), AbortCode::VALUE_RANGE)));
            }
            Role::Drive(mode) => {
                if let Err(code) = self.set_mode(mode.code().into()) {
                    return refusal(AlStatus(0), Some((ObjectAddress::new(MODES_OF_OPERATION, 0), code)));
                }
                self.mapped = Some(mode);
            }
            // [OURS] Sync manager 2 is looked at first, and no other role has the outputs of a servo drive.
            Role::Step(_) | Role::Hsp(_) | Role::Io => return refusal(AlStatus::INVALID_OUTPUTS, None),
        }
        self.sync = config.sync;
        Ok(())
    }

    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        self.mailbox()?;
        dictionary::upload(self, object)
    }

    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        self.mailbox()?;
        dictionary::download(self, object, size, value)
    }

    fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
        inputs[0] = *self.axis.measured();
        let (Some([out, ..]), AlState::Op) = (outputs, self.al.state()) else { return };
        self.al.feed();
        self.axis.machine_mut().command(Controlword(out.controlword.0));
        match self.mapped {
            Some(Mode::Csp) => self.axis.take_target_position(out.target),
            Some(Mode::Csv) => self.axis.targets_mut().velocity = out.target,
            Some(Mode::Cst) => self.axis.targets_mut().torque = out.target as i16,
            Some(Mode::Homing) | None => {}
        }
    }

    fn step(&mut self, dt_ns: Ns) {
        if self.al.step(dt_ns) {
            self.axis.machine_mut().lose_master();
        }
        self.axis.step(dt_ns);
    }

    fn raise_fault(&mut self, axis: usize, fault: DeviceFault) -> bool {
        if axis == 0 {
            self.axis.machine_mut().raise(fault);
        }
        axis == 0
    }

    fn stick_input(&mut self, axis: usize, input: Input, value: Option<bool>) -> bool {
        if axis == 0 {
            self.axis.stick(input, value);
        }
        axis == 0
    }

    fn jam(&mut self, axis: usize, jammed: bool) -> bool {
        if axis == 0 {
            self.axis.jam(jammed);
        }
        axis == 0
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        (axis == 0).then(|| self.axis.plant().position())
    }
}
