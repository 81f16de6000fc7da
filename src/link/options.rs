//! What a link's URI says, as types: the options of any link and those of `sim:`.

use std::path::PathBuf;
use std::time::Duration;

use super::Wait;
use super::fault::FaultOptions;
use super::fraction::Fraction;
use super::keys::Scheme;
use super::slaves::{self, SlaveSpec};
use super::uri::{LinkUri, UriError, slot_size};
use crate::engine::Firmware;
pub use crate::recording::Clock;
use crate::sk::SlotSize;

/// Options of any link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommonOptions {
    /// Slot size; `None` if the link does not say. A link to a modelled board always does.
    pub slot: Option<SlotSize>,
    /// Reports kept while nobody reads, the newest ones: 1 or more.
    pub queue: usize,
    /// File to record to.
    pub record: Option<PathBuf>,
    /// Limit of a read; `None`: it waits until there is a report.
    pub read_timeout: Option<Duration>,
    /// Limit of a write that the board does not accept.
    pub write_timeout: Duration,
    /// Faults on the way, `fault.*`.
    pub fault: FaultOptions,
}

impl CommonOptions {
    /// The options of that link, defaults filled in.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit this machine's integers.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        Ok(Self {
            slot: uri.typed("slot", slot_size)?,
            queue: uri.required("queue", |value| value.parse().ok())?,
            record: uri.typed("record", |value| Some(PathBuf::from(value)))?,
            read_timeout: uri.typed("read_timeout_ms", millis)?,
            write_timeout: uri.required("write_timeout_ms", millis)?,
            fault: FaultOptions::from_uri(uri)?,
        })
    }

    /// Limit of a read, as the seam wants it.
    pub fn read_wait(&self) -> Wait {
        self.read_timeout.map_or(Wait::Forever, Wait::For)
    }

    /// Limit of a write, as the seam wants it.
    pub const fn write_wait(&self) -> Wait {
        Wait::For(self.write_timeout)
    }
}

/// Options of `sim:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimOptions {
    /// The slaves on the network, in order: 0..=40 (30 with 16-byte slots).
    pub slaves: Vec<SlaveSpec>,
    /// CONFIG2.
    pub slot: SlotSize,
    /// Real or virtual time.
    pub clock: Clock,
    /// The firmware modelled.
    pub firmware: Firmware,
    /// CONFIG1: whether the board is in test mode.
    pub test: bool,
    /// The board's own name: links with the same name are the same board.
    pub name: Option<String>,
    /// How long a write takes, microseconds: 0..=1 000 000.
    pub host_us: u32,
    /// How long a change of state may take.
    pub state_timeout: Duration,
    /// How long a slave may take for an SDO.
    pub sdo_timeout: Duration,
    /// Real-time priority (SCHED_FIFO) of the cycle's thread: 1..=99; `None`: an ordinary thread.
    pub priority: Option<u8>,
    /// Whether to keep the process in memory (`mlockall`).
    pub lock_memory: bool,
    /// How much of the time that the board was closed it runs through when it is opened again.
    pub catch_up: Duration,
    /// How fast board time passes on the real clock: 0.001..=1.
    pub rate: Fraction,
    /// What happens when.
    pub script: Option<PathBuf>,
}

impl SimOptions {
    /// The options of that link, defaults filled in.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is no `sim:` link.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        if uri.scheme() != Scheme::Sim {
            return Err(UriError::OtherScheme { uri: uri.to_string(), expected: Scheme::Sim });
        }
        Ok(Self {
            slaves: uri.required("slaves", |value| slaves::parse(value).ok())?,
            slot: uri.required("slot", slot_size)?,
            clock: uri.required("clock", |value| match value {
                "real" => Some(Clock::Real),
                "virtual" => Some(Clock::Virtual),
                _ => None,
            })?,
            firmware: uri.required("fw", |value| match value {
                "1.7" => Some(Firmware::V17),
                "1.5" => Some(Firmware::V15),
                _ => None,
            })?,
            test: uri.required("test", |value| match value {
                "0" => Some(false),
                "1" => Some(true),
                _ => None,
            })?,
            name: uri.typed("name", |value| Some(value.to_owned()))?,
            host_us: uri.required("host_us", |value| value.parse().ok())?,
            state_timeout: uri.required("state_timeout_ms", millis)?,
            sdo_timeout: uri.required("sdo_timeout_ms", millis)?,
            priority: uri.typed("priority", |value| value.parse().ok())?,
            lock_memory: uri.required("lock_memory", |value| match value {
                "no" => Some(false),
                "yes" => Some(true),
                _ => None,
            })?,
            catch_up: uri.required("catch_up_ms", millis)?,
            rate: uri.required("rate", Fraction::parse)?,
            script: uri.typed("script", |value| Some(PathBuf::from(value)))?,
        })
    }
}

pub(super) fn millis(value: &str) -> Option<Duration> {
    value.parse().ok().map(Duration::from_millis)
}
