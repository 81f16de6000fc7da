//! Outputs on their way: from the command FIFO into the process image, to the bus, and back again when SET_FIFO clears
//! what a bus has taken ahead.

use super::volatile::Volatile;
use super::{Engine, Executed};
use crate::fieldbus::{Fieldbus, Ns, Outputs, Pacing, SlaveSet};
use crate::sk::RawSlot;

/// A FIFO entry on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ahead {
    /// The outputs that carry it.
    id: u64,
    /// What of it acts when they are sent, and not before: `None` once it has.
    held: Option<Held>,
}

/// What a FIFO entry holds for the board itself: the chip's inputs and outputs, and the SDO slot. On a bus that takes
/// outputs ahead it acts with the entry's outputs (SK-5): with what it stands beside, and not at all if a clear takes it
/// back.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) master: RawSlot,
    pub(super) sdo: RawSlot,
}

impl Engine {
    /// Hands the bus what it takes: one FIFO entry in each set of outputs.
    pub(super) fn push_outputs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        for _ in 0..bus.room() {
            let (has_entry, held) = self.take_entry(now);
            // A bus that owns its cycle repeats the last outputs by itself.
            let repeats =
                self.pacing != Pacing::Runner && (bus.held() > 0 || !self.outputs_left && !self.outputs_changed());
            if repeats && !has_entry {
                return;
            }
            let id = self.next_output_id;
            self.outputs.id = id;
            let n = self.executed.len() as u64;
            let executed = &mut self.executed[(id % n) as usize];
            refresh_outputs(&mut self.outputs, &mut self.v, executed);
            executed.heads = self.v.heads;
            executed.commanded = self.commanded;
            executed.test = self.v.test;
            self.outputs_left = bus.push(&self.outputs).is_err();
            if self.outputs_left {
                // The cable was cut this moment: what was executed goes with the next outputs.
                self.counters.executed += u64::from(has_entry);
                self.act(held, now);
                return;
            }
            self.next_output_id += 1;
            self.commanded = SlaveSet::EMPTY;
            if has_entry {
                self.ahead.push_back(Ahead { id, held });
            }
        }
    }

    /// Executes the next entry, if there is one to take; what of it does not act yet is handed back.
    fn take_entry(&mut self, now: Ns) -> (bool, Option<Held>) {
        let Some(entry) = self.fifo.take(self.ahead.len() as u16) else { return (false, None) };
        let size = self.config.slot;
        if self.pacing == Pacing::Runner {
            self.execute(&entry, now);
            return (true, None);
        }
        self.execute_slaves(&entry, now);
        (true, Some(Held { master: entry.slot(size, 0), sdo: entry.slot(size, size.sdo_slot()) }))
    }

    fn act(&mut self, held: Option<Held>, at: Ns) {
        if let Some(Held { master, sdo }) = held {
            self.execute_queued_master(&master, at);
            self.execute_sdo(&sdo, at);
        }
    }

    /// Entries whose outputs the bus has sent: all but the newest `held` outputs.
    fn entries_sent(&mut self, held: u16, at: Ns) -> u64 {
        let unsent = self.next_output_id - u64::from(held);
        let mut entries = 0;
        while let Some(Ahead { held, .. }) = self.ahead.pop_front_if(|ahead| ahead.id < unsent) {
            entries += 1;
            // A board that has booted since has forgotten them.
            if self.talks() {
                self.act(held, at);
            }
        }
        self.counters.executed += entries;
        entries
    }

    /// Whether the axes ask for something else than the outputs pushed last.
    fn outputs_changed(&self) -> bool {
        let axes = self.v.axes.iter().zip(&self.outputs.slaves).take(self.v.network.found().into());
        axes.flat_map(|(axes, image)| axes.iter().zip(image)).any(|(axis, out)| axis.differs_from(out))
    }

    /// A cycle has passed, and the newest `held` outputs are still to be sent.
    pub(super) fn note_sent(&mut self, held: u16, at: Ns) {
        let entries = self.entries_sent(held, at);
        if entries == 0 && self.v.network.in_op() {
            self.counters.idle_cycles += 1;
        }
    }

    /// The outputs that the bus has taken and not sent go: their entries count as cleared, and the axes are driven as by
    /// the newest outputs that were sent.
    pub(super) fn withdraw_ahead(&mut self, bus: &mut dyn Fieldbus, at: Ns) {
        let withdrawn = bus.discard_ahead();
        let unsent = self.next_output_id - u64::from(withdrawn);
        self.entries_sent(withdrawn, at);
        self.counters.cleared += self.ahead.len() as u64;
        self.ahead.clear();
        if withdrawn == 0 || unsent == 0 || !self.talks() {
            return;
        }
        let n = self.executed.len() as u64;
        let sent = &self.executed[((unsent - 1) % n) as usize];
        let lost = self.v.network.lost();
        for (slave, (head, then)) in (1..).zip(self.v.heads.iter_mut().zip(&sent.heads)) {
            if !lost.contains(slave) {
                *head = *then;
            }
        }
        if !self.v.network.in_op() {
            return;
        }
        self.v.test = sent.test;
        for (slave, (n, axes)) in (1..).zip(self.v.axes.iter_mut().enumerate()) {
            if lost.contains(slave) {
                continue;
            }
            let then = sent.axes.iter().map(|axes| &axes[n]).zip(&sent.homing[n]);
            for (axis, (then, homing)) in axes.iter_mut().zip(then).take(used_axes(self.v.second_axes, slave)) {
                axis.go_back_to(then, sent.homers.contains(slave).then_some(homing));
            }
            if axes.iter().any(|axis| !axis.homing.is_idle()) {
                self.v.homers.insert(slave);
            }
        }
    }
}

/// Copies the axes' outputs to the process image, and what stands behind them to `executed`.
fn refresh_outputs(outputs: &mut Outputs, v: &mut Volatile, executed: &mut Executed) {
    let Outputs { id, slaves } = outputs;
    let [first, second] = &mut executed.axes;
    let found = usize::from(v.network.found());
    for ((n, axes), image) in v.axes[..found].iter_mut().enumerate().zip(slaves) {
        image[0] = axes[0].next_out(*id);
        first[n] = axes[0].driven();
        if v.second_axes.contains(n as u8 + 1) {
            image[1] = axes[1].next_out(*id);
            second[n] = axes[1].driven();
        }
    }
    executed.homers = v.homers;
    for n in v.homers.iter().map(|slave| usize::from(slave) - 1) {
        executed.homing[n] = v.axes[n].each_ref().map(|axis| axis.homing);
    }
}

/// How many axes of a slave's outputs something can be asked of; what lies behind them stays zero.
pub(super) const fn used_axes(second_axes: SlaveSet, slave: u8) -> usize {
    1 + second_axes.contains(slave) as usize
}
