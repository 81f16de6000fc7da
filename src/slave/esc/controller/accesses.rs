//! Reads and writes of a slave controller's memory by the network, and their side effects.

use super::Controller;
use crate::ethercat::registers::{
    self, AL_CONTROL, AL_STATUS, AlEvents, CLOCK_REGISTERS, DL_CONTROL, DL_STATUS, ECAT_EVENT, EcatEvents, FMMU,
    FMMU_LEN, LATCHES, LatchEdge, PORTS, RAM, SYNC_MANAGER, SYNC_MANAGER_LEN, SiiControl, SyncActivation,
};
use crate::slave::esc::fmmus::{FMMUS_MAX, Fmmus};
use crate::slave::esc::latch_unit;
use crate::slave::esc::managers::MANAGERS_MAX;
use crate::slave::esc::memory::ByteAccess;
use crate::slave::esc::sync_unit::SyncPulse;

/// The registers of the EEPROM interface that are write-protected while the EEPROM is busy or assigned to the slave's
/// processor.
const EEPROM_COMMANDS: std::ops::Range<usize> = registers::SII_CONTROL as usize..registers::MII as usize;

/// Bit 0 of [`CYCLIC_UNIT_CONTROL`](registers::CYCLIC_UNIT_CONTROL): the slave's processor controls the SYNC unit, so writes of
/// the network to it have no effect.
const SYNC_OWNED_BY_DEVICE: u8 = 1 << 0;

/// Bit 0 of [`RECEIVE_TIME_LATCH_MODE`](registers::RECEIVE_TIME_LATCH_MODE): reverse mode.
const LATCH_REVERSE: u8 = 1 << 0;

/// Length in bytes of the registers with the latch times of all edges.
const LATCH_TIMES_LEN: usize = 16 * LATCHES;

/// Whether an access of `accessed` bytes at `address` overlaps a register of `len` bytes at `at`.
fn touches(address: usize, accessed: usize, at: u16, len: usize) -> bool {
    let at = usize::from(at);
    address < at + len && at < address + accessed
}

impl Controller {
    /// Reads memory for the network. Returns whether any byte was read; bytes of `data` without memory are left unchanged.
    pub(in crate::slave::esc) fn read(&mut self, address: usize, data: &mut [u8]) -> bool {
        let registers = usize::from(RAM).saturating_sub(address).min(data.len());
        let (low, high) = data.split_at_mut(registers);
        let mut done = false;
        if !low.is_empty() {
            done |= self.read_registers(address, low);
        }
        if !high.is_empty() {
            done |= self.managers.read(address + registers, high, &mut self.memory);
        }
        done
    }

    fn read_registers(&mut self, address: usize, data: &mut [u8]) -> bool {
        let len = data.len();
        self.refresh(address, len);
        let mut done = false;
        for (n, byte) in data.iter_mut().enumerate() {
            done |= self.memory.access(address + n) != ByteAccess::Absent;
            *byte = self.memory.slice(address + n, 1)[0];
        }
        if touches(address, len, AL_STATUS, 2) {
            self.drop_events(EcatEvents::AL_STATUS);
        }
        if touches(address, len, DL_STATUS, 2) {
            self.drop_events(EcatEvents::DL_STATUS);
        }
        if self.has_clock() && touches(address, len, registers::LATCH_TIMES, LATCH_TIMES_LEN) {
            self.acknowledge_latches(address, len);
        }
        done
    }

    /// Acknowledges each latch edge whose captured time the master has just read, if the master controls the input: its status
    /// bit is cleared, and single-event mode can capture the next edge.
    fn acknowledge_latches(&mut self, address: usize, len: usize) {
        for input in 0..LATCHES {
            for edge in LatchEdge::ALL {
                // Reading the first byte freezes the others, so only that byte acknowledges.
                if touches(address, len, registers::latch_time(input, edge), 1) {
                    latch_unit::acknowledge(input, edge, &mut self.memory);
                }
            }
        }
    }

