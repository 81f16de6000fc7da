//! Complete model of the stepper drive Xinje DP3CL: an open-loop stepper with profile position, profile velocity, homing
//! and CSP.
//!
//! | file | content |
//! | --- | --- |
//! | `mod.rs` | the parts of the drive; raising and clearing alarms |
//! | `config.rs`, `dial.rs` | the configuration; the dial switch |
//! | `objects.rs` | its object dictionary and its PDOs |
//! | `parameters.rs`, `monitors.rs` | parameters P0 to P8 and commands F0; monitors U0 to U4 |
//! | `motion.rs`, `profile.rs`, `set_points.rs` | the modes of operation; ramps; the handshake of profile position |
//! | `inputs.rs`, `touch_probe.rs`, `leds.rs` | inputs and outputs, touch probes, LEDs |
//! | `electric.rs`, `readings.rs`, `timing.rs` | supply, current, outputs; motion values that objects show; cycle timing |
//! | `model.rs` | the time step, faults, and changes of the AL state |
//! | `alarms.rs`, `startup.rs` | the alarms E-8xx, and the checks before a change of the AL state |
//!
//! Homing, the CiA 402 state machine, the switches and the common part of all devices are shared with the other slaves.
//!
//! **Open loop** \[OURS]. The position actual value 0x6064 is the demand of the previous cycle. A jammed shaft would be
//! invisible in a real drive, which has no encoder; in this model it shows in 0x6064 as long as the fault lasts. An end
//! stop shows in 0x6064 too: the shaft stops there, and follows the demand again once the demand comes back.

mod alarms;
mod config;
mod dial;
mod electric;
mod inputs;
mod leds;
mod model;
mod monitors;
mod motion;
mod objects;
mod parameters;
mod profile;
mod rating;
mod readings;
mod set_points;
mod startup;
mod timing;
mod touch_probe;

use super::axis::Axis;
use super::communication::Communication;
use super::device::Base;
use super::plant::PulseTrain;
use super::switches::{Input, Travel};
use crate::ethercat::Ns;
use crate::ethercat::cia402::Statusword;
use alarms::{AlarmRecord, Alarms};
use inputs::Pins;
use motion::Motion;
use parameters::Memory;
use timing::Timing;
use touch_probe::{LastStep, TouchProbes};

pub use alarms::Dp3clAlarm;
pub use config::{Dp3clConfig, Dp3clVariants};
pub use dial::Dial;
pub use inputs::Dp3clOutputs;
pub use leds::{Dp3clLeds, LinkLed, RedLed};
pub use rating::Rating;

/// The device name, object 0x1008, as the drive reports it (from its ESI file).
pub(super) const DEVICE_NAME: &str = "VH3C";

/// A mode of operation of the drive, 0x6060.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(i8)]
pub enum Dp3clMode {
    /// No mode: the drive cannot be enabled (E-881).
    #[default]
    None = 0,
    /// Profile position.
    ProfilePosition = 1,
    /// Profile velocity.
    ProfileVelocity = 3,
    /// Homing.
    Homing = 6,
    /// Cyclic synchronous position.
    CyclicPosition = 8,
}

impl Dp3clMode {
    /// The mode with this value of 0x6060; `None` for a mode that the drive does not support.
    pub const fn from_code(code: i8) -> Option<Self> {
        match code {
            0 => Some(Self::None),
            1 => Some(Self::ProfilePosition),
            3 => Some(Self::ProfileVelocity),
            6 => Some(Self::Homing),
            8 => Some(Self::CyclicPosition),
            _ => None,
        }
    }

    /// The value of the mode in 0x6060.
    pub const fn code(self) -> i8 {
        self as i8
    }
}

/// A simulated stepper drive Xinje DP3CL.
#[derive(Clone, Debug)]
pub struct Dp3cl {
    base: Base<Dp3cl>,
    axis: Axis,
    config: Dp3clConfig,
    memory: Memory,
    motion: Motion,
    pins: Pins,
    probes: TouchProbes,
    alarms: Alarms,
    /// The position of the shaft at the beginning of the last cycle, counts. The position actual value, 0x6064, is
    /// calculated from it.
    shown: i64,
    /// The position at which the shaft is jammed, counts; `None` for a free shaft.
    jammed_at: Option<i64>,
    /// Whether a value other than 0 was written last to F0-00 (clear alarm), F0-01 (restore factory settings) and F0-02
    /// (save parameters): the drive executes such a command on a rising edge.
    commands: [bool; 3],
    /// The levels of SI1 and SI2 at the end of the last cycle.
    seen_pins: [bool; 2],
    last_step: LastStep,
    /// Whether the input that clears alarms was on in the last cycle, to detect its rising edge.
    clears: bool,
    /// Whether process data were exchanged since the last step (`exchanged`), and between the last two steps
    /// (`traffic`). The LEDs of the links show this traffic.
    exchanged: bool,
    traffic: bool,
    /// Whether ports IN and OUT of the slave controller have a link.
    links: [bool; 2],
    power_on_count: u16,
    on_ns: Ns,
    /// The time since the last command pulse to the motor, ns.
    without_pulses_ns: Ns,
    cycle_ns: Ns,
    timing: Timing,
    communication: Option<Communication>,
    /// Bits 0 to 2 of register 0x0981 (activation of SYNC0), and the SYNC0 cycle time, ns; `None` until a network has
    /// set them after power-on.
    dc: Option<(u8, Ns)>,
    /// Whether SYNC0 triggers the cycles of the drive.
    by_sync0: bool,
    /// The number of consecutive cycles in which SYNC0 deviated too much.
    deviations: u16,
}

