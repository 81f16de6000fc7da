//! The frames of a cycle: what they carry, and what their answers tell.

use super::{ANSWER_WAIT, NicBus, NicWires};
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::{CycleDone, Inputs};
use crate::master;

impl<W: NicWires> NicBus<W> {
    /// Sends the frames of a cycle and waits for them, as the page of this module says.
    pub(super) fn exchange(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        if self.is_working() && !self.has_cycles() {
            // A scan or a mapping has the wire for itself.
            return self.heard(now, inputs);
        }
        self.put_outputs();
        let (share, of) = ANSWER_WAIT;
        let limit = self.wires.now().saturating_add(self.cycle.ns() / of * share);
        self.master.cycle(self.wires.now(), &mut self.wires);
        while self.master.is_cycle_open() && self.wires.now() < limit {
            self.wires.wait(limit);
            self.master.poll(self.wires.now(), &mut self.wires);
        }
        self.take_ends();
        match self.master.take_cycle().filter(|done| done.lost == 0 && done.present.is_some()) {
            Some(done) => Some(self.answered(now, &done, inputs)),
            None => {
                self.unanswered = self.unanswered.saturating_add(1);
                None
            }
        }
    }

    /// A cycle in which the wire was used for something else: nothing was exchanged.
    fn heard(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        self.update_lost();
        self.tell(inputs);
        Some(CycleDone {
            at: now,
            outputs: None,
            outputs_lost: 0,
            answers_lost: 0,
            working_counter: 0,
            expected_working_counter: 0,
            next_deadline: None,
        })
    }

    /// Puts the outputs of all slaves into the images that the frames carry. A slave that is not in OP, or has no outputs
    /// from there yet, gets such with which nothing moves.
    fn put_outputs(&mut self) {
        for slave in self.all().iter() {
            let n = usize::from(slave) - 1;
            let station = &self.stations[n];
            let Some(data) = &station.process_data else { continue };
            let Some(image) = self.master.outputs_mut(slave) else { continue };
            if image.len() < data.output_bytes() {
                continue;
            }
            if station.commanded == AlState::Op && !self.holding.contains(slave) {
                data.put_outputs(&self.outputs.slaves[n], image);
            } else {
                data.put_outputs(&data.holding(&self.inputs[n]), image);
            }
        }
    }

    /// The frames have come back.
    fn answered(&mut self, now: Ns, done: &master::CycleDone, inputs: &mut Inputs) -> CycleDone {
        let answers_lost = std::mem::take(&mut self.unanswered);
        let skew = self.skew.unwrap_or(0);
        for slave in self.all().iter() {
            let n = usize::from(slave) - 1;
            let Some(data) = &self.stations[n].process_data else { continue };
            let has_inputs = self.stations[n].commanded >= AlState::SafeOp && !self.lost.contains(slave);
            if let Some(image) =
                self.master.inputs(slave).filter(|image| has_inputs && image.len() >= data.input_bytes())
            {
                data.take_inputs(image, &mut self.inputs[n]);
                inputs.slaves[n] = self.inputs[n];
            }
        }
        let is_new = std::mem::take(&mut self.has_new_outputs);
        let outputs = is_new.then_some(self.outputs.id);
        self.sent = outputs.or(self.sent);
        if done.short.is_empty() {
            self.short_from = None;
        } else if self.short_from.is_none() {
            // What was repeated had reached everybody before.
            self.short_from = outputs.or(self.sent.map(|sent| sent + 1));
        }
        self.update_lost();
        self.tell(inputs);
        CycleDone {
            at: now,
            outputs,
            outputs_lost: 0,
            answers_lost,
            working_counter: done.working_counter,
            expected_working_counter: done.expected_working_counter,
            next_deadline: done.next_deadline.map(|deadline| deadline.wrapping_add(skew)),
        }
    }

    /// Finds out which slaves are lost, by what the master knows of their states.
    fn update_lost(&mut self) {
        let Self { master, stations, lost, lost_from, short_from, found, .. } = self;
        master.look_at_statuses(|slave, status| {
            if slave > *found {
                return;
            }
            let n = usize::from(slave) - 1;
            let state = Some(status).filter(|status| status.is_present).and_then(|status| status.state());
            let is_missing = state.is_none_or(|state| state < stations[n].commanded);
            if is_missing && !lost.contains(slave) {
                lost.insert(slave);
                lost_from[n] = *short_from;
            } else if !is_missing && stations[n].commanded < AlState::SafeOp {
                lost.remove(slave);
                lost_from[n] = None;
            }
        });
    }

    fn tell(&self, inputs: &mut Inputs) {
        inputs.lost = self.lost;
        inputs.lost_from = self.lost_from;
        (inputs.without_outputs, inputs.without_inputs) = (SlaveSet::EMPTY, SlaveSet::EMPTY);
        for slave in self.all().iter() {
            let commanded = self.station(slave).commanded;
            if commanded < AlState::Op {
                inputs.without_outputs.insert(slave);
            }
            if commanded < AlState::SafeOp {
                inputs.without_inputs.insert(slave);
            }
        }
    }
}
