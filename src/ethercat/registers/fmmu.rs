//! FMMUs: the mapping between the logical process image and a slave's memory, bit by bit.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::{U16Le, U32Le, bits};

/// Length in bytes of the registers of one FMMU.
pub const FMMU_LEN: usize = 16;

bits! {
    /// The transfer directions that an FMMU is enabled for.
    FmmuDirections(u8) {
        /// Bit 0: the master reads the slave's memory: inputs.
        READ = 1 << 0;
        /// Bit 1: the master writes the slave's memory: outputs.
        WRITE = 1 << 1;
    }
}

/// Wire layout of the registers. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// Bytes 0..=3: logical start address.
    logical: U32Le,
    /// Bytes 4..=5: length, in logical bytes.
    len: U16Le,
    /// Byte 6: logical start bit.
    first_bit: u8,
    /// Byte 7: logical stop bit.
    last_bit: u8,
    /// Bytes 8..=9: physical start address.
    physical: U16Le,
    /// Byte 10: physical start bit.
    physical_bit: u8,
    /// Byte 11: directions.
    directions: u8,
    /// Byte 12: activate.
    activate: u8,
    /// Bytes 13..=15: reserved.
    reserved: [u8; 3],
}

const _: () = assert!(size_of::<Layout>() == FMMU_LEN && align_of::<Layout>() == 1);

/// The registers of one FMMU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Fmmu {
    /// The logical address of the first byte.
    pub logical: u32,
    /// The number of logical bytes that contain mapped bits.
    pub len: u16,
    /// The first mapped bit in the first logical byte, 0..=7.
    pub first_bit: u8,
    /// The last mapped bit in the last logical byte, 0..=7.
    pub last_bit: u8,
    /// The address of the first byte in the memory of the slave.
    pub physical: u16,
    /// The first mapped bit in that byte, 0..=7.
    pub physical_bit: u8,
    /// Read (inputs), write (outputs), or both.
    pub directions: FmmuDirections,
    /// Whether the FMMU is active.
    pub enabled: bool,
}

impl Fmmu {
    /// An enabled FMMU that maps whole bytes.
    pub const fn bytes(logical: u32, len: u16, physical: u16, directions: FmmuDirections) -> Self {
        Self { logical, len, first_bit: 0, last_bit: 7, physical, physical_bit: 0, directions, enabled: true }
    }

    /// Decodes the registers. Only the lower 3 bits of the bit numbers are used; the reserved bytes are ignored.
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

    /// The number of mapped bits.
    pub const fn bits(&self) -> u32 {
        if self.len == 0 {
            return 0;
        }
        ((self.len as u32 - 1) * 8 + self.last_bit as u32 + 1).saturating_sub(self.first_bit as u32)
    }

    /// Whether the FMMU maps whole logical bytes to whole bytes of memory.
    pub const fn is_bytewise(&self) -> bool {
        self.first_bit == 0 && self.last_bit == 7 && self.physical_bit == 0
    }
}
