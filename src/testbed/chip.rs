//! `xf-sim:` opened as a chip: the model of an ECM-XF with simulated slaves in this process.

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

/// The model of an ECM-XF, which is powered on when the link is opened, and the SPI or USB connection to it.
pub struct SimChip {
    info: ChipInfo,
    port: ChipPort<SimulatedNetwork>,
    clock: ChipClock,
    /// The transfer time of a byte, picoseconds.
    byte_ps: u64,
    /// Whether the INT0 edge that shows the chip ready is still expected: an exchange or a reset has made the chip
    /// busy, and no wait has seen the edge since.
    edge_to_come: bool,
    /// The events of `script=`, in the chip's time.
    script: Option<RunningScript>,
}

/// \[OURS] The longest step by which the chip's time advances between two checks of the script, ns: the shortest cycle of a
/// board, so that an event is at most one cycle late.
const SCRIPT_STEP_NS: Ns = 250_000;

/// The transfer time of a byte to an ECM-XFU, picoseconds. \[OURS] A packet of 1024 bytes takes one USB microframe of 125 us.
const USB_BYTE_PS: u64 = 125_000_000 / 1024;

/// The clock of the modelled chip, from its power-on: the present virtual time, which only waits advance, or the real time at
/// power-on.
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
    /// Builds the chip that an `xf-sim:` link describes.
    ///
    /// # Errors
    /// [`ChipError::Uri`] for an invalid link, and the errors of [`Self::with_options`].
    pub fn from_uri(uri: &LinkUri) -> Result<Self, ChipError> {
        Self::with_options(&uri.to_string(), &SimChipOptions::from_uri(uri)?)
    }

    /// Builds the chip with these options; `name` is the name of the link in messages. The script starts immediately.
    ///
    /// # Errors
    /// [`ChipError::Script`] if the script cannot be read or is invalid; [`ChipError::ManufacturerObjects`] if a file
    /// of manufacturer-specific objects cannot be read or is invalid; [`ChipError::Network`] if a slave does not define
    /// the content of its EEPROM.
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

    /// Builds the chip on an existing simulated network, without a script. `clock` is the clock of the chip; `name` is the name
    /// of the link in messages.
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

    /// Carries out the script up to the present time. The chip's time is advanced along with it, so that each event
    /// happens at its time.
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

    /// The modelled chip, for reading its state.
    pub const fn chip(&self) -> &Chip<SimulatedNetwork> {
        self.port.chip()
    }

    /// The modelled chip, to operate its pins or to inject faults into its network.
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
        // As in the real chip, the response is prepared at the first byte of an exchange, and the packet is processed at the
        // last byte. So the last byte is transferred separately, at the end of the exchange.
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

    /// Pulls the reset line. A modelled chip always has one, so the result is always true.
    fn reset(&mut self) -> Result<bool, ChipError> {
        self.run_script();
        let low = Ns::try_from(RESET_LOW.as_nanos()).unwrap_or(Ns::MAX);
        self.clock.wait_until(self.clock.now().saturating_add(low));
        self.port.reset(self.clock.now());
        self.edge_to_come = true;
        Ok(true)
    }
}
