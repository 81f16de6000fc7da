//! The USB address of a device: the number of its bus, and its own number on the bus.

use std::fmt;
use std::str::FromStr;

/// The USB address of a device, such as `1.5`, as the operating system has assigned it. It changes when the device is
/// plugged in again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// The number of the bus.
    pub bus: u16,
    /// The number of the device on the bus.
    pub device: u8,
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.bus, self.device)
    }
}

/// The text is not an address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no address of a device; write bus and device as Wireshark shows them, for example 1.5")]
pub struct AddressError(String);

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let parse = || {
            let (bus, device) = text.trim().split_once('.')?;
            Some(Self { bus: bus.parse().ok()?, device: device.parse().ok()? })
        };
        parse().ok_or_else(|| AddressError(text.to_owned()))
    }
}
