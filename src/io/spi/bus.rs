//! A spidev device that this process has opened and locked.

use std::os::fd::AsFd;
use std::path::Path;

use rustix::fs::{FlockOperation, flock};
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};

use super::{SpiError, list_devices};

/// Bytes are transferred as SPI words of 8 bits, most significant bit first.
const WORD_BITS: u8 = 8;

/// A spidev device that is open and locked.
pub(super) struct SpiBus {
    name: String,
    spi: Spidev,
}

impl SpiBus {
    /// Opens the device with a clock in Hz and an SPI mode, 0..=3, and locks it against other programs that use this
    /// library.
    pub fn open(device: &Path, speed_hz: u32, mode_number: u8) -> Result<Self, SpiError> {
        let name = device.display().to_string();
        let failed = |error: std::io::Error| SpiError::of(&name, &error, || list_devices("spidev"));
        let mut spi = Spidev::open(device).map_err(failed)?;
        // The lock is needed because spidev allows several programs to open the device.
        flock(spi.inner().as_fd(), FlockOperation::NonBlockingLockExclusive).map_err(|errno| failed(errno.into()))?;
        let options = SpidevOptions::new()
            .bits_per_word(WORD_BITS)
            .max_speed_hz(speed_hz)
            .lsb_first(false)
            .mode(mode(mode_number))
            .build();
        spi.configure(&options).map_err(failed)?;
        Ok(Self { name, spi })
    }

    /// Makes one full-duplex transfer of `tx` and `rx`, which have the same length, under one chip select.
    pub fn exchange(&self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError> {
        let mut transfer = SpidevTransfer::read_write(tx, rx);
        self.spi.transfer(&mut transfer).map_err(|error| {
            let what = format!("exchange {} bytes on {}", tx.len(), self.name);
            SpiError::Refused { what, message: error.to_string() }
        })
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
