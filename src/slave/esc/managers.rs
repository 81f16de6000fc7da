//! The sync managers of a slave controller: mailbox mode with its handshake, and buffered mode with three buffers, in
//! which the reader gets the newest buffer.
//!
//! Accessing the first byte opens a buffer, and accessing the last byte closes it. \[OURS] A buffer opens and closes when the
//! slave processes the datagram, not at the end of the frame.

mod manager;

use super::memory::{Memory, copy};
use crate::ethercat::registers::{
    self, BufferMode, SYNC_MANAGER_LEN, SmActivate, SmControl, SmDirection, SmPdiControl, SmStatus, SyncManager,
};

use manager::{Manager, Side};

/// The maximum number of sync managers of a slave controller.
pub(super) const MANAGERS_MAX: usize = 16;

/// The accesses of the network to sync managers since the slave last took these events, one bit per sync manager.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ManagerEvents {
    /// Bit n: the network has written the whole buffer of sync manager n since the slave last took these events.
    pub(super) written: u16,
    /// Bit n: the network has read the whole buffer of sync manager n since the slave last took these events.
    pub(super) read: u16,
    /// Bit n: the network has written the activate register of sync manager n since the slave last took these events.
    pub(super) activated: u16,
}

#[derive(Clone, Debug)]
#[repr(C)] // The fields that each frame uses are adjacent, at the beginning.
pub(super) struct Managers {
    pub(super) events: ManagerEvents,
    /// The sync managers on the fast path, bit n for sync manager n: the network writes (`writable`) or reads (`readable`)
    /// their whole buffer with one copy. They are in buffered mode and in RAM, and no earlier sync manager overlaps them. Other
    /// accesses search the sync manager of each byte range.
    writable: u16,
    readable: u16,
    /// The sync managers that are enabled and have an area, one bit each.
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

    /// Updates the registers of a sync manager in the memory.
    fn show(&self, n: usize, memory: &mut Memory) {
        memory.put(registers::sync_manager(n as u8), &self.managers[n].registers.encode());
    }

    /// Updates the status registers in the memory. Must be called before the network reads them, because accesses to buffers
    /// change only the decoded status in [`Manager`].
    pub(super) fn show_statuses(&self, memory: &mut Memory) {
        for n in 0..self.count {
            memory.set_u8(registers::sync_manager_status(n), self.registers(n).status.0);
        }
    }

