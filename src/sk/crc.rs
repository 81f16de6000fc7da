//! The CRC-8 of a frame: polynomial x^8+x^2+x+1, initial value 0x5A, over the frame with byte 3 taken as 0 (UG17 2.2).

use core::fmt;

use crc::{Algorithm, Crc, Table};

/// The parameters; over the ASCII digits `123456789` they give 0x58.
pub const ALGORITHM: Algorithm<u8> =
    Algorithm { width: 8, poly: 0x07, init: 0x5A, refin: false, refout: false, xorout: 0, check: 0x58, residue: 0 };

/// Where the CRC stands in a frame.
pub const CRC_BYTE: usize = 3;

static CRC8: Crc<u8, Table<16>> = Crc::<u8, Table<16>>::new(&ALGORITHM);

/// The CRC-8 that belongs into byte 3 of `frame`, whatever stands there now.
///
/// `frame` is a whole frame, 504 or 512 bytes; any other length gives the CRC over what there is.
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

/// What to make of a response whose byte 3 is 0 (SK-1: a host cannot see from one frame whether it carries a CRC).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CrcPolicy {
    /// 0 counts as "no CRC"; anything else must match.
    #[default]
    AbsentAllowed,
    /// Byte 3 must always match.
    Strict,
}

/// A frame whose byte 3 is not its CRC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrcError {
    /// What the frame's bytes give.
    pub expected: u8,
    /// What stood in byte 3.
    pub found: u8,
}

impl fmt::Display for CrcError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CRC-8 in byte 3 is 0x{:02X}, the frame's bytes give 0x{:02X}", self.found, self.expected)
    }
}

impl core::error::Error for CrcError {}

/// What byte 3 of a frame says, for a display; whether a frame may pass is [`CrcPolicy`]'s question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrcStatus {
    /// Byte 3 is the frame's CRC, this value (which may be 0).
    Right(u8),
    /// Byte 3 is 0, and that is not the frame's CRC: most likely nobody filled it in.
    Absent {
        /// What the frame's bytes give.
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
