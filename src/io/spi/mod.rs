//! A device on SPI: whole exchanges under one chip select, a line that says when the next may begin, and one that resets.
//!
//! [`Wires`] is the seam; [`Device`] is what the kernel has: spidev and two lines of a GPIO chip.

mod device;
mod lines;

use std::time::Duration;

pub use device::{Device, Places};
pub use lines::LinePlace;
use rustix::io::Errno;

/// The wires to one device. Nobody else uses them.
pub trait Wires: Send {
    /// Moves `tx` out and the same number of bytes in, under one chip select.
    ///
    /// # Errors
    /// [`WireError`]; how much was moved is not known then.
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), WireError>;

    /// Whether there is a line that shows when the next exchange may begin.
    fn has_busy(&self) -> bool;

    /// The level of that line, high or not; without one it is never high.
    ///
    /// # Errors
    /// [`WireError`].
    fn busy(&mut self) -> Result<bool, WireError>;

    /// Waits until it is low, for at most that long; whether it is. It may have fallen and risen again meanwhile.
    ///
    /// # Errors
    /// [`WireError`].
    fn wait_ready(&mut self, limit: Duration) -> Result<bool, WireError>;

    /// Whether it has fallen since this was asked last.
    ///
    /// # Errors
    /// [`WireError`].
    fn has_fallen(&mut self) -> Result<bool, WireError>;

    /// Pulls the reset line low for at least that long, then lets it go; without one, does nothing and says so.
    ///
    /// # Errors
    /// [`WireError`].
    fn reset(&mut self, low: Duration) -> Result<bool, WireError>;
}

/// Why a wire cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// It is not there.
    #[error("{what} is not there; {there}")]
    Missing {
        /// What was looked for.
        what: String,
        /// What is there instead.
        there: String,
    },
    /// This user may not.
    #[error("{what} may not be used by this user")]
    Denied {
        /// What.
        what: String,
    },
    /// It is there and something else.
    #[error("{what} is no device of that kind; {there}")]
    Another {
        /// What.
        what: String,
        /// What there is instead, for the user.
        there: String,
    },
    /// Somebody else has it.
    #[error("{what} is in use{by}")]
    InUse {
        /// What.
        what: String,
        /// By whom, ` by ...`, where known.
        by: String,
    },
    /// The system refuses.
    #[error("{what}: {message}")]
    Refused {
        /// What was tried, on what.
        what: String,
        /// The system's words.
        message: String,
    },
}

impl WireError {
    /// What a failed call on a file of the system means.
    fn of(what: &str, error: &std::io::Error, there: impl FnOnce() -> String) -> Self {
        use std::io::ErrorKind::{NotFound, PermissionDenied, ResourceBusy, WouldBlock};

        let what = what.to_owned();
        let is_another = [Errno::NOTTY, Errno::ISDIR].map(|errno| Some(errno.raw_os_error()));
        if is_another.contains(&error.raw_os_error()) {
            return Self::Another { what, there: there() };
        }
        match error.kind() {
            NotFound => Self::Missing { what, there: there() },
            PermissionDenied => Self::Denied { what },
            ResourceBusy | WouldBlock => Self::InUse { what, by: " by another program".to_owned() },
            _ => Self::Refused { what, message: error.to_string() },
        }
    }
}

/// The files of `/dev` whose names begin so, for an error.
fn there(beginning: &str) -> String {
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut found: Vec<String> = names.filter(|name| name.starts_with(beginning)).collect();
    if found.is_empty() {
        return format!("there is no /dev/{beginning}* at all");
    }
    found.sort();
    format!("there are /dev/{}", found.join(", /dev/"))
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};

    use super::*;

    /// WIRE-52
    #[test]
    fn what_the_system_says_is_told_apart() {
        let of = |kind: ErrorKind| WireError::of("/dev/x", &Error::from(kind), || "there is /dev/y".to_owned());
        let what = || "/dev/x".to_owned();
        assert_eq!(of(ErrorKind::PermissionDenied), WireError::Denied { what: what() });
        assert_eq!(of(ErrorKind::NotFound), WireError::Missing { what: what(), there: "there is /dev/y".to_owned() });
        let another = Error::from(Errno::NOTTY);
        let another = WireError::of("/dev/x", &another, || "there is /dev/y".to_owned());
        assert_eq!(another, WireError::Another { what: what(), there: "there is /dev/y".to_owned() });
        for taken in [ErrorKind::ResourceBusy, ErrorKind::WouldBlock] {
            assert!(matches!(of(taken), WireError::InUse { .. }));
        }
        assert!(matches!(of(ErrorKind::InvalidInput), WireError::Refused { .. }));
    }
}
