//! The keys of `usb:` as Rust types.

use crate::address::uri::{LinkUri, UriError};

/// Options of `usb:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct UsbOptions {
    /// The serial number of the board; `None` for any.
    pub serial: Option<String>,
    /// Where the board is plugged in: bus and ports as Linux names them, or the device instance on Windows; `None` for
    /// anywhere.
    pub path: Option<String>,
    /// How many transfers for reports are pending in the operating system at the same time, 1 to 64 (`transfers=`):
    /// with several, no report is missed between two reads.
    pub transfers: usize,
}

impl UsbOptions {
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let text = |value: &str| Some(value.to_owned());
        Ok(Self {
            serial: uri.typed("serial", text)?,
            path: uri.typed("path", text)?,
            transfers: uri.required("transfers", |value| value.parse().ok())?,
        })
    }
}
