//! The part of the chip's flash memory that holds files for FoE transfers with slaves, kept in RAM.

use crate::xf::request::{FlashAddress, FlashBytes};

/// Size of the flash memory for files in bytes (XF EN 1598).
pub const FLASH_BYTES: usize = FlashAddress::MAX.get() as usize + 1;
/// The value of an erased byte.
const ERASED: u8 = 0xFF;

pub(super) struct Flash {
    memory: Vec<u8>,
    read: [u8; FlashBytes::MAX.get() as usize],
    /// Number of bytes in `read`; `None` if nothing was read.
    len: Option<usize>,
}

impl Flash {
    pub fn new() -> Self {
        Self { memory: vec![ERASED; FLASH_BYTES], read: [0; FlashBytes::MAX.get() as usize], len: None }
    }

    /// Resets as at power-on; the memory keeps its content.
    pub const fn reset(&mut self) {
        self.len = None;
    }

    /// Whether the range of `bytes` from `start` on is within the memory.
    pub const fn has(start: u32, bytes: usize) -> bool {
        start as usize + bytes <= FLASH_BYTES
    }

    pub fn read(&mut self, start: u32, bytes: u16) {
        let bytes = usize::from(bytes);
        if let Some(found) = self.memory.get(start as usize..start as usize + bytes) {
            self.read[..bytes].copy_from_slice(found);
            self.len = Some(bytes);
        }
    }

    /// Writes the memory. `[OURS]` The chip erases the bytes first, so the host need not erase them.
    pub fn write(&mut self, start: u32, data: &[u8]) {
        if let Some(place) = self.memory.get_mut(start as usize..start as usize + data.len()) {
            place.copy_from_slice(data);
        }
    }

    /// The bytes that were read last; `None` before the first read.
    pub fn result(&self) -> Option<&[u8]> {
        self.len.map(|len| &self.read[..len])
    }

    pub fn memory(&self) -> &[u8] {
        &self.memory
    }
}
