//! The sync managers of a controller: mailboxes with their handshake, and three buffers of which the reader gets the newest.
//!
//! A buffer is opened by its first byte and done with its last one. \[OURS] Effects take place with the datagram, not at the
//! end of the frame.

mod manager;

use super::memory::{Memory, copy};
use crate::ethercat::registers::{
    self, BufferMode, SYNC_MANAGER_LEN, SmActivate, SmControl, SmDirection, SmPdiControl, SmStatus, SyncManager,
};

use manager::{Manager, Side};

/// The most sync managers that a controller has.
pub(super) const MANAGERS_MAX: usize = 16;

/// What the network has done to sync managers since somebody asked: a bit for each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ManagerEvents {
    /// A buffer was written whole.
    pub(super) written: u16,
    /// A buffer was read whole.
    pub(super) read: u16,
    /// The activation was written.
    pub(super) activated: u16,
}

#[derive(Clone, Debug)]
#[repr(C)] // What each frame uses lies side by side, first.
pub(super) struct Managers {
    pub(super) events: ManagerEvents,
    /// A bit for each whose three buffers the network can write, or read, whole and without looking at another one.
    writable: u16,
    readable: u16,
    /// A bit for each that is enabled and has an area.
    enabled: u16,
    count: u8,
    managers: [Manager; MANAGERS_MAX],
}

impl Managers {
    pub(super) fn new(count: u8) -> Self {
        let count = count.min(MANAGERS_MAX as u8);
        let (managers, events) = (Default::default(), ManagerEvents::default());
        Self { managers, count, enabled: 0, writable: 0, readable: 0, events }
    }

    pub(super) fn registers(&self, n: u8) -> SyncManager {
        self.managers[usize::from(n)].registers
    }

    /// Puts the registers of a sync manager into the memory.
    fn show(&self, n: usize, memory: &mut Memory) {
        memory.put(registers::sync_manager(n as u8), &self.managers[n].registers.encode());
    }

    /// Puts what accesses to areas have changed into the memory, which has to be done before the registers are read.
    pub(super) fn show_statuses(&self, memory: &mut Memory) {
        for n in 0..self.count {
            memory.set_u8(registers::sync_manager_status(n), self.registers(n).status.0);
        }
    }

    /// A byte of the registers is written from the network.
    pub(super) fn write_register(&mut self, offset: u16, value: u8, memory: &mut Memory) {
        let (n, at) = (usize::from(offset) / SYNC_MANAGER_LEN, usize::from(offset) % SYNC_MANAGER_LEN);
        let manager = &mut self.managers[n];
        let mut bytes = manager.registers.encode();
        match at {
            // Start, length and control do not change while it is enabled.
            0..=4 if !manager.registers.is_enabled() => bytes[at] = value,
            6 => {
                bytes[6] = value;
                self.events.activated |= 1 << n;
            }
            _ => return,
        }
        manager.registers = SyncManager::decode(&bytes);
        if !manager.registers.is_enabled() {
            let registers = SyncManager { status: Self::idle(manager.registers.control), ..manager.registers };
            let distance = if registers.len == 1 { 0 } else { registers.len };
            *manager = Manager { registers, distance, ..Manager::default() };
        }
        let bit = 1 << n;
        self.enabled = if manager.is_active() { self.enabled | bit } else { self.enabled & !bit };
        self.show(n, memory);
        self.find_whole(memory);
    }

    /// Finds the sync managers whose buffers can be exchanged whole.
    fn find_whole(&mut self, memory: &Memory) {
        (self.writable, self.readable) = (0, 0);
        for n in 0..usize::from(self.count) {
            let manager = &self.managers[n];
            let area = manager.area();
            let end = manager.buffer_start(2) + usize::from(manager.registers.len);
            // An address belongs to the first sync manager that has it.
            let mut before = self.managers[..n].iter().filter(|other| other.is_active()).map(Manager::area);
            let is_first = before.all(|other| other.end <= area.start || area.end <= other.start);
            let is_whole = manager.is_usable() && !manager.is_mailbox() && end <= memory.end() && is_first;
            for (side, bits) in [(Side::Writer, &mut self.writable), (Side::Reader, &mut self.readable)] {
                *bits |= u16::from(is_whole && manager.is_open_to(side)) << n;
            }
        }
    }

    /// A bit for each whose three buffers the network can write whole.
    pub(super) const fn writable(&self) -> u16 {
        self.writable
    }

