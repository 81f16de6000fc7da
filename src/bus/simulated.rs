//! Simulated slaves in virtual time, which this crate's own master reaches like slaves on a network card. The script of
//! the link (`script=`) acts on them. Also a simulated chip with such slaves.

use super::BusError;
use crate::address::uri::LinkUri;
use crate::engine::Script as _;
use crate::ethercat::Ns;
use crate::fieldbus::nic::{ChainWires, NicWires};
use crate::link::LinkError;
use crate::link::chip_link::{ChipLink, ChipOptions, host_config};
use crate::link::machine_error::SimulatedSlavesError;
use crate::master::{FrameBuffer, Wire, WireDown};
use crate::recording::Clock;
use crate::slave::Slave;
use crate::slave::esc::UndescribedError;
use crate::slave::handle::SimHandle;
use crate::testbed::chip::SimChip;
use crate::testbed::chip_options::{ChipNetwork, ModelledChip, SimChipOptions};
use crate::testbed::options::SimOptions;
use crate::testbed::script::RunningScript;
use crate::testbed::simulated_slaves;
use crate::xf::host::HostConfig;
use crate::xf_api::XfError;

/// \[OURS] Error of the slaves' crystals, parts per billion, at most the usual tolerance: the first slave's is too fast
/// by this, the last one's too slow by as much, and those between are evenly distributed.
const DRIFT_PPB: u32 = 20_000;
/// Longest step of virtual time between two runs of the script, ns: an action of the script is late by at most this.
const STEP_NS: Ns = 1_000_000;

/// The wires to simulated slaves that were just powered on, and the script that acts on these slaves.
pub(super) struct SimulatedWires {
    slaves: ChainWires,
    script: Option<RunningScript>,
}

impl SimulatedWires {
    /// The wires to the slaves of a link `sim:`. Only the keys `slaves` and `script` are used, and the script must not
    /// contain lines about a board.
    pub(super) fn new(uri: &LinkUri) -> Result<Self, BusError> {
        let handle = SimHandle::default();
        let (devices, script) = slaves(uri, &handle)?;
        let slaves = ChainWires::with_drift(devices, handle, DRIFT_PPB);
        Ok(Self { slaves: slaves.map_err(|error| undescribed(uri, &error))?, script })
    }

    fn run_script(&mut self) {
        if let Some(script) = &mut self.script {
            script.run(self.slaves.now(), &mut |_| {});
        }
    }
}

/// The slaves, just powered on, and their script.
type Scripted = (Vec<Box<dyn Slave>>, Option<RunningScript>);

/// Builds the slaves of a link and starts their script.
fn slaves(uri: &LinkUri, handle: &SimHandle) -> Result<Scripted, BusError> {
    let options = SimOptions::from_uri(uri)?;
    let refused = |error: SimulatedSlavesError| match error {
        SimulatedSlavesError::Objects(error) => LinkError::from(error),
        SimulatedSlavesError::Script(error) => LinkError::from(error),
        error => LinkError::NoBoard { name: uri.to_string(), reason: error.to_string() },
    };
    let script = options.script.as_deref().map(|path| simulated_slaves::script(path, &options.slaves)).transpose();
    let script = script.map_err(refused)?.map(|script| simulated_slaves::start(script, handle.cable().clone(), 0));
    Ok((simulated_slaves::build(&options.slaves).map_err(refused)?, script))
}

/// The chip of a link `xf-sim:`, in virtual time and with a slave controller for each slave, and the settings of its
/// driver.
pub(super) fn chip(uri: &LinkUri) -> Result<(Box<dyn ChipLink>, HostConfig), BusError> {
    let options = SimChipOptions::from_uri(uri)?;
    let chip = ModelledChip { network: Some(ChipNetwork::Controllers), ..options.chip };
    let options = SimChipOptions { clock: Clock::Virtual, chip, ..options };
    let link = SimChip::with_options(&uri.to_string(), &options).map_err(XfError::Link)?;
    let config = host_config(&link.info(), &ChipOptions::from_uri(uri)?);
    Ok((crate::open::chip::recorded(uri, Box::new(link)).map_err(XfError::Link)?, config))
}

fn undescribed(uri: &LinkUri, error: &UndescribedError) -> LinkError {
    LinkError::NoBoard { name: uri.to_string(), reason: error.to_string() }
}

impl Wire for SimulatedWires {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.run_script();
        self.slaves.send(frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        self.slaves.receive(buffer)
    }
}

impl NicWires for SimulatedWires {
    fn now(&self) -> Ns {
        self.slaves.now()
    }

    fn wait(&mut self, until: Ns) {
        while self.slaves.now() < until {
            self.run_script();
            let next = until.min(self.slaves.now().saturating_add(STEP_NS));
            self.slaves.wait(next);
            if self.slaves.now() < next {
                // A frame has arrived. The wait ends early, so that the master can receive the frame.
                return;
            }
        }
    }

    fn is_real_time(&self) -> bool {
        false
    }
}
