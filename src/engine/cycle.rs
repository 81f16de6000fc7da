//! One cycle of the board: the bus's jobs, the FIFO's entries, process data, the report; and when the next one is due.

use super::{Engine, Event, EventKind};
use crate::fieldbus::{Fieldbus, Ns, Pacing, RingState};
use crate::sk::Frame;

impl Engine {
    /// Runs one cycle at `now`: jobs of the bus, FIFO entries, process data, and the report, which goes to `report`
    /// with the time of its cycle. Returns whether a cycle of the bus has passed. No cycle passes while the cable
    /// before the first slave is cut. In OP there is no report then; before OP the board makes its reports in its own
    /// cycle, even if the bus has no cycles (SK-9).
    pub fn cycle(&mut self, now: Ns, bus: &mut dyn Fieldbus, report: &mut dyn FnMut(&Frame, Ns)) -> bool {
        if let Some(bits) = bus.local_inputs() {
            self.set_local_inputs(bits);
        }
        self.note_bus_down(bus.is_down(), now);
        self.note_other_master(bus, now);
        self.run_jobs(now, bus);
        self.run_clear(now, bus);
        if self.config.test {
            self.run_test(now);
        }
        if self.network().in_op() {
            self.counters.ring_broken += u64::from(bus.ring().is_some_and(RingState::is_broken));
            self.clear_what_nobody_gets();
            self.push_outputs(now, bus);
        }
        let (in_op, mut passed) = (self.network().in_op(), false);
        while let Some(done) = bus.poll(now, &mut self.inputs) {
            passed = true;
            self.note_confirmed(&done);
            self.last_passed = done.at;
            self.next_deadline = done.next_deadline;
            self.complete(&done);
            if in_op {
                self.give_report(done.at, report);
            }
            if self.pacing == Pacing::Runner {
                break;
            }
        }
        if !in_op {
            if self.is_bus_silent(now) {
                self.note_silence(now);
            }
            // While the board boots, no host can read the response: refreshing it in the hundreds of cycles of a boot
            // would be wasted.
            if self.talks() {
                self.refresh_response();
            }
            self.give_report(now, report);
        }
        if self.volatile.local_outputs != self.local_outputs_told {
            self.local_outputs_told = self.volatile.local_outputs;
            bus.set_local_outputs(self.volatile.local_outputs);
        }
        passed
    }

    /// Counts the cycles in OP that a late runner has skipped.
    pub(super) const fn note_left_out(&mut self, cycles: u64) {
        if self.network().in_op() {
            self.counters.cycles_left_out += cycles;
        }
    }

    /// Logs that another master sends frames on the network, only once.
    fn note_other_master(&mut self, bus: &dyn Fieldbus, at: Ns) {
        if self.has_told_other_master {
            return;
        }
        if let Some(address) = bus.strangers().other_master {
            self.has_told_other_master = true;
            self.log.push(Event { at, kind: EventKind::OtherMaster { address } });
        }
    }

    fn note_bus_down(&mut self, down: bool, at: Ns) {
        if down && !self.bus_down {
            self.log.push(Event { at, kind: EventKind::BusDown });
        }
        self.bus_down = down;
    }

    /// When the cycle after the one at `now` is due: a period later, or at the time that the bus requests
    /// ([`CycleDone::next_deadline`](crate::fieldbus::CycleDone)), at most half a period earlier or later \[OURS].
    pub(super) fn next_cycle(&mut self, now: Ns) -> Ns {
        let period = self.period_ns();
        let planned = now + period;
        let asked = self.next_deadline.take().unwrap_or(planned);
        asked.clamp(planned - period / 2, planned + period / 2)
    }

    fn give_report(&mut self, at: Ns, report: &mut dyn FnMut(&Frame, Ns)) {
        if self.talks() && !self.reports_suppressed {
            self.counters.reports += 1;
            report(&self.volatile.response, at);
        }
    }

    /// How long the bus may be without a cycle before the cable counts as cut. A bus with a cycle of its own may
    /// complete none during a cycle of the board: the two are not synchronized, both have jitter, and the cycle time
    /// may just have changed. So the limit is two cycles of the longer cycle time \[OURS], plus the delay of answers.
    pub(crate) fn silence_tolerance_ns(&self) -> Ns {
        match self.pacing {
            Pacing::Runner => 0,
            Pacing::Bus { answer_delay, .. } => (2 + Ns::from(answer_delay)) * self.longest_period_ns(),
        }
    }

    /// Whether the bus has been without a cycle for so long that the cable before the first slave seems to be cut.
    pub(super) fn is_bus_silent(&self, now: Ns) -> bool {
        now - self.last_passed > self.silence_tolerance_ns()
    }
}
