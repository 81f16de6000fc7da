//! The command FIFO of OP (SK-5): its depth ([`FIFO_ENTRIES`], 160 frames), its threshold and its full count.

use std::collections::VecDeque;

use super::Firmware;
use crate::sk::{FIFO_ENTRIES, Frame, SlotSize};

/// Frame buffers are indexed by a `u8`, so there may be at most 256 of them.
const _: () = assert!(FIFO_ENTRIES <= 256);

/// The ring buffer of command frames that wait for their cycle.
///
/// The buffer freed last is reused first: a program that keeps three entries in the FIFO uses the same three or four
/// buffers again and again, instead of the memory of all 160.
#[derive(Debug)]
pub(super) struct CommandFifo {
    /// The frame buffers: as many as were ever in use at once. Like the two collections below, it has the capacity for
    /// the whole FIFO from the start, so that it never allocates later.
    places: Vec<Frame>,
    /// The indices in `places` of the queued entries, the next one to execute first.
    waiting: VecDeque<u8>,
    /// The indices in `places` of the unused buffers.
    vacant: Vec<u8>,
    threshold: u16,
    full_count: u16,
    /// Whether the board is kept from executing entries, as a fault that scripts and tests cause. [`Self::take`] then
    /// returns `None`, whatever the threshold is.
    held: bool,
}

/// The default threshold. The board begins to take entries out when the number of free entries is below the threshold.
/// With 160 it begins with the first entry (SK-5).
const DEFAULT_THRESHOLD: u16 = FIFO_ENTRIES;

impl CommandFifo {
    pub(super) fn new() -> Self {
        Self {
            places: Vec::with_capacity(FIFO_ENTRIES.into()),
            waiting: VecDeque::with_capacity(FIFO_ENTRIES.into()),
            vacant: Vec::with_capacity(FIFO_ENTRIES.into()),
            threshold: DEFAULT_THRESHOLD,
            full_count: 0,
            held: false,
        }
    }

    /// The number of queued entries, at most [`FIFO_ENTRIES`].
    fn len(&self) -> u16 {
        self.waiting.len() as u16
    }

    /// The number of free entries. `ahead` is the number of entries that were taken out but are not sent to the slaves
    /// yet: they still count as used.
    pub(super) fn free(&self, ahead: u16) -> u16 {
        FIFO_ENTRIES.saturating_sub(self.len() + ahead)
    }

    /// The full count in bytes 10..11 of slot 0. It grows with each frame that finds the FIFO full
    /// ([`Firmware::full_count_step`]), and wraps.
    pub(super) const fn full_count(&self) -> u16 {
        self.full_count
    }

    /// Queues a frame. If the FIFO is full, raises the full count and returns false.
    pub(super) fn push(&mut self, frame: &Frame, ahead: u16, firmware: Firmware, size: SlotSize) -> bool {
        if self.free(ahead) == 0 {
            self.full_count = self.full_count.wrapping_add(firmware.full_count_step(size));
            return false;
        }
        if let Some(place) = self.vacant.pop() {
            self.places[usize::from(place)].clone_from(frame);
            self.waiting.push_back(place);
        } else {
            self.waiting.push_back(self.places.len() as u8);
            self.places.push(frame.clone());
        }
        true
    }

    /// Takes the next entry to execute out; `None`: the FIFO is empty, or the threshold is not reached.
    pub(super) fn take(&mut self, ahead: u16) -> Option<Frame> {
        if self.held || self.free(ahead) >= self.threshold {
            return None;
        }
        let place = self.waiting.pop_front()?;
        self.threshold = DEFAULT_THRESHOLD;
        self.vacant.push(place);
        Some(self.places[usize::from(place)].clone())
    }

    /// Stops taking entries out of the FIFO, or resumes it. A fault for scripts and tests.
    pub(super) const fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// SET_FIFO 2: sets the threshold of free entries. SK-5 \[OURS]: a value above 160 counts as 160.
    pub(super) fn set_threshold(&mut self, free: u32) {
        self.threshold = free.min(FIFO_ENTRIES.into()) as u16;
    }

    /// SW_RESET: clears entries, threshold and full count. Returns the number of dropped entries.
    pub(super) fn reset(&mut self) -> u16 {
        self.full_count = 0;
        self.clear()
    }

    /// SET_FIFO 1: clears entries and threshold, but not the full count. Returns the number of dropped entries.
    pub(super) fn clear(&mut self) -> u16 {
        self.threshold = DEFAULT_THRESHOLD;
        let gone = self.len();
        self.vacant.extend(self.waiting.drain(..));
        gone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(n: u8) -> Frame {
        Frame::from_prefix(&[n])
    }

    /// Entries come out in the order in which they went in, whichever buffers store them, and a program that keeps few
    /// entries queued uses few buffers.
    #[test]
    fn few_entries_take_few_places() {
        let mut fifo = CommandFifo::new();
        let (mut next_in, mut next_out) = (0u8, 0u8);
        for round in 0..1000 {
            for _ in 0..1 + round % 3 {
                assert!(fifo.push(&numbered(next_in), 0, Firmware::V17, SlotSize::Bytes12));
                next_in = next_in.wrapping_add(1);
            }
            while fifo.len() > (round % 2) {
                assert_eq!(fifo.take(0), Some(numbered(next_out)));
                next_out = next_out.wrapping_add(1);
            }
        }
        assert_eq!(fifo.places.len(), 4, "never more than 4 were there at once");
        fifo.clear();
        assert_eq!((fifo.free(0), fifo.vacant.len()), (FIFO_ENTRIES, 4));
        for n in 0..FIFO_ENTRIES {
            assert!(fifo.push(&numbered(n as u8), 0, Firmware::V17, SlotSize::Bytes12));
        }
        assert!(!fifo.push(&numbered(0), 0, Firmware::V17, SlotSize::Bytes12), "full");
        assert!((0..FIFO_ENTRIES).all(|n| fifo.take(0) == Some(numbered(n as u8))));
    }
}
