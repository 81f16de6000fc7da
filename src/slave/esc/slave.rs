//! A slave controller with its device: the actions of the device after a frame, and when time passes.

mod cycle;
mod frames;

use super::application::{Application, Change, ProcessManagers, active_len};
use super::mailbox::Mailbox;
use super::managers::ManagerEvents;
use super::memory::copy;
use super::{Controller, DescriptionError, EscSettings, SyncPulse, eeprom_of};
use crate::ethercat::coe::Emergency;
use crate::ethercat::registers::{Features, PORTS, RequestedState, SyncActivation};
use crate::ethercat::sii::Sii;
use crate::ethercat::{AlState, Ns};
use crate::slave::{Slave, SyncEvent};

use frames::Work;

pub use cycle::ERROR_CYCLE_NS;

/// \[OURS] The cycle time of a device in free run, whose cycles neither outputs nor SYNC0 trigger, ns. Each cycle takes the
/// newest outputs and provides inputs.
pub const FREE_RUN_CYCLE_NS: Ns = 1_000_000;
/// \[OURS] The time that a device waits for the next outputs, or the next SYNC0, ns. After this time, the device runs
/// its next cycle without a trigger (free run).
pub const DRIVEN_NS: Ns = 20_000_000;
/// \[OURS] The maximum number of SYNC0 and SYNC1 pulses that one call of [`EscSlave::advance`] processes, to bound its
/// computing time. Further pulses are dropped: they set their status bits, but the device runs no cycle for them.
const PULSES_MAX: u32 = 10_000;
/// \[OURS] The capacity that is reserved for outputs, and for inputs, bytes. Only longer process data allocate, on the change
/// to SafeOP.
const PROCESS_DATA_USUAL: usize = 64;
/// A slave as the network sees it: a slave controller with a device.
///
/// Nearly every frame carries only process data, and nothing happens between frames. Then the slave is quiet: it takes a fast
/// path, which skips the AL state machine, the mailbox, the EEPROM and the timers.
#[repr(C)] // The fields that each frame uses come first, the mailbox comes last.
pub struct EscSlave {
    /// The time up to which the controller has advanced.
    now: Ns,
    /// The time up to which the device has advanced.
    stepped: Ns,
    /// The time of the device's next cycle in free run.
    free_run: Ns,
    /// The time of the last check of the device's error code. Changes of the code are reported by emergencies.
    looked: Ns,
    /// The device's error code (0x603F) at its last check.
    error_code: u16,
    /// Whether the slave is quiet: apart from frames there is nothing to do before the next free-run cycle, SYNC pulse or
    /// watchdog expiry.
    is_quiet: bool,
    /// Whether inputs of the device are also latch inputs of the controller.
    has_latches: bool,
    /// The AL state when [`Self::react`] last ran. The fast path uses it, because the state cannot change while the slave is
    /// quiet.
    quiet_state: AlState,
    /// How far the device has processed the outputs of the newest frame.
    work: Work,
    device: Box<dyn Slave>,
    /// The newest outputs, with the length of sync manager 2.
    outputs: Vec<u8>,
    /// The arrival time of outputs that no SYNC0 pulse has followed yet, to report the interval to the device.
    outputs_came: Option<Ns>,
    /// The buffer for the inputs, with the length of sync manager 3.
    inputs: Vec<u8>,
    /// The station alias of the device at its last power-on, to detect a change at the next power-on.
    station_alias: u16,
    application: Application,
    controller: Controller,
    mailbox: Mailbox,
}

