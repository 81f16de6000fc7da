//! A frame in a recording.

use super::address::Address;
#[cfg(doc)]
use super::meta::RecordMeta;
use crate::sk::{Dir, Frame};

/// A frame in a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// When it passed, nanoseconds: of the link's clock plus [`RecordMeta::base_ns`]; in a capture of a real board
    /// since 1970-01-01.
    pub at_ns: u64,
    /// To the board or from it.
    pub dir: Dir,
    /// All its bytes; what a capture does not have is 0.
    pub frame: Frame,
    /// The bus of a real board, as the system numbered it.
    pub bus: u16,
    /// The board on that bus; it changes when the board is plugged again.
    pub device: u8,
}

impl Recorded {
    /// Which board of a capture this is of.
    pub const fn address(&self) -> Address {
        Address { bus: self.bus, device: self.device }
    }
}
