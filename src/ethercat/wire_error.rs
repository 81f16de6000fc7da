//! Why bytes from the wire are not what they should be, or do not fit where they are written to.

use core::fmt;

/// Bytes are not what they are decoded as, or there is no room for what is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WireError {
    /// The bytes end before the part does.
    Short {
        /// What is decoded, as in `datagram header`.
        part: &'static str,
        /// How many bytes it has.
        needed: usize,
        /// How many bytes there are.
        found: usize,
    },
    /// A field has a value that the format does not allow.
    Field {
        /// The field, as in `EtherType`.
        part: &'static str,
        /// The value that is there.
        found: u32,
        /// What may be there.
        allowed: &'static str,
    },
    /// What is encoded is longer than the room for it.
    NoRoom {
        /// What is encoded.
        part: &'static str,
        /// How many bytes it has.
        needed: usize,
        /// How many bytes there are.
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

/// The first `N` bytes, and those behind them.
///
/// # Errors
/// There are fewer.
pub(crate) fn split<'a, const N: usize>(
    bytes: &'a [u8],
    part: &'static str,
) -> Result<(&'a [u8; N], &'a [u8]), WireError> {
    bytes.split_first_chunk().ok_or(WireError::Short { part, needed: N, found: bytes.len() })
}

/// The first `len` bytes of room.
///
/// # Errors
/// There are fewer.
pub(crate) fn room_for<'a>(room: &'a mut [u8], part: &'static str, len: usize) -> Result<&'a mut [u8], WireError> {
    let found = room.len();
    room.get_mut(..len).ok_or(WireError::NoRoom { part, needed: len, room: found })
}
