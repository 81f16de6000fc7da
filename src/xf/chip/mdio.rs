//! Registers of PHYs, kept in RAM.

use crate::xf::request::Mdio;
use crate::xf::response::MdioAnswer;

/// Number of PHY addresses, and of registers per PHY (IEEE 802.3 clause 22).
const NUMBERS: usize = 32;

pub(super) struct Phys {
    registers: [[u16; NUMBERS]; NUMBERS],
}

impl Phys {
    /// Creates the registers of all PHYs. `[OURS]` They are 0.
    pub const fn new() -> Self {
        Self { registers: [[0; NUMBERS]; NUMBERS] }
    }

    /// A register of a PHY; `None` if it does not exist.
    pub fn register_mut(&mut self, phy: u8, register: u8) -> Option<&mut u16> {
        self.registers.get_mut(usize::from(phy))?.get_mut(usize::from(register))
    }

    /// Reads or writes a register; `None` if it does not exist.
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
