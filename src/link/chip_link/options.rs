//! The keys of links to a chip as Rust types.

use std::path::PathBuf;

use crate::address::keys;
use crate::address::uri::{LinkUri, UriError};
use crate::ethercat::Ns;
use crate::xf::DataSize;

/// Options of every link to a chip: settings of the chip's driver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipOptions {
    /// The pause after each exchange (`idle_us=`), in nanoseconds.
    pub idle_ns: Ns,
    /// The length of a packet's data (n) that the driver sets in the chip at the start (`use_n=`), bytes. A larger n
    /// carries more process data in a packet; `None`: the chip keeps its present value.
    pub use_n: Option<DataSize>,
}

impl ChipOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit the type of its option.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let use_n = uri.typed("use_n", data_size)?;
        if use_n.is_some() && uri.value("chip_fw") == Some("xfu") {
            let (key, value) = ("use_n".to_owned(), uri.value("use_n").unwrap_or_default().to_owned());
            let why = "an ECM-XFU has 992 always; allowed: with chip_fw=new or old, or leave it out".to_owned();
            return Err(UriError::BadValue { key, value, why });
        }
        let idle_ns = uri.required("idle_us", |value| Some(value.parse::<Ns>().ok()? * 1000))?;
        Ok(Self { idle_ns, use_n })
    }
}

/// Parses the length n of a packet's data, bytes; `None` if the chip does not allow this length.
pub(crate) fn data_size(value: &str) -> Option<DataSize> {
    DataSize::new(value.parse().ok()?)
}

/// The file to which the exchanges of a link are recorded (`record=`); `None`: no recording.
pub(crate) fn record(uri: &LinkUri) -> Option<PathBuf> {
    uri.value("record").map(PathBuf::from)
}

/// The frequency of the SPI clock in Hz (`speed=`). A URI without the key has the default of its scheme. Fails if the
/// value is no frequency.
pub(crate) fn speed_hz(uri: &LinkUri) -> Result<u32, UriError> {
    uri.required("speed", |value| keys::hertz(value)?.try_into().ok())
}
