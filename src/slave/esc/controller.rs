//! The controller of a slave without its device: registers, RAM, and what an access to them does.

mod accesses;
mod ports;
mod protection;

use super::EscSettings;
use super::clock::{Clock, FILTERS, SPEED_START};
use super::eeprom::Eeprom;
use super::fmmus::{FMMUS_MAX, Fmmus};
use super::latch_unit;
use super::managers::Managers;
use super::memory::Memory;
use super::sync_unit::{SyncPulse, SyncUnit};
use super::watchdog::Watchdog;
use crate::ethercat::registers::{
    self, AL_CONTROL, AL_EVENT, AL_STATUS, AL_STATUS_CODE, AlControl, AlEvents, AlStatusRegister, DL_CONTROL,
    DL_STATUS, DlControl, DlStatus, ECAT_EVENT, EcatEvents, LoopControl, PORTS, SmStatus, SyncActivation,
};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::slave::{Communication, SyncManagerSettings};

use protection::Protection;

/// What has happened to a controller since its device looked.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ControllerEvents {
    /// AL control was written.
    pub(super) al_control: bool,
    /// The watchdog of process data has expired.
    pub(super) watchdog: bool,
    /// The unit for SYNC was switched on or off.
    pub(super) sync_changed: bool,
    /// The controller was reset.
    pub(super) reset: bool,
}

/// A slave controller (ESC): what the network can read and write, without a device.
#[derive(Clone, Debug)]
#[repr(C)] // What each frame uses lies side by side, first.
pub struct Controller {
    /// When the newest frame has come.
    pub(super) arrival: Ns,
    pub(super) watchdog: Watchdog,
    clock: Clock,
    pub(super) events: ControllerEvents,
    /// Registers were written.
    pub(super) is_set_anew: bool,
    /// Before then no pulse comes.
    without_pulse: Ns,
    /// Another port has been opened or closed since the way of frames was found.
    pub(super) ports_have_changed: bool,
    /// The mask of the events for the master, as in the memory.
    event_mask: u16,
    protection: Protection,
    pub(super) memory: Memory,
    pub(super) fmmus: Fmmus,
    pub(super) managers: Managers,
    pub(super) sync: SyncUnit,
    pub(super) eeprom: Eeprom,
    settings: EscSettings,
    /// How long after a frame has come it is back at ports 1, 2 and 3, if it leaves by them, ns.
    pub(super) returns: [Option<Ns>; PORTS - 1],
    /// Which ports have a link.
    links: [bool; PORTS],
    /// Which ports with the loop control "auto close" are open.
    opened: [bool; PORTS],
    /// Which ports are open.
    open: [bool; PORTS],
    /// Bits 8 to 15 of DL control as they are when they are not for a second alone, and when that second ends.
    permanent_loops: u8,
    temporary_until: Option<Ns>,
    /// How many bytes of the reset sequence have come.
    reset_progress: usize,
    /// Room for the bytes of a datagram while they are combined.
    pub(super) scratch: Vec<u8>,
}

impl Controller {
    /// A controller that is switched on at `now`, with the content of its EEPROM.
    pub fn new(settings: EscSettings, eeprom: Vec<u8>, now: Ns) -> Self {
        let mut controller = Self {
            memory: Memory::new(&settings),
            fmmus: Fmmus::default(),
            managers: Managers::new(settings.sync_managers),
            eeprom: Eeprom::new(eeprom, &settings),
            watchdog: Watchdog::default(),
            clock: Clock::new(now, settings.local_time_ns, settings.drift_ppb),
            sync: SyncUnit::default(),
            events: ControllerEvents::default(),
            is_set_anew: true,
            without_pulse: 0,
            ports_have_changed: true,
            event_mask: 0,
            protection: Protection::default(),
            arrival: now,
            returns: [None; PORTS - 1],
            links: [false; PORTS],
            opened: [true; PORTS],
            open: [false; PORTS],
            permanent_loops: 0,
            temporary_until: None,
            reset_progress: 0,
            scratch: Vec::with_capacity(2048),
            settings,
        };
        controller.power_on(now);
        controller
    }

