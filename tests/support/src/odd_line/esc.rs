//! A slave controller: datagrams and registers.

use std::ops::Range;

use super::{Clock, Device, Eeprom, Mailbox, Ns, States};

/// Registers, and 8 KiB of RAM behind them.
const MEMORY: usize = 0x3000;
/// FMMUs and sync managers.
pub(super) const UNITS: usize = 8;

/// A slave. Its fields are the oddities that a test may choose.
pub struct OddSlave {
    /// All registers and the RAM.
    pub memory: Vec<u8>,
    /// The EEPROM.
    pub eeprom: Eeprom,
    /// The AL state machine.
    pub states: States,
    /// The mailbox.
    pub mailbox: Mailbox,
    /// The distributed clock; `None`: the slave has none.
    pub clock: Option<Clock>,
    /// Registers of the clock that the controller does not have.
    pub lacks_registers: Vec<Range<usize>>,
    /// The device behind the controller.
    pub device: Device,
    /// The cables at IN and OUT are swapped.
    pub is_swapped: bool,
    /// Whether a master has closed a port, also if this line loses no frames by that.
    pub has_closed_ports: bool,
    pub(super) now: Ns,
    /// The times at which the frame passed ports 0 and 1.
    pub(super) passed: [Ns; 2],
    /// The time of the last outputs; `None`: none since SafeOP.
    pub(super) outputs_at: Option<Ns>,
    /// Whether the frame has had process data for this slave.
    pub(super) is_exchanged: bool,
}

impl OddSlave {
    /// A slave with that EEPROM and no oddities, just switched on.
    pub fn new(eeprom: Vec<u8>, device: Device) -> Self {
        let mut slave = Self {
            memory: vec![0; MEMORY],
            eeprom: Eeprom::new(eeprom),
            states: States::default(),
            mailbox: Mailbox::default(),
            clock: Some(Clock::default()),
            lacks_registers: Vec::new(),
            device,
            is_swapped: false,
            has_closed_ports: false,
            now: 0,
            passed: [0; 2],
            outputs_at: None,
            is_exchanged: false,
        };
        slave.switch_on();
        slave
    }

