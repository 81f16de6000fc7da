//! Commands that are queued for the next frame.

use super::slot_set::SlotSet;
use crate::sk::{FifoAction, Frame, MasterCommand, RawSlot, SlotSize};

/// Queued commands for the next frame, at most one for each slot. In that frame they replace the targets that a stream
/// repeats.
pub struct Posts {
    commands: [RawSlot; SlotSize::Bytes12.slots()],
    slots: SlotSet,
}

impl Posts {
    pub const fn new() -> Self {
        Self { commands: [RawSlot::ZERO; SlotSize::Bytes12.slots()], slots: SlotSet::EMPTY }
    }

    /// Queues commands for the next frame, all or none: a slot that already has a queued command takes no second one.
    /// Returns whether they were queued.
    pub fn post(&mut self, commands: &[(usize, RawSlot)]) -> bool {
        let slots = SlotSet::of(commands);
        if self.slots.overlaps(slots) {
            return false;
        }
        for (slot, command) in commands {
            self.commands[*slot] = *command;
        }
        self.slots.insert_all(slots);
        true
    }

    /// Queues the commands in these slots of the last frame again. Slot 0 is left out: if the FIFO was full, the board
    /// has executed the command there and dropped the other slots.
    pub const fn post_again(&mut self, slots: SlotSet) {
        self.slots.insert_all(slots.without(0));
    }

    /// Removes commands that were queued and not written.
    pub fn withdraw(&mut self, commands: &[(usize, RawSlot)]) {
        self.slots.remove_all(SlotSet::of(commands));
    }

    /// Empties the queue, because the frame was written.
    pub const fn clear(&mut self) {
        self.slots = SlotSet::EMPTY;
    }

    /// The slots with a queued command.
    pub const fn slots(&self) -> SlotSet {
        self.slots
    }

    pub const fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Whether a queued command clears the board's FIFO. The frame with it must not have targets.
    pub fn clear_fifo(&self) -> bool {
        self.slots.contains(0) && self.commands[0] == MasterCommand::SetFifo(FifoAction::Clear).encode()
    }

    /// Writes the commands into their slots of a frame.
    pub fn write_to(&self, frame: &mut Frame, size: SlotSize) {
        for slot in self.slots.iter() {
            frame.put(size, slot, &self.commands[slot]);
        }
    }
}
