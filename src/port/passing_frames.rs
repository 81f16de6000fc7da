//! Derives the state of the network behind a board from the frames and reports that pass through its server.

use crate::ecm::Watch;
use crate::link::{ReadMeta, Stamp};
use crate::sk::{Frame, SlotSize};

/// The byte of a report that holds its CRC. A board that fills in no CRC sends 0 there.
const CRC_BYTE: usize = 3;

/// The state of the network, from the frames and reports that pass. If the board's link does not know the slot size,
/// the first report with a right CRC shows it; until then nothing is known of the network.
pub(super) struct PassingFrames {
    size: Option<SlotSize>,
    watch: Watch,
    /// The slot size of the frames that `watch` has read before the link was opened again.
    before: Option<SlotSize>,
    /// The sequence number that the board's link will give to the next report. A higher one shows that reports were
    /// dropped.
    next: u64,
}

impl PassingFrames {
    pub(super) fn new(size: Option<SlotSize>) -> Self {
        Self { size, watch: Watch::default(), before: None, next: 0 }
    }

    /// The same network, after its link was lost and opened again. `size`: the slot size that the link knows now.
    pub(super) fn reopened(&self, size: Option<SlotSize>) -> Self {
        let mut passing = Self { size: None, watch: self.watch.clone(), before: self.size.or(self.before), next: 0 };
        passing.watch.reopened();
        passing.set_size(size);
        passing
    }

    /// Sets the slot size. If the size has changed, this is another board, so the state of the previous board's network
    /// is discarded.
    fn set_size(&mut self, size: Option<SlotSize>) {
        self.size = size;
        if size.is_some() && self.before.is_some_and(|before| Some(before) != size) {
            self.watch = Watch::default();
        }
    }

    /// The slot size; `None`: it is not known yet.
    pub(super) const fn size(&self) -> Option<SlotSize> {
        self.size
    }

    pub(super) const fn watch(&self) -> &Watch {
        &self.watch
    }

    pub(super) const fn next_sequence(&self) -> u64 {
        self.next
    }

    /// Reads a command frame that was written to the board at `at`.
    pub(super) fn command(&mut self, frame: &Frame, at: Stamp) {
        if let Some(size) = self.size {
            self.watch.command(frame, size, at);
        }
    }

    /// Reads a report.
    pub(super) fn report(&mut self, frame: &Frame, meta: ReadMeta) {
        if self.size.is_none() && frame.bytes()[CRC_BYTE] != 0 {
            self.set_size(frame.size_by_crc());
        }
        if let Some(size) = self.size {
            if meta.sequence > self.next {
                self.watch.missed();
            }
            self.watch.report(frame, size, meta.at);
        }
        self.next = meta.sequence.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A report without a CRC shows no slot size, whatever its bytes are; one with a right CRC does.
    #[test]
    fn a_report_shows_the_slot_size() {
        for size in SlotSize::ALL {
            let mut passing = PassingFrames::new(None);
            let mut report = Frame::new();
            passing.report(&report, ReadMeta::default());
            assert_eq!((passing.size(), passing.next_sequence()), (None, 1));
            report.put_master(size, &crate::sk::MasterCommand::SetState(crate::sk::MasterState::Op));
            report.fill_crc(size);
            passing.report(&report, ReadMeta { sequence: 7, ..ReadMeta::default() });
            assert_eq!((passing.size(), passing.next_sequence()), (Some(size), 8));
        }
    }
}
