//! The type of a check word: fixed or CRC-32.

#[cfg(doc)]
use super::FIXED_CHECK;

/// The type of a check word: the parameter of CRC_TYPE_SET, and bits 1 and 0 of byte 0x0A of an answer. The values 1
/// and 2 are undefined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum CheckType {
    /// 0: the fixed word [`FIXED_CHECK`], the chip's setting at power-on (OBS).
    #[default]
    Fixed = 0,
    /// 3: a CRC-32 of the header and the data segment.
    Crc32 = 3,
}

impl CheckType {
    /// The type with this code; `None` unless it is 0 or 3.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Fixed),
            3 => Some(Self::Crc32),
            _ => None,
        }
    }

    /// The code on the wire: 0 or 3.
    pub const fn code(self) -> u8 {
        self as u8
    }
}
