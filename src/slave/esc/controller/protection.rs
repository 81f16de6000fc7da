//! Write protection, registers 0x0020 to 0x0031: while it is on, a frame must enable writing before it can write.
//!
//! Source: the data sheets of slave controllers ("write register enable", "ESC write enable"); rule ECAT-8.14.

use crate::ethercat::registers::{
    ESC_WRITE_ENABLE, ESC_WRITE_PROTECTION, RAM, WRITE_REGISTER_ENABLE, WRITE_REGISTER_PROTECTION,
};
use crate::slave::esc::memory::Memory;

/// The active write protections, and whether the present frame has written the registers that enable writing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Protection {
    /// Whether the registers are protected (`registers`), and whether the whole memory is (`all`).
    registers: bool,
    all: bool,
    may_write_registers: bool,
    may_write_all: bool,
}

impl Protection {
    /// Begins a frame. A write to an enable register allows writing for the rest of the same frame only.
    #[inline]
    pub(super) const fn begin_frame(&mut self) {
        if self.registers || self.all {
            (self.may_write_registers, self.may_write_all) = (false, false);
        }
    }

    /// Whether any protection is on.
    #[inline]
    pub(super) const fn is_on(self) -> bool {
        self.registers || self.all
    }

    /// Whether all writes are blocked: the whole memory is protected, and this frame has not enabled writing.
    #[inline]
    pub(super) const fn blocks_all(self) -> bool {
        self.all && !self.may_write_all
    }

    /// Whether a write to the byte at address `at` is blocked.
    pub(super) fn blocks(self, at: usize) -> bool {
        if at == usize::from(ESC_WRITE_ENABLE) {
            return false;
        }
        let is_free = at == usize::from(WRITE_REGISTER_ENABLE) || at >= usize::from(RAM);
        self.blocks_all() || self.registers && !self.may_write_registers && !is_free
    }

    /// Evaluates a write to any byte: it may enable writing or change the protection.
    pub(super) fn note_written(&mut self, at: usize, memory: &Memory) {
        let Ok(at) = u16::try_from(at) else { return };
        match at {
            WRITE_REGISTER_ENABLE => self.may_write_registers = true,
            ESC_WRITE_ENABLE => self.may_write_all = true,
            WRITE_REGISTER_PROTECTION => self.registers = memory.u8(at) & 1 != 0,
            ESC_WRITE_PROTECTION => self.all = memory.u8(at) & 1 != 0,
            _ => {}
        }
    }
}
