//! The command FIFO of OP (SK-5): 160 frames, a threshold, a full count.

use std::collections::VecDeque;

use super::Firmware;
use crate::sk::{FIFO_ENTRIES, Frame, SlotSize};

/// Frames waiting for their cycle.
#[derive(Debug)]
pub(super) struct CommandFifo {
    /// Has room for all there can be.
    waiting: VecDeque<Frame>,
    threshold: u16,
    full_count: u16,
    /// Nothing is taken out, whatever the threshold says.
    held: bool,
}

/// "160 is the default: taking starts with the first entry."
const DEFAULT_THRESHOLD: u16 = FIFO_ENTRIES;

impl CommandFifo {
    pub(super) fn new() -> Self {
        Self {
            waiting: VecDeque::with_capacity(FIFO_ENTRIES.into()),
            threshold: DEFAULT_THRESHOLD,
            full_count: 0,
            held: false,
        }
    }

    /// Never more than [`FIFO_ENTRIES`].
    fn len(&self) -> u16 {
        self.waiting.len() as u16
    }

    /// Entries that could still come, when `ahead` of those taken out have not been sent yet.
    pub(super) fn free(&self, ahead: u16) -> u16 {
        FIFO_ENTRIES.saturating_sub(self.len() + ahead)
    }

    /// The count of slot 0, bytes 10..11; wraps.
    pub(super) const fn full_count(&self) -> u16 {
        self.full_count
    }

    /// Queues a frame, or raises the full count and says false.
    pub(super) fn push(&mut self, frame: &Frame, ahead: u16, firmware: Firmware, size: SlotSize) -> bool {
        if self.free(ahead) == 0 {
            self.full_count = self.full_count.wrapping_add(firmware.full_count_step(size));
            return false;
        }
        self.waiting.push_back(frame.clone());
        true
    }

    /// The next entry to execute, copied to `out`; false while there is none or the threshold holds it back.
    pub(super) fn take(&mut self, ahead: u16, out: &mut Frame) -> bool {
        if self.held || self.free(ahead) >= self.threshold {
            return false;
        }
        let Some(next) = self.waiting.pop_front() else { return false };
        self.threshold = DEFAULT_THRESHOLD;
        *out = next;
        true
    }

    /// Takes nothing out any more, or goes on; a fault on demand, which no command is.
    pub(super) const fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// SET_FIFO 2. SK-5 \[OURS]: above 160 counts as 160.
    pub(super) fn set_threshold(&mut self, free: u32) {
        self.threshold = free.min(FIFO_ENTRIES.into()) as u16;
    }

    /// SW_RESET: as new. Says how many entries went.
    pub(super) fn reset(&mut self) -> u16 {
        self.full_count = 0;
        self.clear()
    }

    /// SET_FIFO 1: content and threshold go, the full count stays. Says how many entries went.
    pub(super) fn clear(&mut self) -> u16 {
        self.threshold = DEFAULT_THRESHOLD;
        let gone = self.len();
        self.waiting.clear();
        gone
    }
}
