//! Where a device is on its bus.

use std::fmt;
use std::str::FromStr;

/// Where a device is on its bus, as the system numbered it: `1.5`. It changes when the device is plugged again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// The bus.
    pub bus: u16,
    /// The device on that bus.
    pub device: u8,
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.bus, self.device)
    }
}

/// A text that is no address.
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
