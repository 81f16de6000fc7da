//! Time: EtherCAT cycles, and the ends of commands that take time.

use super::Chip;
use super::network::{Exchange, IMAGE_MAX, Network};
use crate::ethercat::{AlState, Ns};
use crate::xf::Interrupts;

/// From the first slave in this state on RxPDOs are taken out of the FIFO. `[OURS]`
const RX_FIFO_FROM: AlState = AlState::Op;
/// From the first slave in this state on inputs come. `[OURS]`
const INPUTS_FROM: AlState = AlState::SafeOp;

impl<N: Network> Chip<N> {
    /// Lets time pass until `now`: EtherCAT cycles at SYNC0 of ECAT_INIT_OP, and the ends of commands. A time that has
    /// passed already has no effect.
    ///
    /// It takes as long as the cycles are many: a second of 1 ms cycles is a thousand.
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

    /// The next cycle, or what the command under way does next if that is earlier.
    fn next_event(&self) -> Ns {
        self.next_job_event().map_or(self.next_cycle, |event| event.min(self.next_cycle))
    }

    /// The time since the last cycle passes in the slaves, then a frame takes outputs to them and brings what they have
    /// measured.
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
        self.helper.lead(places, &mut frame, &bus.inputs);
        let exchange = Exchange { places, outputs: &frame, inputs: &mut bus.inputs, lrw: bus.lrw };
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
