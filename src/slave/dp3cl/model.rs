//! The drive as a [`Model`]: the time step, faults, and changes of the AL state.

use std::slice;

use super::alarms::Dp3clAlarm;
use super::inputs::Pins;
use super::motion::Motion;
use super::startup::{self, SafeOpSettings};
use super::timing::Timing;
use super::touch_probe::{LastStep, TouchProbes};
use super::{Dp3cl, objects, parameters};
use crate::ethercat::cia402::{DriveState, error_name};
use crate::ethercat::registers::{Features, PORTS, RequestedState};
use crate::ethercat::{AlState, Ns};
use crate::slave::axis::Axis;
use crate::slave::communication::{Communication, LatchChange, SyncEvent};
use crate::slave::device::{self, Base, Model};
use crate::slave::dictionary::Object;
use crate::slave::esc::EscSettings;
use crate::slave::plant::Servo;
use crate::slave::process_data::{MappingLimits, Pdo};
use crate::slave::switches::Input;
use crate::slave::{AlStatus, Fault};

/// The time limit for the PLL to lock after synchronization has begun, ns.
const SYNC_LOCK_LIMIT_NS: Ns = 1_000_000_000;

impl Model for Dp3cl {
    const LIMITS: MappingLimits = objects::LIMITS;

    const COMPLETE_ACCESS: bool = false;

    const TEST_MEMORY: bool = false;

    // [OURS] In SafeOP the watchdog of the slave controller runs from the first outputs on. If it expires then, the
    // drive raises its watchdog alarm, as in OP.
    const WATCHDOG_IN_SAFEOP: bool = true;

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

    /// The station alias from parameter P7-00.
    fn station_alias(&self) -> u16 {
        self.base.values.get(parameters::SET_ADDRESS)
    }

    /// The values of the slave controller's registers from the manual. The manual does not mention emergencies, so there
    /// are none \[OURS]. The clock has 32 bits, as the feature register says.
    fn controller_settings(&self) -> EscSettings {
        EscSettings {
            controller_type: 0x04,
            revision: 0x02,
            build: 0x0040,
            fmmus: 3,
            sync_managers: 4,
            ram_kib: 8,
            features: Features::CLOCK | Features::SEPARATE_CHECK_ERRORS | Features::ENHANCED_SYNC,
            pdi_control: 0x0C08,
            pdi_configuration: 0x6600,
            mailbox_bytes_min: 32,
            emergencies: false,
            ..EscSettings::default()
        }
    }

    fn step_axes(&mut self, dt_ns: Ns) {
        let from = self.axis.plant().position();
        self.read_inputs(dt_ns);
        let forced = self.probe_forced();
        let shown = self.shaft_position_now();
        self.run_modes(dt_ns);
        let to = self.axis.plant().position();
        let moved_to = if self.jammed_at.is_none() { to } else { from };
        self.probe(from, moved_to);
        self.last_step = LastStep { from, to: moved_to, ns: dt_ns, forced };
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

    fn begin_axes(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        self.step_axes(dt_ns);
        None
    }

    fn note_exchange(&mut self) {
        self.exchanged = true;
        // With SYNC0, the slave controller reports when outputs and pulses come. Without SYNC0 or without a controller,
        // both come with the exchange.
        if !self.by_sync0 || self.communication.is_none() {
            self.timing.note_outputs(self.on_ns);
        }
        if self.by_sync0 && self.communication.is_none() {
            self.timing.note_sync0(self.on_ns);
        }
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        (axis == 0).then(|| self.shaft_position_now())
    }

    fn fault_meaning(&self, _axis: usize, code: u16) -> &'static str {
        // Several alarms have the same error code. If the present alarm has this code, its meaning is returned,
        // otherwise the general meaning of the code.
        let alarm = self.alarms.present().filter(|alarm| alarm.error_code() == code);
        alarm.map_or(error_name(code), Dp3clAlarm::meaning)
    }

    fn apply_fault(&mut self, fault: Fault) -> bool {
        match fault {
            Fault::Alarm { axis: 0, fault } => match Dp3clAlarm::of_error_code(fault.code) {
                Some(alarm) => self.raise(alarm),
                None => self.axis.machine_mut().raise(fault),
            },
            Fault::AlarmCauseEnds { axis: 0 } => self.axis.machine_mut().end_cause(),
            Fault::Stick { axis: 0, input, value } => {
                for input in Input::ALL.into_iter().filter(|each| input.is_none_or(|input| input == *each)) {
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
            // [OURS] With SYNC0 on, 0x1C32:1 and 0x1C33:1 read as SYNC0 (2), whatever a master has written.
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

    fn state_changed(&mut self, from: AlState) {
        use DriveState::{OperationEnabled, QuickStopActive};
        if from == AlState::PreOp {
            self.timing = Timing::default();
        }
        if matches!(self.axis.machine().state(), OperationEnabled | QuickStopActive) {
            self.raise(Dp3clAlarm::ChangeWhileEnabled);
        }
    }

    fn refuse_request(&mut self, request: RequestedState) -> AlStatus {
        let alarm = if request == RequestedState::Boot { Dp3clAlarm::Bootstrap } else { Dp3clAlarm::UnknownState };
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

    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        Some(SYNC_LOCK_LIMIT_NS)
    }

    fn note_links(&mut self, links: [bool; PORTS]) {
        self.links = [links[0], links[1]];
    }

    fn latch_levels(&self) -> Option<u8> {
        Some(self.probe_pins().into_iter().rev().fold(0, |levels, is_on| levels << 1 | u8::from(is_on)))
    }

    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        self.tell_terminal_changes(tell);
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
        (self.timing, self.cycle_ns) = (Timing::default(), 0);
        (self.communication, self.dc, self.by_sync0) = (None, None, false);
        self.power_on_count = self.power_on_count.saturating_add(1);
        self.rewire();
        self.test_at_power_on();
        (self.seen_pins, self.last_step) = (self.probe_pins(), LastStep::default());
    }
}

impl Dp3cl {
    /// Handles a synchronization event of the slave controller. A loss of synchronization raises an alarm and lowers the AL
    /// state.
    fn synchronization(&mut self, event: SyncEvent) {
        let runs = matches!(self.base.al_state(), AlState::SafeOp | AlState::Op) && self.by_sync0;
        let alarm = match event {
            SyncEvent::InTime => {
                self.deviations = 0;
                self.timing.note_sync0(self.on_ns);
                return;
            }
            SyncEvent::Outputs { ago_ns } => {
                self.timing.note_outputs(self.on_ns.saturating_sub(ago_ns));
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
