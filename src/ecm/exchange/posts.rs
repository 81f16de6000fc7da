//! Commands that wait for the next frame.

use super::slot_set::SlotSet;
use crate::sk::{FifoAction, Frame, MasterCommand, RawSlot, SlotSize};

/// Commands that go out with the next frame, at most one for each slot. In it they stand in the place of what a stream
/// keeps sending.
pub struct Posts {
    commands: [RawSlot; SlotSize::Bytes12.slots()],
    slots: SlotSet,
}

impl Posts {
    pub const fn new() -> Self {
        Self { commands: [RawSlot::ZERO; SlotSize::Bytes12.slots()], slots: SlotSet::EMPTY }
    }

    /// Puts commands into the next frame, all or none: a slot that has one takes no second one. Says whether it did.
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

    /// Puts those of the last frame into the next one, too, but for that of the board itself.
    pub const fn post_again(&mut self, slots: SlotSet) {
        self.slots.insert_all(slots.without(0));
    }

    /// Takes back what was posted and not written.
    pub fn withdraw(&mut self, commands: &[(usize, RawSlot)]) {
        self.slots.remove_all(SlotSet::of(commands));
    }

    /// The frame was written: none waits any more.
    pub const fn clear(&mut self) {
        self.slots = SlotSet::EMPTY;
    }

    /// The slots that have a command.
    pub const fn slots(&self) -> SlotSet {
        self.slots
    }

    pub const fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Whether one of them clears the board's FIFO.
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