    /// Switches the controller off and on again: everything but its EEPROM and its cables is as new.
    pub fn power_on(&mut self, now: Ns) {
        self.memory.clear();
        self.fmmus = Fmmus::default();
        self.event_mask = 0;
        self.protection = Protection::default();
        self.managers = Managers::new(self.settings.sync_managers);
        self.clock = Clock::new(now, self.settings.local_time_ns, self.settings.drift_ppb);
        self.sync = SyncUnit::default();
        self.events = ControllerEvents::default();
        self.is_set_anew = true;
        self.reset_progress = 0;
        self.opened = [true; PORTS];
        let settings = &self.settings;
        let memory = &mut self.memory;
        memory.set_u8(registers::TYPE, settings.controller_type);
        memory.set_u8(registers::REVISION, settings.revision);
        memory.set_u16(registers::BUILD, settings.build);
        memory.set_u8(registers::FMMUS, settings.fmmus.min(FMMUS_MAX as u8));
        memory.set_u8(registers::SYNC_MANAGERS, self.managers.count());
        memory.set_u8(registers::RAM_SIZE, settings.ram_kib.clamp(1, 60));
        let ports = settings.ports.iter().rev().fold(0, |byte, port| byte << 2 | port & 0b11);
        memory.set_u8(registers::PORT_DESCRIPTOR, ports);
        memory.set_u16(registers::FEATURES, settings.features.0);
        // A port that is there decides by itself.
        let exists = |port: &usize| settings.ports[*port] >= 2;
        let auto = |control: DlControl, port| control.with_loop(port, LoopControl::Auto);
        let control = (0..PORTS).filter(exists).fold(DlControl::POWER_ON, auto);
        memory.set_u32(DL_CONTROL, control.0);
        (self.permanent_loops, self.temporary_until) = (memory.u8(DL_CONTROL + 1), None);
        memory.set_u16(AL_CONTROL, AlState::Init as u16);
        memory.set_u16(AL_STATUS, AlState::Init as u16);
        memory.set_u32(registers::AL_EVENT_MASK, 0x00FF_FF0F);
        self.watchdog = Watchdog::power_on(settings.fixed_watchdog_divider, memory);
        if self.has_clock() {
            self.memory.set_u16(registers::SPEED_COUNTER_START, SPEED_START);
            self.memory.put(registers::TIME_DIFFERENCE_FILTER, &FILTERS);
        }
        self.load_words(true);
        self.show_links();
        self.memory.set_u16(ECAT_EVENT, EcatEvents::DL_STATUS.0);
    }

    /// Loads the first words of the EEPROM. The alias is loaded at power-on alone.
    fn load_words(&mut self, at_power_on: bool) {
        let info = self.eeprom.load(&mut self.memory);
        if let Some(info) = info {
            self.memory.set_u16(registers::PDI_CONTROL, info.pdi_control);
            self.memory.set_u16(registers::PDI_CONFIGURATION, info.pdi_configuration);
            self.memory.set_u16(registers::PDI_CONFIGURATION + 2, info.extended_pdi_configuration);
            if self.has_clock() {
                self.memory.set_u16(registers::SYNC_PULSE_LENGTH, info.sync_pulse_length);
            }
            if at_power_on {
                self.memory.set_u16(registers::STATION_ALIAS, info.alias);
            }
        }
        let status = self.memory.u16(DL_STATUS) & !DlStatus::SII_LOADED;
        let loaded = if info.is_some() { DlStatus::SII_LOADED } else { 0 };
        self.memory.set_u16(DL_STATUS, status | loaded);
    }

    fn has_clock(&self) -> bool {
        self.settings.features.contains(registers::Features::CLOCK)
    }

    /// The settings of the controller.
    pub const fn settings(&self) -> &EscSettings {
        &self.settings
    }

    /// The content of the EEPROM.
    pub fn eeprom(&self) -> &[u8] {
        self.eeprom.content()
    }

    /// Whether nothing may be written in this frame.
    #[inline]
    pub(super) const fn is_write_protected(&self) -> bool {
        self.protection.blocks_all()
    }

    /// A frame comes.
    #[inline]
    pub(super) fn begin_frame(&mut self, arrival: Ns) {
        self.arrival = arrival;
        self.protection.begin_frame();
    }

    /// Puts a station alias into the EEPROM, from where it is loaded at the next power-on.
    pub(super) fn store_alias(&mut self, alias: u16) {
        self.eeprom.store_alias(alias);
    }

    /// Bytes of the memory as they stand there, without any effect. Clocks and the states of sync managers show what was read last.
    pub fn peek(&self, address: u16, len: usize) -> &[u8] {
        self.memory.slice(address.into(), len)
    }

    /// A frame came in at a port with a wrong check sequence.
    pub fn note_invalid_frame(&mut self, port: usize) {
        self.memory.count(registers::RX_ERRORS + 2 * port as u16);
    }

    /// A frame came in at a port that another slave has marked: its check sequence was wrong there.
    pub fn note_forwarded_error(&mut self, port: usize) {
        self.memory.count(registers::FORWARDED_ERRORS + port as u16);
    }

