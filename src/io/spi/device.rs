//! [`Wires`] over the kernel's drivers: a spidev device, and lines of GPIO chips.

use std::os::fd::AsFd;
use std::path::PathBuf;
use std::time::Duration;

use rustix::fs::{FlockOperation, flock};
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};

use super::lines::{BusyLine, ResetLine};
use super::{GpioLine, WireError, Wires, list_devices};

/// Bits per SPI word.
const WORD_BITS: u8 = 8;

/// The device files of the wires, and the settings of SPI.
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

/// Wires that this process has opened.
pub struct Device {
    name: String,
    spi: Spidev,
    busy: Option<BusyLine>,
    reset: Option<ResetLine>,
}

impl Device {
    /// Opens the wires and locks them against other programs that use this library.
    ///
    /// # Errors
    /// [`WireError`].
    pub fn open(settings: &SpiSettings) -> Result<Self, WireError> {
        let name = settings.device.display().to_string();
        let failed = |error: std::io::Error| WireError::of(&name, &error, || list_devices("spidev"));
        let mut spi = Spidev::open(&settings.device).map_err(failed)?;
        // spidev itself allows several programs to open it.
        flock(spi.inner().as_fd(), FlockOperation::NonBlockingLockExclusive).map_err(|errno| failed(errno.into()))?;
        let options = SpidevOptions::new()
            .bits_per_word(WORD_BITS)
            .max_speed_hz(settings.speed_hz)
            .lsb_first(false)
            .mode(mode(settings.mode))
            .build();
        spi.configure(&options).map_err(failed)?;
        let busy = settings.busy.as_ref().map(BusyLine::open).transpose()?;
        let reset = settings.reset.as_ref().map(ResetLine::open).transpose()?;
        Ok(Self { name, spi, busy, reset })
    }
}

impl Wires for Device {
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), WireError> {
        let mut transfer = SpidevTransfer::read_write(tx, rx);
        self.spi.transfer(&mut transfer).map_err(|error| {
            let what = format!("exchange {} bytes on {}", tx.len(), self.name);
            WireError::Refused { what, message: error.to_string() }
        })
    }

    fn has_busy_line(&self) -> bool {
        self.busy.is_some()
    }

    fn is_busy(&mut self) -> Result<bool, WireError> {
        self.busy.as_ref().map_or(Ok(false), BusyLine::is_high)
    }

    fn wait_ready(&mut self, limit: Duration) -> Result<bool, WireError> {
        self.busy.as_mut().map_or(Ok(true), |busy| busy.wait_low(limit))
    }

    fn busy_has_fallen(&mut self) -> Result<bool, WireError> {
        self.busy.as_mut().map_or(Ok(false), BusyLine::has_fallen)
    }

    fn reset(&mut self, low: Duration) -> Result<bool, WireError> {
        self.reset.as_ref().map_or(Ok(false), |reset| reset.pull_low(low).map(|()| true))
    }
}

const fn mode(number: u8) -> SpiModeFlags {
    match number {
        1 => SpiModeFlags::SPI_MODE_1,
        2 => SpiModeFlags::SPI_MODE_2,
        3 => SpiModeFlags::SPI_MODE_3,
        _ => SpiModeFlags::SPI_MODE_0,
    }
}
