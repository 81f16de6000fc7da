//! The passage of time: EtherCAT cycles, and the ends of commands that take time.

use super::Chip;
use super::network::{IMAGE_MAX, ProcessExchange, SlaveNetwork};
use crate::ethercat::{AlState, Ns};
use crate::xf::Interrupts;

/// `[OURS]` RxPDOs are taken out of the FIFO once at least one slave, not necessarily all, was brought to this state.
const RX_FIFO_FROM: AlState = AlState::Op;
/// `[OURS]` Process data are exchanged once any slave was brought to this state.
const INPUTS_FROM: AlState = AlState::SafeOp;

impl<N: SlaveNetwork> Chip<N> {
    /// Lets time pass until `now`, ns since the chip's power-on: EtherCAT cycles with the SYNC0 time of ECAT_INIT_OP, and the
    /// ends of commands. A time in the past has no effect.
    ///
    /// The call simulates each of these cycles, so a long step needs much computing time: a second with a cycle time of
    /// 1 ms is a thousand cycles.
    pub fn run_until(&mut self, now: Ns) {
        while self.next_event() <= now {
            self.now = self.next_event().max(self.now);
            if self.now == self.next_cycle {
                self.cycle();
                self.next_cycle = self.now + self.bus.cycle_ns;
            } else if self.network.next_work().is_some_and(|at| at <= self.now) {
                self.network.work(self.now);
            }
            if self.job.is_some() {
                self.run_job();
            }
        }
        self.now = self.now.max(now);
        self.gpio.settle(self.now);
        self.analog.settle(self.now);
    }

    /// The time of the next cycle, or of the next step of the running command if that is earlier.
    fn next_event(&self) -> Ns {
        self.next_job_event().map_or(self.next_cycle, |event| event.min(self.next_cycle))
    }

    /// Runs a cycle. First the time since the last cycle passes in the slaves; then a frame brings them outputs and
    /// returns the inputs that they have measured.
    fn cycle(&mut self) {
        self.network.pass(self.now, self.now - self.last_cycle);
        self.last_cycle = self.now;
        while let Some((slave, emergency)) = self.network.take_emergency() {
            self.results.emergencies.add(slave, emergency);
        }
        if !self.bus.mapped || !self.bus.any_commanded(INPUTS_FROM) {
            return;
        }
        if self.fifo_on && self.bus.any_commanded(RX_FIFO_FROM) {
            let interrupt = self.fifos.pop_rx(&mut self.bus.outputs);
            self.interrupts.raise(interrupt);
        }
        let mut frame = [0; IMAGE_MAX];
        let bus = &mut self.bus;
        frame.copy_from_slice(&bus.outputs);
        let places = &bus.places[..bus.count.into()];
        self.helper.drive_state_machines(places, &mut frame, &bus.inputs);
        let exchange = ProcessExchange { places, outputs: &frame, inputs: &mut bus.inputs, lrw: bus.lrw };
        let working_counter = self.network.exchange(exchange);
        let is_right = bus.count(working_counter, self.network.outputs_count_from());
        let interrupt = self.fifos.push_tx(&bus.inputs[..bus.tx_bytes.into()]);
        self.interrupts.raise(interrupt | Interrupts::ETHERCAT);
        if !is_right {
            self.interrupts.raise(Interrupts::WORKING_COUNTER);
            if self.bus.is_over_limit() {
                (self.bus.mapped, self.fifo_on) = (false, false);
            }
        }
    }
}
