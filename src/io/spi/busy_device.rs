//! Implements [`BusyWires`] over the kernel's drivers: a spidev device, and lines of GPIO chips.

use std::path::PathBuf;
use std::time::Duration;

use super::bus::SpiBus;
use super::lines::{Level, ReadyLine, ResetLine};
use super::{BusyWires, GpioLine, SpiError};

/// The connection to a device: its spidev file, its GPIO lines, and the settings of SPI.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpiSettings {
    /// The spidev file, such as `/dev/spidev0.0`.
    pub device: PathBuf,
    /// The SPI clock in Hz.
    pub speed_hz: u32,
    /// The SPI mode, 0..=3.
    pub mode: u8,
    /// The BUSY line, if it is wired: high while the device is not ready for an exchange.
    pub busy: Option<GpioLine>,
    /// The reset line, if it is wired: low resets the device.
    pub reset: Option<GpioLine>,
}

/// The spidev device and the GPIO lines of a device, opened by this process.
pub struct BusyDevice {
    bus: SpiBus,
    busy: Option<ReadyLine>,
    reset: Option<ResetLine>,
}

impl BusyDevice {
    /// Opens the wires and locks them against other programs that use this library.
    ///
    /// # Errors
    /// [`SpiError`] if the spidev file or a line does not exist, may not be used by this user, is in use, or is of
    /// another kind; it names the file or the line.
    pub fn open(settings: &SpiSettings) -> Result<Self, SpiError> {
        let bus = SpiBus::open(&settings.device, settings.speed_hz, settings.mode)?;
        let busy = settings.busy.as_ref().map(|place| ReadyLine::open(place, Level::Low)).transpose()?;
        let reset = settings.reset.as_ref().map(ResetLine::open).transpose()?;
        Ok(Self { bus, busy, reset })
    }
}

impl BusyWires for BusyDevice {
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError> {
        self.bus.exchange(tx, rx)
    }

    fn has_busy_line(&self) -> bool {
        self.busy.is_some()
    }

    fn is_busy(&mut self) -> Result<bool, SpiError> {
        self.busy.as_ref().map_or(Ok(false), |busy| busy.is_ready().map(|is_ready| !is_ready))
    }

    fn wait_ready(&mut self, limit: Duration) -> Result<bool, SpiError> {
        self.busy.as_mut().map_or(Ok(true), |busy| busy.wait_ready(limit))
    }

    fn busy_has_fallen(&mut self) -> Result<bool, SpiError> {
        self.busy.as_mut().map_or(Ok(false), ReadyLine::has_become_ready)
    }

    fn reset(&mut self, low: Duration) -> Result<bool, SpiError> {
        self.reset.as_ref().map_or(Ok(false), |reset| reset.pull_low(low).map(|()| true))
    }
}
