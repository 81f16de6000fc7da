//! The kind of chip of a schedule, and how it is used: any combination that is fast enough for its cycle.

use std::sync::{Arc, Mutex};

use ecmsk::fieldbus::xf::plan::CycleDemand;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions, fifo_entries};
use ecmsk::fieldbus::{Fieldbus, Ns};
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::{Chip, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, HostPacing, Timeouts};
use support::dice::Dice;
use support::faulty_wire::quick;

use super::line::{Line, Trouble};
use crate::followed::Setting;

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
const S: Ns = 1_000_000_000;
/// The clock of SPI.
const CLOCK_HZ: u32 = 24_000_000;
/// Bytes of the inputs of a drive and of the module: more than of their outputs.
const INPUT_BYTES: (usize, usize) = (10, 2);

/// The kind of chip, and how it is used.
#[derive(Clone, Copy, Debug)]
pub struct How {
    pub profile: Profile,
    pub cycle_us: u32,
    pub options: XfBusOptions,
    pub config: HostConfig,
    packet_ns: Ns,
    pub drives: usize,
    pub state_timeout_ns: Ns,
    have_identity: bool,
}

impl How {
    pub fn random(seed: u64) -> Self {
        let mut dice = Dice(seed ^ 0x686F_7721);
        let profile = dice.pick(&[Profile::OLD, Profile::NEW, Profile::XFU]);
        let drives = 1 + dice.below(4) as usize;
        let (idle_ns, pacing) =
            dice.pick(&[(20 * US, HostPacing::Idle), (150 * US, HostPacing::Idle), (20 * US, HostPacing::Int0)]);
        let ahead = dice.pick(&[1, 2, 4, 8, 8, 20, 60]);
        let process_bytes = drives * INPUT_BYTES.0 + INPUT_BYTES.1;
        let from = dice.below(6) as usize;
        let holds = |cycle_us: &&u32| {
            let demand = CycleDemand {
                process_bytes,
                fifo_entries: fifo_entries(2 * process_bytes),
                cycle_ns: Ns::from(**cycle_us) * US,
                clock_hz: Some(CLOCK_HZ),
                idle_ns: idle_ns + 20 * US,
                present: profile.size,
                size_is_fixed: profile.size_is_fixed,
            };
            demand.plan().is_ok()
        };
        let cycle_us = *[250, 500, 1000, 1000, 2000, 4000][from..].iter().find(holds).unwrap_or(&4000);
        let timeouts = Timeouts { answer_ns: dice.pick(&[20 * MS, 100 * MS]), int0_ns: 5 * MS, ..Timeouts::DEFAULT };
        let config = HostConfig {
            size: dice.pick(&[None, Some(profile.size)]),
            pacing,
            idle_ns,
            resync_after: dice.pick(&[2, 4, 8]),
            timeouts,
            ..HostConfig::DEFAULT
        };
        let options = XfBusOptions {
            ahead,
            clock_hz: Some(CLOCK_HZ),
            size_is_fixed: profile.size_is_fixed,
            real_time: dice.one_in(3),
            ..XfBusOptions::DEFAULT
        };
        let packet_ns = if pacing == HostPacing::Int0 { 100 * US } else { idle_ns - 5 * US };
        let state_timeout_ns = dice.pick(&[S, 10 * S]);
        let have_identity = dice.one_in(2);
        Self { profile, cycle_us, options, config, packet_ns, drives, state_timeout_ns, have_identity }
    }
}

impl Setting for How {
    type Ends = Arc<Mutex<Trouble>>;

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
        self.have_identity
    }

    fn bus(&self, seed: u64, slaves: Vec<Box<dyn Slave>>, network: SimHandle) -> (Box<dyn Fieldbus>, Self::Ends) {
        let trouble = Arc::new(Mutex::new(Trouble::default()));
        let slaves = SlaveModels::new(slaves).reached_by(network);
        let chip = Chip::with_timing(self.profile, quick(self.packet_ns), slaves);
        let line = Line::new(chip, Arc::clone(&trouble), seed, !self.profile.size_is_fixed);
        (Box::new(XfBus::new(line, self.config, self.options)), trouble)
    }
}