    /// If the network is about to read the event register, a sync manager status or a clock register, writes the
    /// present value of that register into the memory.
    fn refresh(&mut self, address: usize, len: usize) {
        if touches(address, len, ECAT_EVENT, 2) {
            let others = self.memory.u16(ECAT_EVENT) & 0x000F;
            self.memory.set_u16(ECAT_EVENT, others | self.manager_events());
        }
        if touches(address, len, SYNC_MANAGER, MANAGERS_MAX * SYNC_MANAGER_LEN) {
            self.managers.show_statuses(&mut self.memory);
        }
        let clock = usize::from(CLOCK_REGISTERS.start)..usize::from(CLOCK_REGISTERS.end);
        if !self.has_clock() || address >= clock.end || address + len <= clock.start {
            return;
        }
        self.memory.set_u64(registers::SYSTEM_TIME, self.shown_time(self.clock.system_for_network()));
        self.memory.set_u32(registers::SYSTEM_TIME_DIFFERENCE, self.clock.shown_difference().0);
        if self.sync.is_running() {
            let (next0, next1) = self.sync.shown();
            if let Some(next0) = next0 {
                self.memory.set_u64(registers::SYNC0_START, self.shown_time(next0));
            }
            self.memory.set_u64(registers::SYNC1_NEXT, self.shown_time(next1.unwrap_or(0)));
        }
        self.memory.set_u8(registers::SYNC_ACTIVATION_STATUS, self.sync.pending());
    }

    /// Writes memory for the network. Returns whether any byte was written.
    pub(in crate::slave::esc) fn write(&mut self, address: usize, data: &[u8]) -> bool {
        if address == usize::from(registers::SYSTEM_TIME)
            && data.len() <= 8
            && self.has_clock()
            && !self.protection.is_on()
        {
            // The common case: with distributed clocks the master sends the system time in each cycle. The device is not
            // involved.
            return self.receive_system_time(data);
        }
        let registers = usize::from(RAM).saturating_sub(address).min(data.len());
        let (low, high) = data.split_at(registers);
        let mut done = false;
        if !low.is_empty() {
            done |= self.write_registers(address, low);
        }
        if !high.is_empty() && !self.protection.blocks_all() {
            done |= self.managers.write(address + registers, high, &mut self.memory);
            self.note_outputs();
        }
        done
    }

    /// Restarts the process data watchdog if the outputs were written completely.
    fn note_outputs(&mut self) {
        let mut written = self.managers.events.written;
        while written != 0 {
            let n = written.trailing_zeros() as u8;
            written &= written - 1;
            if self.managers.registers(n).control.contains(registers::SmControl::WATCHDOG) {
                self.watchdog.trigger(self.arrival, &mut self.memory);
            }
        }
    }

    fn write_registers(&mut self, address: usize, data: &[u8]) -> bool {
        let eeprom_is_free = self.eeprom.is_free(&self.memory);
        let managers = usize::from(SYNC_MANAGER)..usize::from(SYNC_MANAGER) + MANAGERS_MAX * SYNC_MANAGER_LEN;
        let mut done = false;
        for (n, byte) in data.iter().enumerate() {
            let at = address + n;
            if self.protection.is_on() && self.protection.blocks(at) {
                continue;
            }
            match self.memory.access(at) {
                ByteAccess::Absent | ByteAccess::Read => continue,
                ByteAccess::Clear => self.clear_counters(at as u16),
                ByteAccess::Write if managers.contains(&at) => {
                    self.managers.write_register((at - managers.start) as u16, *byte, &mut self.memory);
                }
                ByteAccess::Write if EEPROM_COMMANDS.contains(&at) && !eeprom_is_free => continue,
                ByteAccess::Write if self.is_al_control_unread && touches(at, 1, AL_CONTROL, 2) => continue,
                ByteAccess::Write if is_trigger(at) || self.is_devices_unit(at) => {}
                ByteAccess::Write => {
                    self.memory.slice_mut(at, 1)[0] = *byte;
                    self.protection.note_written(at, &self.memory);
                }
            }
            done = true;
        }
        if done {
            self.after_write(address, data, eeprom_is_free);
        }
        done
    }

    /// Whether a byte is a register of the SYNC unit or of a latch input that the slave's processor controls. The network
    /// cannot change such a byte.
    fn is_devices_unit(&self, at: usize) -> bool {
        let Ok(at) = u16::try_from(at) else { return false };
        match at {
            registers::SYNC_ACTIVATION => self.is_sync_the_devices(),
            _ if (registers::SYNC0_START..registers::SYNC1_NEXT).contains(&at) => self.is_sync_the_devices(),
            _ if (registers::SYNC0_CYCLE..registers::LATCH_CONTROL).contains(&at) => self.is_sync_the_devices(),
            _ => at
                .checked_sub(registers::LATCH_CONTROL)
                .map(usize::from)
                .is_some_and(|input| input < LATCHES && latch_unit::is_devices(input, &self.memory)),
        }
    }

    fn is_sync_the_devices(&self) -> bool {
        self.memory.u8(registers::CYCLIC_UNIT_CONTROL) & SYNC_OWNED_BY_DEVICE != 0
    }

