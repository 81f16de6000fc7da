//! The wires that the kernel has: a spidev device, and lines of its GPIO chips.

use std::os::fd::AsFd;
use std::path::PathBuf;
use std::time::Duration;

use rustix::fs::{FlockOperation, flock};
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};

use super::lines::{Input, Output};
use super::{LinePlace, WireError, Wires, there};

/// Bits of a word on the wire.
const WORD_BITS: u8 = 8;

/// Where the wires are and how they are used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Places {
    /// The spidev file.
    pub device: PathBuf,
    /// Clock, Hz.
    pub speed_hz: u32,
    /// SPI mode: 0..=3.
    pub mode: u8,
    /// The line that shows when the device is busy.
    pub busy: Option<LinePlace>,
    /// The line that resets the device when low.
    pub reset: Option<LinePlace>,
}

/// Open wires.
pub struct Device {
    name: String,
    spi: Spidev,
    busy: Option<Input>,
    reset: Option<Output>,
}

impl Device {
    /// Opens them; no other program that uses this gets them then.
    ///
    /// # Errors
    /// [`WireError`].
    pub fn open(places: &Places) -> Result<Self, WireError> {
        let name = places.device.display().to_string();
        let failed = |error: std::io::Error| WireError::of(&name, &error, || there("spidev"));
        let mut spi = Spidev::open(&places.device).map_err(failed)?;
        // spidev itself lets several programs in.
        flock(spi.inner().as_fd(), FlockOperation::NonBlockingLockExclusive).map_err(|errno| failed(errno.into()))?;
        let options = SpidevOptions::new()
            .bits_per_word(WORD_BITS)
            .max_speed_hz(places.speed_hz)
            .lsb_first(false)
            .mode(mode(places.mode))
            .build();
        spi.configure(&options).map_err(failed)?;
        let busy = places.busy.as_ref().map(Input::open).transpose()?;
        let reset = places.reset.as_ref().map(Output::open).transpose()?;
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

    fn has_busy(&self) -> bool {
        self.busy.is_some()
    }

    fn busy(&mut self) -> Result<bool, WireError> {
        self.busy.as_ref().map_or(Ok(false), Input::is_high)
    }

    fn wait_ready(&mut self, limit: Duration) -> Result<bool, WireError> {
        self.busy.as_mut().map_or(Ok(true), |busy| busy.wait_low(limit))
    }

    fn has_fallen(&mut self) -> Result<bool, WireError> {
        self.busy.as_mut().map_or(Ok(false), Input::has_fallen)
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