impl Dp3cl {
    /// A drive with factory parameters in its power-on state.
    pub fn new(config: Dp3clConfig) -> Self {
        let mut memory = Memory::new(parameters::factory(config.rating));
        let values = memory.load(config.rating, config.dial.station());
        let axis = Self::axis_at_power_on(&config, memory.subdivision(), config.position, &values);
        let pins = Pins::new(config.wiring, &config.travel, config.dial.is_reversed());
        let mut base = Base::new(config.name.clone(), config.serial, &objects::IDENTITY, values, objects::PDOS);
        if config.variants.ten_entries {
            base = base.with_limits(objects::TEN_ENTRIES, objects::PDOS);
        }
        let mut drive = Self {
            base,
            axis,
            shown: config.position,
            config,
            memory,
            motion: Motion::new(),
            pins,
            probes: TouchProbes::default(),
            alarms: Alarms::default(),
            jammed_at: None,
            commands: [false; 3],
            seen_pins: [false; 2],
            last_step: LastStep::default(),
            clears: false,
            exchanged: false,
            traffic: false,
            links: [true; 2],
            power_on_count: 1,
            on_ns: 0,
            without_pulses_ns: 0,
            cycle_ns: 0,
            timing: Timing::default(),
            communication: None,
            dc: None,
            by_sync0: false,
            deviations: 0,
        };
        drive.rewire();
        drive.test_at_power_on();
        drive.seen_pins = drive.probe_pins();
        drive
    }

    fn axis_at_power_on(config: &Dp3clConfig, turn: u16, position: i64, values: &super::dictionary::Values) -> Axis {
        let train = PulseTrain { max_rate: u32::MAX };
        let index = config.travel.index.map(|index| index % u32::from(turn));
        // Limit switches must not stop the axis model itself: the modes of the drive do that, see `motion.rs`.
        let travel = Travel { index, limits_stop_motion: false, ..config.travel };
        let mut axis = Axis::of_pulses(&train, config.times, objects::settings(values), position)
            .with_travel(&travel, turn.into());
        if config.variants.without_index {
            axis.stick(Input::Index, Some(false));
        }
        // [OURS] The drive does not keep its position without power: wherever the shaft is, the position actual value
        // begins at 0.
        axis.set_position(0);
        axis
    }

    /// The configuration of the drive.
    pub const fn config(&self) -> &Dp3clConfig {
        &self.config
    }

    /// The axis, for tests that need values which no object shows.
    pub const fn axis(&self) -> &Axis {
        &self.axis
    }

    /// The present alarm; `None` if there is no alarm.
    pub const fn alarm(&self) -> Option<Dp3clAlarm> {
        self.alarms.present()
    }

    /// Sets the dial switch. Motor current follows immediately; the other settings are read at power-on.
    pub const fn set_dial(&mut self, dial: Dial) {
        self.config.dial = dial;
    }

    /// The statusword: the bits of the state machine and the bits of the mode of operation.
    pub fn statusword(&self) -> Statusword {
        Statusword(self.axis.machine().status_bits() | self.motion.bits())
    }

    /// The active mode of operation.
    pub const fn mode(&self) -> Dp3clMode {
        self.motion.active
    }

    /// Raises an alarm: the drive goes to Fault.
    fn raise(&mut self, alarm: Dp3clAlarm) {
        if self.alarms.present() == Some(alarm) {
            return;
        }
        let monitored = self.monitored();
        let record = AlarmRecord {
            phase_a_ma: monitored.phase_a_ma,
            phase_b_ma: monitored.phase_b_ma,
            current_ma: monitored.current_ma,
            voltage_v: (self.config.supply_mv / 1000) as i16,
            position_offset: self.following_error() as i16,
            speed_rpm: monitored.speed_rpm,
            seconds: self.on_seconds() as u32,
        };
        self.alarms.note(alarm, record);
        self.axis.machine_mut().raise(alarm.fault());
    }

    /// Clears the present alarm unless it needs a restart. Called for F0-00, the input that P2-05 selects, and a fault
    /// reset.
    fn clear_alarm(&mut self) {
        self.axis.machine_mut().request_reset();
    }

    /// Connects the functions POT, NOT and HOME to the terminals that their parameters select.
    fn rewire(&mut self) {
        let values = &self.base.values;
        let parameter = |input| match input {
            Input::PositiveLimit => values.get(parameters::POSITIVE_LIMIT),
            Input::NegativeLimit => values.get(parameters::NEGATIVE_LIMIT),
            _ => values.get(parameters::HOME),
        };
        let switches = self.axis.switches().rewired(|input| self.pins.wiring_of(parameter(input)));
        self.axis.set_switches(switches);
    }

    /// Takes over the target position from process data or an SDO. The first target position in CSP after homing is
    /// ignored, see `axis/homing.rs`.
    fn take_target_position(&mut self, position: i32) {
        self.motion.target_position = position;
        if self.motion.active == Dp3clMode::CyclicPosition && !self.axis.skips_target() {
            self.motion.target_came = true;
        }
    }

    /// Reads the inputs in a step of `dt_ns`. A rising edge of the input that clears alarms clears the alarm.
    fn read_inputs(&mut self, dt_ns: Ns) {
        let clears = self.pins.function(self.base.values.get(parameters::ALARM_CLEAR), self.shaft_position_now());
        if clears && !std::mem::replace(&mut self.clears, clears) {
            self.clear_alarm();
        }
        self.clears = clears;
        if self.pins.are_forced() {
            self.pins.pass(dt_ns);
            self.rewire();
        }
    }
}

impl Default for Dp3cl {
    fn default() -> Self {
        Self::new(Dp3clConfig::default())
    }
}
