//! The slave controller without its device: registers, RAM, and the effects of accesses to them.

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

/// Events of a slave controller that its device has not handled yet.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ControllerEvents {
    /// The master has written AL control.
    pub(super) al_control: bool,
    /// The process data watchdog has expired.
    pub(super) watchdog: bool,
    /// The SYNC unit was activated or deactivated.
    pub(super) sync_changed: bool,
    /// The master has reset the controller by the reset sequence, register 0x0040.
    pub(super) reset: bool,
}

/// A slave controller (ESC): the memory that the network reads and writes, without a device.
#[derive(Clone, Debug)]
#[repr(C)] // The fields that each frame uses are adjacent, at the beginning.
pub struct Controller {
    /// The arrival time of the newest frame, ns of simulated time.
    pub(super) arrival: Ns,
    /// The arrival time of the frame before that one.
    arrival_before: Ns,
    pub(super) watchdog: Watchdog,
    clock: Clock,
    pub(super) events: ControllerEvents,
    /// Whether a frame has written registers that trigger an action of the device, or that change the time of the next timer
    /// event or SYNC pulse.
    pub(super) is_set_anew: bool,
    /// The simulated time before which no SYNC pulse comes, ns; [`Self::look_for_pulse`] computes it.
    without_pulse: Ns,
    /// Whether a port has been opened or closed since the route of frames was computed.
    pub(super) ports_have_changed: bool,
    /// The mask of the events for the master, a copy of register 0x0200.
    event_mask: u16,
    protection: Protection,
    pub(super) memory: Memory,
    pub(super) fmmus: Fmmus,
    pub(super) managers: Managers,
    pub(super) sync: SyncUnit,
    pub(super) eeprom: Eeprom,
    settings: EscSettings,
    /// The round-trip time of a frame through ports 1, 2 and 3, from its arrival at the slave, ns; `None` for a port that
    /// frames do not leave by.
    pub(super) returns: [Option<Ns>; PORTS - 1],
    /// Whether each port has a link.
    links: [bool; PORTS],
    /// For the loop setting "auto close": whether each port may open. A lost link clears this; a write to DL control
    /// sets it again if the port has a link.
    opened: [bool; PORTS],
    /// Whether each port is open, so that frames leave by it.
    open: [bool; PORTS],
    /// The permanent loop settings (bits 8 to 15 of DL control), and the time when temporary ones end; `None` if no
    /// temporary settings are active.
    permanent_loops: u8,
    temporary_until: Option<Ns>,
    /// Whether the device has not read AL control since the master has written it. Until then the controller refuses
    /// further writes to AL control.
    is_al_control_unread: bool,
    /// The number of bytes of the reset sequence, `RES` to register 0x0040, received so far.
    reset_progress: usize,
    /// A reusable buffer for combining the data of a datagram with data of the memory.
    pub(super) scratch: Vec<u8>,
}

