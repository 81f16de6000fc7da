//! The stepper drive Xinje DP3CL, whole: an open loop stepper with profile position, profile velocity, homing and CSP.
//!
//! | file | what it answers |
//! | --- | --- |
//! | `mod.rs` | what the drive is made of, how time passes in it, its alarms |
//! | `config.rs`, `dial.rs` | what it is built and set up as; the dial switch |
//! | `objects.rs` | its object dictionary and its PDOs |
//! | `parameters.rs`, `monitors.rs` | parameters P0 to P8 and commands F0; monitors U0 to U4 |
//! | `motion.rs`, `profile.rs`, `set_points.rs` | the modes of operation; ramps; the handshake of profile position |
//! | `inputs.rs`, `touch_probe.rs`, `leds.rs` | inputs and outputs, touch probes, LEDs |
//! | `alarms.rs`, `startup.rs` | the alarms E-8xx, and the checks before a change of the AL state |
//!
//! Homing, the state machine of CiA 402, the switches and what holds of every device are those of the other slaves.
//!
//! **Open loop** \[OURS]. The position actual value 0x6064 is the demand of the cycle before. A shaft that is jammed is a
//! fault that nobody could see in a real drive without an encoder: it shows in 0x6064 here, until it ends. So does an end
//! stop: beyond it the shaft stands, and is there again when the demand comes back.

mod alarms;
mod config;
mod dial;
mod inputs;
mod leds;
mod monitors;
mod motion;
mod objects;
mod parameters;
mod profile;
mod set_points;
mod startup;
mod touch_probe;

use std::slice;

use super::axis::Axis;
use super::communication::{Communication, SyncEvent};
use super::device::{self, Base, Model};
use super::dictionary::Object;
use super::plant::{Following, PulseTrain};
use super::process_data::{MappingLimits, Pdo};
use super::switches::{Input, Travel};
use super::{AlStatus, Fault};
use crate::cia402::{DriveState, Statusword};
use crate::ethercat::{AlState, Ns};
use alarms::{AlarmRecord, Alarms};
use inputs::Pins;
use monitors::Monitored;
use motion::Motion;
use parameters::Memory;
use startup::SafeOpSettings;
use touch_probe::{EDGES_MAX, Signal, TouchProbes};

pub use alarms::Dp3clAlarm;
pub use config::{Dp3clConfig, Dp3clVariants, Rating};
pub use dial::Dial;
pub use inputs::Dp3clOutputs;
pub use leds::{Dp3clLeds, LinkLed, RedLed};

/// The name of 0x1008.
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
    /// The mode with this value of 0x6060; `None`: the drive does not have it.
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

/// A simulated DP3CL.
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
    /// The shaft where the last cycle began, counts: what 0x6064 shows.
    shown: i64,
    /// The shaft stands here, whatever the drive demands.
    jammed_at: Option<i64>,
    /// The last values written to the commands F0-00 to F0-02.
    commands: [bool; 3],
    /// SI1 and SI2 at the end of the last cycle.
    seen_pins: [bool; 2],
    /// The input that clears alarms was on.
    clears: bool,
    /// Process data were exchanged since the last step, and before it.
    exchanged: bool,
    traffic: bool,
    power_on_count: u16,
    on_ns: Ns,
    /// How long no pulses have come.
    without_pulses_ns: Ns,
    cycle_ns: Ns,
    communication: Option<Communication>,
    /// Bits 0 to 2 of register 0x0981, and the cycle of SYNC0.
    dc: Option<(u8, Ns)>,
    /// The drive runs by SYNC0.
    by_sync0: bool,
    /// Cycles one after the other in which SYNC0 deviated too much.
    deviations: u16,
}

