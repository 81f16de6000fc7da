//! Implements [`EdgeWires`] over the kernel's drivers: a spidev device, and lines of GPIO chips.

use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use super::bus::SpiBus;
use super::lines::{InputLine, Level, ReadyLine, ResetLine};
use super::{EdgeWires, GpioLine, SpiError};

/// The connection to a device: its spidev file, its GPIO lines, and the settings of SPI.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EdgeSettings {
    /// The spidev file, such as `/dev/spidev0.0`.
    pub device: PathBuf,
    /// The SPI clock in Hz.
    pub speed_hz: u32,
    /// The SPI mode, 0..=3.
    pub mode: u8,
    /// The line that shows when the device is ready for an exchange, if it is wired.
    pub ready: Option<GpioLine>,
    /// The level of the ready line while the device is ready.
    pub ready_level: Level,
    /// The interrupt line of the device, if it is wired. A setting of the device decides which level is active.
    pub interrupt: Option<GpioLine>,
    /// The reset line, if it is wired: low resets the device.
    pub reset: Option<GpioLine>,
}

/// Wires that this process has opened. Their monotonic clock is 0 at the opening.
pub struct EdgeDevice {
    bus: SpiBus,
    ready: Option<ReadyLine>,
    interrupt: Option<InputLine>,
    reset: Option<ResetLine>,
    opened: Instant,
}

impl EdgeDevice {
    /// Opens the wires and locks them against other programs that use this library.
    ///
    /// # Errors
    /// [`SpiError`] if the spidev file or a line does not exist, may not be used by this user, is in use, or is of
    /// another kind; it names the file or the line.
    pub fn open(settings: &EdgeSettings) -> Result<Self, SpiError> {
        let bus = SpiBus::open(&settings.device, settings.speed_hz, settings.mode)?;
        let ready = settings.ready.as_ref().map(|place| ReadyLine::open(place, settings.ready_level)).transpose()?;
        let interrupt = settings.interrupt.as_ref().map(InputLine::open).transpose()?;
        let reset = settings.reset.as_ref().map(ResetLine::open).transpose()?;
        Ok(Self { bus, ready, interrupt, reset, opened: Instant::now() })
    }
}

impl EdgeWires for EdgeDevice {
    fn now_ns(&self) -> u64 {
        u64::try_from(self.opened.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn sleep(&mut self, time: Duration) {
        thread::sleep(time);
    }

    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError> {
        self.bus.exchange(tx, rx)
    }

    fn has_ready_line(&self) -> bool {
        self.ready.is_some()
    }

    fn forget_edges(&mut self) -> Result<(), SpiError> {
        self.ready.as_mut().map_or(Ok(()), |ready| ready.has_become_ready().map(drop))
    }

    fn wait_edge(&mut self, limit: Duration) -> Result<bool, SpiError> {
        self.ready.as_mut().map_or(Ok(false), |ready| ready.wait_edge(limit))
    }

    fn interrupt_is_high(&mut self) -> Result<Option<bool>, SpiError> {
        self.interrupt.as_ref().map(InputLine::is_high).transpose()
    }

    fn reset(&mut self, low: Duration) -> Result<bool, SpiError> {
        self.reset.as_ref().map_or(Ok(false), |reset| reset.pull_low(low).map(|()| true))
    }
}