impl EscSlave {
    /// A slave that is switched on at `now`, with this content of its EEPROM. The device must be in Init.
    pub fn new(device: Box<dyn Slave>, settings: EscSettings, eeprom: Vec<u8>, now: Ns) -> Self {
        let has_mailbox = Sii::new(&eeprom).is_ok_and(|sii| sii.info().protocols.0 != 0);
        let managers = ProcessManagers::of(&eeprom, has_mailbox);
        let latch_levels = device.latch_levels();
        let mut controller = Controller::new(settings, eeprom, now);
        controller.begin_latch_inputs(latch_levels.unwrap_or(0));
        Self {
            controller,
            has_latches: latch_levels.is_some(),
            station_alias: device.station_alias(),
            device,
            application: Application::new(has_mailbox, managers),
            mailbox: Mailbox::default(),
            outputs: Vec::with_capacity(PROCESS_DATA_USUAL),
            outputs_came: None,
            inputs: Vec::with_capacity(PROCESS_DATA_USUAL),
            now,
            stepped: now,
            free_run: now + FREE_RUN_CYCLE_NS,
            looked: now,
            error_code: 0,
            is_quiet: false,
            quiet_state: AlState::Init,
            work: Work::None,
        }
    }

    /// A slave that is switched on at `now`, with an EEPROM generated from its device. A device without distributed clocks
    /// gets a controller without them.
    ///
    /// # Errors
    /// [`DescriptionError`] under the same conditions as [`eeprom_of`].
    pub fn describe(mut device: Box<dyn Slave>, settings: EscSettings, now: Ns) -> Result<Self, DescriptionError> {
        let clocks = Features::CLOCK | Features::CLOCK_64_BITS;
        let features = if device.has_dc() { settings.features } else { settings.features.without(clocks) };
        let settings = EscSettings { features, ..settings };
        let eeprom = eeprom_of(&mut *device, &settings)?;
        Ok(Self::new(device, settings, eeprom, now))
    }

    /// Power-cycles the slave at `now`.
    pub fn power_on(&mut self, now: Ns) {
        self.device.restart();
        let alias = self.device.station_alias();
        // A device with a new alias writes it to the EEPROM. Otherwise the alias in the EEPROM is kept, because a
        // master may have written it.
        if std::mem::replace(&mut self.station_alias, alias) != alias {
            self.controller.store_alias(alias);
        }
        self.controller.power_on(now);
        self.mailbox.forget();
        self.controller.begin_latch_inputs(self.device.latch_levels().unwrap_or(0));
        self.application = Application::new(self.application.has_mailbox, self.application.managers);
        (self.now, self.stepped, self.looked, self.error_code) = (now, now, now, 0);
        self.free_run = now + FREE_RUN_CYCLE_NS;
        (self.is_quiet, self.work) = (false, Work::None);
        self.outputs.clear();
        self.outputs_came = None;
        self.inputs.clear();
    }

    /// The slave controller.
    pub const fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The slave controller, mutable, for access to its ports, error counters and EEPROM.
    pub const fn controller_mut(&mut self) -> &mut Controller {
        self.is_quiet = false;
        &mut self.controller
    }

    /// Sets for each port whether it has a link.
    pub fn set_links(&mut self, links: [bool; PORTS]) {
        self.controller_mut().set_links(links);
        self.device.note_links(links);
    }

    /// The device behind the slave controller.
    pub fn device(&self) -> &dyn Slave {
        &*self.device
    }

    /// Writes registers or memory for a [`Predecessor`](super::Predecessor), with all effects of a write by a master, but
    /// without a frame that other slaves or the present master could see. Returns whether any byte was written.
    pub(super) fn write_unseen(&mut self, address: u16, data: &[u8], now: Ns) -> bool {
        self.is_quiet = false;
        self.advance(now);
        self.controller.begin_frame(now);
        let is_done = self.controller.write(address.into(), data);
        self.react(now);
        is_done
    }

    /// The mailbox, mutable, in which a [`Predecessor`](super::Predecessor) leaves messages.
    pub(super) const fn mailbox_mut(&mut self) -> &mut Mailbox {
        &mut self.mailbox
    }

    /// The device, mutable, for injecting faults.
    pub fn device_mut(&mut self) -> &mut dyn Slave {
        &mut *self.device
    }

    /// The AL state that the network reads, including bootstrap.
    pub const fn shown_state(&self) -> RequestedState {
        self.application.shown_state()
    }

