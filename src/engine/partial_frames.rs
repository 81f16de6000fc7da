//! Command frames that arrive piece by piece, put together (CONFIG3, SK-5).
//!
//! A frame that does not arrive completely is none: it is counted as incomplete and as nothing else, takes no FIFO entry
//! and raises no CRC error count. What of it comes after it was dropped begins the next frame \[OURS]: with checking on,
//! that one fails its CRC, and so do those after it until the bytes pause for 100 cycles.

use crate::fieldbus::Ns;
use crate::sk::{Frame, SlotSize};

/// "A command frame that does not arrive completely within 100 cycles is dropped" (UG17 1.3.4). The cycles are those of
/// the time when that is found out \[OURS]: of the EtherCAT cycle in OP, of the default cycle before.
pub const INCOMPLETE_CYCLES: u64 = 100;

/// CONFIG3: what becomes of a command frame that does not arrive completely.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PartialFrames {
    /// High or floating: after [`INCOMPLETE_CYCLES`] it is dropped.
    #[default]
    Dropped,
    /// Low: the rest is waited for.
    Awaited,
}

/// The frame under way.
#[derive(Debug)]
pub(super) struct Assembler {
    frame: Frame,
    filled: usize,
    /// When its first byte came.
    began: Ns,
}

impl Assembler {
    pub(super) fn new() -> Self {
        Self { frame: Frame::new(), filled: 0, began: 0 }
    }

    /// Takes those bytes that belong to the frame under way and says how many they were.
    pub(super) fn take(&mut self, bytes: &[u8], at: Ns, size: SlotSize) -> usize {
        if self.filled == 0 {
            self.began = at;
        }
        let taken = bytes.len().min(size.frame_len() - self.filled);
        self.frame.bytes_mut()[self.filled..][..taken].copy_from_slice(&bytes[..taken]);
        self.filled += taken;
        taken
    }

    /// The frame, once it is complete; the next one begins.
    pub(super) fn complete(&mut self, size: SlotSize) -> Option<&Frame> {
        if self.filled < size.frame_len() {
            return None;
        }
        self.filled = 0;
        Some(&self.frame)
    }

    /// The next byte begins a frame. Says whether bytes of another one are forgotten with it.
    pub(super) fn forget(&mut self) -> bool {
        std::mem::take(&mut self.filled) > 0
    }

    /// Drops a frame of which some bytes have come, if its first one came longer ago than `limit_ns`; says how many.
    pub(super) fn drop_late(&mut self, now: Ns, limit_ns: Ns) -> Option<usize> {
        let late = self.filled > 0 && now - self.began > limit_ns;
        late.then(|| std::mem::take(&mut self.filled))
    }
}
