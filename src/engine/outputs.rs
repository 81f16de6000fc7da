//! Outputs on their way: from the command FIFO into the process image, to the bus, and back again when SET_FIFO clears
//! what a bus has taken ahead.

use super::Engine;
use crate::fieldbus::{Fieldbus, Ns, Pacing, SlaveSet};

impl Engine {
    /// Hands the bus what it takes: one FIFO entry in each set of outputs.
    pub(super) fn push_outputs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        for _ in 0..bus.room() {
            let has_entry = self.take_entry(now);
            // A bus that owns its cycle repeats the last outputs by itself.
            let repeats = self.pacing != Pacing::Runner && (bus.held() > 0 || !self.outputs_changed());
            if repeats && !has_entry {
                return;
            }
            self.refresh_outputs();
            let id = self.next_output_id;
            self.outputs.id = id;
            let n = self.executed.len() as u64;
            let executed = &mut self.executed[(id % n) as usize];
            executed.heads = self.v.heads;
            executed.axes = self.v.axes;
            executed.commanded = self.commanded;
            executed.test = self.v.test;
            if bus.push(&self.outputs).is_err() {
                // The cable was cut this moment: what was executed goes with the next outputs.
                self.counters.executed += u64::from(has_entry);
                return;
            }
            self.next_output_id += 1;
            self.commanded = SlaveSet::EMPTY;
            if has_entry {
                self.ahead.push_back(id);
            }
        }
    }

    fn take_entry(&mut self, now: Ns) -> bool {
        let mut entry = std::mem::take(&mut self.entry);
        let taken = self.fifo.take(self.ahead.len() as u16, &mut entry);
        if taken {
            self.execute(&entry, now);
        }
        self.entry = entry;
        taken
    }

    /// Whether the axes ask for something else than the outputs pushed last.
    fn outputs_changed(&self) -> bool {
        let axes = self.v.axes.iter().zip(&self.outputs.slaves).take(self.v.network.found().into());
        axes.flat_map(|(axes, image)| axes.iter().zip(image)).any(|(axis, out)| axis.differs_from(out))
    }

    /// Copies the axes' outputs to the process image.
    fn refresh_outputs(&mut self) {
        for (image, axes) in self.outputs.slaves.iter_mut().zip(&mut self.v.axes).take(self.v.network.found().into()) {
            for (out, axis) in image.iter_mut().zip(axes) {
                *out = axis.next_out(self.next_output_id);
            }
        }
    }

    /// A cycle has passed, and the newest `held` outputs are still to be sent.
    pub(super) fn note_sent(&mut self, held: u16) {
        let unsent = self.next_output_id - u64::from(held);
        let mut entries = 0;
        while self.ahead.pop_front_if(|id| *id < unsent).is_some() {
            entries += 1;
        }
        self.counters.executed += entries;
        if entries == 0 && self.v.network.in_op() {
            self.counters.idle_cycles += 1;
        }
    }

    /// The outputs that the bus has taken and not sent go: their entries count as cleared, and the axes are driven as by
    /// the newest outputs that were sent.
    pub(super) fn withdraw_ahead(&mut self, bus: &mut dyn Fieldbus) {
        let withdrawn = bus.discard_ahead();
        let unsent = self.next_output_id - u64::from(withdrawn);
        while self.ahead.pop_front_if(|id| *id < unsent).is_some() {
            self.counters.executed += 1;
        }
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
        for (slave, (axes, then)) in (1..).zip(self.v.axes.iter_mut().zip(&sent.axes)) {
            if lost.contains(slave) {
                continue;
            }
            for (axis, then) in axes.iter_mut().zip(then) {
                axis.go_back_to(then);
            }
            if axes.iter().any(|axis| !axis.homing.is_idle()) {
                self.v.homers.insert(slave);
            }
        }
    }
}