    /// A frame came whose datagrams do not fit into it.
    pub fn note_wrong_structure(&mut self) {
        self.memory.count(registers::PROCESSING_UNIT_ERRORS);
    }

    fn raise(&mut self, events: EcatEvents) {
        let raised = EcatEvents(self.memory.u16(ECAT_EVENT)) | events;
        self.memory.set_u16(ECAT_EVENT, raised.0);
    }

    fn drop_events(&mut self, events: EcatEvents) {
        let left = EcatEvents(self.memory.u16(ECAT_EVENT)).without(events);
        self.memory.set_u16(ECAT_EVENT, left.0);
    }

    /// The events that the controller adds to each datagram.
    pub(super) fn masked_events(&self) -> u16 {
        match self.event_mask {
            0 => 0,
            mask => mask & (self.memory.u16(ECAT_EVENT) | self.manager_events()),
        }
    }

    /// The bits of the sync managers in the events for the master.
    fn manager_events(&self) -> u16 {
        let mut events = EcatEvents::NONE;
        for n in 0..self.managers.count().min(8) {
            let manager = self.managers.registers(n);
            let bit = match manager.control.direction() {
                registers::SmDirection::Read => SmStatus::WRITTEN,
                _ => SmStatus::READ,
            };
            if manager.is_enabled() && manager.status.contains(bit) {
                events = events | EcatEvents::sync_manager(n);
            }
        }
        events.0
    }

    /// Time passes up to `now`: the clock, the EEPROM and the watchdog go on.
    pub fn advance(&mut self, now: Ns) {
        self.clock.advance(now);
        if self.eeprom.advance(now, &mut self.memory) {
            self.load_words(false);
        }
        if self.watchdog.advance(now, &mut self.memory) {
            self.events.watchdog = true;
            self.raise_for_device(AlEvents::WATCHDOG);
        }
        if self.temporary_until.take_if(|due| *due <= now).is_some() {
            self.end_temporary_loops();
        }
    }

    /// Time passes up to `now`, before which the controller does nothing by itself.
    #[inline]
    pub(super) fn advance_quietly(&mut self, now: Ns) {
        self.clock.advance(now);
    }

    /// Whether nothing but frames does anything up to `now`, if [nothing is ahead](Self::has_something_ahead) and pulses were
    /// [looked for](Self::look_for_pulse).
    #[inline]
    pub(super) fn is_quiet_until(&self, now: Ns) -> bool {
        now < self.without_pulse && self.watchdog.due().is_none_or(|due| now < due)
    }

    /// Whether something other than the watchdog and pulses happens by itself sooner or later: a command for the EEPROM is done, or
    /// ports are as before.
    pub(super) fn has_something_ahead(&self) -> bool {
        self.eeprom.due().is_some() || self.temporary_until.is_some()
    }

    /// Finds out before when no pulse comes, whatever frames do to the clock that [leaves the device quiet](Self::is_set_anew).
    pub(super) fn look_for_pulse(&mut self) {
        self.without_pulse = self.until_pulse().map_or(Ns::MAX, |left| self.clock.soonest(left));
    }

    /// How much time of the clock is left until the next pulse, ns; 0 if it has come.
    fn until_pulse(&self) -> Option<u64> {
        let (at, _) = self.sync.next()?;
        Some(at.wrapping_sub(self.clock.system()).cast_signed().max(0).unsigned_abs())
    }

    /// Whether a frame has written registers that make the device do something, or that change when something happens next.
    #[inline]
    pub(super) const fn is_set_anew(&self) -> bool {
        self.is_set_anew
    }

    fn raise_for_device(&mut self, events: AlEvents) {
        let raised = AlEvents(self.memory.u32(AL_EVENT)) | events;
        self.memory.set_u32(AL_EVENT, raised.0);
    }

    fn drop_for_device(&mut self, events: AlEvents) {
        let left = AlEvents(self.memory.u32(AL_EVENT)).without(events);
        self.memory.set_u32(AL_EVENT, left.0);
    }

    /// When the watchdog expires, the EEPROM is done or ports are as before next. `None`: nothing of that is to come.
    pub(super) fn next_due(&self) -> Option<Ns> {
        [self.watchdog.due(), self.eeprom.due(), self.temporary_until].into_iter().flatten().min()
    }

    /// When the next pulse comes, as far as the clock can tell.
    pub(super) fn next_pulse(&self, now: Ns) -> Option<Ns> {
        Some(now + self.until_pulse()?)
    }

