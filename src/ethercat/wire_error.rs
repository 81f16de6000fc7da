//! The error type of the wire format: bytes that cannot be decoded, or a buffer too small for encoding.

use core::fmt;

/// Why bytes of an EtherCAT frame, mailbox message or EEPROM cannot be decoded, or why a value cannot be encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WireError {
    /// The bytes end before the header, message or field that is to be decoded.
    Short {
        /// What was to be decoded, such as `datagram header`.
        part: &'static str,
        /// The length of what was to be decoded, bytes.
        needed: usize,
        /// The number of bytes available.
        found: usize,
    },
    /// A field has a value that the format does not allow.
    Field {
        /// The name of the field, such as `EtherType`.
        part: &'static str,
        /// The value found.
        found: u32,
        /// The values that the field may have, as a text.
        allowed: &'static str,
    },
    /// The buffer is too small for encoding.
    NoRoom {
        /// What was to be encoded, such as `mailbox message`.
        part: &'static str,
        /// The length of what was to be encoded, bytes.
        needed: usize,
        /// The length of the buffer, bytes.
        room: usize,
    },
}

impl fmt::Display for WireError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { part, needed, found } => write!(f, "{part} has {needed} bytes, and only {found} are there"),
            Self::Field { part, found, allowed } => {
                write!(f, "{part} is {found} (0x{found:X}), allowed is {allowed}")
            }
            Self::NoRoom { part, needed, room } => write!(f, "{part} has {needed} bytes, and there is room for {room}"),
        }
    }
}

impl core::error::Error for WireError {}

/// Splits off the first `N` bytes.
///
/// # Errors
/// [`WireError::Short`]: there are fewer than `N` bytes.
pub(crate) fn split<'a, const N: usize>(
    bytes: &'a [u8],
    part: &'static str,
) -> Result<(&'a [u8; N], &'a [u8]), WireError> {
    bytes.split_first_chunk().ok_or(WireError::Short { part, needed: N, found: bytes.len() })
}

/// The first `len` bytes of the buffer `room`, for a caller that writes `part` into them.
pub(crate) fn room_for<'a>(room: &'a mut [u8], part: &'static str, len: usize) -> Result<&'a mut [u8], WireError> {
    let found = room.len();
    room.get_mut(..len).ok_or(WireError::NoRoom { part, needed: len, room: found })
}