impl Controller {
    /// A controller that is switched on at `now`, with this content of the EEPROM.
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
            arrival_before: now,
            returns: [None; PORTS - 1],
            links: [false; PORTS],
            opened: [true; PORTS],
            open: [false; PORTS],
            permanent_loops: 0,
            temporary_until: None,
            is_al_control_unread: false,
            reset_progress: 0,
            scratch: Vec::with_capacity(2048),
            settings,
        };
        controller.power_on(now);
        controller
    }

    /// Power-cycles the controller: everything except the EEPROM and the cables is reset.
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
        self.is_al_control_unread = false;
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
        // Existing ports start with the loop setting "auto": open while they have a link.
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

    /// Loads the configuration words of the EEPROM. The alias is loaded only at power-on.
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

    /// The value of a time in a register of 8 bytes: with a clock of 32 bits, the upper half is 0.
    fn shown_time(&self, time: u64) -> u64 {
        if self.has_long_clock() { time } else { u64::from(time as u32) }
    }

    fn has_long_clock(&self) -> bool {
        self.settings.features.contains(registers::Features::CLOCK_64_BITS)
    }

    /// The settings of the controller.
    pub const fn settings(&self) -> &EscSettings {
        &self.settings
    }

    /// The content of the EEPROM.
    pub fn eeprom(&self) -> &[u8] {
        self.eeprom.content()
    }

    /// Whether write protection blocks all writes of the present frame.
    #[inline]
    pub(super) const fn is_write_protected(&self) -> bool {
        self.protection.blocks_all()
    }

    /// Begins a frame that arrives at time `arrival`. If the previous frame has enabled writing despite write
    /// protection, the protection is active again.
    #[inline]
    pub(super) fn begin_frame(&mut self, arrival: Ns) {
        self.arrival_before = std::mem::replace(&mut self.arrival, arrival);
        self.protection.begin_frame();
    }

    /// Stores a station alias in the EEPROM. It is loaded at the next power-on.
    pub(super) fn store_alias(&mut self, alias: u16) {
        self.eeprom.store_alias(alias);
    }

    /// Reads bytes of the memory without side effects. Clocks and sync manager states have the values of their last access.
    pub fn peek(&self, address: u16, len: usize) -> &[u8] {
        self.memory.slice(address.into(), len)
    }

    /// Counts a frame with a wrong check sequence that came in at a port.
    pub fn note_invalid_frame(&mut self, port: usize) {
        self.memory.count(registers::RX_ERRORS + 2 * port as u16);
    }

    /// Counts a damaged frame that came in at a port and that an earlier slave has already counted and marked.
    pub fn note_forwarded_error(&mut self, port: usize) {
        self.memory.count(registers::FORWARDED_ERRORS + port as u16);
    }

    /// Counts a frame whose datagrams are longer than the frame.
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

    /// The ECAT event bits (register 0x0210, masked by 0x0200) that the controller ORs into the event field (IRQ) of each
    /// datagram.
    pub(super) fn masked_events(&self) -> u16 {
        match self.event_mask {
            0 => 0,
            mask => mask & (self.memory.u16(ECAT_EVENT) | self.manager_events()),
        }
    }

    /// The ECAT event bits of the sync managers: a bit is set if the slave has written a buffer for the master, or has
    /// read a buffer that the master has written.
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

    /// Advances the clock, the EEPROM, the watchdog and temporary loop settings to `now`.
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

    /// Advances only the clock to `now`. The caller has made sure that no timer event and no SYNC pulse is due up to then.
    #[inline]
    pub(super) fn advance_quietly(&mut self, now: Ns) {
        self.clock.advance(now);
    }

    /// Whether no timer event and no SYNC pulse occurs up to `now`. The answer is wrong if [an EEPROM command or a temporary
    /// loop is pending](Self::has_something_ahead), or before [`Self::look_for_pulse`] was called.
    #[inline]
    pub(super) fn is_quiet_until(&self, now: Ns) -> bool {
        now < self.without_pulse && self.watchdog.due().is_none_or(|due| now < due)
    }

    /// Whether an event other than the watchdog and SYNC pulses is pending: the end of an EEPROM command or of temporary
    /// loop settings.
    pub(super) fn has_something_ahead(&self) -> bool {
        self.eeprom.due().is_some() || self.temporary_until.is_some()
    }

    /// Computes a time before which no SYNC pulse comes, whatever clock corrections frames bring. It is valid until a
    /// frame writes [registers that change the time of the next pulse](Self::is_set_anew).
    pub(super) fn look_for_pulse(&mut self) {
        self.without_pulse = self.until_pulse().map_or(Ns::MAX, |left| self.clock.soonest(left));
    }

    /// The clock time until the next SYNC pulse, ns; 0 if it is due. `None` if no pulse is scheduled.
    fn until_pulse(&self) -> Option<u64> {
        let (at, _) = self.sync.next()?;
        Some(at.wrapping_sub(self.clock.system()).cast_signed().max(0).unsigned_abs())
    }

    /// Whether a frame has written registers that trigger an action of the device, or that change the time of the next timer
    /// event or SYNC pulse.
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

    /// The time of the next event of watchdog, EEPROM or temporary loop settings; `None` if none is pending.
    pub(super) fn next_due(&self) -> Option<Ns> {
        [self.watchdog.due(), self.eeprom.due(), self.temporary_until].into_iter().flatten().min()
    }

    /// The simulated time of the next SYNC pulse, as estimated by the clock; `None` if no pulse is scheduled.
    pub(super) fn next_pulse(&self, now: Ns) -> Option<Ns> {
        Some(now + self.until_pulse()?)
    }

    /// Drops all SYNC pulses up to `now` at once, without calling the device for each one. Their status and event bits are set.
    pub(super) fn skip_pulses(&mut self, now: Ns) {
        self.clock.advance(now);
        let skipped = self.sync.skip_to(self.clock.system());
        for (_, pulse) in skipped.into_iter().zip([SyncPulse::Sync0, SyncPulse::Sync1]).filter(|(came, _)| *came) {
            self.show_pulse(pulse);
        }
    }

    /// Takes the next SYNC pulse if it is due, and sets its status and event bits.
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

    /// Takes the pending events for the device, and clears the bits of a written AL control and of changed sync managers in the
    /// AL event register.
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

    /// The value of AL control that the master has written.
    pub(super) fn al_control(&self) -> AlControl {
        AlControl(self.memory.u16(AL_CONTROL))
    }

    /// Notes that the device has read AL control, so that the master can write it again.
    pub(super) const fn note_al_control_read(&mut self) {
        self.is_al_control_unread = false;
    }

    /// Sets AL status and AL status code, and raises the event of a changed AL status for the master.
    pub(super) fn set_al_status(&mut self, status: AlStatusRegister, code: AlStatus) {
        self.memory.set_u16(AL_STATUS_CODE, code.0);
        self.memory.set_u16(AL_STATUS, status.0);
        self.raise(EcatEvents::AL_STATUS);
    }

    /// Whether the EEPROM configures device emulation: AL status copies AL control.
    pub(super) fn is_device_emulated(&self) -> bool {
        self.memory.u8(registers::ESC_CONFIGURATION) & 1 != 0
    }

    /// The activation register of the SYNC unit; nothing is active without distributed clocks.
    pub(super) fn sync_activation(&self) -> SyncActivation {
        if self.has_clock() { SyncActivation(self.memory.u8(registers::SYNC_ACTIVATION)) } else { SyncActivation::NONE }
    }

    /// The settings of sync managers, watchdog and distributed clocks that the device checks before a change of state.
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

    /// The SYNC0 cycle time that the master has set, ns.
    pub(super) fn sync0_cycle_ns(&self) -> u32 {
        self.memory.u32(registers::SYNC0_CYCLE)
    }

    /// Sets the level of a latch input, 0 to [`LATCHES`](registers::LATCHES) - 1, from the simulated time `at` on,
    /// which should be near the arrival of the newest frame: the captured system time may be off by 1 % of the time
    /// between them. The call has no effect for an unchanged level, for an input that does not exist, and without
    /// distributed clocks.
    pub fn set_latch_input(&mut self, input: usize, is_on: bool, at: Ns) {
        if self.has_clock() && input < registers::LATCHES {
            latch_unit::set_level(input, is_on, at, &self.clock, &mut self.memory);
        }
    }

    /// Sets the levels of the latch inputs at power-on; bit 0 is input 0. They are initial levels and no edges, so no time is
    /// captured.
    pub(super) fn begin_latch_inputs(&mut self, levels: u8) {
        if self.has_clock() {
            latch_unit::set_levels(levels, &mut self.memory);
        }
    }

    /// Writes bytes of the RAM or the station alias on behalf of the model, without the side effects of a write by the network.
    pub(super) fn fill(&mut self, address: u16, data: &[u8]) {
        let room = self.memory.end().saturating_sub(address.into());
        self.memory.put(address, &data[..data.len().min(room)]);
    }

    /// Assigns the access to the EEPROM to the slave's processor, or gives it back to the master.
    pub fn take_eeprom(&mut self, takes: bool) {
        self.memory.set_u8(registers::SII_PDI_ACCESS, takes.into());
    }

    /// The system time as the slave's processor reads it, ns.
    pub const fn system_time_ns(&self) -> u64 {
        self.clock.system()
    }
}
