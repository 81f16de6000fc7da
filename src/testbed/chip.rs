//! `xf-sim:`: the model of an ECM-XF with simulated slaves in this process.

use std::time::{Duration, Instant};

use super::build;
use super::chip_options::{ChipNetwork, ModelledChip, SimChipOptions};
use super::script::RunningScript;
use super::simulated_slaves;
use crate::address::uri::LinkUri;
use crate::engine::Script as _;
use crate::ethercat::Ns;
use crate::link::chip_link::{ChipError, ChipInfo, ChipLink, RESET_LOW};
use crate::recording::Clock;
use crate::slave::handle::SimHandle;
use crate::xf::chip::{Chip, ChipPort, SimulatedNetwork};
use crate::xf::host::Wires;

/// A model of the chip, which gets its power when it is opened, and the wires to it.
pub struct SimChip {
    info: ChipInfo,
    port: ChipPort<SimulatedNetwork>,
    clock: ChipClock,
    /// How long a byte takes, in picoseconds.
    byte_ps: u64,
    /// The chip was or came to be at work in the last exchange: INT0 becomes active once more.
    edge_to_come: bool,
    /// What happens to the slaves and when, in the chip's time (`script=`).
    script: Option<RunningScript>,
}

/// How far the chip's time advances at most before its script is looked at again. \[OURS] The shortest cycle of a board.
const SCRIPT_STEP_NS: Ns = 250_000;

/// How long a byte of an ECM-XFU takes: its packets of 1024 bytes take a microframe of USB. \[OURS]
const USB_BYTE_PS: u64 = 125_000_000 / 1024;

/// The time since the chip got its power.
enum ChipClock {
    Virtual(Ns),
    Real(Instant),
}

impl ChipClock {
    fn now(&self) -> Ns {
        match self {
            Self::Virtual(now) => *now,
            Self::Real(start) => Ns::try_from(start.elapsed().as_nanos()).unwrap_or(Ns::MAX),
        }
    }

    fn wait_until(&mut self, time: Ns) {
        let left = time.saturating_sub(self.now());
        match self {
            Self::Virtual(now) => *now += left,
            Self::Real(_) => std::thread::sleep(Duration::from_nanos(left)),
        }
    }
}

impl SimChip {
    /// The chip that an `xf-sim:` link describes.
    ///
    /// # Errors
    /// [`ChipError::Uri`], and as [`Self::with_options`].
    pub fn from_uri(uri: &LinkUri) -> Result<Self, ChipError> {
        Self::with_options(&uri.to_string(), &SimChipOptions::from_uri(uri)?)
    }

    /// The chip with these options; `name` is the name of the link in messages. A script begins now.
    ///
    /// # Errors
    /// [`ChipError::Script`], [`ChipError::ManufacturerObjects`], [`ChipError::Network`].
    pub fn with_options(name: &str, options: &SimChipOptions) -> Result<Self, ChipError> {
        let network = options.chip.network.unwrap_or(ChipNetwork::Controllers);
        let script = match &options.script {
            Some(path) => {
                Some(simulated_slaves::script_of_chip(path, &options.slaves, network == ChipNetwork::Controllers)?)
            }
            None => None,
        };
        let slaves = build::slaves(&options.slaves)?;
        let handle = SimHandle::default();
        let script = script.map(|script| simulated_slaves::start(script, handle.cable().clone(), 0));
        let network = network
            .with(slaves, handle)
            .map_err(|error| ChipError::Network { name: name.to_owned(), reason: error.to_string() })?;
        Ok(Self { script, ..Self::over(name, options.chip, options.clock, network) })
    }

    /// The chip with that network; `name` is the name of the link in messages.
    pub fn over(name: &str, chip: ModelledChip, clock: Clock, network: SimulatedNetwork) -> Self {
        let profile = chip.profile();
        let size = profile.size_is_fixed.then_some(profile.size);
        let clock_hz = size.is_none().then_some(chip.speed_hz);
        let byte_ps = clock_hz.map_or(USB_BYTE_PS, |hertz| 8_000_000_000_000 / u64::from(hertz));
        let info = ChipInfo {
            name: name.to_owned(),
            size,
            clock_hz,
            has_int0: chip.int0,
            virtual_time: clock == Clock::Virtual,
        };
        let clock = match clock {
            Clock::Virtual => ChipClock::Virtual(0),
            Clock::Real => ChipClock::Real(Instant::now()),
        };
        let port = ChipPort::new(Chip::new(profile, network));
        Self { info, port, clock, byte_ps, edge_to_come: false, script: None }
    }

    /// What the script says until now happens to the slaves.
    fn run_script(&mut self) {
        let Some(script) = &mut self.script else { return };
        let (mut at, now) = (self.port.chip().now(), self.clock.now());
        loop {
            script.run(at, &mut |_| {});
            if at >= now || script.is_over() {
                return;
            }
            at = now.min(at + SCRIPT_STEP_NS);
            self.port.chip_mut().run_until(at);
        }
    }

    /// The chip, to look at.
    pub const fn chip(&self) -> &Chip<SimulatedNetwork> {
        self.port.chip()
    }

    /// The chip, to use its pins and to cause trouble in its network.
    pub const fn chip_mut(&mut self) -> &mut Chip<SimulatedNetwork> {
        self.port.chip_mut()
    }
}

impl Wires for SimChip {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.clock.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        // The chip chooses its answer at the first byte, and takes the packet at the last one.
        let Some(last) = to_chip.len().min(from_chip.len()).checked_sub(1) else { return Ok(()) };
        self.run_script();
        let begin = self.clock.now();
        self.port.transfer(begin, &to_chip[..last], &mut from_chip[..last]);
        self.clock.wait_until(begin.saturating_add(to_chip.len() as u64 * self.byte_ps / 1000));
        let end = self.clock.now();
        self.port.transfer(end, &to_chip[last..=last], &mut from_chip[last..=last]);
        self.edge_to_come = self.port.chip().ready_at() > begin;
        Ok(())
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.clock.wait_until(time);
        Ok(())
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        let ready_at = self.port.chip().ready_at();
        let comes = self.info.has_int0 && self.edge_to_come && ready_at <= until;
        self.clock.wait_until(if comes { ready_at } else { until });
        if comes {
            self.edge_to_come = false;
        }
        Ok(comes)
    }
}

impl ChipLink for SimChip {
    fn info(&self) -> ChipInfo {
        self.info.clone()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.run_script();
        let now = self.clock.now();
        Ok(Some(self.port.chip_mut().int1(now)))
    }

    /// A modelled chip always has the line.
    fn reset(&mut self) -> Result<bool, ChipError> {
        self.run_script();
        let low = Ns::try_from(RESET_LOW.as_nanos()).unwrap_or(Ns::MAX);
        self.clock.wait_until(self.clock.now().saturating_add(low));
        self.port.reset(self.clock.now());
        self.edge_to_come = true;
        Ok(true)
    }
}
