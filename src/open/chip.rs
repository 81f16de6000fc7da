//! Opens an ECM-XF, as a chip or as a board over the chip.

use crate::address::keys::Scheme;
use crate::address::uri::{LinkUri, UriError};
use crate::link::LinkError;
use crate::link::chip_link::{ChipError, ChipLink, ChipOptions, host_config, record};
use crate::link::record::RecordedChip;
use crate::own_board::chip::{ChipBoard, refused};
use crate::own_board::engine::EngineLink;
use crate::xf::host::HostConfig;

/// Opens the link to a chip at a URI. Also returns the settings of the chip's driver.
///
/// # Errors
/// [`ChipError::Uri`], [`ChipError::NotAChip`] for the URI of a board, [`ChipError::Unsupported`]; for a model
/// [`ChipError::Script`], [`ChipError::ManufacturerObjects`] and [`ChipError::Network`]; for hardware or a recording
/// that cannot be opened [`ChipError::Wires`].
pub fn open(uri: &str) -> Result<(Box<dyn ChipLink>, HostConfig), ChipError> {
    let uri = LinkUri::parse(uri)?;
    let link = connect(&uri)?;
    let config = host_config(&link.info(), &ChipOptions::from_uri(&uri)?);
    Ok((recorded(&uri, link)?, config))
}

/// Puts a recorder around the link if the URI has the key `record=`; refuses `flight=`.
pub(crate) fn recorded(uri: &LinkUri, link: Box<dyn ChipLink>) -> Result<Box<dyn ChipLink>, ChipError> {
    if let Some(value) = uri.value("flight") {
        let (key, value) = ("flight".to_owned(), value.to_owned());
        let why = "a flight recorder is for boards; record a chip with record=".to_owned();
        return Err(UriError::BadValue { key, value, why }.into());
    }
    Ok(match record(uri) {
        Some(path) => Box::new(RecordedChip::new(link, &path)?),
        None => link,
    })
}

pub(crate) fn connect(uri: &LinkUri) -> Result<Box<dyn ChipLink>, ChipError> {
    match uri.scheme() {
        #[cfg(feature = "sim")]
        Scheme::XfSim => Ok(Box::new(crate::testbed::chip::SimChip::from_uri(uri)?)),
        #[cfg(all(feature = "spi", target_os = "linux"))]
        Scheme::XfSpi => Ok(Box::new(crate::hardware::chip_on_spi::SpiChip::from_uri(uri)?)),
        #[cfg(all(feature = "usb", unix))]
        Scheme::XfUsb => Ok(Box::new(crate::hardware::chip_on_usb::UsbChip::from_uri(uri)?)),
        Scheme::Sim | Scheme::Usb | Scheme::Spi | Scheme::Tcp | Scheme::Nic => {
            Err(ChipError::NotAChip { name: uri.to_string() })
        }
        #[allow(unreachable_patterns, reason = "a build may have every link")]
        scheme => Err(ChipError::Unsupported { scheme, hint: scheme.instead() }),
    }
}

/// Opens the board that the URI describes, whose slaves are reached over a real chip.
#[cfg_attr(not(unix), allow(dead_code, reason = "no link to a real chip is in the build"))]
pub(super) fn board(uri: &LinkUri) -> Result<EngineLink, LinkError> {
    let options = ChipBoard::from_uri(uri)?;
    let link = crate::open::chip::connect(uri).map_err(|error| refused(&uri.to_string(), error))?;
    options.open_over(link)
}
