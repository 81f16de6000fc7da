//! The keys of boards that are modelled in this process, `sim:` and `xf-sim:`, as Rust types.

use std::path::PathBuf;
use std::time::Duration;

use super::millis;
use crate::engine::Firmware;
use crate::link::chip::{ChipOptions, ModelledChip};
use crate::link::fraction::Fraction;
use crate::link::keys::Scheme;
use crate::link::slaves::{self, SlaveSpec};
use crate::link::uri::{LinkUri, UriError, slot_size};
pub use crate::recording::Clock;
use crate::sk::SlotSize;

/// What is between a modelled board and its slaves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelledBus {
    /// Nothing: a cycle of the board is a frame that passes the slaves (`sim:`).
    Direct,
    /// An ECM-XF, whose driver the board uses (`xf-sim:`).
    Chip {
        /// The chip and the wires to it.
        chip: ModelledChip,
        /// How the driver uses it.
        driver: ChipOptions,
        /// How many sets of outputs may lie in the chip, see
        /// [`XfBusOptions::ahead`](crate::fieldbus::xf::XfBusOptions::ahead).
        ahead: u16,
    },
}

/// Options of `sim:` and `xf-sim:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimOptions {
    /// The slaves in network order: 0..=40, or 0..=30 with 16-byte slots.
    pub slaves: Vec<SlaveSpec>,
    /// The slot size, which the board's jumper CONFIG2 selects.
    pub slot: SlotSize,
    /// Real or virtual time.
    pub clock: Clock,
    /// The version of the firmware to simulate.
    pub firmware: Firmware,
    /// Whether the board is in test mode, which the jumper CONFIG1 selects.
    pub test: bool,
    /// The name of the board: links with the same name open the same board.
    pub name: Option<String>,
    /// How long a write takes, in microseconds of the board's time: 0..=1 000 000.
    pub host_us: u32,
    /// How long a change of the EtherCAT state may take.
    pub state_timeout: Duration,
    /// How long a slave may take to answer an SDO request.
    pub sdo_timeout: Duration,
    /// The real-time priority (SCHED_FIFO) of the cyclic thread, 1..=99; `None`: an ordinary thread.
    pub priority: Option<u8>,
    /// Whether the process is locked into memory (`mlockall`), so that no cycle waits for a page.
    pub lock_memory: bool,
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
            Scheme::XfSim => ModelledBus::Chip {
                chip: ModelledChip::from_uri(uri)?,
                driver: ChipOptions::from_uri(uri)?,
                ahead: uri.required("ahead", |value| value.parse().ok())?,
            },
            _ => {
                uri.expect_scheme(Scheme::Sim)?;
                ModelledBus::Direct
            }
        };
        Ok(Self {
            slaves: uri.required("slaves", |value| slaves::parse(value).ok())?,
            slot: uri.required("slot", slot_size)?,
            clock: uri.choice("clock", [("real", Clock::Real), ("virtual", Clock::Virtual)])?,
            firmware: uri.choice("fw", [("1.7", Firmware::V17), ("1.5", Firmware::V15)])?,
            test: uri.choice("test", [("0", false), ("1", true)])?,
            name: uri.typed("name", |value| Some(value.to_owned()))?,
            host_us: uri.required("host_us", |value| value.parse().ok())?,
            state_timeout: uri.required("state_timeout_ms", millis)?,
            sdo_timeout: uri.required("sdo_timeout_ms", millis)?,
            priority: uri.typed("priority", |value| value.parse().ok())?,
            lock_memory: uri.choice("lock_memory", [("no", false), ("yes", true)])?,
            catch_up: uri.required("catch_up_ms", millis)?,
            rate: uri.required("rate", Fraction::parse)?,
            script: uri.typed("script", |value| Some(PathBuf::from(value)))?,
            bus,
        })
    }
}