    /// The same with an oddity; it is switched on afterwards.
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self.switch_on();
        self
    }

    /// Sets the registers to their values at power-on.
    fn switch_on(&mut self) {
        self.memory.fill(0);
        self.memory[..8].copy_from_slice(&[0x11, 0, 2, 0, UNITS as u8, UNITS as u8, 8, 0x0F]);
        let features: u16 = match &self.clock {
            None => 0x00C0,
            Some(clock) if clock.is_short => 0x00C4,
            Some(_) => 0x00CC,
        };
        self.put(0x0008, &features.to_le_bytes());
        self.put(0x0100, &0x0007_C001_u32.to_le_bytes());
        self.put(0x0110, &0x5611_u16.to_le_bytes());
        self.put(0x0120, &[1]);
        self.put(0x0130, &[1]);
        self.put(0x0400, &0x09C2_u16.to_le_bytes());
        self.put(0x0420, &1000_u16.to_le_bytes());
        self.put(0x0930, &0x1000_u16.to_le_bytes());
        self.load_eeprom();
        if self.states.copies_control {
            self.memory[0x0141] |= 1;
        }
    }

    pub(super) fn put(&mut self, at: usize, bytes: &[u8]) {
        self.memory[at..at + bytes.len()].copy_from_slice(bytes);
    }

    pub(super) fn word(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.memory[at], self.memory[at + 1]])
    }

    pub(super) fn begin_frame(&mut self, now: Ns, passed: [Ns; 2]) {
        self.advance(now);
        self.passed = passed;
        self.is_exchanged = false;
    }

    pub(super) fn end_frame(&mut self) {
        if self.is_exchanged {
            self.run_device();
        }
        self.advance(self.now);
    }

    pub(super) fn advance(&mut self, now: Ns) {
        self.now = now.max(self.now);
        self.advance_state();
        self.advance_mailbox();
    }

    /// Processes a datagram; returns what it adds to the working counter.
    pub(super) fn datagram(&mut self, command: u8, address: &mut [u8; 4], data: &mut [u8]) -> u16 {
        let adp = u16::from_le_bytes([address[0], address[1]]);
        let at = u16::from_le_bytes([address[2], address[3]]);
        let is_for_me = match command {
            0x01..=0x03 | 0x0D => adp == 0,
            0x04..=0x06 | 0x0E => adp == self.word(0x0010) || self.memory[0x0103] & 1 == 1 && adp == self.word(0x0012),
            0x07..=0x09 => true,
            0x0A..=0x0C => return self.logical(command, u32::from_le_bytes(*address), data),
            _ => return 0,
        };
        if matches!(command, 0x01..=0x03 | 0x0D | 0x07..=0x09) {
            address[..2].copy_from_slice(&adp.wrapping_add(1).to_le_bytes());
        }
        let mut read = vec![0; data.len()];
        match command {
            0x01 | 0x04 if is_for_me => {
                let is_read = self.read(at, &mut read);
                if is_read {
                    data.copy_from_slice(&read);
                }
                is_read.into()
            }
            0x02 | 0x05 | 0x08 if is_for_me => self.write(at, data).into(),
            0x03 | 0x06 if is_for_me => {
                let is_read = self.read(at, &mut read);
                let is_written = self.write(at, data);
                if is_read {
                    data.copy_from_slice(&read);
                }
                u16::from(is_read) + 2 * u16::from(is_written)
            }
            0x07 | 0x09 => {
                let is_read = self.read(at, &mut read);
                let is_written = command == 0x09 && self.write(at, data);
                if is_read {
                    data.iter_mut().zip(&read).for_each(|(to, from)| *to |= from);
                }
                u16::from(is_read) + 2 * u16::from(is_written)
            }
            0x0D | 0x0E if is_for_me => {
                let is_read = self.read(at, &mut read);
                if is_read {
                    data.copy_from_slice(&read);
                }
                is_read.into()
            }
            0x0D | 0x0E => self.write(at, data).into(),
            _ => 0,
        }
    }

    fn exists(&self, at: usize, len: usize) -> bool {
        match at {
            0x0600..0x0800 => at < 0x0600 + 16 * UNITS,
            0x0800..0x0900 => at < 0x0800 + 8 * UNITS,
            0x0900..0x0A00 if self.lacks_registers.iter().any(|block| block.contains(&at)) => false,
            0x0900..0x0A00 => self.clock.is_some(),
            _ => at + len <= MEMORY,
        }
    }

    pub(super) fn read(&mut self, at: u16, data: &mut [u8]) -> bool {
        let (at, len) = (usize::from(at), data.len());
        if !self.exists(at, len) {
            return false;
        }
        let covers = |register: usize| (at..at + len).contains(&register);
        if covers(0x0503) || covers(0x0502) {
            self.show_eeprom();
        }
        if covers(0x0910) {
            self.show_time();
        }
        let is_read = if at >= 0x1000 { self.may_be_read(at, len) } else { true };
        if is_read {
            data.copy_from_slice(&self.memory[at..at + len]);
            if at >= 0x1000 {
                self.was_read(at, len);
            }
        }
        is_read
    }

    pub(super) fn write(&mut self, at: u16, data: &[u8]) -> bool {
        let (at, len) = (usize::from(at), data.len());
        if !self.exists(at, len) {
            return false;
        }
        if at >= 0x1000 {
            return self.write_ram(at, data);
        }
        let covers = |register: usize| (at..at + len).contains(&register);
        if covers(0x0502) && at < 0x0510 && self.is_eeprom_kept() {
            return false;
        }
        if covers(0x0120) && self.refuses_requests() {
            return false;
        }
        if covers(0x0900) {
            self.latch();
        }
        if covers(0x0910) && at == 0x0910 {
            self.take_time(data);
            return true;
        }
        for (register, byte) in (at..).zip(data) {
            let is_read_only = matches!(register, 0x0000..0x0010 | 0x0012..0x0014 | 0x0110..0x0112 | 0x0130..0x0138
                | 0x0140..0x0142 | 0x0501 | 0x0502..0x0504 | 0x0900..0x0920 | 0x092C..0x0930);
            if (0x0800..0x0880).contains(&register) {
                self.write_manager(register, *byte);
            } else if !is_read_only && register < 0x1000 {
                self.memory[register] = *byte;
            }
        }
        if covers(0x0101) {
            // Two bits for each port: 3 is closed.
            self.has_closed_ports |= (0..4).any(|port| self.memory[0x0101] >> (2 * port) & 3 == 3);
        }
        if covers(0x0500) {
            self.pass_eeprom();
        }
        if covers(0x0503) {
            let word = |n: usize| data.get(0x0502 + n - at).copied().unwrap_or(0);
            self.command_eeprom(u16::from_le_bytes([word(0), word(1)]));
        }
        if covers(0x0930)
            && let Some(clock) = &mut self.clock
        {
            clock.forget();
        }
        if covers(0x0120) {
            self.ask_for_state(self.memory[0x0120]);
        }
        true
    }
}
