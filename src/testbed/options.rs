//! The keys of boards that are modelled in this process, `sim:` and `xf-sim:`, as Rust types.

use std::path::PathBuf;
use std::time::Duration;

use super::chip_options::ModelledChip;
use super::clock_and_script::{clock, script};
use crate::address::Fraction;
use crate::address::keys::{Scheme, millis};
use crate::address::slaves::SlaveSpec;
use crate::address::uri::{LinkUri, UriError};
use crate::own_board::chip::ChipUse;
use crate::own_board::options::BoardOptions;
pub use crate::recording::Clock;

/// What is between a modelled board and its slaves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelledBus {
    /// Nothing: a cycle of the board is a frame that passes the slaves (`sim:`).
    Direct,
    /// An ECM-XF, which the board uses (`xf-sim:`).
    Chip {
        /// The chip and the wires to it.
        chip: ModelledChip,
        /// How the board uses it.
        used: ChipUse,
    },
}

/// Options of `sim:` and `xf-sim:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimOptions {
    /// What every board has that is modelled in this process.
    pub board: BoardOptions,
    /// The slaves in network order: 0..=40, or 0..=30 with 16-byte slots.
    pub slaves: Vec<SlaveSpec>,
    /// Real or virtual time.
    pub clock: Clock,
    /// The name of the board: links with the same name open the same board.
    pub name: Option<String>,
    /// How much of the time during which a board was closed is simulated when it is opened again.
    pub catch_up: Duration,
    /// The speed of the board's time on the real clock: 0.001..=1.
    pub rate: Fraction,
    /// A file of events that happen to the board and its slaves.
    pub script: Option<PathBuf>,
    /// What is between the board and its slaves.
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
            slaves: uri.slaves()?,
            clock: clock(uri)?,
            name: uri.typed("name", |value| Some(value.to_owned()))?,
            catch_up: uri.required("catch_up_ms", millis)?,
            rate: uri.required("rate", Fraction::parse)?,
            script: script(uri)?,
            bus,
        })
    }
}
