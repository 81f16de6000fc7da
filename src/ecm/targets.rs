//! What a stream commands: the slots of the next frame and of the last ones, as they stand on the wire.

use crate::sk::{AxisTarget, Frame, Motion, RawSlot, SlaveCommand, SlotCommand, SlotSize};

/// \[OURS] Steps that are looked back at for the speed of an axis.
const STEPS: usize = 9;
const SLOTS: usize = SlotSize::Bytes12.slots();

/// The outputs of an HSP's channels.
pub(super) type Outputs = [u16; 2];

/// The commands that a stream keeps sending, by slave. A slot of zero is one without.
pub(super) struct Targets {
    size: SlotSize,
    /// Slaves that have any, a bit each.
    some: u64,
    /// With the next frame, and with every one after it until there is another.
    now: Box<Frame>,
    /// In the last steps; `newest` is the place of the last one.
    steps: [Box<Frame>; STEPS],
    newest: usize,
    /// What the outputs of HSPs were told last: it outlives the targets.
    outputs: [Outputs; SLOTS],
}

impl Targets {
    pub(super) fn new(size: SlotSize) -> Self {
        Self { size, some: 0, now: Box::default(), steps: Default::default(), newest: 0, outputs: [[0; 2]; SLOTS] }
    }

    /// What goes into the next frame.
    pub(super) fn next(&self) -> &Frame {
        &self.now
    }

    /// What the outputs of all slaves were told last.
    pub(super) const fn outputs(&self) -> &[Outputs; SLOTS] {
        &self.outputs
    }

    /// No slave has one.
    pub(super) fn clear(&mut self) {
        self.forget(u64::MAX);
    }

    /// The outputs are off again: the network was out of OP.
    pub(super) fn forget_outputs(&mut self) {
        self.outputs = [[0; 2]; SLOTS];
    }

    /// Takes those of slaves away, a bit each, for good.
    pub(super) fn forget(&mut self, slaves: u64) {
        for slave in bits(slaves & self.some) {
            for frame in self.steps.iter_mut().chain([&mut self.now]) {
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
        for (back, command) in [(0, last), (1, before)] {
            let slot = command.map_or(RawSlot::ZERO, |command| SlotCommand::from(command).encode(self.size));
            self.steps[(self.newest + STEPS - back) % STEPS].put(self.size, slave, &slot);
        }
        if let Some(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) = last {
            self.outputs[slave] = [motion.first.outputs, motion.second.outputs];
        }
        self.some |= 1 << slave;
    }

    /// The next targets are in a frame; `hsps` have outputs in it, a bit each.
    pub(super) fn stepped(&mut self, hsps: u64) {
        self.newest = (self.newest + 1) % STEPS;
        self.steps[self.newest].clone_from(&self.now);
        for slave in bits(hsps & self.some) {
            if let Some(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) = self.last(slave as u8) {
                self.outputs[slave] = [motion.first.outputs, motion.second.outputs];
            }
        }
    }

    /// The frame was not taken: what it held for the first time goes out with no other one.
    pub(super) fn unstep(&mut self) {
        self.now.clone_from(&self.steps[self.newest]);
    }

    /// What a slave was told last.
    pub(super) fn last(&self, slave: u8) -> Option<SlaveCommand> {
        self.back(slave, 0)
    }

    /// How far the targets of a slave's axes went in a step, lately. A program may give one every few steps: its way is
    /// that of all of them. Held for longer than that the axis stands.
    pub(super) fn speeds(&self, slave: u8) -> [f64; 2] {
        let motions = std::array::from_fn(|k| match self.back(slave, k) {
            Some(SlaveCommand::Csp(motion)) => Some(motion),
            _ => None,
        });
        [|motion: &Motion| motion.first, |motion: &Motion| motion.second].map(|axis| speed(&motions, axis))
    }

    fn back(&self, slave: u8, steps: usize) -> Option<SlaveCommand> {
        let slot = self.steps[(self.newest + STEPS - steps) % STEPS].slot(self.size, slave.into());
        if slot.is_zero() {
            return None;
        }
        SlotCommand::decode(&slot, self.size).ok().map(|slot| slot.command)
    }
}

/// The speed of an axis by its targets, the newest first.
fn speed(motions: &[Option<Motion>; STEPS], axis: impl Fn(&Motion) -> AxisTarget) -> f64 {
    let target = |k: usize| motions[k].as_ref().map(|motion| axis(motion).target);
    // Steps whose target is another one than that of the step before.
    let mut changes = (0..STEPS - 1).filter_map(|k| match (target(k), target(k + 1)) {
        (Some(to), Some(from)) if to != from => Some((k, to.wrapping_sub(from))),
        _ => None,
    });
    let Some((held, by)) = changes.next() else { return 0.0 };
    // A first target that has no other before it has been given once a step, until more is known.
    let known = (0..STEPS).take_while(|k| target(*k).is_some()).count();
    let period = changes.next().map_or(if known < STEPS { 1 } else { STEPS - 1 }, |(before, _)| before - held);
    if held < period { f64::from(by) / period as f64 } else { 0.0 }
}

/// The numbers of the bits that are set, rising.
pub(super) fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = (mask != 0).then(|| mask.trailing_zeros() as usize)?;
        mask &= mask - 1;
        Some(bit)
    })
}