    /// Writes a byte of the registers for the network. `offset` counts from the first register of sync manager 0.
    pub(super) fn write_register(&mut self, offset: u16, value: u8, memory: &mut Memory) {
        let (n, at) = (usize::from(offset) / SYNC_MANAGER_LEN, usize::from(offset) % SYNC_MANAGER_LEN);
        let manager = &mut self.managers[n];
        let mut bytes = manager.registers.encode();
        match at {
            // Start, length and control are write-protected while the sync manager is enabled.
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

    /// Computes which sync managers allow the fast path, see [`Self::writable`] and [`Self::readable`].
    fn find_whole(&mut self, memory: &Memory) {
        (self.writable, self.readable) = (0, 0);
        for n in 0..usize::from(self.count) {
            let manager = &self.managers[n];
            let area = manager.area();
            let end = manager.buffer_start(2) + usize::from(manager.registers.len);
            // An address belongs to the first sync manager whose area contains it.
            let mut before = self.managers[..n].iter().filter(|other| other.is_active()).map(Manager::area);
            let is_first = before.all(|other| other.end <= area.start || area.end <= other.start);
            let is_whole = manager.is_usable() && !manager.is_mailbox() && end <= memory.end() && is_first;
            for (side, bits) in [(Side::Writer, &mut self.writable), (Side::Reader, &mut self.readable)] {
                *bits |= u16::from(is_whole && manager.is_open_to(side)) << n;
            }
        }
    }

    /// The sync managers for [`Self::write_whole`], one bit each: in buffered mode, open to writes of the network, in RAM, and
    /// not overlapped by an earlier sync manager.
    pub(super) const fn writable(&self) -> u16 {
        self.writable
    }

    /// The sync managers for [`Self::read_whole`], one bit each: in buffered mode, open to reads of the network, in RAM, and
    /// not overlapped by an earlier sync manager.
    pub(super) const fn readable(&self) -> u16 {
        self.readable
    }

    /// A mask with the bit of the first enabled sync manager that has exactly this start address and length; 0 if there is
    /// none. An FMMU that maps the same bytes can take the fast path.
    pub(super) fn of_area(&self, start: u16, len: u16) -> u16 {
        let has_it =
            |manager: &Manager| manager.is_active() && manager.registers.start == start && manager.registers.len == len;
        self.managers.iter().position(has_it).map_or(0, |n| 1 << n)
    }

    /// The status of a sync manager before its first access: no event. In buffered mode, the field for the last written
    /// buffer is 3, which means that no buffer was written.
    fn idle(control: SmControl) -> SmStatus {
        match control.mode() {
            BufferMode::Buffered => SmStatus::NONE.with_last_buffer(3),
            _ => SmStatus::NONE,
        }
    }

    /// The enabled sync manager whose area contains an address, with the end of that area; or `None`, with the start of the
    /// next area.
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

    /// Writes a whole buffer of a [writable](Self::writable) sync manager from the network. Returns whether this restarts the
    /// process data watchdog.
    #[inline]
    pub(super) fn write_whole(&mut self, n: usize, data: &[u8], memory: &mut Memory) -> bool {
        let manager = &mut self.managers[n];
        let start = manager.fill();
        copy(memory.slice_mut(start, data.len()), data);
        self.events.written |= 1 << n;
        manager.registers.control.contains(SmControl::WATCHDOG)
    }

    /// Reads the newest whole buffer of a [readable](Self::readable) sync manager for the network.
    #[inline]
    pub(super) fn read_whole(&mut self, n: usize, data: &mut [u8], memory: &Memory) {
        let start = self.managers[n].drain();
        copy(data, memory.slice(start, data.len()));
        self.events.read |= 1 << n;
    }

    /// Writes bytes from address 0x1000 on for the network. Bytes in the area of a sync manager go through its buffers. Returns
    /// whether any byte was written.
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

    /// Reads bytes from address 0x1000 on for the network. Bytes in the area of a sync manager come from its buffers. Returns
    /// whether any byte was read; other bytes of `data` are left unchanged.
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

    /// Writes a whole buffer on behalf of the slave's processor. Returns false if the sync manager is off or its mailbox is
    /// full.
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

    /// Reads a whole buffer on behalf of the slave's processor; `None` if the sync manager is off or its mailbox is empty.
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

    /// Takes a message that the network has not read yet out of the mailbox, because a repeated message goes first. Returns the
    /// whole mailbox, message and padding; `None` if the sync manager is off or the mailbox is empty.
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

    /// Acknowledges a repeat that the master has requested.
    pub(super) fn acknowledge_repeat(&mut self, n: u8, memory: &mut Memory) {
        let SyncManager { activate, pdi, .. } = self.managers[usize::from(n)].registers;
        let wanted = activate.contains(SmActivate::REPEAT);
        let acknowledge = SmPdiControl::REPEAT_ACKNOWLEDGE;
        let pdi = if wanted { pdi.with(acknowledge) } else { pdi.without(acknowledge) };
        self.managers[usize::from(n)].registers.pdi = pdi;
        self.show(n.into(), memory);
    }

    /// Deactivates a sync manager on behalf of the slave's processor, or activates it again.
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

/// Writes bytes into the memory, up to the end of the memory. Returns whether any byte was written.
fn put(memory: &mut Memory, address: usize, data: &[u8]) -> bool {
    let len = data.len().min(memory.end().saturating_sub(address));
    memory.slice_mut(address, len).copy_from_slice(&data[..len]);
    len > 0
}

/// Reads bytes from the memory, up to the end of the memory. Returns whether any byte was read.
fn take(memory: &Memory, address: usize, data: &mut [u8]) -> bool {
    let len = data.len().min(memory.end().saturating_sub(address));
    data[..len].copy_from_slice(memory.slice(address, len));
    len > 0
}
