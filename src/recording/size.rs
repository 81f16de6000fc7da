//! Finds the slot size of frames, since frames do not contain it.

use crate::sk::{Frame, SlotForm, SlotSize};

/// How certain the slot size of a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SizeFrom {
    /// The slot size is certain: the user or the recording states it, or the frame's length, CRC or slots fit only one
    /// size.
    Known,
    /// The slot size is the default of 12 bytes, because no frame shows the size.
    Assumed,
}

/// Finds the slot size of frames: by what the user or the recording states, by their CRCs, and for frames without a CRC
/// by their slots.
#[derive(Clone, Debug)]
pub struct SizeFinder {
    known: Option<SlotSize>,
    /// `[n12, n16]`: the number of frames that fit only 12-byte slots, and of those that fit only 16-byte slots.
    votes: [u32; 2],
}

impl SizeFinder {
    /// `known` is the size that the user or the recording states; `None` if neither does.
    pub const fn new(known: Option<SlotSize>) -> Self {
        Self { known, votes: [0; 2] }
    }

    /// The size that the user or the recording states; `None` if neither does.
    pub const fn given(&self) -> Option<SlotSize> {
        self.known
    }

    /// Takes a frame of `len` bytes, 504..=512, into account.
    pub fn look(&mut self, frame: &Frame, len: usize) {
        if let Some(size) = own_size(frame, len) {
            self.votes[usize::from(size == SlotSize::Bytes16)] += 1;
        }
    }

    /// The size of one frame: that of the frame itself if it shows one, otherwise that of the frames seen so far.
    pub fn size_of(&self, frame: &Frame, len: usize) -> (SlotSize, SizeFrom) {
        match self.known.or_else(|| own_size(frame, len)) {
            Some(size) => (size, SizeFrom::Known),
            None => self.size(),
        }
    }

    /// The size of the frames seen so far. \[OURS] If as many frames fit one size as the other, it is 12 bytes, the
    /// board's default.
    pub fn size(&self) -> (SlotSize, SizeFrom) {
        match (self.known, self.votes) {
            (Some(size), _) => (size, SizeFrom::Known),
            (None, [narrow, wide]) if wide > narrow => (SlotSize::Bytes16, SizeFrom::Known),
            (None, [narrow, wide]) if narrow > wide => (SlotSize::Bytes12, SizeFrom::Known),
            (None, _) => (SlotSize::default(), SizeFrom::Assumed),
        }
    }

    /// Whether more frames are unlikely to change the result: one size leads by three frames. A CRC of the wrong size
    /// fits by chance in one of 256 frames, so three such frames in a row hardly occur.
    pub fn is_sure(&self) -> bool {
        self.known.is_some() || self.votes[0].abs_diff(self.votes[1]) >= 3
    }
}

/// The size that a frame shows by its length, its CRC or its slots; `None` if these fit both sizes or neither.
fn own_size(frame: &Frame, len: usize) -> Option<SlotSize> {
    if len < SlotSize::Bytes16.frame_len() {
        return Some(SlotSize::Bytes12);
    }
    let by_crc = if frame.crc_byte() == 0 { None } else { frame.size_by_crc() };
    by_crc.or_else(|| frame.size_by_slots(SlotForm::CommandOrReport))
}
