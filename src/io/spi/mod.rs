//! A device on SPI: full-duplex exchanges under one chip select, a line that shows when the next exchange may begin,
//! and a reset or an interrupt line.
//!
//! The link `spi:` uses the trait [`BusyWires`], with a line whose level shows that the device is busy. The link `xf-spi:`
//! uses [`EdgeWires`], with a line whose edge shows that the device has become ready. [`BusyDevice`] and [`EdgeDevice`]
//! implement the traits over the kernel's spidev and GPIO lines; tests have implementations of their own.

mod bus;
mod busy_device;
mod edge_device;
mod lines;

use std::time::Duration;

pub use busy_device::{BusyDevice, SpiSettings};
pub use edge_device::{EdgeDevice, EdgeSettings};
pub use lines::{GpioLine, Level};
use rustix::io::Errno;

/// The wires to one device with a BUSY line. Only the owner of this value uses them.
pub trait BusyWires: Send {
    /// Sends `tx` and receives the same number of bytes into `rx`, under one chip select.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel refuses the transfer; it is then unknown how many bytes were exchanged.
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError>;

    /// Whether a BUSY line is wired, which is low when the next exchange may begin.
    fn has_busy_line(&self) -> bool;

    /// Whether the BUSY line is high; `false` if none is wired.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot read the line.
    fn is_busy(&mut self) -> Result<bool, SpiError>;

    /// Waits until the BUSY line is low, for at most `limit`; returns whether it has become low. When the call returns,
    /// the line may be high again.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot read the line.
    fn wait_ready(&mut self, limit: Duration) -> Result<bool, SpiError>;

    /// Whether the BUSY line has fallen since the last call of this function or since it was opened.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot read the line.
    fn busy_has_fallen(&mut self) -> Result<bool, SpiError>;

    /// Pulls the reset line low for at least `low` and then high again. Returns `false`, and does nothing, if no reset
    /// line is wired.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot set the line.
    fn reset(&mut self, low: Duration) -> Result<bool, SpiError>;
}

/// The wires to one device that signals by an edge when it has become ready, with a clock. Only the owner of this value
/// uses the wires.
pub trait EdgeWires: Send {
    /// The time in nanoseconds; its zero point is arbitrary.
    fn now_ns(&self) -> u64;

    /// Waits for the duration `time`.
    fn sleep(&mut self, time: Duration);

    /// Sends `tx` and receives the same number of bytes into `rx`, under one chip select.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel refuses the transfer; it is then unknown how many bytes were exchanged.
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError>;

    /// Whether the ready line is wired, whose edge shows that the next exchange may begin.
    fn has_ready_line(&self) -> bool;

    /// Discards all edges of the ready line so far, so that [`Self::wait_edge`] waits for a later one.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot read the line.
    fn forget_edges(&mut self) -> Result<(), SpiError>;

    /// Waits until the ready line has an edge to its ready level, for at most `limit`; edges before
    /// [`Self::forget_edges`] do not count. Returns whether there was an edge, and forgets it. Returns `false` at once
    /// if the line is not wired.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot read the line.
    fn wait_edge(&mut self, limit: Duration) -> Result<bool, SpiError>;

    /// Whether the interrupt line is high; `None` if it is not wired. A setting of the device decides which level is
    /// active.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot read the line.
    fn interrupt_is_high(&mut self) -> Result<Option<bool>, SpiError>;

    /// Pulls the reset line low for at least `low` and then high again. Returns `false`, and does nothing, if no reset
    /// line is wired.
    ///
    /// # Errors
    /// [`SpiError::Refused`] if the kernel cannot set the line.
    fn reset(&mut self, _low: Duration) -> Result<bool, SpiError> {
        Ok(false)
    }
}

/// The reason why SPI or a GPIO line cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "`what` is always the device file or line, and the messages say the rest")]
pub enum SpiError {
    /// The device file or the GPIO line does not exist.
    #[error("{what} is not there; {there}")]
    Missing {
        what: String,
        /// Which devices or lines exist, as a text for the user.
        there: String,
    },
    /// This user has no permission to use the device or line.
    #[error("{what} may not be used by this user")]
    Denied { what: String },
    /// The device file is not a spidev device or not a GPIO chip, whichever was expected.
    #[error("{what} is no device of that kind; {there}")]
    WrongKind {
        what: String,
        /// Which devices exist, as a text for the user.
        there: String,
    },
    /// Another program or a kernel driver uses the device or line.
    #[error("{what} is in use{by}")]
    InUse {
        what: String,
        /// Who uses the device or line, as text that begins with ` by `; empty if unknown.
        by: String,
    },
    /// The system has refused a call.
    #[error("{what}: {message}")]
    Refused {
        /// The refused call, and its device file or line.
        what: String,
        /// The error text of the operating system.
        message: String,
    },
}

impl SpiError {
    /// Converts an error of the operating system when a device file is opened.
    fn of(what: &str, error: &std::io::Error, there: impl FnOnce() -> String) -> Self {
        use std::io::ErrorKind::{NotFound, PermissionDenied, ResourceBusy, WouldBlock};

        let what = what.to_owned();
        let is_another = [Errno::NOTTY, Errno::ISDIR].map(|errno| Some(errno.raw_os_error()));
        if is_another.contains(&error.raw_os_error()) {
            return Self::WrongKind { what, there: there() };
        }
        match error.kind() {
            NotFound => Self::Missing { what, there: there() },
            PermissionDenied => Self::Denied { what },
            ResourceBusy | WouldBlock => Self::InUse { what, by: " by another program".to_owned() },
            _ => Self::Refused { what, message: error.to_string() },
        }
    }
}

/// A text with the files in `/dev` whose names begin with `prefix`, for an error.
fn list_devices(prefix: &str) -> String {
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut found: Vec<String> = names.filter(|name| name.starts_with(prefix)).collect();
    if found.is_empty() {
        return format!("there is no /dev/{prefix}* at all");
    }
    found.sort();
    format!("there are /dev/{}", found.join(", /dev/"))
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};

    use super::*;

    #[test]
    fn what_the_system_says_is_told_apart() {
        let of = |kind: ErrorKind| SpiError::of("/dev/x", &Error::from(kind), || "there is /dev/y".to_owned());
        let what = || "/dev/x".to_owned();
        assert_eq!(of(ErrorKind::PermissionDenied), SpiError::Denied { what: what() });
        assert_eq!(of(ErrorKind::NotFound), SpiError::Missing { what: what(), there: "there is /dev/y".to_owned() });
        let another = Error::from(Errno::NOTTY);
        let another = SpiError::of("/dev/x", &another, || "there is /dev/y".to_owned());
        assert_eq!(another, SpiError::WrongKind { what: what(), there: "there is /dev/y".to_owned() });
        for taken in [ErrorKind::ResourceBusy, ErrorKind::WouldBlock] {
            assert!(matches!(of(taken), SpiError::InUse { .. }));
        }
        assert!(matches!(of(ErrorKind::InvalidInput), SpiError::Refused { .. }));
    }
}