    /// The AL state as the device model knows it, which has no bootstrap: while AL status shows bootstrap, this is Init.
    pub fn state(&self) -> AlState {
        self.application.state()
    }

    /// Queues an emergency, which is sent as soon as the master has emptied the mailbox. If `EMERGENCIES_MAX` (8) are
    /// pending, the new one is lost.
    pub fn send_emergency(&mut self, emergency: Emergency) {
        self.mailbox.raise(emergency);
        self.react(self.controller.arrival);
    }

    /// Delays SDO responses by `ns` from the next request on; 0 ends the delay. A delayed response is put into the mailbox when
    /// the slave next advances after the delay, at most [`FREE_RUN_CYCLE_NS`] later.
    pub const fn delay_sdo(&mut self, ns: Ns) {
        self.mailbox.delay_sdo(ns);
    }

    /// Sets the round-trip times of a frame through ports 1, 2 and 3, ns; `None` for a port that frames do not leave by.
    pub(super) const fn set_returns(&mut self, returns: [Option<Ns>; PORTS - 1]) {
        self.controller.returns = returns;
        self.controller.ports_have_changed = false;
    }

    /// Whether a port was opened or closed since [`Self::set_returns`].
    pub(super) const fn ports_have_changed(&self) -> bool {
        self.controller.ports_have_changed
    }

    /// Advances the slave to `now`.
    #[inline]
    pub fn advance(&mut self, now: Ns) {
        if self.is_quiet && now < self.free_run && self.controller.is_quiet_until(now) {
            self.now = self.now.max(now);
            self.controller.advance_quietly(now);
        } else {
            self.advance_with_care(now);
        }
    }

    /// Advances the slave to `now`, and processes the events that occur until then: the slow path of [`Self::advance`].
    #[inline(never)]
    fn advance_with_care(&mut self, now: Ns) {
        let mut pulses = 0;
        while self.due() < now {
            pulses += self.run_to(self.due().max(self.now));
            if pulses > PULSES_MAX {
                self.controller.skip_pulses(now);
            }
        }
        self.run_to(now);
    }

    /// Whether the slave can become quiet: neither mailbox, AL state machine nor controller have pending work.
    fn has_become_quiet(&self) -> bool {
        let has_mailbox_work = self.mailbox.is_touched(ManagerEvents::default());
        !has_mailbox_work && !self.application.is_busy() && !self.controller.has_something_ahead()
    }

    /// Whether SYNC0 pulses trigger the cycles of the device.
    fn follows_pulses(&self) -> bool {
        self.application.is_synchronized && self.state() >= AlState::SafeOp
    }

    /// The time of the next event that occurs without a frame.
    fn due(&self) -> Ns {
        let pulse = self.controller.next_pulse(self.now).filter(|_| self.follows_pulses());
        let others = [pulse, self.controller.next_due(), self.application.due()];
        others.into_iter().flatten().fold(self.free_run, Ns::min)
    }

    /// Advances to `now`; the caller has made sure that no event occurs before that time. Returns the number of pulses
    /// processed.
    fn run_to(&mut self, now: Ns) -> u32 {
        self.now = self.now.max(now);
        self.controller.advance(now);
        let mut pulses = 0;
        while let Some(pulse) = self.controller.take_pulse() {
            pulses += 1;
            if !self.follows_pulses() {
                // The device does not run by SYNC pulses, so all due pulses are dropped.
                self.controller.skip_pulses(now);
            } else if pulse == SyncPulse::Sync0 {
                self.application.sync_came = true;
                self.cycle(now, DRIVEN_NS);
                if let Some(came) = self.outputs_came.take() {
                    self.device.report_sync(SyncEvent::Outputs { ago_ns: now.saturating_sub(came) });
                }
                self.device.report_sync(SyncEvent::InTime);
            }
            if pulses > PULSES_MAX {
                self.controller.skip_pulses(now);
            }
        }
        if now >= self.free_run {
            self.cycle(now, FREE_RUN_CYCLE_NS);
        }
        self.react(now);
        pulses
    }