impl Dp3cl {
    /// A drive that is switched on now, as it comes from the factory.
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
            clears: false,
            exchanged: false,
            traffic: false,
            power_on_count: 1,
            on_ns: 0,
            without_pulses_ns: 0,
            cycle_ns: 0,
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
        let travel = Travel { index: config.travel.index.map(|index| index % u32::from(turn)), ..config.travel };
        let mut axis = Axis::of_pulses(&train, config.times, objects::settings(values), position)
            .with_travel(&travel, turn.into());
        if config.variants.without_index {
            axis.stick(Input::Index, Some(false));
        }
        axis.set_position(0);
        axis
    }

    /// The auto tuning at power-on, P1-00, finds out whether there is a motor.
    fn test_at_power_on(&mut self) {
        let tunes = self.base.values.get(parameters::AUTO_TUNING) != 0;
        if tunes && !self.config.has_motor {
            self.raise(Dp3clAlarm::OpenMotor);
        }
        self.check_supply();
    }

    /// The configuration.
    pub const fn config(&self) -> &Dp3clConfig {
        &self.config
    }

    /// The axis, for tests that measure what no object shows.
    pub const fn axis(&self) -> &Axis {
        &self.axis
    }

    /// The present alarm; `None`: there is none.
    pub const fn alarm(&self) -> Option<Dp3clAlarm> {
        self.alarms.present()
    }

    /// Changes the dial switch. It is read at power-on, but for the current of the motor.
    pub const fn set_dial(&mut self, dial: Dial) {
        self.config.dial = dial;
    }

    /// Changes the supply voltage, mV.
    pub fn set_supply(&mut self, supply_mv: u32) {
        self.config.supply_mv = supply_mv;
        self.check_supply();
    }

    /// The alarms of the supply. P3-02 is the threshold of under voltage, V; 0: there is no such alarm.
    fn check_supply(&mut self) {
        let threshold_mv = u32::from(self.base.values.get(parameters::UNDER_VOLTAGE)) * 1000;
        if self.config.supply_mv > self.config.rating.supply_max_mv() {
            self.raise(Dp3clAlarm::OverVoltage);
        } else if self.config.supply_mv < threshold_mv {
            self.raise(Dp3clAlarm::UnderVoltage);
        }
    }

    /// The outputs ERR and BRK.
    pub fn outputs(&self) -> Dp3clOutputs {
        let values = &self.base.values;
        let has_current =
            matches!(self.axis.machine().state(), DriveState::OperationEnabled | DriveState::QuickStopActive)
                || self.axis.machine().state() == DriveState::FaultReactionActive;
        Dp3clOutputs::of(
            values.get(parameters::ALARM_OUTPUT),
            values.get(parameters::BRAKE_OUTPUT),
            self.axis.machine().fault().is_some(),
            has_current,
        )
    }

    /// What the LEDs show.
    pub fn leds(&self) -> Dp3clLeds {
        let alarm = match self.axis.machine().fault().map(|fault| Dp3clAlarm::of_error_code(fault.code)) {
            None => RedLed::Off,
            Some(Some(alarm)) if alarm.number() < 10 => RedLed::Flashes(alarm.number() as u8),
            Some(_) => RedLed::On,
        };
        let by_bus = self.alarms.present().is_some_and(|alarm| alarm.al_status() != AlStatus(0));
        Dp3clLeds {
            power: true,
            alarm,
            run: self.base.al_state() != AlState::Init && !by_bus,
            link: if self.exchanged || self.traffic { LinkLed::Flashing } else { LinkLed::On },
        }
    }

    /// The station alias: P7-00.
    pub fn station_alias(&self) -> u16 {
        self.base.values.get(parameters::SET_ADDRESS)
    }

    /// The time of the command filter that the parameter P0-02 sets; the dial switch may set another one.
    pub const fn filter_time(&self) -> u16 {
        self.memory.filter_time()
    }

    /// The peak current of the motor, mA. \[OURS] The dial switch replaces P4-00 unless SW1 to SW3 are off.
    pub fn peak_ma(&self) -> u32 {
        let by_parameter = u32::from(self.base.values.get(parameters::PEAK_CURRENT)) * 100;
        self.config.dial.peak_ma(self.config.rating).map_or(by_parameter, u32::from)
    }

    /// The current in the motor, mA: none while the power stage is off; while no pulses come for the time of P0-12 that of
    /// P0-08, unless SW4 keeps it full; otherwise that of P0-05. \[OURS] P0-12 is in ms.
    pub fn motor_ma(&self) -> u32 {
        if !self.outputs_current() {
            return 0;
        }
        let values = &self.base.values;
        let delay_ns = Ns::from(values.get(parameters::HOLDING_DELAY)) * 1_000_000;
        let holds = self.without_pulses_ns >= delay_ns && !self.config.dial.holds_full_current();
        let percent = if holds { parameters::HOLDING_CURRENT } else { parameters::RUNNING_CURRENT };
        self.peak_ma() * u32::from(values.get(percent)) / 100
    }

    fn outputs_current(&self) -> bool {
        use DriveState::*;
        matches!(self.axis.machine().state(), OperationEnabled | QuickStopActive | FaultReactionActive)
    }

    /// The statusword.
    pub fn statusword(&self) -> Statusword {
        Statusword(self.axis.machine().status_bits() | self.motion.bits())
    }

    /// The mode in force.
    pub const fn mode(&self) -> Dp3clMode {
        self.motion.active
    }

    /// An alarm occurs: the drive goes to Fault.
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

    /// The alarm is cleared, if it does not need a restart: by F0-00, by the input of P2-05, or by a fault reset.
    fn clear_alarm(&mut self) {
        self.axis.machine_mut().request_reset();
    }

    /// Gives the functions POT, NOT and HOME the terminals that their parameters name.
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

    /// The position of the shaft, counts: where it is jammed, or what the drive demands as far as the end stops allow.
    fn shaft_position_now(&self) -> i64 {
        let position = self.jammed_at.unwrap_or(self.axis.plant().position());
        self.config.travel.stops.map_or(position, |(low, high)| position.clamp(low, high.max(low)))
    }

    /// The sign of positions of objects against those of the shaft: bit 7 of the polarity, 0x607E.
    fn position_sign(&self) -> i64 {
        if self.base.values.get(objects::POLARITY) & 1 << 7 != 0 { -1 } else { 1 }
    }

    /// The sign of velocities of objects: bit 6 of the polarity.
    fn velocity_sign(&self) -> f64 {
        if self.base.values.get(objects::POLARITY) & 1 << 6 != 0 { -1.0 } else { 1.0 }
    }

    /// A position of an object as one of the shaft.
    fn shaft_position(&self, position: i32) -> i32 {
        if self.position_sign() < 0 { position.wrapping_neg() } else { position }
    }

    /// The target position, 0x607A, as one of the shaft.
    fn shaft_target(&self) -> i32 {
        self.shaft_position(self.motion.target_position)
    }

    /// 0x6062, position demand value.
    fn demand_value(&self) -> i64 {
        self.axis.demand().wrapping_mul(self.position_sign())
    }

    /// 0x6064, position actual value.
    fn actual_value(&self) -> i64 {
        self.shown.wrapping_add(self.axis.origin()).wrapping_mul(self.position_sign())
    }

    /// 0x60F4, following error actual value: 0x6062 - 0x6064.
    fn following_error(&self) -> i64 {
        self.demand_value().wrapping_sub(self.actual_value())
    }

    /// A position in command units as counts of the encoder, P4-01 of them a turn.
    fn as_increments(&self, position: i64) -> i64 {
        let turn = i128::from(self.memory.subdivision());
        (i128::from(position) * i128::from(parameters::ENCODER_COUNTS)).div_euclid(turn) as i64
    }

    /// The velocity of the demand as objects have it, command units/s.
    fn velocity_value(&self) -> f64 {
        self.motion.velocity() * self.velocity_sign()
    }

    fn monitored(&self) -> Monitored {
        let pulses = self.axis.plant().position().wrapping_sub(self.config.position);
        Monitored::of(pulses, self.motion.velocity(), self.memory.subdivision(), self.motor_ma())
    }

    const fn on_seconds(&self) -> u64 {
        self.on_ns / 1_000_000_000
    }

    /// U3-00, the cycle. \[OURS] In microseconds.
    const fn cycle_us(&self) -> i64 {
        (self.cycle_ns / 1000) as i64 & 0xFFFF
    }

    /// U3-04, the cycle of SYNC0. \[OURS] In microseconds; 0 without it.
    fn sync0_us(&self) -> i64 {
        if self.by_sync0 { self.dc.map_or(self.cycle_us(), |(_, ns)| (ns / 1000) as i64) } else { 0 }
    }

    /// Takes the target position of process data or of an SDO. After homing the first one in CSP does not count, see
    /// `axis/homing.rs`.
    fn take_target_position(&mut self, position: i32) {
        self.motion.target_position = position;
        if self.motion.active == Dp3clMode::CyclicPosition && !self.axis.skips_target() {
            self.motion.target_came = true;
        }
    }

    /// `dt_ns` pass at the inputs: one that clears alarms does so when it goes on.
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

    /// The shaft has moved from one count to another: the probes store the positions of the edges between.
    fn probe(&mut self, from: i64, to: i64) {
        for probe in 0..2 {
            let Some(signal) = self.probes.signal(probe) else { continue };
            let mut at = from;
            for _ in 0..EDGES_MAX {
                let next = match signal {
                    Signal::Input => self.pins.next_change(probe, at, to),
                    Signal::Index => self.axis.switches().next_pulse(at, to),
                };
                let Some(next) = next else { break };
                let rises = signal == Signal::Index || self.pins.is_on(probe, next);
                self.store(probe, rises, next);
                at = next;
            }
        }
    }

    /// A terminal that is forced has changed since the last cycle, while the shaft stands at a count.
    fn probe_forced(&mut self) {
        let at = self.shaft_position_now();
        for (probe, was) in self.seen_pins.into_iter().enumerate() {
            let is = self.pins.is_on(probe, at);
            if is != was && self.probes.signal(probe) == Some(Signal::Input) {
                self.store(probe, is, at);
            }
        }
    }

    fn store(&mut self, probe: usize, rises: bool, at: i64) {
        let position = at.wrapping_add(self.axis.origin()).wrapping_mul(self.position_sign());
        self.probes.edge(probe, rises, position as i32);
    }

    fn probe_pins(&self) -> [bool; 2] {
        [0, 1].map(|pin| self.pins.is_on(pin, self.shaft_position_now()))
    }

    /// Something of the synchronization has happened.
    fn synchronization(&mut self, event: SyncEvent) {
        let runs = matches!(self.base.al_state(), AlState::SafeOp | AlState::Op) && self.by_sync0;
        let alarm = match event {
            SyncEvent::InTime => {
                self.deviations = 0;
                return;
            }
            SyncEvent::Deviation => {
                self.deviations = self.deviations.saturating_add(1);
                let limit = self.base.values.get(objects::SYNC_ERROR_LIMIT);
                if self.deviations < limit.max(1) {
                    return;
                }
                Dp3clAlarm::SyncDeviation
            }
            SyncEvent::NotLocked => Dp3clAlarm::NotSynchronized,
            SyncEvent::LockLost => Dp3clAlarm::PhaseLost,
        };
        if runs {
            let to = if alarm == Dp3clAlarm::NotSynchronized { AlState::PreOp } else { AlState::SafeOp };
            self.raise(alarm);
            device::fall(self, to, alarm.al_status());
            self.deviations = 0;
        }
    }
}

