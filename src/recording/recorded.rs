//! A frame in a recording.

use super::address::Address;
#[cfg(doc)]
use super::meta::RecordMeta;
use crate::sk::{Dir, Frame};

/// A frame in a recording, with its time, its direction and the address of its board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// The time of the frame, nanoseconds. In a recording it is the link's time plus [`RecordMeta::base_ns`]; in a
    /// capture of a real board it counts from 1970-01-01.
    pub at_ns: u64,
    /// The direction: to the board, or from it.
    pub dir: Dir,
    /// The bytes of the frame. Bytes that the capture cut off are 0. In a box, because what reads a recording moves frames often.
    pub frame: Box<Frame>,
    /// The number of the USB bus, as the operating system has assigned it.
    pub bus: u16,
    /// The number of the board on its bus. It changes when the board is plugged in again.
    pub device: u8,
    /// How many damaged parts of the file, which were skipped, come before the frame: the frames there are missing.
    pub damage_before: u64,
}

impl Recorded {
    /// The USB address of the board.
    pub const fn address(&self) -> Address {
        Address { bus: self.bus, device: self.device }
    }
}