    fn clear_counters(&mut self, at: u16) {
        const GROUPS: [std::ops::Range<u16>; 5] = [
            registers::RX_ERRORS..registers::PROCESSING_UNIT_ERRORS,
            registers::PROCESSING_UNIT_ERRORS..registers::PDI_ERRORS,
            registers::PDI_ERRORS..registers::PDI_ERROR_CODE,
            registers::LOST_LINKS..registers::LOST_LINKS + PORTS as u16,
            registers::WATCHDOG_COUNTER_PROCESS_DATA..registers::WATCHDOG_COUNTER_PDI + 1,
        ];
        if let Some(group) = GROUPS.iter().find(|group| group.contains(&at)) {
            self.memory.slice_mut(group.start.into(), group.len()).fill(0);
        }
    }

    /// Carries out the side effects of a write to registers.
    fn after_write(&mut self, address: usize, data: &[u8], eeprom_is_free: bool) {
        let hits = |at: u16, len: usize| touches(address, data.len(), at, len);
        self.is_set_anew = true;
        // A datagram that writes several of these registers has their effects in the order of their addresses.
        if hits(registers::RESET_ECAT, 1) {
            self.reset_byte(self.memory.u8(registers::RESET_ECAT));
        }
        if hits(DL_CONTROL, 4) {
            self.control_loops();
        }
        if hits(AL_CONTROL, 2) && !self.is_al_control_unread {
            self.is_al_control_unread = !self.is_device_emulated();
            self.events.al_control = true;
            self.raise_for_device(AlEvents::AL_CONTROL);
        }
        if hits(registers::ECAT_EVENT_MASK, 2) {
            self.event_mask = self.memory.u16(registers::ECAT_EVENT_MASK);
        }
        if hits(registers::WATCHDOG_DIVIDER, 2) || hits(registers::WATCHDOG_PROCESS_DATA, 2) {
            self.watchdog.set(self.arrival, &mut self.memory);
        }
        if hits(registers::SII_CONFIGURATION, 1) && self.memory.u8(registers::SII_CONFIGURATION) & 0b10 != 0 {
            self.memory.set_u8(registers::SII_PDI_ACCESS, 0);
        }
        if eeprom_is_free && hits(registers::SII_CONTROL, 1) {
            self.eeprom.written_in_part(&mut self.memory);
        }
        if eeprom_is_free && hits(registers::SII_CONTROL + 1, 1) {
            // The write-enable bit counts only if the same datagram has written it: a datagram that begins after the
            // lower byte of the control register clears the bit.
            let kept =
                if address > usize::from(registers::SII_CONTROL) { SiiControl::WRITE_ENABLE } else { SiiControl::NONE };
            let written = SiiControl(self.memory.u16(registers::SII_CONTROL)).without(kept);
            self.eeprom.command(written, self.arrival, &mut self.memory);
            if self.eeprom.advance(self.arrival, &mut self.memory) {
                self.load_words(false);
            }
        }
        if hits(FMMU, FMMUS_MAX * FMMU_LEN) || hits(SYNC_MANAGER, MANAGERS_MAX * SYNC_MANAGER_LEN) {
            self.fmmus = Fmmus::decode(self.settings.fmmus, &self.memory, &self.managers);
        }
        if self.managers.events.activated != 0 {
            self.raise_for_device(AlEvents::SM_ACTIVATION);
        }
        if self.has_clock() && address + data.len() > usize::from(CLOCK_REGISTERS.start) {
            self.after_clock_write(address, data);
        }
    }

    /// Handles a byte written to register 0x0040, which resets the controller after the bytes `R`, `E` and `S`.
    fn reset_byte(&mut self, byte: u8) {
        let expected = registers::RESET_SEQUENCE;
        self.reset_progress = match expected.get(self.reset_progress) {
            Some(next) if *next == byte => self.reset_progress + 1,
            _ => usize::from(byte == expected[0]),
        };
        if self.reset_progress == expected.len() {
            self.reset_progress = 0;
            self.events.reset = true;
        }
    }

