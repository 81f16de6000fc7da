//! The network of a schedule, and how its board is run.

use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::{Fieldbus, Ns};
use ecmsk::master::Settings;
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use support::dice::Dice;

use super::line::{Line, LineEnds};
use crate::followed::Setting;

const S: Ns = 1_000_000_000;

/// The network, and how its board is run.
#[derive(Clone, Copy, Debug)]
pub struct How {
    cycle_us: u32,
    drives: usize,
    /// Whether a runner waits for the time of each cycle, as with a real card.
    has_runner: bool,
    state_timeout_ns: Ns,
}

impl How {
    pub fn random(seed: u64) -> Self {
        let mut dice = Dice(seed ^ 0x7769_7265);
        Self {
            cycle_us: dice.pick(&[250, 500, 1000, 1000, 2000, 4000]),
            drives: 1 + dice.below(4) as usize,
            has_runner: dice.one_in(2),
            state_timeout_ns: dice.pick(&[S, 10 * S]),
        }
    }
}

impl Setting for How {
    type Ends = LineEnds;

    fn drives(&self) -> usize {
        self.drives
    }

    fn cycle_us(&self) -> u32 {
        self.cycle_us
    }

    fn state_timeout_ns(&self) -> Ns {
        self.state_timeout_ns
    }

    fn have_identity(&self) -> bool {
        true
    }

    fn bus(&self, seed: u64, slaves: Vec<Box<dyn Slave>>, network: SimHandle) -> (Box<dyn Fieldbus>, LineEnds) {
        let wires = ChainWires::new(slaves, network).expect("they have an EEPROM");
        let line = Line::new(wires, seed, self.has_runner);
        let ends = line.ends(self.has_runner);
        (Box::new(NicBus::new(line, Settings::default())), ends)
    }
}
