//! `xf-spi:`: a real ECM-XF on a spidev device, with INT0 and INT1 on lines of a GPIO chip.
//!
//! INT0 is active while the chip is ready for a packet, and inactive while it processes one (XF EN 1706). When an
//! exchange has just ended it may still be active from before, so its level says nothing then: what counts is the edge
//! that comes after the exchange began.

use std::time::Duration;

use super::options::{reset_times, spi_settings};
use super::{ChipError, ChipInfo, ChipLink, RESET_LOW, ResetTimes};
use crate::ethercat::Ns;
use crate::io::spi::{EdgeDevice, EdgeWires, WireError};
use crate::link::spi::next_step;
use crate::link::uri::LinkUri;
use crate::xf::host::Wires;

/// A chip on SPI.
pub struct SpiChip<W: EdgeWires = EdgeDevice> {
    info: ChipInfo,
    wires: W,
    resets_at_close: bool,
}

impl SpiChip {
    /// The chip that an `xf-spi:` link names.
    ///
    /// # Errors
    /// [`ChipError::Uri`]; [`ChipError::Wires`], which says which device or line cannot be used and what to do.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, ChipError> {
        let (settings, times) = (spi_settings(uri)?, reset_times(uri)?);
        let name = uri.to_string();
        let wires = EdgeDevice::open(&settings).map_err(|error| refused(&name, &error))?;
        Self::over(&name, wires, settings.speed_hz).reset_at(times)
    }
}

impl<W: EdgeWires> SpiChip<W> {
    /// The chip behind these wires, whose clock of SPI has that frequency in Hz; `name` is the name of the link in
    /// messages.
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

    /// The same chip, which is reset now or when it is closed.
    ///
    /// # Errors
    /// [`ChipError::Wires`].
    pub fn reset_at(mut self, times: ResetTimes) -> Result<Self, ChipError> {
        if times.at_open {
            self.reset()?;
        }
        self.resets_at_close = times.at_close;
        Ok(self)
    }

    /// The wires.
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
        done.map_err(|error| refused(&self.info.name, &error))
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
        self.wires.wait_edge(left).map_err(|error| refused(&self.info.name, &error))
    }
}

impl<W: EdgeWires> ChipLink for SpiChip<W> {
    fn info(&self) -> ChipInfo {
        self.info.clone()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.wires.interrupt_is_high().map_err(|error| refused(&self.info.name, &error))
    }

    fn reset(&mut self) -> Result<bool, ChipError> {
        self.wires.reset(RESET_LOW).map_err(|error| refused(&self.info.name, &error))
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

/// The error of a link whose wires cannot be used.
fn refused(name: &str, error: &WireError) -> ChipError {
    let next = match error {
        WireError::InUse { .. } => "end what uses it, or correct the link",
        WireError::Refused { .. } => "look at speed=, and at bufsiz of the module spidev (1440 at least)",
        other => next_step(other),
    };
    ChipError::Wires { name: name.to_owned(), message: format!("{error}; {next}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xf::MAX_PACKET;

    /// XF-16.6
    #[test]
    fn wires_that_cannot_be_used_are_told_with_the_next_step() {
        let said = |error| refused("xf-spi:/dev/spidev0.0", &error).to_string();
        let what = || "line 24 of /dev/gpiochip0".to_owned();
        let there = || "there is y".to_owned();
        let failed = said(WireError::Refused { what: what(), message: "no".to_owned() });
        for (said, expected) in [
            (said(WireError::Missing { what: what(), there: there() }), "is not there; there is y; switch SPI on"),
            (said(WireError::Another { what: what(), there: there() }), "no device of that kind; there is y; correct"),
            (said(WireError::Denied { what: what() }), "may not be used by this user; add the user to the groups"),
            (said(WireError::InUse { what: what(), by: " by a driver".to_owned() }), "by a driver; end what uses it"),
            (failed.clone(), "no; look at speed="),
        ] {
            assert!(said.starts_with("xf-spi:/dev/spidev0.0: line 24 of /dev/gpiochip0"), "{said}");
            assert!(said.contains(expected), "{said}: no {expected}");
        }
        assert!(failed.contains(&format!("({MAX_PACKET} at least)")), "{failed}");
    }
}
