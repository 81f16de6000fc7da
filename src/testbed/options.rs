//! The keys of the links to boards that are modelled in this process, `sim:` and `xf-sim:`, as Rust types.

use std::path::PathBuf;
use std::time::Duration;

use super::chip_options::ModelledChip;
use super::shared_options::{clock, script};
use crate::address::Fraction;
use crate::address::keys::{Scheme, millis};
use crate::address::slaves::SlaveSpec;
use crate::address::uri::{LinkUri, UriError};
use crate::machine_file::slaves_of_link;
use crate::own_board::chip::ChipUse;
use crate::own_board::options::BoardOptions;
pub use crate::recording::Clock;

/// How a modelled board reaches its slaves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelledBus {
    /// No chip: in each cycle the board itself sends a simulated frame through the slaves (`sim:`).
    Direct,
    /// A modelled ECM-XF (`xf-sim:`).
    Chip {
        /// The chip, and the SPI or USB connection to it.
        chip: ModelledChip,
        /// How the board uses the chip: settings of its driver, for how many cycles it may send outputs ahead, and which pins
        /// of the chip are the board's local inputs and outputs.
        used: ChipUse,
    },
}

/// Options of `sim:` and `xf-sim:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimOptions {
    /// The options of the board that do not depend on its slaves, such as slot size and cycle time.
    pub board: BoardOptions,
    /// The slaves in network order: 0..=40, or 0..=30 with 16-byte slots.
    pub slaves: Vec<SlaveSpec>,
    /// Real or virtual time.
    pub clock: Clock,
    /// The name of the board: links of this process with the same name and the same options open the same board.
    pub name: Option<String>,
    /// The maximum time by which a board is advanced when it is opened again after its link was closed.
    pub catch_up: Duration,
    /// The rate of the board's clock relative to the real clock, 0.001..=1; with 0.1 the board is ten times slower.
    pub rate: Fraction,
    /// The script file with events that happen to the board and its slaves.
    pub script: Option<PathBuf>,
    /// The name or path of the control socket, through which events are injected while the board runs
    /// ([`super::control`]).
    pub control: Option<String>,
    /// The connection between the board and its slaves.
    pub bus: ModelledBus,
}

impl SimOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is neither a `sim:` nor an `xf-sim:` link.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let bus = match uri.scheme() {
            Scheme::XfSim => ModelledBus::Chip { chip: ModelledChip::from_uri(uri)?, used: ChipUse::from_uri(uri)? },
            _ => {
                uri.expect_scheme(Scheme::Sim)?;
                ModelledBus::Direct
            }
        };
        Ok(Self {
            board: BoardOptions::from_uri(uri)?,
            slaves: slaves_of_link(uri)?,
            clock: clock(uri)?,
            name: uri.typed("name", |value| Some(value.to_owned()))?,
            catch_up: uri.required("catch_up_ms", millis)?,
            rate: uri.required("rate", Fraction::parse)?,
            script: script(uri)?,
            control: uri.typed("control", |value| Some(value.to_owned()))?,
            bus,
        })
    }
}
