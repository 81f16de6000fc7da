//! Boards over an ECM-XF: `xf-sim:`, `xf-spi:` and `xf-usb:` opened as a board. This process runs the model of the
//! EC01M, and the chip runs the network of its slaves.

use super::engine::EngineLink;
use super::options::BoardOptions;
use super::{boots, switching_off};
use crate::address::keys;
use crate::address::uri::{LinkUri, UriError};
use crate::engine::{Board, Rate};
use crate::fieldbus::xf::{LocalPins, XfBus, XfBusOptions};
use crate::link::LinkError;
use crate::link::chip_link::{ChipError, ChipLink, ChipOptions, host_config};
use crate::link::common_options::CommonOptions;
use crate::xf::host::{HostError, StepError};

/// How a board uses the chip through which it reaches its slaves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipUse {
    /// The settings of the chip's driver.
    pub driver: ChipOptions,
    /// For how many cycles outputs may be sent to the chip ahead of time, 1..=60; see [`XfBusOptions::ahead`].
    pub ahead: u16,
    /// The pins of the chip that are the board's local inputs and outputs.
    pub local_pins: LocalPins,
}

impl ChipUse {
    /// Reads the options from a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError`] if the URI is not that of a link to a chip.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let lines = |key, max| uri.typed(key, |value| keys::pins(value, max)).map(Option::unwrap_or_default);
        Ok(Self {
            driver: ChipOptions::from_uri(uri)?,
            ahead: uri.required("ahead", |value| value.parse().ok())?,
            local_pins: LocalPins {
                inputs: lines("local_in", LocalPins::INPUT_MAX)?,
                outputs: lines("local_out", LocalPins::OUTPUT_MAX)?,
            },
        })
    }

    /// The bus of a board that reaches its slaves through `link`.
    pub fn bus<L: ChipLink + 'static>(&self, link: L) -> XfBus<L> {
        let info = link.info();
        let options = XfBusOptions {
            ahead: self.ahead,
            clock_hz: info.clock_hz,
            local_pins: self.local_pins,
            real_time: !info.virtual_time,
            size_is_fixed: info.size.is_some(),
        };
        XfBus::new(link, host_config(&info, &self.driver), options)
    }
}

/// A board that reaches its slaves through a real chip, while its EC01M is a model that runs in this process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipBoard {
    /// The options of the board's model and of its host interface.
    pub board: BoardOptions,
    /// How the board uses the chip.
    pub used: ChipUse,
    /// The options that every link has, such as the recording and the time limits.
    pub common: CommonOptions,
}

impl ChipBoard {
    /// Reads the options from a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError`] if the URI is not that of a link to a chip.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        Ok(Self {
            board: BoardOptions::from_uri(uri)?,
            used: ChipUse::from_uri(uri)?,
            common: CommonOptions::from_uri(uri)?,
        })
    }

    /// Opens a board over a link to a chip: starts the chip and scans its network.
    ///
    /// The board ends with this process. If the process is killed, it cannot stop the axes, and the chip repeats its
    /// newest outputs for ever: an axis in CSP stops, but an axis in CSV or CST keeps moving.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`]: the chip cannot be reached, does not answer, or finds no slave; [`LinkError::Io`]: the
    /// system provides no thread.
    pub fn open_over(&self, link: Box<dyn ChipLink>) -> Result<EngineLink, LinkError> {
        let name = link.info().name;
        let no_board = |reason: String| LinkError::NoBoard { name: name.clone(), reason };
        let mut bus = self.used.bus(link);
        bus.start_up().map_err(|error| match error {
            StepError::Host(error) => {
                no_board(format!("the chip does not answer: {error}; look at its wires and power, try `ecmsk xf info`"))
            }
            StepError::Wires(error) => refused(&name, error),
        })?;
        if bus.host().gave_crc_up() {
            log::warn!("{name}: {}", HostError::CRC_GIVEN_UP);
        }
        let mut board = Board::new(self.board.engine(), Box::new(bus));
        if !boots(&mut board) {
            let next = "look at the network cable and at the slaves' power, and try `ecmsk xf scan`";
            return Err(no_board(format!("the chip finds no slave; {next}")));
        }
        let run = self.board.run(&self.common, false, Rate::default());
        EngineLink::open(&name, board, run, Some(switching_off()))
    }
}

/// Converts the error of a chip that cannot be reached to the error of the board's link.
pub(crate) fn refused(name: &str, error: ChipError) -> LinkError {
    match error {
        ChipError::Uri(error) => error.into(),
        ChipError::Unsupported { scheme, hint } => LinkError::Unsupported { scheme: scheme.name().to_owned(), hint },
        ChipError::Wires { message, .. } => LinkError::NoBoard { name: name.to_owned(), reason: message },
        other => LinkError::NoBoard { name: name.to_owned(), reason: other.to_string() },
    }
}
