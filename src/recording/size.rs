//! The slot size of frames, which they do not say of themselves.

use crate::sk::{CommandId, CrcStatus, Frame, MASTER_CYCLIC, RawSlot, SlotKind, SlotSize};

/// How sure the slot size of a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SizeFrom {
    /// The user or the recording says so, only one size has frames of this length, or a CRC or the slots fit one size alone.
    Known,
    /// Nothing tells.
    Assumed,
}

/// Finds the slot size of frames, by what is said, by what their CRCs fit and, where there are none, their slots.
#[derive(Clone, Debug)]
pub struct SizeFinder {
    known: Option<SlotSize>,
    /// Frames seen that can only be of 12-byte slots, only of 16-byte slots.
    votes: [u32; 2],
}

impl SizeFinder {
    /// `known`: what the user or the recording says.
    pub const fn new(known: Option<SlotSize>) -> Self {
        Self { known, votes: [0; 2] }
    }

    /// What the user or the recording says.
    pub const fn given(&self) -> Option<SlotSize> {
        self.known
    }

    /// Takes a frame of `len` bytes, 504..=512, into account.
    pub fn look(&mut self, frame: &Frame, len: usize) {
        if let Some(size) = own_size(frame, len) {
            self.votes[usize::from(size == SlotSize::Bytes16)] += 1;
        }
    }

    /// The size of one frame: by itself if it tells, else by the frames seen.
    pub fn size_of(&self, frame: &Frame, len: usize) -> (SlotSize, SizeFrom) {
        match self.known.or_else(|| own_size(frame, len)) {
            Some(size) => (size, SizeFrom::Known),
            None => self.size(),
        }
    }

    /// The size by all frames seen. \[OURS] A tie is 12 bytes, the board's default.
    pub fn size(&self) -> (SlotSize, SizeFrom) {
        match (self.known, self.votes) {
            (Some(size), _) => (size, SizeFrom::Known),
            (None, [narrow, wide]) if wide > narrow => (SlotSize::Bytes16, SizeFrom::Known),
            (None, [narrow, wide]) if narrow > wide => (SlotSize::Bytes12, SizeFrom::Known),
            (None, _) => (SlotSize::default(), SizeFrom::Assumed),
        }
    }

    /// Whether more frames would hardly change the answer: three that agree (a wrong CRC fits once in 256).
    pub fn is_sure(&self) -> bool {
        self.known.is_some() || self.votes[0].abs_diff(self.votes[1]) >= 3
    }
}

/// The size that a frame shows by its length, its CRC or its slots.
fn own_size(frame: &Frame, len: usize) -> Option<SlotSize> {
    if len < SlotSize::Bytes16.frame_len() {
        return Some(SlotSize::Bytes12);
    }
    let fits = |size| matches!(frame.crc_status(size), CrcStatus::Right(_));
    // A byte 3 that is 0 is more often no CRC than one.
    match (frame.crc_byte(), fits(SlotSize::Bytes12), fits(SlotSize::Bytes16)) {
        (1.., true, false) => Some(SlotSize::Bytes12),
        (1.., false, true) => Some(SlotSize::Bytes16),
        _ => by_slots(frame),
    }
}

/// The size whose slots alone make sense: each holds an id that belongs there, or nothing. \[OURS] Slots of the other size
/// begin in the middle of these, and what asks for something or answers does not look like that there. A slot of a
/// response that answers GET_STATUS holds data without an id: such a frame tells nothing.
fn by_slots(frame: &Frame) -> Option<SlotSize> {
    let sensible = |size: SlotSize| {
        frame.slots(size).iter().enumerate().all(|(i, slot)| match i {
            0 => slot.id == MASTER_CYCLIC || !matches!(CommandId::from_code(slot.id), CommandId::Unknown(_)),
            i if i == size.sdo_slot() => is_sdo(&slot, size) || slot.is_zero(),
            _ => asks(&slot, SlotKind::Slave) || slot.is_zero(),
        })
    };
    match (sensible(SlotSize::Bytes12), sensible(SlotSize::Bytes16)) {
        (true, false) => Some(SlotSize::Bytes12),
        (false, true) => Some(SlotSize::Bytes16),
        _ => None,
    }
}

/// A command that belongs there (SK-4), or the answer to one, but for GET_STATUS, whose id is 0.
fn asks(slot: &RawSlot, kind: SlotKind) -> bool {
    slot.id != CommandId::GetStatus.code() && CommandId::from_code(slot.id).belongs_in(kind)
}

/// A transfer, or the answer to one (SK-6).
fn is_sdo(slot: &RawSlot, size: SlotSize) -> bool {
    asks(slot, SlotKind::Sdo) && (1..=size.max_slaves()).contains(&usize::from(slot.parm & 0xFF))
}
