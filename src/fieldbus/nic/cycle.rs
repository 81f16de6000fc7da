//! The frames of a cycle: writes the outputs into the frames and reads the inputs from the answers. Finds the lost
//! slaves by the AL states that the master has read, and by stale inputs.

use super::unreached_outputs::Cycle;
use super::{NicBus, NicWires, answer_wait_ns};
use crate::ethercat::registers::{AlStatusRegister, RequestedState};
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::pdo::{IMAGE_BYTES_MAX, ProcessData};
use crate::fieldbus::{CycleDone, Inputs, MAX_SLAVES, SlaveIn, SlaveOut};
use crate::master;

impl<W: NicWires> NicBus<W> {
    /// Sends the frames of a cycle and waits until they are back, at most for the time
    /// [`ANSWER_WAIT`](super::ANSWER_WAIT). `None`: not all frames came back in time.
    pub(super) fn exchange(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        if self.is_working() && !self.has_cycles() {
            // During a scan or a configuration only the job uses the wire, and no process data are exchanged. This
            // pause in the cycles must not be reported as a delay of this machine, so `sent_at` is reset.
            self.standstill.sent_at = None;
            return self.heard(now, inputs);
        }
        self.put_outputs();
        let sent_at = self.wires.now();
        // The wait for the answers ends at a fixed time after the cycle was due (`answer_wait_ns`). If the runner is
        // late, the wait is shorter by this delay.
        let late = sent_at.wrapping_sub(now.wrapping_sub(self.skew.unwrap_or(0)));
        let due = if late < self.cycle.ns() { sent_at - late.min(sent_at) } else { sent_at };
        let limit = due.saturating_add(answer_wait_ns(self.cycle));
        self.standstill.note(sent_at);
        self.master.lock().cycle(sent_at, &mut self.wires);
        self.may_have_come = self.has_new_outputs;
        // A result that the master already has belongs to the previous cycle, whose answer came too late.
        let _ = self.master.lock().take_cycle();
        while self.master.lock().is_cycle_open() && self.wires.now() < limit {
            self.wires.wait(limit);
            self.master.lock().poll(self.wires.now(), &mut self.wires);
        }
        self.take_ends();
        let done = self.master.lock().take_cycle();
        match done.filter(|done| done.lost == 0 && done.present.is_some()) {
            Some(done) => Some(self.answered(now, &done, inputs)),
            None => {
                self.unanswered = self.unanswered.saturating_add(1);
                None
            }
        }
    }

    /// The result of a cycle without process data, during a scan or a configuration.
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

    /// Writes the outputs of all slaves into the process images that the frames carry. A slave gets outputs that keep
    /// its axes at a standstill if it is not in OP, or the engine has pushed no outputs since it entered OP, or it is
    /// lost: a lost slave may answer again at any time (SK-4.62). A slave in OP whose inputs are stale gets a quick
    /// stop.
    fn put_outputs(&mut self) {
        let mut master = self.master.lock();
        for slave in self.all().iter() {
            let n = usize::from(slave) - 1;
            let station = &self.stations[n];
            let Some(data) = &station.process_data else { continue };
            let Some(image) = master.outputs_mut(slave) else { continue };
            let holds = self.holding.contains(slave) || self.lost.contains(slave);
            if station.commanded == AlState::Op && self.ages.stale.contains(slave) {
                put_into(data, &data.stopping(&self.inputs[n]), image);
            } else if station.commanded == AlState::Op && !holds {
                put_into(data, &self.outputs.slaves[n], image);
            } else {
                put_into(data, &data.holding(&self.inputs[n]), image);
            }
        }
    }

    /// Evaluates the answers of a cycle whose frames have all come back.
    fn answered(&mut self, now: Ns, done: &master::CycleDone, inputs: &mut Inputs) -> CycleDone {
        let answers_lost = std::mem::take(&mut self.unanswered);
        let skew = self.skew.unwrap_or(0);
        let mut newly_stale = SlaveSet::EMPTY;
        let master = self.master.lock();
        for slave in SlaveSet::first(self.found).iter() {
            let n = usize::from(slave) - 1;
            let Some(data) = &self.stations[n].process_data else { continue };
            let has_inputs = self.stations[n].commanded >= AlState::SafeOp && !self.lost.contains(slave);
            let Some(image) = master.inputs(slave).filter(|image| has_inputs && !image.is_empty()) else {
                self.ages.renew(slave);
                continue;
            };
            if done.fresh.contains(slave) {
                take_from(data, image, &mut self.inputs[n]);
                inputs.slaves[n] = self.inputs[n];
                self.ages.renew(slave);
            } else if self.ages.hold(slave, done.sent_at, answers_lost, self.cycle.ns(), master.searched()) {
                newly_stale.insert(slave);
            }
        }
        let (lost_part, states_read) = (master.working_counter_of(self.lost), master.states_read());
        drop(master);
        let is_new = std::mem::take(&mut self.has_new_outputs);
        let outputs = is_new.then_some(self.outputs.id);
        self.sent = outputs.or(self.sent);
        if !is_new {
            self.all_is_sent();
        }
        let missed = done.expected_working_counter.saturating_sub(done.working_counter);
        let is_short =
            missed > lost_part || !done.doubtful.difference(self.lost).is_empty() || self.has_fallen_slave(done.states);
        let outputs_lost = self.missed.take_cycle(&Cycle {
            sent_at: done.sent_at,
            outputs,
            sent: self.sent,
            working_counters: [done.working_counter, done.expected_working_counter],
            is_short,
            has_lost: !self.lost.is_empty(),
            is_obeyed: self.lost.is_empty() || done.all_in_op && missed == 0,
            has_job: self.job.is_some(),
        });
        self.update_lost();
        self.lose_stale(newly_stale);
        self.missed.note_states(states_read, self.sent);
        self.tell(inputs);
        CycleDone {
            at: now,
            outputs,
            outputs_lost,
            answers_lost,
            working_counter: done.working_counter,
            expected_working_counter: done.expected_working_counter,
            next_deadline: done.next_deadline.map(|deadline| deadline.wrapping_add(skew)),
        }
    }

