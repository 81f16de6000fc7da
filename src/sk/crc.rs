//! The CRC-8 of a frame: polynomial x^8+x^2+x+1, initial value 0x5A, over the frame with byte 3 taken as 0 (UG17 2.2).

use core::fmt;

use crc::{Algorithm, Crc, Table};

/// The parameters of the CRC. Its check value, the CRC over the ASCII digits `123456789`, is 0x58.
pub const ALGORITHM: Algorithm<u8> =
    Algorithm { width: 8, poly: 0x07, init: 0x5A, refin: false, refout: false, xorout: 0, check: 0x58, residue: 0 };

/// The offset of the CRC in a frame.
pub const CRC_BYTE: usize = 3;

static CRC8: Crc<u8, Table<16>> = Crc::<u8, Table<16>>::new(&ALGORITHM);

/// The CRC-8 that belongs in byte 3 of `frame`. The present value of that byte does not matter.
///
/// `frame` is a whole frame, 504 or 512 bytes. For any other length the result is the CRC over the bytes given.
pub fn frame_crc(frame: &[u8]) -> u8 {
    let mut digest = CRC8.digest();
    match frame.split_at_checked(CRC_BYTE + 1) {
        Some((head, rest)) => {
            digest.update(&[head[0], head[1], head[2], 0]);
            digest.update(rest);
        }
        None => digest.update(frame),
    }
    digest.finalize()
}

/// Whether a host accepts a response whose byte 3 is 0. Such a frame is ambiguous: the board may leave the CRC out, or
/// the frame's CRC may be 0 (SK-1.20).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CrcPolicy {
    /// A 0 in byte 3 counts as "no CRC" and is accepted; any other value must be the frame's CRC.
    #[default]
    AbsentAllowed,
    /// Byte 3 must be the frame's CRC, whatever its value.
    Strict,
}

/// The error that byte 3 of a frame is not its CRC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrcError {
    /// The CRC that was calculated over the frame, with byte 3 taken as 0.
    pub expected: u8,
    /// The value of byte 3.
    pub found: u8,
}

impl fmt::Display for CrcError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CRC-8 in byte 3 is 0x{:02X}, the frame's bytes give 0x{:02X}", self.found, self.expected)
    }
}

impl core::error::Error for CrcError {}

/// How byte 3 of a frame compares with the frame's CRC, for display. [`CrcPolicy`] decides whether a host accepts the
/// frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrcStatus {
    /// Byte 3 is the frame's CRC. The value of the CRC may be 0.
    Right(u8),
    /// Byte 3 is 0 and the frame's CRC is not: most likely the sender does not fill in a CRC.
    Absent {
        /// The CRC that was calculated over the frame, with byte 3 taken as 0.
        expected: u8,
    },
    /// Byte 3 is neither 0 nor the frame's CRC.
    Wrong(CrcError),
}

impl fmt::Display for CrcStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Right(crc) => write!(f, "CRC 0x{crc:02X} ok"),
            Self::Absent { .. } => f.write_str("CRC absent"),
            Self::Wrong(CrcError { expected, found }) => {
                write!(f, "CRC 0x{found:02X} wrong (expected 0x{expected:02X})")
            }
        }
    }
}
