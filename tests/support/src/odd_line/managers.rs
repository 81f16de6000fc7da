//! Sync managers and FMMUs.

use super::OddSlave;
use super::esc::UNITS;

/// Mailbox full.
const FULL: u8 = 1 << 3;

/// The registers of a sync manager.
#[derive(Clone, Copy)]
pub(super) struct Manager {
    pub(super) start: usize,
    pub(super) len: usize,
    pub(super) control: u8,
    status: u8,
    activate: u8,
    pdi: u8,
}

impl Manager {
    pub(super) const fn is_on(self) -> bool {
        self.activate & 1 != 0 && self.len > 0
    }

    pub(super) const fn is_mailbox(self) -> bool {
        self.control & 3 == 2
    }

    /// Whether the master writes the buffer.
    pub(super) const fn is_written(self) -> bool {
        self.control & 0x0C == 4
    }

    pub(super) const fn is_full(self) -> bool {
        self.status & FULL != 0
    }
}

impl OddSlave {
    pub(super) fn manager(&self, n: usize) -> Manager {
        let bytes = &self.memory[0x0800 + 8 * n..][..8];
        Manager {
            start: u16::from_le_bytes([bytes[0], bytes[1]]).into(),
            len: u16::from_le_bytes([bytes[2], bytes[3]]).into(),
            control: bytes[4],
            status: bytes[5],
            activate: bytes[6],
            pdi: bytes[7],
        }
    }

    pub(super) fn set_full(&mut self, n: usize, is_full: bool) {
        let status = &mut self.memory[0x0805 + 8 * n];
        *status = if is_full { *status | FULL } else { *status & !FULL };
    }

    /// Writes a byte of a sync manager: address and length are fixed while it is on, and the status is read-only.
    pub(super) fn write_manager(&mut self, register: usize, byte: u8) {
        let n = (register - 0x0800) / 8;
        let before = self.memory[register];
        match register % 8 {
            0..=4 if self.memory[0x0806 + 8 * n] & 1 == 1 => {}
            5 | 7 => {}
            6 => {
                self.memory[register] = byte;
                if byte & 1 == 0 {
                    self.memory[0x0805 + 8 * n] = 0;
                }
                if (byte ^ before) & 2 != 0 {
                    self.repeat_message(n);
                    self.memory[0x0807 + 8 * n] = self.memory[0x0807 + 8 * n] & !2 | byte & 2;
                }
            }
            _ => self.memory[register] = byte,
        }
    }

    fn manager_at(&self, at: usize, len: usize) -> Option<(usize, Manager)> {
        let covers =
            |manager: &Manager| manager.is_on() && at < manager.start + manager.len && at + len > manager.start;
        (0..UNITS).map(|n| (n, self.manager(n))).find(|(_, manager)| covers(manager))
    }

    pub(super) fn may_be_read(&self, at: usize, len: usize) -> bool {
        self.manager_at(at, len).is_none_or(|(_, manager)| {
            !manager.is_written() && manager.pdi & 1 == 0 && (!manager.is_mailbox() || manager.is_full())
        })
    }

    /// A mailbox is empty when its last byte has been read.
    pub(super) fn was_read(&mut self, at: usize, len: usize) {
        if let Some((n, manager)) = self.manager_at(at, len).filter(|(_, manager)| manager.is_mailbox())
            && at + len >= manager.start + manager.len
        {
            self.set_full(n, false);
        }
    }

    pub(super) fn write_ram(&mut self, at: usize, data: &[u8]) -> bool {
        let end = at + data.len();
        let Some((n, manager)) = self.manager_at(at, data.len()) else {
            self.put(at, data);
            return true;
        };
        if !manager.is_written() || manager.pdi & 1 != 0 || manager.is_mailbox() && manager.is_full() {
            return false;
        }
        self.put(at, data);
        if end >= manager.start + manager.len {
            if manager.is_mailbox() {
                self.set_full(n, true);
            } else {
                self.outputs_at = Some(self.now);
            }
        }
        true
    }

    /// Processes a logical datagram, bit by bit; returns what it adds to the working counter.
    pub(super) fn logical(&mut self, command: u8, address: u32, data: &mut [u8]) -> u16 {
        let (first, end) = (u64::from(address) * 8, (u64::from(address) + data.len() as u64) * 8);
        let came = data.to_vec();
        let (mut is_read, mut is_written) = (false, false);
        for n in 0..UNITS {
            let unit: [u8; 16] = self.memory[0x0600 + 16 * n..][..16].try_into().expect("16 bytes");
            if unit[12] & 1 == 0 {
                continue;
            }
            let start = u64::from(u32::from_le_bytes([unit[0], unit[1], unit[2], unit[3]])) * 8 + u64::from(unit[6]);
            let len = u64::from(u16::from_le_bytes([unit[4], unit[5]]));
            let bits = (len * 8 + u64::from(unit[7]) + 1).saturating_sub(8 + u64::from(unit[6]));
            let physical = u64::from(u16::from_le_bytes([unit[8], unit[9]])) * 8 + u64::from(unit[10]);
            let hit: Vec<u64> = (0..bits).filter(|bit| (first..end).contains(&(start + bit))).collect();
            let (Some(from), Some(to)) = (hit.first(), hit.last()) else { continue };
            let at = ((physical + from) / 8) as usize;
            let after = ((physical + to) / 8) as usize + 1;
            let is_output = unit[11] & 2 != 0 && command != 0x0A;
            let is_input = unit[11] & 1 != 0 && command != 0x0B;
            if is_output {
                let mut bytes = self.memory[at..after].to_vec();
                for bit in &hit {
                    let value = came[((start + bit - first) / 8) as usize] >> ((start + bit) % 8) & 1;
                    let place = (physical + bit) as usize - 8 * at;
                    bytes[place / 8] = bytes[place / 8] & !(1 << (place % 8)) | value << (place % 8);
                }
                is_written |= self.write_ram(at, &bytes);
            }
            if is_input && (at < 0x1000 || self.may_be_read(at, after - at)) {
                for bit in &hit {
                    let place = (physical + bit) as usize;
                    let value = self.memory[place / 8] >> (place % 8) & 1;
                    let to = &mut data[((start + bit - first) / 8) as usize];
                    *to = *to & !(1 << ((start + bit) % 8)) | value << ((start + bit) % 8);
                }
                is_read = true;
            }
        }
        self.is_exchanged |= is_read || is_written;
        match command {
            0x0C => u16::from(is_read) + 2 * u16::from(is_written),
            _ => u16::from(is_read || is_written),
        }
    }
}
