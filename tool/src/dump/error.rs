//! Errors that end a dump.

use std::io;

use ecmsk::sk::SlotSize;

use super::LINE_BYTES_MAX;
use super::hex::HexError;

/// Why `ecmsk dump` stopped.
#[derive(Debug, thiserror::Error)]
pub enum DumpError {
    /// Standard input cannot be read.
    #[error("cannot read standard input: {0}; give it lines of hexadecimal digits")]
    Input(io::Error),
    /// `--hex` is given with the recording of a board. With a file, `--hex` shows the bytes of packets, and only the
    /// recording of a chip has packets.
    #[error(
        "{name} is no recording of a chip, and --hex reads frames from standard input: leave out --hex, or the file"
    )]
    HexOfBoard {
        /// The name of the recording's file.
        name: String,
    },
    /// A line of hexadecimal digits is not a frame.
    #[error("line {line}: {problem}; put `#` before lines that are not frames")]
    Line {
        /// The number of the line, from 1.
        line: u64,
        /// What is wrong with the line.
        problem: HexError,
    },
    /// A line of standard input is longer than the digits of the longest frame.
    #[error("line {line} is longer than {LINE_BYTES_MAX} bytes; give one frame per line, as hexadecimal digits")]
    LongLine {
        /// The number of the line, from 1.
        line: u64,
    },
    /// A frame that is given in hexadecimal digits is too short for the slot size.
    #[error("line {line}: {len} bytes are no frame of 16-byte slots, which has 512; leave out --slot-size 16")]
    TooShort {
        /// The number of the line, from 1.
        line: u64,
        /// The number of bytes on the line.
        len: usize,
    },
    /// The frames are too short to have a slot that `--slots` requests.
    #[error("a frame of {}-byte slots has no slot {slot}; name slots from 0 to {}", .size.bytes(), .size.sdo_slot())]
    NoSlot {
        /// The first requested slot that the frames do not have.
        slot: usize,
        /// The frames' slot size.
        size: SlotSize,
    },
}
