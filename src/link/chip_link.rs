//! Links to an ECM-XF: the trait [`ChipLink`], its errors and options. Through such a link a program uses the chip
//! directly, or a board reaches its slaves.
//!
//! A chip has no frames. Its host transfers bytes in both directions at once ([`Wires`]), and
//! [`Host`](crate::xf::host::Host) finds packets in them. The URI has the form of any link's, with schemes of its own,
//! for example `xf-sim:?slaves=drive*3,io`.
//!
//! `open/chip.rs` opens such links: `xf-sim:` (`testbed/chip.rs`), `xf-spi:` and `xf-usb:` (`hardware/`). With the key
//! `record=` it wraps the link in another one that records all exchanges (`record/chip.rs`).

mod options;

pub use options::ChipOptions;
pub(crate) use options::{data_size, record, speed_hz};

use std::time::Duration;

use crate::address::keys::Scheme;
use crate::address::uri::UriError;
use crate::ethercat::Ns;
use crate::xf::DataSize;
use crate::xf::MAX_PACKET;
use crate::xf::host::{HostConfig, HostPacing, Timeouts, Wires};

/// The properties of a link to a chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipInfo {
    /// The URI of the link in its normal form: keys in a fixed order, keys with their default values left out.
    pub name: String,
    /// The only length of a packet's data (n in the manuals of the chip) that the link supports; `None`: it supports
    /// several.
    pub size: Option<DataSize>,
    /// The SPI clock, Hz; `None`: the link is not SPI.
    pub clock_hz: Option<u32>,
    /// Whether the INT0 line is connected.
    pub has_int0: bool,
    /// Whether time is virtual: it then advances only inside calls.
    pub virtual_time: bool,
}

/// A link to one chip, for exclusive use by its owner.
pub trait ChipLink: Wires<Error = ChipError> + Send {
    /// The properties of the link.
    fn info(&self) -> ChipInfo;

    /// The level of the line INT1, by which the chip signals interrupts; `true` is high, `None`: the line is not
    /// connected. A setting of the chip decides which level is active (XF EN 1316; low after a start).
    ///
    /// # Errors
    /// [`ChipError::Wires`] if the level cannot be read.
    fn int1(&mut self) -> Result<Option<bool>, ChipError>;

    /// Pulls the chip's reset line low for [`RESET_LOW`] and releases it. The chip then starts as after power-on and
    /// does not answer until it has started. If the line is not connected, returns `false` and does nothing.
    ///
    /// # Errors
    /// [`ChipError::Wires`] if the line cannot be set.
    fn reset(&mut self) -> Result<bool, ChipError> {
        Ok(false)
    }
}

/// How long a chip's reset line is pulled low (OBS: seen in a program that uses the chip).
pub const RESET_LOW: Duration = Duration::from_millis(100);

/// Implements the traits of a link for a pointer to a link, so that the pointer can be used as a link.
macro_rules! through {
    ($($pointer:ty),*) => {$(
        impl<L: Wires + ?Sized> Wires for $pointer {
            type Error = L::Error;

            fn now(&self) -> Ns {
                (**self).now()
            }

            fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Self::Error> {
                (**self).exchange(to_chip, from_chip)
            }

            fn wait_until(&mut self, time: Ns) -> Result<(), Self::Error> {
                (**self).wait_until(time)
            }

            fn wait_ready(&mut self, until: Ns) -> Result<bool, Self::Error> {
                (**self).wait_ready(until)
            }
        }

        impl<L: ChipLink + ?Sized> ChipLink for $pointer {
            fn info(&self) -> ChipInfo {
                (**self).info()
            }

            fn int1(&mut self) -> Result<Option<bool>, ChipError> {
                (**self).int1()
            }

            fn reset(&mut self) -> Result<bool, ChipError> {
                (**self).reset()
            }
        }
    )*};
}

through! { Box<L>, &mut L }

/// Why a chip cannot be reached.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
#[non_exhaustive]
pub enum ChipError {
    /// The URI or one of its keys is invalid.
    #[error(transparent)]
    Uri(#[from] UriError),
    /// The URI names a board and not a chip.
    #[error(
        "`{name}` is a board and not an ECM-XF; name a chip, such as xf-sim:?slaves=drive*2; see `ecmsk link help`"
    )]
    NotAChip { name: String },
    /// This build cannot open links with this scheme.
    #[error("link `{scheme}:` is not in this build; {hint}")]
    Unsupported {
        scheme: Scheme,
        /// What the user can do instead.
        hint: String,
    },
    /// The file with manufacturer-specific objects of a simulated slave is invalid.
    #[error(transparent)]
    ManufacturerObjects(#[from] crate::link::machine_error::ManufacturerObjectsError),
    /// The script of faults (key `script=`) is invalid, or one of its lines cannot be carried out on the simulated
    /// slaves.
    #[error(transparent)]
    Script(#[from] crate::link::machine_error::SimulatedSlavesError),
    /// A slave in the URI cannot be simulated with a slave controller (`network=controllers`), because no EEPROM
    /// content can be made for it.
    #[error("{name}: {reason}; take that slave out, or write network=models")]
    Network {
        name: String,
        /// Which slave is meant, and why it cannot be simulated.
        reason: String,
    },
    /// The hardware between this machine and the chip, such as SPI or USB, cannot be used.
    #[error("{name}: {message}")]
    Wires {
        name: String,
        /// What is wrong, and what the user can do.
        message: String,
    },
}

/// The settings of the chip's driver that follow from the link and its options.
pub(crate) fn host_config(info: &ChipInfo, options: &ChipOptions) -> HostConfig {
    HostConfig {
        size: info.size,
        wanted_size: options.use_n.filter(|_| info.size.is_none()),
        idle_ns: options.idle_ns,
        pacing: if info.has_int0 { HostPacing::Int0 } else { HostPacing::Idle },
        timeouts: timeouts(info.clock_hz),
        ..HostConfig::DEFAULT
    }
}

/// The least time after which an answer of the chip counts as missing, as a number of exchanges of the longest packet.
/// It matters on a slow SPI clock, where exchanges take long. \[OURS]
const EXCHANGES_TO_ANSWER: Ns = 10;

/// The default deadlines of the driver. On a slow SPI clock the deadline of an answer is longer:
/// [`EXCHANGES_TO_ANSWER`] exchanges of the longest packet.
fn timeouts(clock_hz: Option<u32>) -> Timeouts {
    let longest = clock_hz.map_or(0, |hertz| MAX_PACKET as u64 * 8_000_000_000 / u64::from(hertz.max(1)));
    let answer_ns = Timeouts::DEFAULT.answer_ns.max(EXCHANGES_TO_ANSWER * longest);
    Timeouts { answer_ns, ..Timeouts::DEFAULT }
}