impl Default for Dp3cl {
    fn default() -> Self {
        Self::new(Dp3clConfig::default())
    }
}

impl Model for Dp3cl {
    const LIMITS: MappingLimits = objects::LIMITS;

    const COMPLETE_ACCESS: bool = false;

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

    fn step_axes(&mut self, dt_ns: Ns) {
        let from = self.axis.plant().position();
        self.read_inputs(dt_ns);
        self.probe_forced();
        let shown = self.shaft_position_now();
        self.run_modes(dt_ns);
        let to = self.axis.plant().position();
        if self.jammed_at.is_none() {
            self.probe(from, to);
        }
        self.shown = shown;
        self.seen_pins = self.probe_pins();
        if self.axis.machine().fault().is_none() {
            self.alarms.clear();
        }
        self.without_pulses_ns = if from == to { self.without_pulses_ns.saturating_add(dt_ns) } else { 0 };
        self.on_ns = self.on_ns.saturating_add(dt_ns);
        self.cycle_ns = dt_ns;
        self.traffic = std::mem::take(&mut self.exchanged);
    }

    fn begin_axes(&mut self, dt_ns: Ns) -> Option<Following<'_>> {
        self.step_axes(dt_ns);
        None
    }

    fn note_exchange(&mut self) {
        self.exchanged = true;
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        (axis == 0).then(|| self.shaft_position_now())
    }

    fn apply_fault(&mut self, fault: Fault) -> bool {
        match fault {
            Fault::Alarm { axis: 0, fault } => match Dp3clAlarm::of_error_code(fault.code) {
                Some(alarm) => self.raise(alarm),
                None => self.axis.machine_mut().raise(fault),
            },
            Fault::Stick { axis: 0, input, value } => {
                let inputs = input.map_or_else(|| Input::ALL.to_vec(), |input| vec![input]);
                for input in inputs {
                    match input {
                        Input::Index => self.axis.stick(input, value),
                        sensor => self.pins.stick(sensor, value),
                    }
                }
                self.rewire();
            }
            Fault::Jam { axis: 0, jammed } => self.jammed_at = jammed.then(|| self.shaft_position_now()),
            Fault::ForceInputs { channel: 0, pattern } => {
                self.pins.force(pattern);
                self.rewire();
            }
            _ => return false,
        }
        true
    }

    fn check_change(&mut self, to: AlState, mapped: Result<(), AlStatus>) -> Result<(), AlStatus> {
        let checked = match (to, &self.communication) {
            (AlState::PreOp, Some(communication)) => startup::to_preop(communication, self.config.variants),
            (AlState::SafeOp, _) => {
                mapped?;
                let values = &self.base.values;
                let sync_types = (values.get(objects::OUTPUT_SYNC_TYPE), values.get(objects::INPUT_SYNC_TYPE));
                let settings = SafeOpSettings { communication: self.communication, dc: self.dc, sync_types };
                startup::to_safeop(&settings).map(|by_sync0| self.by_sync0 = by_sync0)
            }
            _ => Ok(()),
        };
        checked.map_err(Dp3clAlarm::al_status)?;
        if to == AlState::SafeOp && self.by_sync0 && self.dc.is_some() {
            // [OURS] With SYNC0 on the types read "DC", whatever was written.
            self.base.values.set(objects::OUTPUT_SYNC_TYPE, objects::DC_SYNC0);
            self.base.values.set(objects::INPUT_SYNC_TYPE, objects::DC_SYNC0);
        }
        Ok(())
    }

    fn change_refused(&mut self, status: AlStatus) {
        if let Some(alarm) = Dp3clAlarm::of_al_status(status) {
            self.raise(alarm);
        }
    }

    fn state_changed(&mut self, _from: AlState) {
        use DriveState::{OperationEnabled, QuickStopActive};
        if matches!(self.axis.machine().state(), OperationEnabled | QuickStopActive) {
            self.raise(Dp3clAlarm::ChangeWhileEnabled);
        }
    }

    fn refuse_request(&mut self, code: u8) -> AlStatus {
        let alarm = if code == device::BOOTSTRAP { Dp3clAlarm::Bootstrap } else { Dp3clAlarm::UnknownState };
        let to = if alarm == Dp3clAlarm::Bootstrap { AlState::Init } else { AlState::SafeOp };
        self.raise(alarm);
        device::fall(self, to, alarm.al_status());
        alarm.al_status()
    }

    fn watchdog_expired(&mut self) {
        self.raise(Dp3clAlarm::Watchdog);
    }

    fn set_communication(&mut self, communication: &Communication) {
        self.communication = Some(*communication);
        self.dc = Some((communication.dc_activation & 0b111, communication.sync0_cycle_ns.into()));
    }

    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        self.dc = Some(startup::activation_of(cycle_ns));
    }

    fn report_sync(&mut self, event: SyncEvent) {
        self.synchronization(event);
    }

    fn restart(&mut self) {
        let position = self.axis.plant().position();
        let values = self.memory.load(self.config.rating, self.config.dial.station());
        self.pins = Pins::new(self.config.wiring, &self.config.travel, self.config.dial.is_reversed());
        self.axis = Self::axis_at_power_on(&self.config, self.memory.subdivision(), position, &values);
        self.base.restart(values, objects::PDOS);
        self.alarms.restart();
        (self.motion, self.probes, self.shown) = (Motion::new(), TouchProbes::default(), position);
        (self.commands, self.exchanged, self.clears) = Default::default();
        (self.on_ns, self.without_pulses_ns, self.deviations) = (0, 0, 0);
        (self.communication, self.dc, self.by_sync0) = (None, None, false);
        self.power_on_count = self.power_on_count.saturating_add(1);
        self.rewire();
        self.test_at_power_on();
    }
}
