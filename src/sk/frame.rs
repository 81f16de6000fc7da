//! A frame: the 512 bytes that travel each way, and access to its slots.

use super::crc::{CRC_BYTE, CrcError, CrcPolicy, CrcStatus, frame_crc};
use super::slot::{RawSlot, Slot12, Slot16, SlotSize, Slots};
use super::{MasterCommand, SdoCommand, SlotCommand};

/// Size of a frame in bytes as it is sent, equal to the board's USB report. With slots of 12 bytes the first 504 are
/// used.
pub const FRAME_LEN: usize = 512;

/// One command or response frame. It always carries 512 bytes; the slot size is an argument where it matters.
#[derive(Clone, PartialEq, Eq)]
pub struct Frame {
    bytes: [u8; FRAME_LEN],
}

impl Frame {
    /// A frame of zeros: GET_STATUS in every slot, and no CRC.
    pub const fn new() -> Self {
        Self { bytes: [0; FRAME_LEN] }
    }

    /// A frame with the given bytes.
    pub const fn from_bytes(bytes: [u8; FRAME_LEN]) -> Self {
        Self { bytes }
    }

    /// A frame with the first 512 bytes of `bytes`; missing bytes are 0.
    pub fn from_prefix(bytes: &[u8]) -> Self {
        let mut frame = Self::new();
        frame.set_prefix(bytes);
        frame
    }

    /// Overwrites the frame with the first 512 bytes of `bytes`; missing bytes become 0.
    #[inline]
    pub fn set_prefix(&mut self, bytes: &[u8]) {
        let (start, rest) = self.bytes.split_at_mut(bytes.len().min(FRAME_LEN));
        start.copy_from_slice(&bytes[..start.len()]);
        rest.fill(0);
    }

    /// The 512 bytes of the frame, for reading.
    pub const fn bytes(&self) -> &[u8; FRAME_LEN] {
        &self.bytes
    }

    /// The 512 bytes of the frame, for writing.
    pub const fn bytes_mut(&mut self) -> &mut [u8; FRAME_LEN] {
        &mut self.bytes
    }

    /// The bytes of the frame that are sent: 504 with slots of 12 bytes, 512 with slots of 16.
    pub fn wire(&self, size: SlotSize) -> &[u8] {
        &self.bytes[..size.frame_len()]
    }

    /// The slots, borrowed from the frame without a copy.
    pub fn slots(&self, size: SlotSize) -> Slots<'_> {
        match size {
            SlotSize::Bytes12 => Slots::Narrow(bytemuck::from_bytes(&self.bytes[..size_of::<[Slot12; 42]>()])),
            SlotSize::Bytes16 => Slots::Wide(bytemuck::from_bytes(&self.bytes[..size_of::<[Slot16; 32]>()])),
        }
    }

    /// The fields of slot `i`.
    ///
    /// # Panics
    /// If a frame of this size has no slot `i`.
    pub fn slot(&self, size: SlotSize, i: usize) -> RawSlot {
        self.slots(size).get(i)
    }

    /// Writes all bytes of slot `i`. In 12-byte mode there is no room for `data3`, which is left out.
    ///
    /// # Panics
    /// If a frame of this size has no slot `i`.
    #[inline]
    pub fn put(&mut self, size: SlotSize, i: usize, slot: &RawSlot) {
        assert!(i < size.slots(), "slot {i} of {}", size.slots());
        let at = i * size.bytes();
        match size {
            SlotSize::Bytes12 => self.bytes[at..at + 12].copy_from_slice(bytemuck::bytes_of(&slot.to_narrow())),
            SlotSize::Bytes16 => self.bytes[at..at + 16].copy_from_slice(bytemuck::bytes_of(&slot.to_wide())),
        }
    }

    /// Writes a command for the board itself into slot 0 and sets byte 3, the frame's CRC, to 0.
    pub fn put_master(&mut self, size: SlotSize, command: &MasterCommand) {
        self.put(size, 0, &command.encode());
    }

    /// Writes a command into the slot of `slave`, 1..=40 (1..=30 in 16-byte mode).
    ///
    /// # Panics
    /// If a frame of this size has no slot for that slave.
    pub fn put_slave(&mut self, size: SlotSize, slave: usize, command: &SlotCommand) {
        assert!((1..=size.max_slaves()).contains(&slave), "slave {slave} of {}", size.max_slaves());
        self.put(size, slave, &command.encode(size));
    }

    /// Writes a command into the SDO slot.
    pub fn put_sdo(&mut self, size: SlotSize, command: &SdoCommand) {
        self.put(size, size.sdo_slot(), &command.encode());
    }

    /// The value of byte 3, which is the place of the frame's CRC.
    pub const fn crc_byte(&self) -> u8 {
        self.bytes[CRC_BYTE]
    }

    /// The CRC-8 over the frame, which belongs in byte 3.
    pub fn crc(&self, size: SlotSize) -> u8 {
        frame_crc(self.wire(size))
    }

    /// Writes the CRC-8 into byte 3. Any later change of the frame makes it wrong.
    pub fn fill_crc(&mut self, size: SlotSize) {
        self.bytes[CRC_BYTE] = self.crc(size);
    }

    /// Checks the CRC in byte 3.
    ///
    /// # Errors
    /// [`CrcError`] if byte 3 is not the frame's CRC; under [`CrcPolicy::AbsentAllowed`] a 0 passes.
    pub fn check_crc(&self, size: SlotSize, policy: CrcPolicy) -> Result<(), CrcError> {
        let found = self.crc_byte();
        if found == 0 && policy == CrcPolicy::AbsentAllowed {
            return Ok(());
        }
        let expected = self.crc(size);
        if found == expected { Ok(()) } else { Err(CrcError { expected, found }) }
    }

    /// How byte 3 compares with the frame's CRC, for display.
    pub fn crc_status(&self, size: SlotSize) -> CrcStatus {
        match self.check_crc(size, CrcPolicy::Strict) {
            Ok(()) => CrcStatus::Right(self.crc_byte()),
            Err(CrcError { expected, found: 0 }) => CrcStatus::Absent { expected },
            Err(error) => CrcStatus::Wrong(error),
        }
    }
}

impl Default for Frame {
    fn default() -> Self {
        Self::new()
    }
}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Frame[")?;
        for byte in self.bytes.iter().take(16) {
            write!(f, "{byte:02x}")?;
        }
        write!(f, "..]")
    }
}

/// The direction of a frame between host and board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dir {
    /// Commands to the board.
    Write = 0,
    /// Reports from the board.
    Read = 1,
}

impl core::fmt::Display for Dir {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Write => "write",
            Self::Read => "read",
        })
    }
}
