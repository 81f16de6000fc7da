//! Registers of PHYs, as memory.

use crate::xf::request::Mdio;
use crate::xf::response::MdioAnswer;

/// Addresses of PHYs, and registers of each (IEEE 802.3 clause 22).
const NUMBERS: usize = 32;

pub(super) struct Phys {
    registers: [[u16; NUMBERS]; NUMBERS],
}

impl Phys {
    /// `[OURS]` All registers are 0.
    pub const fn new() -> Self {
        Self { registers: [[0; NUMBERS]; NUMBERS] }
    }

    /// A register; `None` if there is no such one.
    pub fn register_mut(&mut self, phy: u8, register: u8) -> Option<&mut u16> {
        self.registers.get_mut(usize::from(phy))?.get_mut(usize::from(register))
    }

    /// `None`: there is no such register.
    pub fn run(&mut self, request: Mdio) -> Option<MdioAnswer> {
        Some(MdioAnswer(match request {
            Mdio::Write { phy, register, value } => {
                *self.register_mut(phy, register)? = value;
                None
            }
            Mdio::Read { phy, register } => Some(*self.register_mut(phy, register)?),
        }))
    }
}