    fn tell(&self, inputs: &mut Inputs) {
        inputs.lost = self.lost;
        inputs.held = self.ages.held.difference(self.lost);
        inputs.stale = self.ages.stale.intersection(self.lost);
        inputs.lost_from = self.lost_from;
        inputs.stood_still_ns = self.standstill.recent_ns(self.wires.now());
        inputs.left_with = [0; MAX_SLAVES];
        if !self.lost.is_empty() {
            self.master.lock().look_at_statuses(|slave, status| {
                let has_left = status.is_present && status.status.contains(AlStatusRegister::ERROR);
                if let Some(place) = inputs.left_with.get_mut(usize::from(slave) - 1).filter(|_| has_left) {
                    *place = status.code.0;
                }
            });
        }
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

    /// Whether a slave that is not known as lost is in a lower AL state than commanded: it still increments the working
    /// counter, but ignores outputs. `states`: the AL status of all slaves, combined by OR. The lower state then shows
    /// as a bit that no expected state has.
    pub(super) fn has_fallen_slave(&self, states: u16) -> bool {
        let known = |slave| {
            if self.lost.contains(slave) {
                self.master.lock().status(slave).map_or(0, |status| status.status.0)
            } else {
                RequestedState::State(self.station(slave).commanded).code().into()
            }
        };
        self.job.is_none() && states & !self.all().iter().map(known).fold(0, |all, bits| all | bits) != 0
    }

    /// Updates the set of lost slaves by the AL states that the master has read. A slave is lost if it does not answer,
    /// or is in a lower state than commanded. It is no longer lost if it answers and a state below SafeOP was
    /// commanded.
    pub(super) fn update_lost(&mut self) {
        let Self { master, stations, lost, lost_from, ages, missed, found, .. } = self;
        let had_lost = !lost.is_empty();
        master.lock().look_at_statuses(|slave, status| {
            if slave > *found {
                return;
            }
            let n = usize::from(slave) - 1;
            let state = Some(status).filter(|status| status.is_present).and_then(|status| status.state());
            let is_missing = state.is_none_or(|state| state < stations[n].commanded);
            if is_missing && !lost.contains(slave) {
                lost.insert(slave);
                lost_from[n] = missed.name(had_lost);
            } else if !is_missing && stations[n].commanded < AlState::SafeOp {
                lost.remove(slave);
                ages.forget(slave);
                lost_from[n] = None;
            }
        });
    }

    /// Marks slaves whose inputs have become stale as lost. The first outputs that may not have reached such a slave,
    /// and all later ones, count as not executed, because it is not known whether the slave uses them.
    pub(super) fn lose_stale(&mut self, stale: SlaveSet) {
        let had_lost = !self.lost.is_empty();
        for slave in stale.difference(self.lost).iter() {
            self.lost.insert(slave);
            self.lost_from[usize::from(slave) - 1] = self.missed.name(had_lost);
        }
    }
}

/// Writes outputs into a process image. If a module keeps the process data from its EEPROM, its image may be longer or
/// shorter than the board's image. Then the first bits are used, and the others stay 0 \[OURS].
#[inline]
fn put_into(data: &ProcessData, outputs: &SlaveOut, image: &mut [u8]) {
    if image.len() >= data.output_bytes() {
        data.put_outputs(outputs, image);
    } else {
        let mut whole = [0; IMAGE_BYTES_MAX];
        let bytes = data.put_outputs(outputs, &mut whole);
        image.copy_from_slice(&bytes[..image.len()]);
    }
}

/// Reads inputs from a process image. If the image is shorter than the board's image, the missing bits are read as 0
/// \[OURS].
#[inline]
fn take_from(data: &ProcessData, image: &[u8], inputs: &mut SlaveIn) {
    if image.len() >= data.input_bytes() {
        data.take_inputs(image, inputs);
    } else {
        let mut whole = [0; IMAGE_BYTES_MAX];
        whole[..image.len()].copy_from_slice(image);
        data.take_inputs(&whole, inputs);
    }
}
