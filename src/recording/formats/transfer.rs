//! What a packet of a capture tells of a USB transfer, whoever captured it.

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

/// Kind of transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum Kind {
    /// Interrupt, or one of which the capture does not know the endpoint.
    Interrupt,
    Control,
    /// Bulk or isochronous.
    Other,
}

/// What has happened to a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum Stage {
    /// It was handed to the controller.
    Submitted,
    /// It has ended; whether it was carried out.
    Ended { done: bool },
}

/// One packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) struct Event<'a> {
    pub at: Address,
    pub kind: Kind,
    pub stage: Stage,
    pub to_host: bool,
    /// The same in all packets of a transfer while it is under way.
    pub id: u64,
    /// The setup packet of a control transfer.
    pub setup: Option<[u8; 8]>,
    /// Bytes that were moved or are to be; a capture may hold fewer of them.
    pub length: u32,
    pub data: &'a [u8],
}