    /// Lets the pulses that have come by `now` pass in one go.
    pub(super) fn skip_pulses(&mut self, now: Ns) {
        self.clock.advance(now);
        let skipped = self.sync.skip_to(self.clock.system());
        for (_, pulse) in skipped.into_iter().zip([SyncPulse::Sync0, SyncPulse::Sync1]).filter(|(came, _)| *came) {
            self.show_pulse(pulse);
        }
    }

    /// The next pulse that has come by now.
    pub(super) fn take_pulse(&mut self) -> Option<SyncPulse> {
        let (_, pulse) = self.sync.take(self.clock.system())?;
        self.show_pulse(pulse);
        Some(pulse)
    }

    fn show_pulse(&mut self, pulse: SyncPulse) {
        let (event, status) = match pulse {
            SyncPulse::Sync0 => (AlEvents::SYNC0, registers::SYNC0_STATUS),
            SyncPulse::Sync1 => (AlEvents::SYNC1, registers::SYNC1_STATUS),
        };
        self.raise_for_device(event);
        self.memory.set_u8(status, 1);
    }

    /// Takes the events for the device.
    pub(super) fn take_events(&mut self) -> ControllerEvents {
        let events = std::mem::take(&mut self.events);
        self.is_set_anew = false;
        if events.al_control {
            self.drop_for_device(AlEvents::AL_CONTROL);
        }
        if self.managers.events.activated != 0 {
            self.drop_for_device(AlEvents::SM_ACTIVATION);
        }
        events
    }

    /// AL control as the master has written it.
    pub(super) fn al_control(&self) -> AlControl {
        AlControl(self.memory.u16(AL_CONTROL))
    }

    /// Shows the device's AL status and its code, the code first.
    pub(super) fn set_al_status(&mut self, status: AlStatusRegister, code: AlStatus) {
        self.memory.set_u16(AL_STATUS_CODE, code.0);
        self.memory.set_u16(AL_STATUS, status.0);
        self.raise(EcatEvents::AL_STATUS);
    }

    /// Whether the EEPROM says that AL status copies AL control.
    pub(super) fn is_device_emulated(&self) -> bool {
        self.memory.u8(registers::ESC_CONFIGURATION) & 1 != 0
    }

    /// The unit for SYNC: what is activated.
    pub(super) fn sync_activation(&self) -> SyncActivation {
        if self.has_clock() { SyncActivation(self.memory.u8(registers::SYNC_ACTIVATION)) } else { SyncActivation::NONE }
    }

    /// What the device reads of the registers before a change of state.
    pub(super) fn communication(&self) -> Communication {
        let settings = |n| {
            let manager = self.managers.registers(n);
            SyncManagerSettings {
                start: manager.start,
                length: manager.len,
                control: manager.control.0,
                enabled: manager.is_enabled(),
            }
        };
        Communication {
            sync_managers: [0, 1, 2, 3].map(settings),
            watchdog_ns: Watchdog::time(&self.memory),
            dc_activation: self.sync_activation().0,
            sync0_cycle_ns: self.sync0_cycle_ns(),
        }
    }

    /// The cycle of SYNC0, ns.
    pub(super) fn sync0_cycle_ns(&self) -> u32 {
        self.memory.u32(registers::SYNC0_CYCLE)
    }

    /// A latch input, from 0 to one less than [`LATCHES`](registers::LATCHES), has that level from the time `at` of the network on,
    /// which is not much earlier or later than that of the newest frame. A level that it has already changes nothing; nor does an
    /// input that there is not, or a controller without distributed clocks.
    pub fn set_latch_input(&mut self, input: usize, is_on: bool, at: Ns) {
        if self.has_clock() && input < registers::LATCHES {
            latch_unit::set_level(input, is_on, at, &self.clock, &mut self.memory);
        }
    }

    /// The levels of the latch inputs at power-on, bit 0 that of input 0.
    pub(super) fn begin_latch_inputs(&mut self, levels: u8) {
        if self.has_clock() {
            latch_unit::set_levels(levels, &mut self.memory);
        }
    }

    /// Bytes that no master writes, or that are written without any effect: the RAM, and the station alias.
    pub(super) fn fill(&mut self, address: u16, data: &[u8]) {
        let room = self.memory.end().saturating_sub(address.into());
        self.memory.put(address, &data[..data.len().min(room)]);
    }

    /// The slave's own controller takes the EEPROM, or gives it back.
    pub fn take_eeprom(&mut self, takes: bool) {
        self.memory.set_u8(registers::SII_PDI_ACCESS, takes.into());
    }

    /// The system time as the slave's own controller reads it, ns.
    pub const fn system_time_ns(&self) -> u64 {
        self.clock.system()
    }
}
