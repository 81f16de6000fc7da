//! The memory of a slave controller: registers below 0x1000, RAM above, and which bytes the network can write.

use super::EscSettings;
use crate::ethercat::registers::{
    self, CLOCK_REGISTERS, FMMU, FMMU_LEN, Features, MAP, RAM, RegisterAccess, SYNC_MANAGER, SYNC_MANAGER_LEN,
};

/// What the network can do with a byte of the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteAccess {
    /// The byte belongs to no register, so the network can neither read nor write it.
    Absent,
    Read,
    Write,
    /// The byte belongs to a group of counters. A write clears the whole group, whatever the data.
    Clear,
}

const REGISTERS: usize = RAM as usize;

/// The access of the network to each byte of the registers, computed from the register table [`MAP`].
static REGISTER_BYTES: [ByteAccess; REGISTERS] = {
    let mut bytes = [ByteAccess::Absent; REGISTERS];
    let mut n = 0;
    while n < MAP.len() {
        let register = &MAP[n];
        let access = match register.access {
            RegisterAccess::Read => ByteAccess::Read,
            RegisterAccess::Write => ByteAccess::Write,
            RegisterAccess::Clear => ByteAccess::Clear,
        };
        let mut at = register.address;
        while at < register.address + register.len {
            bytes[at as usize] = access;
            at += 1;
        }
        n += 1;
    }
    bytes
};

/// The registers and the RAM of one slave controller.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    bytes: Box<[u8]>,
    fmmus_end: u16,
    managers_end: u16,
    has_clock: bool,
    is_divider_fixed: bool,
}

impl Memory {
    pub(super) fn new(settings: &EscSettings) -> Self {
        let ram = usize::from(settings.ram_kib.clamp(1, 60)) * 1024;
        Self {
            bytes: vec![0; REGISTERS + ram].into(),
            fmmus_end: FMMU + u16::from(settings.fmmus.min(16)) * FMMU_LEN as u16,
            managers_end: SYNC_MANAGER + u16::from(settings.sync_managers.min(16)) * SYNC_MANAGER_LEN as u16,
            has_clock: settings.features.contains(Features::CLOCK),
            is_divider_fixed: settings.fixed_watchdog_divider.is_some(),
        }
    }

    /// Sets all bytes to 0, the state at power-on.
    pub(super) fn clear(&mut self) {
        self.bytes.fill(0);
    }

    /// The first address after the RAM.
    pub(super) fn end(&self) -> usize {
        self.bytes.len()
    }

    /// The access of the network to the byte at an address.
    pub(super) fn access(&self, address: usize) -> ByteAccess {
        let Some(access) = REGISTER_BYTES.get(address) else {
            return if address < self.bytes.len() { ByteAccess::Write } else { ByteAccess::Absent };
        };
        let at = address as u16;
        let is_absent = (FMMU..registers::FMMU + 16 * FMMU_LEN as u16).contains(&at) && at >= self.fmmus_end
            || (SYNC_MANAGER..SYNC_MANAGER + 16 * SYNC_MANAGER_LEN as u16).contains(&at) && at >= self.managers_end
            || CLOCK_REGISTERS.contains(&at) && !self.has_clock;
        let is_fixed = self.is_divider_fixed && at & !1 == registers::WATCHDOG_DIVIDER;
        match access {
            _ if is_absent => ByteAccess::Absent,
            ByteAccess::Write if is_fixed => ByteAccess::Read,
            access => *access,
        }
    }

    /// The `len` bytes from an address on; empty if the memory does not contain all of them.
    pub(super) fn slice(&self, address: usize, len: usize) -> &[u8] {
        self.bytes.get(address..address.saturating_add(len)).unwrap_or_default()
    }

    pub(super) fn slice_mut(&mut self, address: usize, len: usize) -> &mut [u8] {
        self.bytes.get_mut(address..address.saturating_add(len)).unwrap_or_default()
    }

    /// The `N` bytes of the register at an address.
    pub(super) fn get<const N: usize>(&self, address: u16) -> [u8; N] {
        self.bytes[usize::from(address)..].first_chunk().copied().unwrap_or([0; N])
    }

    pub(super) fn put(&mut self, address: u16, bytes: &[u8]) {
        let address = usize::from(address);
        self.bytes[address..address + bytes.len()].copy_from_slice(bytes);
    }

    pub(super) fn u8(&self, address: u16) -> u8 {
        self.bytes[usize::from(address)]
    }

    pub(super) fn u16(&self, address: u16) -> u16 {
        u16::from_le_bytes(self.get(address))
    }

    pub(super) fn u32(&self, address: u16) -> u32 {
        u32::from_le_bytes(self.get(address))
    }

    pub(super) fn u64(&self, address: u16) -> u64 {
        u64::from_le_bytes(self.get(address))
    }

    pub(super) fn set_u8(&mut self, address: u16, value: u8) {
        self.put(address, &[value]);
    }

    pub(super) fn set_u16(&mut self, address: u16, value: u16) {
        self.put(address, &value.to_le_bytes());
    }

    pub(super) fn set_u32(&mut self, address: u16, value: u32) {
        self.put(address, &value.to_le_bytes());
    }

    pub(super) fn set_u64(&mut self, address: u16, value: u64) {
        self.put(address, &value.to_le_bytes());
    }

    /// Increments a counter, which stops at 0xFF.
    pub(super) fn count(&mut self, address: u16) {
        self.set_u8(address, self.u8(address).saturating_add(1));
    }
}

/// Copies bytes like `copy_from_slice`. But 8 to 16 bytes, a usual length of process data, are copied by two moves
/// without a function call, because the call would take longer than the copying.
///
/// # Panics
/// If the lengths differ.
#[inline]
pub(super) fn copy(to: &mut [u8], from: &[u8]) {
    if to.len() != from.len() || to.len() > 16 {
        return to.copy_from_slice(from);
    }
    let (Some(first), Some(last)) = (from.first_chunk::<8>(), from.last_chunk::<8>()) else {
        return to.copy_from_slice(from);
    };
    // 8 to 16 bytes are copied as the first 8 bytes and the last 8 bytes, which may overlap.
    if let Some(to) = to.first_chunk_mut() {
        *to = *first;
    }
    if let Some(to) = to.last_chunk_mut() {
        *to = *last;
    }
}
