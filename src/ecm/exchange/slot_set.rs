//! Sets of slots, one bit for each.

use crate::ethercat::{MAX_SLAVES, SlaveSet};
use crate::sk::RawSlot;

/// A set of slots of one frame: slot 0 is that of the board, slot n that of slave n, and the last one that of SDO
/// transfers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotSet(u64);

impl SlotSet {
    pub const EMPTY: Self = Self(0);

    /// The slots of the given commands.
    pub fn of(commands: &[(usize, RawSlot)]) -> Self {
        Self(commands.iter().fold(0, |slots, (slot, _)| slots | 1 << slot))
    }

    pub const fn contains(self, slot: usize) -> bool {
        self.0 & 1 << slot != 0
    }

    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether the sets have a slot in common.
    pub const fn overlaps(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    pub const fn insert_all(&mut self, other: Self) {
        self.0 |= other.0;
    }

    pub const fn remove_all(&mut self, other: Self) {
        self.0 &= !other.0;
    }

    pub const fn remove(&mut self, slot: usize) {
        self.0 &= !(1 << slot);
    }

    /// The set without `slot`.
    pub const fn without(self, slot: usize) -> Self {
        Self(self.0 & !(1 << slot))
    }

    /// The slaves whose slots are in the set; slot 0 is left out. The SDO slot of 16-byte frames, 31, becomes a slave 31,
    /// which such frames do not have.
    pub const fn slaves(self) -> SlaveSet {
        SlaveSet::from_bits(self.0 >> 1 & ((1 << MAX_SLAVES) - 1))
    }

    /// The slots in ascending order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let slot = (left != 0).then(|| left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some(slot)
        })
    }
}