    /// Handles events of the controller after a frame or when time has passed: a reset, changed sync managers, new outputs, an
    /// expired watchdog, a request for a state, and mailbox messages.
    fn react(&mut self, now: Ns) {
        let events = self.controller.take_events();
        if events.reset {
            return self.power_on(now);
        }
        let done = std::mem::take(&mut self.controller.managers.events);
        if done.activated != 0 {
            let lens = (self.outputs.len(), self.inputs.len());
            self.application.check_again(done.activated, lens, &mut self.controller, &mut *self.device);
        }
        if events.sync_changed {
            self.sync_changed();
        }
        if done.written & 1 << self.application.managers.outputs != 0 && self.take_outputs(self.state()) {
            self.cycle(now, DRIVEN_NS);
        }
        if events.watchdog {
            self.watchdog_expired();
        }
        if events.al_control {
            let due = now + self.controller.settings().state_change_ns;
            self.application.request(self.controller.al_control(), due);
        }
        let mut change = Change::None;
        if self.application.is_busy() {
            change = self.application.advance(now, &mut self.controller, &mut *self.device);
            self.begin(change, now);
        }
        let is_on = self.state() > AlState::Init || self.application.is_in_bootstrap();
        let has_mailbox = self.application.has_mailbox && is_on;
        if has_mailbox && (self.mailbox.is_touched(done) || change == Change::MailboxOn) {
            let Controller { managers, memory, .. } = &mut self.controller;
            self.mailbox.serve(now, done, managers, memory, &mut *self.device);
        }
        self.is_quiet = self.has_become_quiet();
        self.controller.look_for_pulse();
        self.quiet_state = self.state();
    }

    /// Starts the mailbox or process data after a change of state.
    fn begin(&mut self, change: Change, now: Ns) {
        let managers = self.application.managers;
        let len = |n: u8| usize::from(active_len(&self.controller.managers.registers(n)));
        match change {
            Change::None => {}
            Change::MailboxOn => {
                let (requests, answers) = (len(super::mailbox::REQUESTS), len(super::mailbox::ANSWERS));
                self.mailbox.reset(requests, answers, self.application.is_in_bootstrap());
                self.error_code = 0;
            }
            Change::ProcessDataOn => {
                let (outputs, inputs) = (len(managers.outputs), len(managers.inputs));
                self.outputs.clear();
                self.outputs.resize(outputs, 0);
                self.inputs.clear();
                self.inputs.resize(inputs, 0);
                self.cycle(now, FREE_RUN_CYCLE_NS);
            }
        }
    }

    /// Copies written outputs from their sync manager to `outputs`. Returns whether the device runs a cycle with them now,
    /// because SYNC0 does not trigger its cycles.
    #[inline]
    fn take_outputs(&mut self, state: AlState) -> bool {
        if state < AlState::SafeOp {
            return false;
        }
        let Controller { managers, memory, .. } = &mut self.controller;
        let Some(outputs) = managers.take(self.application.managers.outputs, memory) else { return false };
        let len = outputs.len().min(self.outputs.len());
        copy(&mut self.outputs[..len], &outputs[..len]);
        self.application.outputs_came = true;
        self.outputs_came = Some(self.controller.arrival);
        !self.application.is_synchronized
    }

    /// Handles an expired process data watchdog: it has an effect only in SafeOP and OP, and only on a slave with
    /// outputs.
    fn watchdog_expired(&mut self) {
        if self.state() >= AlState::SafeOp && !self.outputs.is_empty() {
            self.application.lose_outputs(&mut self.controller, &mut *self.device);
        }
    }

    /// Handles the activation or deactivation of the SYNC unit: a slave that runs by SYNC0 in SafeOP or OP has lost SYNC0 if
    /// the unit is now off.
    fn sync_changed(&mut self) {
        let is_running = self.controller.sync_activation().contains(SyncActivation::ACTIVATE);
        if self.state() >= AlState::SafeOp && self.application.is_synchronized && !is_running {
            self.application.lose_sync(&mut self.controller, &mut *self.device);
        }
    }
}
