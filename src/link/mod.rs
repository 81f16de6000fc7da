//! The connection of a program to one ECM-SK board: the trait [`Link`], and links that wrap another link.
//!
//! A link exchanges whole 512-byte frames with one board: command frames out, reports in. The same trait covers a
//! simulated board in this process (`sim:`, and with an ECM-XF before its slaves `xf-sim:`), a real board on USB
//! (`usb:`) or SPI (`spi:`), and a board that another process or machine serves (`tcp:`). Links that change or record
//! the traffic wrap another link ([`Layer`]).
//!
//! - `mod.rs`: [`Link`]; `error.rs`, `machine_error.rs`: [`LinkError`], and errors in the files of a simulated machine
//! - `layer.rs`, `fault.rs`, `record/`, `limits.rs`: links around a link: fault injection (`fault.*`), recording (`record=`),
//!   and the limits of a machine file (`axes=`)
//! - `chip_link.rs`: the trait of links to an ECM-XF itself, which is a chip and no board
//! - `common_options.rs`, `call_counts.rs`: the keys that every link has as Rust types, and the counters of a program's calls
//! - `network.rs`: the slaves that a board's server knows, for its clients
//! - `paths.rs`: re-exports, which give items of other folders a public path here: the URI (`address/`), the links
//!   themselves (`hardware/`, `own_board/`, `testbed/`, `tcp/`), and opening them (`open/`)

pub(crate) mod call_counts;
pub(crate) mod chip_link;
pub(crate) mod common_options;
mod error;
pub mod fault;
mod layer;
pub(crate) mod limits;
pub(crate) mod machine_error;
mod network;
mod paths;
pub mod record;

use std::time::{Duration, Instant};

pub use error::LinkError;
pub use layer::Layer;
pub use network::KnownNetwork;
pub use paths::*;

pub use crate::recording::CarriedFile;
pub use crate::sk::Dir;
use crate::sk::{Frame, SlotSize};
use crate::span::Span;

/// How long a call may wait for the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// Until the call has succeeded, the board is lost, or the link is closed.
    Forever,
    /// At most this long.
    For(Duration),
    /// Not at all: the call succeeds at once or fails with [`LinkError::Timeout`].
    Now,
}

impl Wait {
    /// Waits at most `limit`; for a duration of zero that is [`Wait::Now`].
    pub const fn at_most(limit: Duration) -> Self {
        if limit.is_zero() { Self::Now } else { Self::For(limit) }
    }

    /// The longest duration of the wait; `None`: no limit.
    pub const fn limit(self) -> Option<Duration> {
        match self {
            Self::Forever => None,
            Self::For(limit) => Some(limit),
            Self::Now => Some(Duration::ZERO),
        }
    }

    /// When a wait that begins now ends; `None`: never, or too late for an [`Instant`].
    pub fn deadline(self) -> Option<Instant> {
        Instant::now().checked_add(self.limit()?)
    }
}

/// The properties of a link: its name, its slot size, its clock and its default timeouts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkInfo {
    /// The URI of the link in its normal form: keys in a fixed order, keys with their default values left out.
    pub name: String,
    /// The slot size of the board's frames; `None` if neither the URI nor the board has given it.
    pub slot: Option<SlotSize>,
    /// Whether the board's time is virtual: it advances only inside calls to the link, and no wait takes real time.
    pub virtual_time: bool,
    /// When the link was opened, on the link's own clock.
    pub opened_at: Stamp,
    /// The timeout of reads for callers that do not choose one, from the key `read_timeout_ms`.
    pub read_wait: Wait,
    /// The timeout of writes for callers that do not choose one, from the key `write_timeout_ms`.
    pub write_wait: Wait,
}

/// A time on a link's clock, in nanoseconds: when a command frame was handed over, or when a report was made. The link
/// chooses the zero of its clock; see [`LinkInfo::opened_at`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp(pub u64);

impl Stamp {
    /// The time as a signed number of nanoseconds, as in recordings; 2^63 - 1 if it does not fit.
    pub fn nanoseconds(self) -> i64 {
        i64::try_from(self.0).unwrap_or(i64::MAX)
    }
}

/// Time and sequence number of a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadMeta {
    /// When the board made the report, on the link's clock. A real board does not give this time; then it is the time
    /// at which the link received the report. On SPI this is the start of the exchange. On USB it is the moment at
    /// which the operating system handed the report over: between two reads this moment is up to 1 ms after the arrival
    /// of the report.
    pub at: Stamp,
    /// The number of the report, counted from 0 since the link was opened. A gap means that reports were dropped.
    pub sequence: u64,
    /// How many reports have been dropped so far because the program did not read them in time.
    pub dropped: u64,
}