    fn after_clock_write(&mut self, address: usize, data: &[u8]) {
        let hits = |at: u16, len: usize| touches(address, data.len(), at, len);
        let system_time = usize::from(registers::SYSTEM_TIME);
        if hits(registers::RECEIVE_TIMES, 1) {
            self.latch_receive_times();
        }
        if address <= system_time {
            self.receive_system_time(data.get(system_time - address..).unwrap_or_default());
        }
        if hits(registers::SYSTEM_TIME_OFFSET, 8) || hits(registers::SYSTEM_TIME_DELAY, 4) {
            self.clock.offset = self.memory.u64(registers::SYSTEM_TIME_OFFSET);
            self.clock.delay = self.memory.u32(registers::SYSTEM_TIME_DELAY);
            self.sync.skip_to(self.clock.system());
        }
        if hits(registers::SPEED_COUNTER_START, 2) {
            self.clock.reset_filters();
        }
        if hits(registers::CYCLIC_UNIT_CONTROL, 1) || hits(registers::LATCH_CONTROL, LATCHES) {
            latch_unit::control_written(&mut self.memory);
        }
        let activation = self.written_activation(hits(registers::SYNC_ACTIVATION, 1));
        let extends = activation.contains(SyncActivation::EXTEND_START);
        if extends && hits(registers::SYNC0_START + 3, 1) {
            self.extend_start();
        }
        let last_of_start = if extends { registers::SYNC0_START + 3 } else { registers::SYNC0_START + 7 };
        let is_auto = activation.contains(SyncActivation::AUTO) && hits(last_of_start, 1);
        if hits(registers::SYNC_ACTIVATION, 1) || is_auto {
            let activation = if is_auto { activation | SyncActivation::ACTIVATE } else { activation };
            self.memory.set_u8(registers::SYNC_ACTIVATION, activation.0);
            let cycles = (self.sync0_cycle_ns(), self.memory.u32(registers::SYNC1_CYCLE));
            let (start, now) = (self.memory.u64(registers::SYNC0_START), self.clock.system());
            // A clock of 32 bits uses only the lower half of the start time. \[OURS] The start is the nearest time with
            // this lower half.
            let ahead = (start as u32).wrapping_sub(now as u32).cast_signed();
            let start = if self.has_long_clock() { start } else { now.wrapping_add_signed(ahead.into()) };
            self.sync.activate(activation, start, now, cycles);
            self.events.sync_changed = true;
        }
    }

    /// Handles a system time that the master has written, if its lower 32 bits are complete. Returns whether any byte was
    /// written, for the working counter.
    fn receive_system_time(&mut self, data: &[u8]) -> bool {
        if let Some(received) = data.first_chunk() {
            let depth = self.memory.u8(registers::TIME_DIFFERENCE_FILTER);
            self.clock.receive(u32::from_le_bytes(*received), depth);
        }
        !data.is_empty()
    }

    /// The activation of the SYNC unit. Without the enhanced SYNC feature only the lower three bits are used. With
    /// `is_new`, the register was just written and may request an immediate debug pulse, which the device ignores \[OURS].
    fn written_activation(&mut self, is_new: bool) -> SyncActivation {
        let written = SyncActivation(self.memory.u8(registers::SYNC_ACTIVATION));
        if !self.settings.features.contains(registers::Features::ENHANCED_SYNC) {
            return SyncActivation(written.0 & 0b111);
        }
        if is_new && written.contains(SyncActivation::DEBUG_PULSE) {
            let signals = [(SyncActivation::SYNC0, SyncPulse::Sync0), (SyncActivation::SYNC1, SyncPulse::Sync1)];
            for (_, pulse) in signals.into_iter().filter(|(signal, _)| written.contains(*signal)) {
                self.show_pulse(pulse);
            }
        }
        written.without(SyncActivation::DEBUG_PULSE)
    }

    /// Extends the 32-bit start time of SYNC0 to the 64-bit time that is nearest to the present time \[OURS].
    fn extend_start(&mut self) {
        let now = self.clock.system();
        let ahead = self.memory.u32(registers::SYNC0_START).wrapping_sub(now as u32).cast_signed();
        self.memory.set_u64(registers::SYNC0_START, now.wrapping_add_signed(ahead.into()));
    }

    /// Latches the receive times of the newest frame. In reverse mode, ports 1 to 3 show the receive times of the
    /// previous frame. That mode is for slaves that frames enter through one of these ports.
    fn latch_receive_times(&mut self) {
        let arrival = self.clock.local();
        let is_reverse = self.memory.u8(registers::RECEIVE_TIME_LATCH_MODE) & LATCH_REVERSE != 0;
        let passed = if is_reverse { self.arrival_before } else { self.arrival };
        self.memory.set_u64(registers::RECEIVE_TIME_UNIT, self.shown_time(arrival));
        self.memory.set_u32(registers::RECEIVE_TIMES, arrival as u32);
        for (port, returns_ns) in (1..).zip(self.returns) {
            if let Some(returns_ns) = returns_ns {
                let local = self.clock.local_at(passed + returns_ns);
                self.memory.set_u32(registers::receive_time(port), local as u32);
            }
        }
    }
}

/// Whether a write to a byte triggers an action and stores no value: receive times and system time.
fn is_trigger(at: usize) -> bool {
    (usize::from(registers::RECEIVE_TIMES)..usize::from(registers::RECEIVE_TIME_UNIT)).contains(&at)
}
