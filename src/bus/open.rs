//! Opens the network that a link names.

use super::{BusError, Network};
use crate::address::keys::Scheme;
use crate::address::uri::LinkUri;

/// Opens the network of a link: `nic:eth1`, `sim:?slaves=drive*2` in virtual time, or a chip (`xf-sim:`, `xf-spi:` or
/// `xf-usb:`). Nothing is sent yet. A network card is refused if another program has it, if it belongs to another
/// network, or if another master sends on it.
///
/// # Errors
/// [`BusError::Link`]: the link is wrong, or does not open; [`BusError::IsBoard`].
pub fn open(link: &str) -> Result<Box<dyn Network>, BusError> {
    let uri = LinkUri::parse(link)?;
    match uri.scheme() {
        #[cfg(feature = "sim")]
        Scheme::Sim => {
            let wires = super::simulated::SimulatedWires::new(&uri)?;
            Ok(Box::new(super::software::SoftwareNetwork::new(wires, crate::master::Settings::default())))
        }
        #[cfg(all(feature = "nic", target_os = "linux"))]
        Scheme::Nic => {
            use crate::own_board::nic::{CardWires, wires};
            Ok(match wires(&uri)? {
                (CardWires::Line(card), settings) => Box::new(super::software::SoftwareNetwork::new(card, settings)),
                (CardWires::Ring(ring), settings) => Box::new(super::software::SoftwareNetwork::new(ring, settings)),
            })
        }
        #[cfg(feature = "sim")]
        Scheme::XfSim => {
            let (link, config) = super::simulated::chip(&uri)?;
            Ok(Box::new(super::chip::XfNetwork::over(link, config)?))
        }
        Scheme::XfSpi | Scheme::XfUsb => Ok(Box::new(super::chip::XfNetwork::open(&uri)?)),
        Scheme::Usb | Scheme::Spi | Scheme::Tcp => Err(BusError::IsBoard { link: uri.to_string() }),
        #[allow(unreachable_patterns, reason = "a build may have every link")]
        scheme => {
            Err(crate::link::LinkError::Unsupported { scheme: scheme.to_string(), hint: scheme.instead() }.into())
        }
    }
}

/// A network whose slaves this crate's own master reaches over `wires`, a network card or a simulated one, as [`open`]
/// returns it for a link `nic:`. Nothing is sent yet.
#[cfg(any(feature = "sim", all(feature = "nic", target_os = "linux")))]
pub fn over<W: crate::fieldbus::nic::NicWires + 'static>(
    wires: W,
    settings: crate::master::Settings,
) -> Box<dyn Network> {
    Box::new(super::software::SoftwareNetwork::new(wires, settings))
}