/// Counters of a link since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkStats {
    /// The number of command frames written.
    pub written: u64,
    /// The number of reports handed to the program.
    pub read: u64,
    /// The number of reports dropped because the program did not read them in time; the oldest are dropped first.
    pub reports_dropped: u64,
    /// The number of writes that ended with an error.
    pub write_errors: u64,
    /// The number of reads that ended with an error.
    pub read_errors: u64,
    /// The number of empty or short USB transfers, which are not whole reports and were skipped.
    pub reports_short: u64,
    /// The number of USB transfers that failed on the bus and were started again.
    pub transfers_failed: u64,
    /// The number of frames missing from the recording because the file could not be written fast enough or at all.
    pub record_dropped: u64,
    /// Faults injected by the keys `fault.*`.
    pub faults: fault::FaultStats,
    /// The board's own counters; `None` for a real board, which does not report them.
    pub board: Option<crate::engine::Counters>,
    /// Why the board's last change of state failed; only for a board in this process. `None` if it did not fail or the
    /// link cannot know. [`StateFailure::explain`](crate::engine::StateFailure::explain) turns it into text.
    pub state_failure: Option<crate::engine::StateFailure>,
    /// Whether the board receives nothing from its network, so that it makes no reports: the cable to the first slave
    /// is cut, or the network card or chip is gone. Only for a board in this process.
    pub network_down: bool,
    /// The slaves that are lost, as in [`Snapshot::lost`](crate::engine::Snapshot::lost). Only for a board in this
    /// process; empty for any other.
    pub lost: crate::ethercat::SlaveSet,
    /// How late the cycles began. Only for a board in this process on the real clock; `None` for any other.
    pub lateness: Option<crate::engine::Lateness>,
}

/// A connection to one ECM-SK board, over which frames are exchanged.
///
/// Frames are passed on whole and unchanged. Reading, writing and closing may happen in three different threads. Every
/// wait ends: by its timeout, by the loss of the board, or by [`Link::close`].
pub trait Link: Send + Sync {
    /// Name, slot size, clock and default timeouts of the link.
    fn info(&self) -> LinkInfo;

    /// The slaves behind the board, as far as its server knows them; `None` if nothing is known. The call does not ask
    /// the board.
    fn network(&self) -> Option<KnownNetwork> {
        None
    }

    /// Hands a command frame to the board. Returns the time at which that happened.
    ///
    /// # Errors
    /// The board has not taken the frame: [`LinkError::Timeout`], [`LinkError::Lost`], [`LinkError::Closed`],
    /// [`LinkError::Cancelled`], [`LinkError::WrongSlot`], [`LinkError::Io`]. There are two exceptions. After
    /// [`LinkError::Unsure`], which occurs on a network, it is not known whether the board has taken the frame. After
    /// [`LinkError::BeyondLimit`] it has taken the frame without its CSP targets.
    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError>;

    /// Reads the oldest unread report into `out`. Without a report `out` stays unchanged.
    ///
    /// # Errors
    /// Those of [`Link::write`], and [`LinkError::Silent`] on a virtual clock.
    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError>;

    /// Advances the time of a board on a virtual clock ([`LinkInfo::virtual_time`]) and returns the time reached.
    /// Reports that the board makes meanwhile are queued or dropped as if the program had not read. On the real clock
    /// the call does nothing and returns `None`.
    ///
    /// One call advances at most [`PASS_MAX`], and does so in steps, so that [`Link::close`] from another thread ends
    /// it.
    ///
    /// # Errors
    /// [`LinkError::Lost`], [`LinkError::Closed`]; [`LinkError::Io`] for more than [`PASS_MAX`], in which case no time
    /// has passed.
    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        let _ = time;
        Ok(None)
    }

    /// Cancels the calls that are waiting in one direction at this moment. They fail with [`LinkError::Cancelled`].
    /// Later calls are not affected.
    fn cancel(&self, dir: Dir);

    /// Ends every wait and releases the board. A second call does nothing.
    fn close(&self);

    /// Closes the link of a program that ends without having closed it properly, for example by a crash. In contrast to
    /// [`Link::close`], the server of a board on the network then brings the axes that the program has moved to a
    /// standstill (`ecmsk serve tcp`), as it does when a program is killed. A recording is completed in either case.
    fn vanish(&self) {
        self.close();
    }

    /// Checks whether the board is still connected. The call reads and writes nothing, and does not wait.
    ///
    /// # Errors
    /// [`LinkError::Lost`] once the board is gone, [`LinkError::Closed`] after [`Link::close`].
    fn check(&self) -> Result<(), LinkError>;

    /// The counters since the link was opened.
    fn stats(&self) -> LinkStats;

    /// The time from the first opening of the board in the recording of this link (key `record=`) to this opening. Times in
    /// a recording count from its first opening. Zero for the first opening, and without a recording.
    fn recorded_before(&self) -> Duration {
        Duration::ZERO
    }
}

/// The longest time that one call of [`Link::pass`] advances: a day. \[OURS] Simulating a day takes minutes of
/// computing; larger values, up to the 2^63 ns that the type can hold, can only be a mistake.
pub const PASS_MAX: Duration = Duration::from_secs(24 * 60 * 60);

/// Returns an error for a time longer than [`PASS_MAX`].
pub(crate) fn check_pass(time: Duration) -> Result<(), LinkError> {
    if time <= PASS_MAX {
        return Ok(());
    }
    Err(LinkError::Io {
        what: format!("let {} of the board's time pass", Span(time)),
        message: format!("one call lets at most {} pass; call it several times", Span(PASS_MAX)),
    })
}

/// By how much a failed attempt to open a board advances its virtual clock \[OURS]. A program that tries again and
/// again after SW_RESET then sees the board start up.
pub(crate) const FAILED_OPEN: Duration = Duration::from_millis(50);

/// When several links share one simulated board of this process, and when a link gets its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// Links with the same `name=` share a board. A link without a name gets its own board, which ends with the link.
    ByName,
    /// Links with the same `name=`, or without a name but with the same options, share a board. The C library uses
    /// this, so that a program that closes its link and opens it again finds the board in the state in which it left
    /// it.
    ByUri,
}
