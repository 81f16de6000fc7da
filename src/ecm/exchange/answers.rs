//! Matches answers to commands: a call can tell the answer to its own command from older answers and from the answers to
//! other calls.
//!
//! In each slot, reports show the answer to the last command of that slot until the slot gets another command (SK-3). A
//! call that needs the answer to its own command claims the slot: until it releases the slot, no other call can claim
//! it. For claimed slots this file keeps the newest answer, and whether it may be the answer to an earlier command.

use super::slot_set::SlotSet;
use crate::link::Stamp;
use crate::sk::{Frame, RawSlot, SlotSize, Slots};

const SLOTS: usize = SlotSize::Bytes12.slots();

pub struct Answers {
    /// The slots that calls have claimed. Until a call releases its slots, no other call can claim them.
    claimed: SlotSet,
    /// For each claimed slot: the newest answer with the id of the command for which the slot was claimed, and the time
    /// of its report.
    newest: [(Stamp, RawSlot); SLOTS],
    /// Claimed slots that showed the command's id at the time of the claim and in every report since. Their answers may
    /// belong to an earlier command.
    unchanged: SlotSet,
}

impl Answers {
    pub const fn new() -> Self {
        Self { claimed: SlotSet::EMPTY, newest: [(Stamp(0), RawSlot::ZERO); SLOTS], unchanged: SlotSet::EMPTY }
    }

    /// Reserves the slots of `commands` for one call until [`release`](Self::release). Returns false if another call
    /// has claimed one of them. `report` is the newest report: if a slot already shows the id of the command there,
    /// later reports may repeat an old answer.
    pub fn claim(&mut self, commands: &[(usize, RawSlot)], report: &Frame, size: SlotSize) -> bool {
        let slots = SlotSet::of(commands);
        if self.claimed.overlaps(slots) {
            return false;
        }
        self.claimed.insert_all(slots);
        self.unchanged.insert_all(slots);
        for (slot, command) in commands {
            self.newest[*slot] = (Stamp(0), RawSlot { id: command.id, ..RawSlot::ZERO });
            if report.slot(size, *slot).id != command.id {
                self.unchanged.remove(*slot);
            }
        }
        true
    }

    pub fn release(&mut self, commands: &[(usize, RawSlot)]) {
        self.claimed.remove_all(SlotSet::of(commands));
    }

    /// Reads the answers in the claimed slots of a report that was made at `at`.
    pub fn read(&mut self, at: Stamp, slots: Slots<'_>) {
        for slot in self.claimed.iter() {
            if slots.head(slot).id == self.newest[slot].1.id {
                self.newest[slot] = (at, slots.get(slot));
            } else {
                self.unchanged.remove(slot);
            }
        }
    }

    /// The newest answer in a claimed slot, and the time of its report.
    pub const fn newest(&self, slot: usize) -> (Stamp, RawSlot) {
        self.newest[slot]
    }

    /// Whether the answer in a claimed slot may be older than the claim.
    pub const fn may_be_old(&self, slot: usize) -> bool {
        self.unchanged.contains(slot)
    }
}
