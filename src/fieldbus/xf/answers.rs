//! Keeps the answers of the chip's cycles until the engine polls them: the inputs, the time of the cycle, and the
//! newest outputs sent by then.

use super::chip_bus::ChipBus;
use super::tick_ns;
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::{CycleDone, Inputs};
use crate::xf::DataSize;
use crate::xf::host::Wires;

/// The maximum number of bytes of process data in one direction: as many as the largest packet holds.
pub(super) const IMAGE_MAX: usize = DataSize::MAX.bytes();
/// The maximum number of answers that are kept until they are polled; if there are more, the oldest is lost. \[OURS]
pub(super) const ANSWERS: usize = 128;

/// The chip's answer for one of its cycles.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    /// When the cycle ran, on the clock of the wires to the chip.
    at: Ns,
    sent: Option<u64>,
    cycles_lost: u32,
    /// Whether the inputs of this cycle are in doubt, so that the previous inputs stay: the chip has reported wrong
    /// working counters, and this cycle may have had one.
    is_doubtful: bool,
    image: Vec<u8>,
}

impl Default for Answer {
    fn default() -> Self {
        Self { at: 0, sent: None, cycles_lost: 0, is_doubtful: false, image: vec![0; IMAGE_MAX] }
    }
}

impl<W: Wires> ChipBus<W> {
    /// Keeps the answer of the cycle with the number `cycle`. Its inputs begin at byte `from` of the inputs that the
    /// driver has received. `behind`: the number of later cycles in the same exchange, so the cycle ran about that many
    /// periods before `now`.
    pub(super) fn keep_cycle(&mut self, now: Ns, cycle: u64, behind: u64, from: usize) {
        let period_ns = self.network.cycle.ns();
        let estimate = now.saturating_sub(behind * period_ns);
        let due = self.newest_cycle.saturating_add(period_ns);
        let cycles_lost =
            if std::mem::take(&mut self.gap) { (estimate.saturating_sub(due) / period_ns) as u32 } else { 0 };
        let at = due.clamp(estimate.saturating_sub(period_ns), estimate).max(self.newest_cycle + 1).min(now);
        self.newest_cycle = at;
        self.counters.cycles_lost += u64::from(cycles_lost);
        let (sent, is_doubtful) = (self.ledger.sent_in(cycle), self.takes_in_doubt());
        let mut answer = match self.spare.pop() {
            Some(answer) => answer,
            None => {
                // No buffer is free, because the engine has not polled for a while: the oldest answer is dropped.
                let Some(oldest) = self.answers.pop_front() else { return };
                self.lost_cycles += oldest.cycles_lost + 1;
                self.counters.cycles_lost += 1;
                oldest
            }
        };
        let tx_bytes = self.network.tx_bytes;
        answer.image[..tx_bytes].copy_from_slice(&self.host.inputs()[from..from + tx_bytes]);
        (answer.at, answer.sent, answer.cycles_lost, answer.is_doubtful) = (at, sent, cycles_lost, is_doubtful);
        self.answers.push_back(answer);
    }

    /// Returns the chip's next cycle if it had passed by the engine's time `now`; `None`: no further cycle.
    pub(super) fn next_answer(&mut self, now: Ns) -> Option<CycleDone> {
        let at = self.engine_time(self.answers.front()?.at);
        // If the wires to the chip have a real clock, a received cycle has passed, even if the engine's time is still
        // before the cycle.
        if at > now && !self.options.real_time {
            return None;
        }
        let answer = self.answers.pop_front()?;
        let tx_bytes = self.network.tx_bytes;
        self.is_held = answer.is_doubtful;
        if !answer.is_doubtful {
            self.newest_inputs[..tx_bytes].copy_from_slice(&answer.image[..tx_bytes]);
        }
        self.judge_inputs(answer.at, answer.is_doubtful);
        let answers_lost = answer.cycles_lost + std::mem::take(&mut self.lost_cycles);
        let at = at.max(self.told_at + 1).min(now);
        let done = self.done(at, answer.sent, answers_lost);
        self.spare.push(answer);
        Some(done)
    }

    /// Returns a cycle every [`tick_ns`] while no slave is in OP. The chip's own cycles are not read then, but the
    /// board has to make a report in each cycle even so.
    pub(super) fn next_tick(&mut self, now: Ns) -> Option<CycleDone> {
        self.is_held = false;
        let at = self.told_at.saturating_add(tick_ns());
        if at > now {
            return None;
        }
        // A bus whose network was lost still accepts outputs, which reach no slave, so they count as lost.
        if let Some(set) = self.queue.pop_front() {
            self.lose_left_behind();
            self.lose_sets(1);
            self.dropped = Some(set.id);
        }
        let newest = self.dropped.or(self.ledger.newest_sent());
        let lost = std::mem::take(&mut self.lost_cycles);
        Some(self.done(at, newest, lost))
    }

    fn done(&mut self, at: Ns, outputs: Option<u64>, answers_lost: u32) -> CycleDone {
        self.told_at = at;
        CycleDone {
            at,
            outputs,
            outputs_lost: std::mem::take(&mut self.outputs_lost),
            answers_lost,
            working_counter: 0,
            expected_working_counter: 0,
            next_deadline: None,
        }
    }

    /// Copies the inputs of the newest polled cycle, and the sets of lost and stale slaves, into `inputs`.
    pub(super) fn fill(&self, inputs: &mut Inputs) {
        let network = &self.network;
        let in_safe_op = network.at_least(AlState::SafeOp);
        inputs.held = if self.is_held { self.with_inputs() } else { SlaveSet::EMPTY };
        inputs.stale = network.stale;
        for (n, slave) in (1..=network.found).enumerate() {
            if let Some(data) = &network.process_data[n]
                && in_safe_op.contains(slave)
                && !network.lost.contains(slave)
            {
                data.take_inputs(&self.newest_inputs[network.places[n].inputs_at..], &mut inputs.slaves[n]);
            }
        }
        let found = SlaveSet::first(network.found);
        (inputs.lost, inputs.lost_from) = (network.lost, network.lost_from);
        inputs.without_outputs = found.difference(network.in_op());
        inputs.without_inputs = found.difference(in_safe_op);
    }
}
