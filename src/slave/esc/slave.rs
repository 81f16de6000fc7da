//! A controller with its device: what the device does after a frame has passed, and while time passes.

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

/// \[OURS] How often a device works that neither outputs nor SYNC0 drive, ns. It takes its newest outputs then, too.
pub const FREE_RUN_CYCLE_NS: Ns = 1_000_000;
/// \[OURS] How long after outputs, or after SYNC0, a device waits for the next ones before it works by itself, ns.
pub const DRIVEN_NS: Ns = 20_000_000;
/// \[OURS] How many pulses of SYNC0 and SYNC1 a device follows in one go; others are left out.
const PULSES_MAX: u32 = 10_000;
/// \[OURS] For how many bytes of outputs, and of inputs, there is room before more needs memory.
const PROCESS_DATA_USUAL: usize = 64;
/// A slave as the network sees it: a controller, and a device behind it.
///
/// Nearly every frame brings process data and nothing else, and between frames nothing happens: the slave is quiet then, and
/// does only what it has to.
#[repr(C)] // What each frame uses lies side by side, first; the mailbox last.
pub struct EscSlave {
    /// Up to when time has passed in the controller.
    now: Ns,
    /// Up to when it has passed in the device.
    stepped: Ns,
    /// When the device works next by itself.
    free_run: Ns,
    /// When the device looked for errors.
    looked: Ns,
    /// The code of the error that it saw then.
    error_code: u16,
    /// There is nothing to do before the device works by itself, a pulse comes or a watchdog expires, but what frames bring.
    is_quiet: bool,
    /// The device is connected to latch inputs of the controller.
    has_latches: bool,
    /// The AL state, while the slave is quiet.
    quiet_state: AlState,
    /// How far the device is with the outputs of the newest frame.
    work: Work,
    device: Box<dyn Slave>,
    /// The newest outputs, as long as sync manager 2.
    outputs: Vec<u8>,
    /// When outputs came that no pulse of SYNC0 has followed yet.
    outputs_came: Option<Ns>,
    /// Room for the inputs, as long as sync manager 3.
    inputs: Vec<u8>,
    /// The station alias of the device at its last power-on.
    station_alias: u16,
    application: Application,
    controller: Controller,
    mailbox: Mailbox,
}

impl EscSlave {
    /// A slave that is switched on at `now`, with the content of its EEPROM. The device has to be in Init.
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

    /// A slave that is switched on at `now`, with the EEPROM that its device describes. A device without distributed clocks has
    /// a controller without them.
    ///
    /// # Errors
    /// [`DescriptionError`].
    pub fn describe(mut device: Box<dyn Slave>, settings: EscSettings, now: Ns) -> Result<Self, DescriptionError> {
        let clocks = Features::CLOCK | Features::CLOCK_64_BITS;
        let features = if device.has_dc() { settings.features } else { settings.features.without(clocks) };
        let settings = EscSettings { features, ..settings };
        let eeprom = eeprom_of(&mut *device, &settings)?;
        Ok(Self::new(device, settings, eeprom, now))
    }

