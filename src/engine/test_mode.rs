//! Test mode (pin CONFIG1 high, SK-4): the board goes to OP by itself, with default settings. Until a host writes
//! outputs it switches the outputs of all IO slaves on and off in turn.

use super::Engine;
use crate::fieldbus::{Ns, Role};
use crate::sk::MasterState;

/// How long all outputs of all IO slaves are on at the beginning of each round. SK-4 \[OURS]: 2 s.
pub const ALL_ON_NS: Ns = 2_000_000_000;
/// After all outputs were on, each output is on alone for this time, slave by slave from output 0 on. Then the next
/// round begins. \[OURS]
pub const ONE_ON_NS: Ns = 250_000_000;
/// The number of digital outputs of an IO slave.
const OUTPUTS: u64 = 16;

/// The progress of the output test.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum TestPhase {
    /// The board has not reached PreOP since its boot.
    #[default]
    Booting,
    /// The board has requested OP once and waits until the network is in OP. The test then starts from the beginning.
    Waiting,
    /// The test runs, since this board time.
    Running(Ns),
    /// The test has ended, because a host has written outputs.
    Over,
}

/// The digital outputs (bit k: output k) that the test gives to the `n`-th (from 0) of `slaves` IO slaves, `elapsed_ns`
/// after the test began.
fn image(n: u64, slaves: u64, elapsed_ns: Ns) -> u16 {
    let round_ns = ALL_ON_NS + slaves * OUTPUTS * ONE_ON_NS;
    match (elapsed_ns % round_ns).checked_sub(ALL_ON_NS) {
        None => u16::MAX,
        Some(alone_ns) => {
            let step = alone_ns / ONE_ON_NS;
            u16::from(step / OUTPUTS == n) << (step % OUTPUTS)
        }
    }
}

impl Engine {
    /// Runs the output test for one cycle.
    pub(super) fn run_test(&mut self, now: Ns) {
        let in_op = self.network().in_op();
        match self.volatile.test {
            TestPhase::Booting if self.talks() => {
                self.volatile.test = TestPhase::Waiting;
                // The result is ignored: the network is in PreOP, where every SET_STATE is allowed, so this request
                // cannot fail.
                self.volatile.network.request(MasterState::Op, now.saturating_add(self.config.state_timeout_ns), false);
            }
            TestPhase::Waiting if in_op => {
                self.volatile.test = TestPhase::Running(now);
                self.write_test_outputs(0);
            }
            TestPhase::Running(since) if in_op => self.write_test_outputs(now - since),
            TestPhase::Running(_) => self.volatile.test = TestPhase::Waiting,
            TestPhase::Booting | TestPhase::Waiting | TestPhase::Over => {}
        }
    }

    fn write_test_outputs(&mut self, elapsed_ns: Ns) {
        let slaves = self.io_slaves().count() as u64;
        self.write_outputs(|n| image(n, slaves, elapsed_ns));
    }

    /// Called when a host has written outputs: the test ends, and the outputs that it has switched on go off \[OURS].
    pub(super) fn end_output_test(&mut self) {
        if self.config.test && self.volatile.test != TestPhase::Over {
            self.volatile.test = TestPhase::Over;
            self.write_outputs(|_| 0);
        }
    }

    fn write_outputs(&mut self, image: impl Fn(u64) -> u16) {
        let lost = self.network().lost();
        let mut n = 0;
        for slave in 1..=usize::from(self.network().found()) {
            if self.role(slave) != Role::Io {
                continue;
            }
            if !lost.contains(slave as u8) {
                self.axes[slave - 1][0].requested.out.outputs = image(n);
            }
            n += 1;
        }
    }

    fn io_slaves(&self) -> impl Iterator<Item = usize> {
        (1..=usize::from(self.network().found())).filter(|slave| self.role(*slave) == Role::Io)
    }
}
