//! FMMUs: which bits of the logical process image are which bits of a slave's memory.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::{U16Le, U32Le, bits};

/// Bytes of the registers of one FMMU.
pub const FMMU_LEN: usize = 16;

bits! {
    /// What an FMMU is for.
    FmmuDirections(u8) {
        /// Bit 0: the master reads the slave's memory: inputs.
        READ = 1 << 0;
        /// Bit 1: the master writes the slave's memory: outputs.
        WRITE = 1 << 1;
    }
}

/// The registers as bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// 0.
    logical: U32Le,
    /// 4.
    len: U16Le,
    /// 6.
    first_bit: u8,
    /// 7.
    last_bit: u8,
    /// 8.
    physical: U16Le,
    /// 10.
    physical_bit: u8,
    /// 11.
    directions: u8,
    /// 12.
    activate: u8,
    /// 13..=15.
    reserved: [u8; 3],
}

const _: () = assert!(size_of::<Layout>() == FMMU_LEN && align_of::<Layout>() == 1);

/// The registers of one FMMU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Fmmu {
    /// The logical address of the first byte.
    pub logical: u32,
    /// How many logical bytes are touched.
    pub len: u16,
    /// The first bit in the first byte, 0..=7.
    pub first_bit: u8,
    /// The last bit in the last byte, 0..=7.
    pub last_bit: u8,
    /// The address of the first byte in the slave.
    pub physical: u16,
    /// The first bit in that byte, 0..=7.
    pub physical_bit: u8,
    /// Inputs or outputs.
    pub directions: FmmuDirections,
    /// Whether the FMMU maps anything.
    pub enabled: bool,
}

impl Fmmu {
    /// An enabled FMMU that maps whole bytes.
    pub const fn bytes(logical: u32, len: u16, physical: u16, directions: FmmuDirections) -> Self {
        Self { logical, len, first_bit: 0, last_bit: 7, physical, physical_bit: 0, directions, enabled: true }
    }

    /// Decodes the registers. Of the bit numbers the lower 3 bits count; the reserved bytes are left out.
    pub fn decode(bytes: &[u8; FMMU_LEN]) -> Self {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        Self {
            logical: layout.logical.get(),
            len: layout.len.get(),
            first_bit: layout.first_bit & 7,
            last_bit: layout.last_bit & 7,
            physical: layout.physical.get(),
            physical_bit: layout.physical_bit & 7,
            directions: FmmuDirections(layout.directions),
            enabled: layout.activate & 1 != 0,
        }
    }

    /// The registers as bytes.
    pub fn encode(&self) -> [u8; FMMU_LEN] {
        bytemuck::cast(Layout {
            logical: self.logical.into(),
            len: self.len.into(),
            first_bit: self.first_bit,
            last_bit: self.last_bit,
            physical: self.physical.into(),
            physical_bit: self.physical_bit,
            directions: self.directions.0,
            activate: self.enabled.into(),
            reserved: [0; 3],
        })
    }

    /// How many bits are mapped.
    pub const fn bits(&self) -> u32 {
        if self.len == 0 {
            return 0;
        }
        ((self.len as u32 - 1) * 8 + self.last_bit as u32 + 1).saturating_sub(self.first_bit as u32)
    }

    /// Whether the FMMU maps whole bytes onto whole bytes.
    pub const fn is_bytewise(&self) -> bool {
        self.first_bit == 0 && self.last_bit == 7 && self.physical_bit == 0
    }
}
