//! `xf-spi:`: a real ECM-XF on a spidev device, with INT0 and INT1 on lines of a GPIO chip.
//!
//! INT0 is active while the chip is ready for a packet, and inactive while it processes one (XF EN 1706). Right after
//! an exchange INT0 may still have the active level from before the exchange, so the level does not show whether the
//! chip is ready. The link therefore waits for an edge to the active level, and forgets all edges from before the
//! exchange.

use std::time::Duration;

use super::spi::{device, next_step};
use crate::address::keys::Scheme;
use crate::address::uri::{LinkUri, UriError};
use crate::ethercat::Ns;
use crate::io::spi::{EdgeDevice, EdgeSettings, EdgeWires, GpioLine, Level, SpiError};
use crate::link::chip_link::{ChipError, ChipInfo, ChipLink, RESET_LOW, speed_hz};
use crate::xf::host::Wires;

/// A link to an ECM-XF on SPI.
pub struct SpiChip<W: EdgeWires = EdgeDevice> {
    info: ChipInfo,
    wires: W,
    resets_at_close: bool,
}

impl SpiChip {
    /// Opens the chip that an `xf-spi:` link names.
    ///
    /// # Errors
    /// [`ChipError::Uri`]: a value of the link is missing or invalid. [`ChipError::Wires`]: the device or a line cannot
    /// be used; the error names it and says what to do.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, ChipError> {
        let (settings, times) = (spi_settings(uri)?, reset_times(uri)?);
        let name = uri.to_string();
        let wires = EdgeDevice::open(&settings).map_err(|error| chip_error(&name, &error))?;
        Self::over(&name, wires, settings.speed_hz).reset_at(times)
    }
}

impl<W: EdgeWires> SpiChip<W> {
    /// A link over these wires, with an SPI clock of `speed_hz`; `name` is the name of the link in messages.
    pub fn over(name: &str, wires: W, speed_hz: u32) -> Self {
        let info = ChipInfo {
            name: name.to_owned(),
            size: None,
            clock_hz: Some(speed_hz),
            has_int0: wires.has_ready_line(),
            virtual_time: false,
        };
        Self { info, wires, resets_at_close: false }
    }

    /// Resets the chip now if `times.at_open` is set. `times.at_close`: the chip is also reset when the link is closed.
    ///
    /// # Errors
    /// [`ChipError::Wires`]: the reset line cannot be switched.
    pub fn reset_at(mut self, times: ResetTimes) -> Result<Self, ChipError> {
        if times.at_open {
            self.reset()?;
        }
        self.resets_at_close = times.at_close;
        Ok(self)
    }

    /// The wires to the chip, for tests and for direct access.
    pub const fn wires_mut(&mut self) -> &mut W {
        &mut self.wires
    }

    fn left_until(&self, time: Ns) -> Duration {
        Duration::from_nanos(time.saturating_sub(self.wires.now_ns()))
    }
}

impl<W: EdgeWires> Wires for SpiChip<W> {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.wires.now_ns()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        let done = self.wires.forget_edges().and_then(|()| self.wires.exchange(to_chip, from_chip));
        done.map_err(|error| chip_error(&self.info.name, &error))
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        let left = self.left_until(time);
        if !left.is_zero() {
            self.wires.sleep(left);
        }
        Ok(())
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        let left = self.left_until(until);
        self.wires.wait_edge(left).map_err(|error| chip_error(&self.info.name, &error))
    }
}

impl<W: EdgeWires> ChipLink for SpiChip<W> {
    fn info(&self) -> ChipInfo {
        self.info.clone()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.wires.interrupt_is_high().map_err(|error| chip_error(&self.info.name, &error))
    }

    fn reset(&mut self) -> Result<bool, ChipError> {
        self.wires.reset(RESET_LOW).map_err(|error| chip_error(&self.info.name, &error))
    }
}

impl<W: EdgeWires> Drop for SpiChip<W> {
    fn drop(&mut self) {
        if self.resets_at_close
            && let Err(error) = self.reset()
        {
            log::warn!("the chip was not reset at the end and may go on: {error}");
        }
    }
}

/// When an `xf-spi:` link resets its chip. A reset is possible only if the link names the chip's reset line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetTimes {
    /// Whether the link resets the chip when it is opened.
    pub at_open: bool,
    /// Whether the link resets the chip when it is closed.
    pub at_close: bool,
}