    /// A bit for each whose three buffers the network can read whole.
    pub(super) const fn readable(&self) -> u16 {
        self.readable
    }

    /// A bit for the first enabled sync manager that has just this area; 0: there is none.
    pub(super) fn of_area(&self, start: u16, len: u16) -> u16 {
        let has_it =
            |manager: &Manager| manager.is_active() && manager.registers.start == start && manager.registers.len == len;
        self.managers.iter().position(has_it).map_or(0, |n| 1 << n)
    }

    /// The status of a sync manager that nobody has used.
    fn idle(control: SmControl) -> SmStatus {
        match control.mode() {
            BufferMode::Buffered => SmStatus::NONE.with_last_buffer(3),
            _ => SmStatus::NONE,
        }
    }

    /// The enabled sync manager that has an address, and where its area or, without one, the next area begins.
    fn at(&self, address: usize) -> (Option<usize>, usize) {
        let (mut bits, mut next) = (self.enabled, usize::MAX);
        while bits != 0 {
            let n = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let area = self.managers[n].area();
            if area.contains(&address) {
                return (Some(n), area.end);
            }
            if area.start > address {
                next = next.min(area.start);
            }
        }
        (None, next)
    }

    /// The network writes three buffers whole, of one that is [writable](Self::writable). Whether that triggers the watchdog.
    #[inline]
    pub(super) fn write_whole(&mut self, n: usize, data: &[u8], memory: &mut Memory) -> bool {
        let manager = &mut self.managers[n];
        let start = manager.fill();
        copy(memory.slice_mut(start, data.len()), data);
        self.events.written |= 1 << n;
        manager.registers.control.contains(SmControl::WATCHDOG)
    }

    /// The network reads three buffers whole, of one that is [readable](Self::readable).
    #[inline]
    pub(super) fn read_whole(&mut self, n: usize, data: &mut [u8], memory: &Memory) {
        let start = self.managers[n].drain();
        copy(data, memory.slice(start, data.len()));
        self.events.read |= 1 << n;
    }

    /// The network writes RAM. Whether any byte was written.
    pub(super) fn write(&mut self, address: usize, data: &[u8], memory: &mut Memory) -> bool {
        let mut done = false;
        let mut at = 0;
        while at < data.len() {
            let (manager, end) = self.at(address + at);
            let len = (end - (address + at)).min(data.len() - at);
            let part = &data[at..at + len];
            done |= match manager {
                None => put(memory, address + at, part),
                Some(n) => self.write_area(n, address + at, part, memory),
            };
            at += len;
        }
        done
    }

    fn write_area(&mut self, n: usize, address: usize, data: &[u8], memory: &mut Memory) -> bool {
        if !self.managers[n].is_open_to(Side::Writer) {
            return false;
        }
        let manager = &mut self.managers[n];
        let area = manager.area();
        let offset = address - area.start;
        let Some(buffer) = manager.buffer(Side::Writer, offset) else { return false };
        let done = put(memory, manager.buffer_start(buffer) + offset, data);
        if address + data.len() == area.end {
            manager.close(Side::Writer);
            self.events.written |= 1 << n;
        }
        done
    }

    /// The network reads RAM. Whether any byte was read; others stay as they are.
    pub(super) fn read(&mut self, address: usize, data: &mut [u8], memory: &mut Memory) -> bool {
        let mut done = false;
        let mut at = 0;
        while at < data.len() {
            let (manager, end) = self.at(address + at);
            let len = (end - (address + at)).min(data.len() - at);
            let part = &mut data[at..at + len];
            done |= match manager {
                None => take(memory, address + at, part),
                Some(n) => self.read_area(n, address + at, part, memory),
            };
            at += len;
        }
        done
    }

    fn read_area(&mut self, n: usize, address: usize, data: &mut [u8], memory: &mut Memory) -> bool {
        if !self.managers[n].is_open_to(Side::Reader) {
            return false;
        }
        let manager = &mut self.managers[n];
        let area = manager.area();
        let offset = address - area.start;
        let Some(buffer) = manager.buffer(Side::Reader, offset) else { return false };
        let done = take(memory, manager.buffer_start(buffer) + offset, data);
        if address + data.len() == area.end {
            manager.close(Side::Reader);
            self.events.read |= 1 << n;
        }
        done
    }