    /// Switches the slave off and on again.
    pub fn power_on(&mut self, now: Ns) {
        self.device.restart();
        let alias = self.device.station_alias();
        // A device that was given another alias writes it to the EEPROM, in which a master may have put one meanwhile.
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

    /// The controller.
    pub const fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The controller, for its ports, its error counters and its EEPROM.
    pub const fn controller_mut(&mut self) -> &mut Controller {
        self.is_quiet = false;
        &mut self.controller
    }

    /// Sets which ports have a link.
    pub fn set_links(&mut self, links: [bool; PORTS]) {
        self.controller_mut().set_links(links);
        self.device.note_links(links);
    }

    /// The device.
    pub fn device(&self) -> &dyn Slave {
        &*self.device
    }

    /// Another master writes to the slave, in a frame that is seen nowhere else. Whether any byte was written.
    pub(super) fn write_unseen(&mut self, address: u16, data: &[u8], now: Ns) -> bool {
        self.is_quiet = false;
        self.advance(now);
        self.controller.begin_frame(now);
        let is_done = self.controller.write(address.into(), data);
        self.react(now);
        is_done
    }

    /// The mailbox, to leave something in it.
    pub(super) const fn mailbox_mut(&mut self) -> &mut Mailbox {
        &mut self.mailbox
    }

    /// The device, to cause faults in it.
    pub fn device_mut(&mut self) -> &mut dyn Slave {
        &mut *self.device
    }

    /// The AL state that the network reads, bootstrap too.
    pub const fn shown_state(&self) -> RequestedState {
        self.application.shown_state()
    }

    /// The AL state of the device. In bootstrap it stands in Init.
    pub fn state(&self) -> AlState {
        self.application.state()
    }

    /// Sends an emergency as soon as the mailbox has room for it.
    pub fn send_emergency(&mut self, emergency: Emergency) {
        self.mailbox.raise(emergency);
        self.react(self.controller.arrival);
    }

    /// Makes SDOs take that much longer from the next one on; 0: no longer than they do. Answers come with the next step of
    /// time, [`FREE_RUN_CYCLE_NS`] later at most.
    pub const fn delay_sdo(&mut self, ns: Ns) {
        self.mailbox.delay_sdo(ns);
    }

    /// Tells how long after a frame has come it is back at ports 1, 2 and 3, if it leaves by them, ns.
    pub(super) const fn set_returns(&mut self, returns: [Option<Ns>; PORTS - 1]) {
        self.controller.returns = returns;
        self.controller.ports_have_changed = false;
    }

    /// Whether a port was opened or closed since [`Self::set_returns`].
    pub(super) const fn ports_have_changed(&self) -> bool {
        self.controller.ports_have_changed
    }

    /// Time passes up to `now`.
    #[inline]
    pub fn advance(&mut self, now: Ns) {
        if self.is_quiet && now < self.free_run && self.controller.is_quiet_until(now) {
            self.now = self.now.max(now);
            self.controller.advance_quietly(now);
        } else {
            self.advance_with_care(now);
        }
    }

    /// Time passes up to `now`, and things happen in the meantime.
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

    /// Whether there is nothing to do before the device works by itself, a pulse comes or a watchdog expires, but what frames bring.
    fn has_become_quiet(&self) -> bool {
        let has_mailbox_work = self.mailbox.is_touched(ManagerEvents::default());
        !has_mailbox_work && !self.application.is_busy() && !self.controller.has_something_ahead()
    }

    /// Whether the device works at the pulses of SYNC0.
    fn follows_pulses(&self) -> bool {
        self.application.is_synchronized && self.state() >= AlState::SafeOp
    }

    /// When something happens next without a frame.
    fn due(&self) -> Ns {
        let pulse = self.controller.next_pulse(self.now).filter(|_| self.follows_pulses());
        let others = [pulse, self.controller.next_due(), self.application.due()];
        others.into_iter().flatten().fold(self.free_run, Ns::min)
    }

    /// Time passes up to `now`, before which nothing happens. How many pulses have come.
    fn run_to(&mut self, now: Ns) -> u32 {
        self.now = self.now.max(now);
        self.controller.advance(now);
        let mut pulses = 0;
        while let Some(pulse) = self.controller.take_pulse() {
            pulses += 1;
            if !self.follows_pulses() {
                // Nobody looks at each of them.
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

    /// What the device does at once, after a frame or when time has passed.
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

    /// The state has changed to one with a mailbox or with process data.
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

    /// Takes the outputs that were written. Whether the device works on them now, since nothing else drives it.
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

    /// No outputs have come for too long.
    fn watchdog_expired(&mut self) {
        if self.state() >= AlState::SafeOp && !self.outputs.is_empty() {
            self.application.lose_outputs(&mut self.controller, &mut *self.device);
        }
    }

    /// The unit for SYNC was switched on or off.
    fn sync_changed(&mut self) {
        let is_running = self.controller.sync_activation().contains(SyncActivation::ACTIVATE);
        if self.state() >= AlState::SafeOp && self.application.is_synchronized && !is_running {
            self.application.lose_sync(&mut self.controller, &mut *self.device);
        }
    }
}