/// Reads from the key `reset_at=`, or from its default, when a link resets its chip. Without a reset line (`reset=`)
/// the link never resets it.
///
/// # Errors
/// [`UriError::BadValue`] if `reset_at=` asks for a reset at closing and the link names no reset line.
fn reset_times(uri: &LinkUri) -> Result<ResetTimes, UriError> {
    let has_line = uri.typed("reset", GpioLine::parse)?.is_some();
    let times = |at_open, at_close| ResetTimes { at_open, at_close };
    let chosen = uri.choice(
        "reset_at",
        [("open", times(true, false)), ("close", times(false, true)), ("both", times(true, true))],
    )?;
    match uri.value("reset_at") {
        Some(value) if !has_line && chosen.at_close => {
            let why = "it is about a line that the link does not name; allowed: with reset=CHIP/LINE".to_owned();
            Err(UriError::BadValue { key: "reset_at".to_owned(), value: value.to_owned(), why })
        }
        _ if has_line => Ok(chosen),
        _ => Ok(times(false, false)),
    }
}

/// The SPI mode of the chip: clock polarity 0, clock phase 0 (XF EN 148).
const SPI_MODE: u8 = 0;

/// The spidev device, the GPIO lines and their settings, as the URI of an `xf-spi:` link gives them.
///
/// # Errors
/// [`UriError::OtherScheme`] if it is not an `xf-spi:` link; [`UriError::BadPath`] without a device;
/// [`UriError::BadValue`] if the link sets INT0 to active low but names no line for INT0.
fn spi_settings(uri: &LinkUri) -> Result<EdgeSettings, UriError> {
    uri.expect_scheme(Scheme::XfSpi)?;
    let ready = uri.typed("int0", GpioLine::parse)?;
    let ready_level = uri.choice("int0_active", [("high", Level::High), ("low", Level::Low)])?;
    if ready.is_none() && ready_level == Level::Low {
        let why = "it is the level of a line that the link does not name; allowed: with int0=CHIP/LINE".to_owned();
        return Err(UriError::BadValue { key: "int0_active".to_owned(), value: "low".to_owned(), why });
    }
    Ok(EdgeSettings {
        device: device(uri, "xf-spi:/dev/spidevB.C, e.g. xf-spi:/dev/spidev0.0")?,
        speed_hz: speed_hz(uri)?,
        mode: SPI_MODE,
        ready,
        ready_level,
        interrupt: uri.typed("int1", GpioLine::parse)?,
        reset: uri.typed("reset", GpioLine::parse)?,
    })
}

/// The error of a link whose SPI device or GPIO lines cannot be used.
fn chip_error(name: &str, error: &SpiError) -> ChipError {
    let next = match error {
        SpiError::InUse { .. } => "end what uses it, or correct the link",
        SpiError::Refused { .. } => "look at speed=, and at bufsiz of the module spidev (1440 at least)",
        other => next_step(other),
    };
    ChipError::Wires { name: name.to_owned(), message: format!("{error}; {next}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xf::MAX_PACKET;

    /// XF-16.6 The error of a device or line that cannot be used ends with what to do.
    #[test]
    fn wires_that_cannot_be_used_are_told_with_the_next_step() {
        let said = |error| chip_error("xf-spi:/dev/spidev0.0", &error).to_string();
        let what = || "line 24 of /dev/gpiochip0".to_owned();
        let there = || "there is y".to_owned();
        let failed = said(SpiError::Refused { what: what(), message: "no".to_owned() });
        for (said, expected) in [
            (said(SpiError::Missing { what: what(), there: there() }), "is not there; there is y; switch SPI on"),
            (said(SpiError::WrongKind { what: what(), there: there() }), "no device of that kind; there is y; correct"),
            (said(SpiError::Denied { what: what() }), "may not be used by this user; add the user to the groups"),
            (said(SpiError::InUse { what: what(), by: " by a driver".to_owned() }), "by a driver; end what uses it"),
            (failed.clone(), "no; look at speed="),
        ] {
            assert!(said.starts_with("xf-spi:/dev/spidev0.0: line 24 of /dev/gpiochip0"), "{said}");
            assert!(said.contains(expected), "{said}: no {expected}");
        }
        assert!(failed.contains(&format!("({MAX_PACKET} at least)")), "{failed}");
    }
}
