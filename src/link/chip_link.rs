//! How a host reaches one ECM-XF, as the chip that it is or with a board over it: the trait [`ChipLink`] and every link to a chip there is.
//!
//! A chip has no frames. Its host clocks bytes both ways ([`Wires`]), and [`Host`](crate::xf::host::Host) makes packets
//! of them. The URI is that of any link, with schemes of its own, for example `xf-sim:?slaves=drive*3,io`.
//!
//! What opens such links is in `open/chip.rs`; the links are `xf-sim:` (`testbed/chip.rs`), `xf-spi:` and `xf-usb:`
//! (`hardware/`), and one around a link that records (`record/chip.rs`).

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

/// What a link to a chip is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipInfo {
    /// The URI in its normal form.
    pub name: String,
    /// The only n there can be, if the link has one.
    pub size: Option<DataSize>,
    /// The clock of SPI in Hz; `None`: the link has none.
    pub clock_hz: Option<u32>,
    /// Whether INT0 is wired.
    pub has_int0: bool,
    /// Whether time is virtual: it then advances only inside calls.
    pub virtual_time: bool,
}

/// The link to one chip, which only its owner uses.
pub trait ChipLink: Wires<Error = ChipError> + Send {
    /// What it is.
    fn info(&self) -> ChipInfo;

    /// The level of INT1; `None`: it is not wired. The chip chooses which level is active
    /// (XF EN 1316; low after a start).
    ///
    /// # Errors
    /// [`ChipError::Wires`].
    fn int1(&mut self) -> Result<Option<bool>, ChipError>;

    /// Pulls the chip's reset line low for [`RESET_LOW`] and releases it. The chip is as after power-on then, and takes its time to
    /// start. Returns `false`, and does nothing, if the line is not wired.
    ///
    /// # Errors
    /// [`ChipError::Wires`].
    fn reset(&mut self) -> Result<bool, ChipError> {
        Ok(false)
    }
}

/// How long a chip's reset line is pulled low (OBS: a client of the chip).
pub const RESET_LOW: Duration = Duration::from_millis(100);

/// A link behind a pointer is a link.
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
    /// The link is one to a board.
    #[error("`{name}` is a board and no ECM-XF; name a chip, such as xf-sim:?slaves=drive*2; see `ecmsk link help`")]
    NotAChip { name: String },
    /// This build cannot open links of that scheme.
    #[error("link `{scheme}:` is not in this build; {hint}")]
    Unsupported {
        scheme: Scheme,
        /// What to do instead.
        hint: String,
    },
    /// The file with a simulated slave's manufacturer-specific objects is invalid.
    #[error(transparent)]
    ManufacturerObjects(#[from] crate::link::machine_error::ManufacturerObjectsError),
    /// The script of what happens to the slaves is invalid, or has a line that cannot happen there.
    #[error(transparent)]
    Script(#[from] crate::link::machine_error::SimulatedSlavesError),
    /// The slaves cannot be put on a network of controllers.
    #[error("{name}: {reason}; take that slave out, or write network=models")]
    Network {
        name: String,
        /// Why.
        reason: String,
    },
    /// The wires cannot be used.
    #[error("{name}: {message}")]
    Wires {
        name: String,
        /// What happened and what to do.
        message: String,
    },
}

/// How the driver uses a chip behind that link.
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

/// How many exchanges an answer may take. \[OURS]
const EXCHANGES_TO_ANSWER: Ns = 10;

/// The default deadlines; on a slow clock an answer has the time for some exchanges of the largest n.
fn timeouts(clock_hz: Option<u32>) -> Timeouts {
    let longest = clock_hz.map_or(0, |hertz| MAX_PACKET as u64 * 8_000_000_000 / u64::from(hertz.max(1)));
    let answer_ns = Timeouts::DEFAULT.answer_ns.max(EXCHANGES_TO_ANSWER * longest);
    Timeouts { answer_ns, ..Timeouts::DEFAULT }
}
