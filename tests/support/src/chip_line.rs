//! Wires in this process to the model of an ECM-XF, on a clock that passes only in exchanges and waits.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels, SlaveNetwork};
use ecmsk::xf::host::{HostConfig, Wires};

/// The clock of SPI if none is given.
const CLOCK_HZ: u32 = 24_000_000;

/// The wires to a chip, and the chip.
pub struct ChipLine<N: SlaveNetwork> {
    port: ChipPort<N>,
    /// The time. A test that advances it lets the chip go on while the host is stalled.
    pub clock: Arc<AtomicU64>,
    clock_hz: u32,
    /// The wires are cut: no byte reaches the chip, and the host reads zeros.
    pub cut: Arc<AtomicBool>,
}

impl<N: SlaveNetwork> ChipLine<N> {
    /// A chip that gets its power at time 0.
    pub fn new(chip: Chip<N>) -> Self {
        Self { port: ChipPort::new(chip), clock: Arc::default(), clock_hz: CLOCK_HZ, cut: Arc::default() }
    }

    /// The same with another clock than 24 MHz.
    #[must_use]
    pub fn at(self, clock_hz: u32) -> Self {
        Self { clock_hz, ..self }
    }

    pub fn chip(&mut self) -> &mut Chip<N> {
        self.port.chip_mut()
    }
}

impl<N: SlaveNetwork> Wires for ChipLine<N> {
    type Error = Infallible;

    fn now(&self) -> Ns {
        self.clock.load(Ordering::Relaxed)
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Infallible> {
        let Some(last) = to_chip.len().checked_sub(1) else { return Ok(()) };
        let bits_ns = to_chip.len() as u64 * 8_000_000_000 / u64::from(self.clock_hz);
        let from = self.clock.fetch_add(bits_ns, Ordering::Relaxed);
        if self.cut.load(Ordering::Relaxed) {
            from_chip.fill(0);
            return Ok(());
        }
        self.port.transfer(from, &to_chip[..last], &mut from_chip[..last]);
        self.port.transfer(from + bits_ns, &to_chip[last..], &mut from_chip[last..]);
        Ok(())
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), Infallible> {
        self.clock.fetch_max(time, Ordering::Relaxed);
        Ok(())
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, Infallible> {
        self.clock.fetch_max(until, Ordering::Relaxed);
        Ok(false)
    }
}

/// A bus over a chip with these slaves.
pub fn xf_bus(slaves: Vec<Box<dyn Slave>>, options: XfBusOptions) -> XfBus<ChipLine<SlaveModels>> {
    xf_bus_reached_by(slaves, SimHandle::default(), options)
}

/// A bus over a chip with these slaves at the end of an SPI with that clock.
pub fn xf_bus_at(
    clock_hz: u32,
    slaves: Vec<Box<dyn Slave>>,
    config: HostConfig,
    options: XfBusOptions,
) -> XfBus<ChipLine<SlaveModels>> {
    let chip = Chip::new(Profile::NEW, SlaveModels::new(slaves));
    let config = HostConfig { size: Some(Profile::NEW.size), ..config };
    XfBus::new(ChipLine::new(chip).at(clock_hz), config, options)
}

/// The same, with the slaves on the cable of this handle.
pub fn xf_bus_reached_by(
    slaves: Vec<Box<dyn Slave>>,
    handle: SimHandle,
    options: XfBusOptions,
) -> XfBus<ChipLine<SlaveModels>> {
    xf_bus_with(slaves, handle, HostConfig::DEFAULT, options)
}

/// The same with a driver of these options.
pub fn xf_bus_with(
    slaves: Vec<Box<dyn Slave>>,
    handle: SimHandle,
    config: HostConfig,
    options: XfBusOptions,
) -> XfBus<ChipLine<SlaveModels>> {
    let chip = Chip::new(Profile::NEW, SlaveModels::new(slaves).reached_by(handle));
    let config = HostConfig { size: Some(Profile::NEW.size), ..config };
    XfBus::new(ChipLine::new(chip), config, XfBusOptions { clock_hz: Some(CLOCK_HZ), ..options })
}
