//! The targets that a stream repeats in every frame, as encoded slots: the targets for the next frame, and the targets
//! in the last frame.

use crate::ethercat::{MAX_SLAVES, SlaveSet};
use crate::sk::{CommandId, Frame, RawSlot, SlaveCommand, SlotCommand, SlotSize};

const SLOTS: usize = SlotSize::Bytes12.slots();

/// The digital outputs of an HSP's two channels.
pub type Outputs = [u16; 2];

/// The targets of all slaves, by slot. A slot of zeros has no target.
pub struct CyclicTargets {
    size: SlotSize,
    /// Slaves with a target in the next frame or in the last one.
    set: SlaveSet,
    /// The targets for the next frame. They are repeated in each frame until other targets are set.
    next: Box<Frame>,
    /// The targets of the last frame that was written.
    last: Box<Frame>,
    /// The digital outputs last sent to the two channels of each HSP, by slot. Removing the targets does not change the
    /// outputs.
    outputs: [Outputs; SLOTS],
    /// Slaves whose targets were withdrawn since the last call of [`take_withdrawn`](Self::take_withdrawn).
    withdrawn: SlaveSet,
}

impl CyclicTargets {
    pub fn new(size: SlotSize) -> Self {
        Self {
            size,
            set: SlaveSet::EMPTY,
            next: Box::default(),
            last: Box::default(),
            outputs: [[0; 2]; SLOTS],
            withdrawn: SlaveSet::EMPTY,
        }
    }

    /// The targets for the next frame.
    pub fn next(&self) -> &Frame {
        &self.next
    }

    /// The digital outputs last sent to the two channels of each HSP, by slot; 0 for all other slaves.
    pub const fn outputs(&self) -> &[Outputs; SLOTS] {
        &self.outputs
    }

    /// Removes the targets of all slaves.
    pub fn clear(&mut self) {
        self.forget(SlaveSet::first(MAX_SLAVES as u8));
    }

    /// Sets the recorded outputs of all HSPs to 0, as the board sets the outputs when the network leaves OP.
    pub fn forget_outputs(&mut self) {
        self.outputs = [[0; 2]; SLOTS];
    }

    /// Removes the targets of slaves whose axes went off or are going to be homed. A stream then also drops the targets
    /// that it has prepared for its next step ([`take_withdrawn`](Self::take_withdrawn)).
    pub fn withdraw(&mut self, slaves: SlaveSet) {
        self.forget(slaves);
        self.withdrawn = self.withdrawn.union(slaves);
    }

    /// The slaves whose targets were withdrawn since the last call.
    pub fn take_withdrawn(&mut self) -> SlaveSet {
        std::mem::take(&mut self.withdrawn)
    }

    fn forget(&mut self, slaves: SlaveSet) {
        for slave in self.set.intersection(slaves).iter() {
            for frame in [&mut self.next, &mut self.last] {
                frame.put(self.size, slave.into(), &RawSlot::ZERO);
            }
        }
        self.set = self.set.difference(slaves);
    }

    /// Sets the targets of all slaves for the next frame, by slot; `set`: the slaves that have a target.
    pub fn set_all(&mut self, next: &Frame, set: SlaveSet) {
        Frame::clone_from(&mut self.next, next);
        self.set = self.set.union(set);
    }

    /// Sets the next target of a slave; `None`: removes it.
    pub fn set(&mut self, slave: u8, command: Option<SlaveCommand>) {
        let slot = command.map_or(RawSlot::ZERO, |command| SlotCommand::from(command).encode(self.size));
        self.next.put(self.size, slave.into(), &slot);
        self.set.insert(slave);
    }

    /// Sets the last target of a slave to one that no stream of this process has sent: a target of the program whose
    /// board this process takes over, or the target with which a stop holds the axis.
    pub fn assume(&mut self, slave: u8, last: Option<SlaveCommand>) {
        let slot = last.map_or(RawSlot::ZERO, |command| SlotCommand::from(command).encode(self.size));
        self.last.put(self.size, slave.into(), &slot);
        self.note_outputs(slave, last);
        self.set.insert(slave);
    }

    /// Notes the digital outputs of an HSP that another program has set.
    pub const fn assume_outputs(&mut self, slave: u8, outputs: Outputs) {
        self.outputs[slave as usize] = outputs;
    }

    /// Makes the next targets the last ones, because a frame with them was sent. `hsps`: the HSPs. Their digital
    /// outputs are recorded as well, because a frame that changes only the target of an HSP must repeat its outputs.
    pub fn stepped(&mut self, hsps: SlaveSet) {
        self.last.clone_from(&self.next);
        for slave in hsps.intersection(self.set).iter() {
            self.note_outputs(slave, self.last(slave));
        }
    }

    /// As [`stepped`](Self::stepped), for a frame that was sent without its CSP targets: the CSP targets of the last
    /// frame stay in force.
    pub fn stepped_without_csp(&mut self, hsps: SlaveSet) {
        for slave in self.set.iter() {
            if self.next.slot(self.size, slave.into()).id == CommandId::Csp.code() {
                let last = self.last.slot(self.size, slave.into());
                self.next.put(self.size, slave.into(), &last);
            }
        }
        self.stepped(hsps);
    }

    fn note_outputs(&mut self, slave: u8, command: Option<SlaveCommand>) {
        if let Some(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) = command {
            self.outputs[usize::from(slave)] = [motion.first.outputs, motion.second.outputs];
        }
    }

    /// The newest target of a slave: that of the next frame, also a target of a stop's ramp, or else the
    /// [`last`](Self::last) one.
    pub fn in_force(&self, slave: u8) -> Option<SlaveCommand> {
        self.decoded(&self.next, slave).or_else(|| self.last(slave))
    }

    /// Returns to the targets of the last frame, because the frame with the new ones was not written.
    pub fn revert(&mut self) {
        self.next.clone_from(&self.last);
    }

    /// The target of a slave in the last frame that was written; `None` if that frame had none for the slave.
    pub fn last(&self, slave: u8) -> Option<SlaveCommand> {
        self.decoded(&self.last, slave)
    }

    fn decoded(&self, frame: &Frame, slave: u8) -> Option<SlaveCommand> {
        let slot = frame.slot(self.size, slave.into());
        if slot.is_zero() {
            return None;
        }
        SlotCommand::decode(&slot, self.size).ok().map(|slot| slot.command)
    }
}
