//! Assembles command frames that arrive in pieces (CONFIG3, SK-5).
//!
//! A frame that does not arrive completely is counted as incomplete and not executed: it takes no FIFO entry and does
//! not raise the CRC error count. Bytes of such a frame that come after it was dropped begin the next frame \[OURS]:
//! with CRC checking on, that frame fails its CRC, and so do the frames after it until no bytes come for 100 cycles.

use crate::fieldbus::Ns;
use crate::sk::{Frame, SlotSize};

/// "A command frame that does not arrive completely within 100 cycles is dropped" (UG17 1.3.4). The cycles are those in
/// force when the frame is dropped \[OURS]: EtherCAT cycles in OP, cycles of 1 ms, the default, before.
pub const INCOMPLETE_CYCLES: u64 = 100;

/// Pin CONFIG3: what happens to a command frame that does not arrive completely.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PartialFrames {
    /// CONFIG3 is high or floating: the frame is dropped after [`INCOMPLETE_CYCLES`].
    #[default]
    Dropped,
    /// CONFIG3 is low: the board waits for the rest of the frame.
    Awaited,
}

/// The bytes of a command frame that has not arrived completely yet.
#[derive(Debug)]
pub(super) struct Assembler {
    frame: Frame,
    filled: usize,
    /// When the first byte of the frame arrived.
    began: Ns,
}

impl Assembler {
    pub(super) fn new() -> Self {
        Self { frame: Frame::new(), filled: 0, began: 0 }
    }

    /// Takes the bytes that belong to the present frame. Returns their number.
    pub(super) fn take(&mut self, bytes: &[u8], at: Ns, size: SlotSize) -> usize {
        if self.filled == 0 {
            self.began = at;
        }
        let taken = bytes.len().min(size.frame_len() - self.filled);
        self.frame.bytes_mut()[self.filled..][..taken].copy_from_slice(&bytes[..taken]);
        self.filled += taken;
        taken
    }

    /// Returns the frame if it is complete. The next byte then begins another frame.
    pub(super) fn complete(&mut self, size: SlotSize) -> Option<&Frame> {
        if self.filled < size.frame_len() {
            return None;
        }
        self.filled = 0;
        Some(&self.frame)
    }

    /// Drops the incomplete frame, so that the next byte begins a new one. Returns whether there was an incomplete
    /// frame.
    pub(super) fn forget(&mut self) -> bool {
        std::mem::take(&mut self.filled) > 0
    }

    /// Drops an incomplete frame whose first byte came more than `limit_ns` ago. Returns the number of bytes of the
    /// dropped frame; `None`: no frame was dropped.
    pub(super) fn drop_late(&mut self, now: Ns, limit_ns: Ns) -> Option<usize> {
        let late = self.filled > 0 && now - self.began > limit_ns;
        late.then(|| std::mem::take(&mut self.filled))
    }
}
