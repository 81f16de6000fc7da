//! What a stream commands: the slots of the next frame, of the last one and of the one before, as they stand on the wire.

use crate::sk::{Frame, RawSlot, SlaveCommand, SlotCommand, SlotSize};

/// The commands that a stream keeps sending, by slave. A slot of zero is one without.
pub(super) struct Targets {
    size: SlotSize,
    /// Slaves that have any, a bit each.
    some: u64,
    /// With the next frame, and with every one after it until there is another.
    now: Box<Frame>,
    /// In the last step, and in the one before: how fast the axes are meant to move.
    last: Box<Frame>,
    before: Box<Frame>,
}

impl Targets {
    pub(super) fn new(size: SlotSize) -> Self {
        Self { size, some: 0, now: Box::default(), last: Box::default(), before: Box::default() }
    }

    /// What goes into the next frame.
    pub(super) fn next(&self) -> &Frame {
        &self.now
    }

    /// No slave has one.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.size);
    }

    /// Takes those of slaves away, a bit each, for good.
    pub(super) fn forget(&mut self, slaves: u64) {
        for slave in bits(slaves & self.some) {
            for frame in [&mut self.now, &mut self.last, &mut self.before] {
                frame.put(self.size, slave, &RawSlot::ZERO);
            }
        }
        self.some &= !slaves;
    }

    /// The next targets of all slaves; a bit for each that has one.
    pub(super) fn take(&mut self, next: &Frame, some: u64) {
        Frame::clone_from(&mut self.now, next);
        self.some |= some;
    }

    /// The next target of a slave.
    pub(super) fn set(&mut self, slave: usize, command: Option<SlaveCommand>) {
        let slot = command.map_or(RawSlot::ZERO, |command| SlotCommand::from(command).encode(self.size));
        self.now.put(self.size, slave, &slot);
        self.some |= 1 << slave;
    }

    /// What somebody else has told a slave last, and before that.
    pub(super) fn told(&mut self, slave: usize, last: Option<SlaveCommand>, before: Option<SlaveCommand>) {
        for (frame, command) in [(&mut self.last, last), (&mut self.before, before)] {
            let slot = command.map_or(RawSlot::ZERO, |command| SlotCommand::from(command).encode(self.size));
            frame.put(self.size, slave, &slot);
        }
        self.some |= 1 << slave;
    }

    /// The next targets are in a frame.
    pub(super) fn stepped(&mut self) {
        std::mem::swap(&mut self.last, &mut self.before);
        self.last.clone_from(&self.now);
    }

    /// What a slave was told last.
    pub(super) fn last(&self, slave: u8) -> Option<SlaveCommand> {
        self.command(&self.last, slave)
    }

    /// What it was told before that.
    pub(super) fn before(&self, slave: u8) -> Option<SlaveCommand> {
        self.command(&self.before, slave)
    }

    fn command(&self, frame: &Frame, slave: u8) -> Option<SlaveCommand> {
        let slot = frame.slot(self.size, slave.into());
        if slot.is_zero() {
            return None;
        }
        SlotCommand::decode(&slot, self.size).ok().map(|slot| slot.command)
    }
}

/// The numbers of the bits that are set, rising.
pub(super) fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = (mask != 0).then(|| mask.trailing_zeros() as usize)?;
        mask &= mask - 1;
        Some(bit)
    })
}
