//! What a URI `usb:` says, as types.

use super::super::uri::{LinkUri, UriError};

/// Options of `usb:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct UsbOptions {
    /// The serial number of the board that is meant.
    pub serial: Option<String>,
    /// Where the board that is meant is plugged in: bus and ports as Linux names them, or Windows' name of its instance.
    pub path: Option<String>,
    /// Transfers to the host that are handed over at a time.
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
