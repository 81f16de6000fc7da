//! The keys of a link's URI as Rust types: those of any link, and those of `sim:`.

use std::path::PathBuf;
use std::time::Duration;

use super::fault::FaultOptions;
use super::fraction::Fraction;
use super::keys::Scheme;
use super::slaves::{self, SlaveSpec};
use super::uri::{LinkUri, UriError, slot_size};
use super::{LinkInfo, Stamp, Wait};
use crate::engine::Firmware;
pub use crate::recording::Clock;
use crate::sk::SlotSize;

/// Options that every link has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommonOptions {
    /// The slot size (`slot=`); `None` if the URI does not give one. For a board in this process it is always given.
    pub slot: Option<SlotSize>,
    /// How many unread reports are kept (`queue=`), 1 or more. When the queue is full the oldest report is dropped.
    pub queue: usize,
    /// The file to record to (`record=`).
    pub record: Option<PathBuf>,
    /// The time limit of a read (`read_timeout_ms=`); `None`: a read waits until there is a report.
    pub read_timeout: Option<Duration>,
    /// The time limit of a write that the board does not accept (`write_timeout_ms=`).
    pub write_timeout: Duration,
    /// Faults to inject (`fault.*`).
    pub fault: FaultOptions,
}

impl CommonOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit the type of its option.
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

    /// The time limit of a read as a [`Wait`].
    pub fn read_wait(&self) -> Wait {
        self.read_timeout.map_or(Wait::Forever, Wait::For)
    }

    /// The time limit of a write as a [`Wait`].
    pub const fn write_wait(&self) -> Wait {
        Wait::For(self.write_timeout)
    }

    /// What a link with these options is, whose real clock begins when it is opened.
    pub fn info(&self, name: String, slot: Option<SlotSize>) -> LinkInfo {
        let (read_wait, write_wait) = (self.read_wait(), self.write_wait());
        LinkInfo { name, slot, virtual_time: false, opened_at: Stamp(0), read_wait, write_wait }
    }
}

/// Options of `sim:`.
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
}

impl SimOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is not a `sim:` link.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        uri.expect_scheme(Scheme::Sim)?;
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
        })
    }
}

pub(super) fn millis(value: &str) -> Option<Duration> {
    value.parse().ok().map(Duration::from_millis)
}