    /// The slave's own controller writes a whole buffer; `false`: the sync manager is off, or its mailbox is full.
    #[inline]
    pub(super) fn put(&mut self, n: u8, data: &[u8], memory: &mut Memory) -> bool {
        let manager = &mut self.managers[usize::from(n)];
        if self.readable & 1 << n == 0 || data.len() != usize::from(manager.registers.len) {
            return self.put_with_care(n, data, memory);
        }
        let start = manager.fill();
        copy(memory.slice_mut(start, data.len()), data);
        true
    }

    #[inline(never)]
    fn put_with_care(&mut self, n: u8, data: &[u8], memory: &mut Memory) -> bool {
        let manager = &mut self.managers[usize::from(n)];
        if !manager.is_usable() || manager.registers.control.direction() != SmDirection::Read {
            return false;
        }
        let Some(buffer) = manager.open(Side::Writer) else { return false };
        manager.close(Side::Writer);
        let room = memory.slice_mut(manager.buffer_start(buffer), usize::from(manager.registers.len));
        let len = data.len().min(room.len());
        room[..len].copy_from_slice(&data[..len]);
        room[len..].fill(0);
        true
    }

    /// The slave's own controller reads a whole buffer; `None`: the sync manager is off, or its mailbox is empty.
    #[inline]
    pub(super) fn take<'m>(&mut self, n: u8, memory: &'m mut Memory) -> Option<&'m [u8]> {
        let manager = &mut self.managers[usize::from(n)];
        let start = if self.writable & 1 << n == 0 { Self::take_with_care(manager)? } else { manager.drain() };
        Some(memory.slice(start, usize::from(manager.registers.len)))
    }

    #[inline(never)]
    fn take_with_care(manager: &mut Manager) -> Option<usize> {
        if !manager.is_usable() || manager.registers.control.direction() != SmDirection::Write {
            return None;
        }
        let buffer = manager.open(Side::Reader)?;
        manager.close(Side::Reader);
        Some(manager.buffer_start(buffer))
    }

    /// Takes back a message that the network has not read yet, with the whole mailbox.
    pub(super) fn take_back<'m>(&mut self, n: u8, memory: &'m mut Memory) -> Option<&'m [u8]> {
        let n = usize::from(n);
        let manager = &mut self.managers[n];
        if !manager.is_usable() || !manager.registers.status.contains(SmStatus::FULL) {
            return None;
        }
        let status = manager.registers.status;
        manager.registers.status = status.without(SmStatus::FULL).without(SmStatus::WRITTEN);
        manager.reading = None;
        let (start, len) = (manager.buffer_start(0), usize::from(manager.registers.len));
        Some(memory.slice(start, len))
    }

    /// The repeat that the master has asked for is done.
    pub(super) fn acknowledge_repeat(&mut self, n: u8, memory: &mut Memory) {
        let SyncManager { activate, pdi, .. } = self.managers[usize::from(n)].registers;
        let wanted = activate.contains(SmActivate::REPEAT);
        let acknowledge = SmPdiControl::REPEAT_ACKNOWLEDGE;
        let pdi = if wanted { pdi.with(acknowledge) } else { pdi.without(acknowledge) };
        self.managers[usize::from(n)].registers.pdi = pdi;
        self.show(n.into(), memory);
    }

    /// The slave's own controller switches a sync manager off, or lets it be on again.
    pub(super) fn deactivate(&mut self, n: u8, is_off: bool, memory: &mut Memory) {
        let pdi = &mut self.managers[usize::from(n)].registers.pdi;
        *pdi = if is_off { pdi.with(SmPdiControl::DEACTIVATE) } else { pdi.without(SmPdiControl::DEACTIVATE) };
        self.show(n.into(), memory);
        self.find_whole(memory);
    }

    /// The number of sync managers.
    pub(super) const fn count(&self) -> u8 {
        self.count
    }
}

/// Puts bytes into the memory, as far as there is any. Whether there is some.
fn put(memory: &mut Memory, address: usize, data: &[u8]) -> bool {
    let len = data.len().min(memory.end().saturating_sub(address));
    memory.slice_mut(address, len).copy_from_slice(&data[..len]);
    len > 0
}

/// Takes bytes from the memory, as far as there is any. Whether there is some.
fn take(memory: &Memory, address: usize, data: &mut [u8]) -> bool {
    let len = data.len().min(memory.end().saturating_sub(address));
    data[..len].copy_from_slice(memory.slice(address, len));
    len > 0
}
