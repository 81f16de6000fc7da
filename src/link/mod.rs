//! How a host program reaches one ECM-SK board: the trait [`Link`], the URI that names a link, and every link there is.
//!
//! A link exchanges whole 512-byte frames with one board: command frames out, reports in. The same trait covers a
//! simulated board in this process (`sim:`, and with an ECM-XF before its slaves `xf-sim:`), a real board on USB (`usb:`)
//! or SPI (`spi:`), and a board that another process or machine serves (`tcp:`). Links that change or record the traffic
//! wrap another link ([`Layer`]).
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Link`], [`open`]; `error.rs`: [`LinkError`]
//! - `uri.rs`, `keys.rs`, `keys/table.rs`: the URI `scheme:path?key=value`; the table of all keys with their defaults
//! - `options.rs` with `options/sim.rs`, `travel.rs`, `fraction.rs`: the values of the keys as Rust types; those that only
//!   `usb:`, `spi:`, `tcp:` or `fault.*` has are in an `options.rs` of that folder
//! - `slaves.rs` with `slaves/kinds.rs`: the list of simulated slaves, and the kinds of them that there are
//! - `config.rs`: which link is opened when a program names none (`ECMSK_LINK`, `ecmsk.toml`)
//! - `sim.rs`, `engine.rs`, `boards.rs`: `sim:` and `xf-sim:`, the links to a board in this process, and the boards that
//!   outlive their links
//! - `manufacturer_objects.rs`, `script.rs`: manufacturer-specific objects of simulated slaves, and scripts of events
//!   (`script=`)
//! - `simulated_slaves.rs`: the same slaves and scripts for a network without a board
//! - `rejections.rs`, `episodes.rs`: what the log says of commands that a simulated board did not execute
//! - `usb/`, `spi/`, `tcp/`: real boards and remote boards; `slot_watch.rs` checks `slot=` against the reports of a USB
//!   board
//! - `layer.rs`, `fault.rs`, `record/`: links around a link: fault injection (`fault.*`) and recording (`record=`)
//! - `nic/`: slaves at the end of a network card
//! - `own_board.rs`: boards over real hardware whose EC01M is this process
//! - `chip/`: links to an ECM-XF itself, which is a chip and no board: its trait, its errors, `xf-sim:`, `xf-spi:`; and the
//!   bus of a board over such a link
//! - `call_counts.rs`: the counters of a program's calls, which every link has
//! - `network.rs`: what is known of the slaves behind a link, for programs that ask the server of a board

#[cfg(feature = "sim")]
mod boards;
mod call_counts;
pub mod chip;
pub mod config;
pub mod engine;
mod episodes;
mod error;
pub mod fault;
mod fraction;
pub mod keys;
mod layer;
#[cfg(feature = "sim")]
pub mod manufacturer_objects;
mod network;
#[cfg(all(feature = "nic", target_os = "linux"))]
pub(crate) mod nic;
pub mod options;
mod own_board;
pub mod record;
mod rejections;
#[cfg(feature = "sim")]
pub mod script;
#[cfg(feature = "sim")]
mod sim;
#[cfg(feature = "sim")]
pub mod simulated_slaves;
pub mod slaves;
#[cfg(all(feature = "usb", any(unix, windows)))]
mod slot_watch;
#[cfg(all(feature = "spi", target_os = "linux"))]
pub mod spi;
#[cfg(all(feature = "tcp", any(unix, windows)))]
#[cfg_attr(not(feature = "serve"), allow(dead_code, unused_imports, reason = "the server's end is not in the build"))]
pub mod tcp;
pub mod travel;
pub mod uri;
#[cfg(all(feature = "usb", any(unix, windows)))]
mod usb;

use std::sync::Arc;
use std::time::{Duration, Instant};

#[cfg(feature = "sim")]
#[doc(hidden)]
pub use boards::forget_parked;
pub use error::LinkError;
pub use fraction::Fraction;
pub use layer::Layer;
pub use network::KnownNetwork;

use crate::recording::RecordMeta;
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
    /// At most that long; a wait of no time is [`Wait::Now`].
    pub const fn at_most(limit: Duration) -> Self {
        if limit.is_zero() { Self::Now } else { Self::For(limit) }
    }

    /// The longest time; `None` if there is no limit.
    pub const fn limit(self) -> Option<Duration> {
        match self {
            Self::Forever => None,
            Self::For(limit) => Some(limit),
            Self::Now => Some(Duration::ZERO),
        }
    }

    /// When a wait that begins now ends; `None`: never, or beyond the range of [`Instant`].
    pub fn deadline(self) -> Option<Instant> {
        Instant::now().checked_add(self.limit()?)
    }
}

/// What a link is: its name, its slot size, its clock and its default time limits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkInfo {
    /// The URI in its normal form.
    pub name: String,
    /// The slot size of the board's frames; `None` if neither the URI nor the board has told it.
    pub slot: Option<SlotSize>,
    /// Whether the board's time is virtual: it advances only inside calls to the link, and no wait takes real time.
    pub virtual_time: bool,
    /// When the link was opened, on the link's own clock.
    pub opened_at: Stamp,
    /// The limit of a read for callers that do not choose one, from the key `read_timeout_ms`.
    pub read_wait: Wait,
    /// The limit of a write for callers that do not choose one, from the key `write_timeout_ms`.
    pub write_wait: Wait,
}

/// A moment on a link's clock, in nanoseconds: when a command frame was handed over, or when a report was made. Where
/// zero lies depends on the link; see [`LinkInfo::opened_at`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp(pub u64);

impl Stamp {
    /// The moment as recordings have it, which count with a sign.
    pub fn nanoseconds(self) -> i64 {
        i64::try_from(self.0).unwrap_or(i64::MAX)
    }
}

/// What is known of a report besides its bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadMeta {
    /// When the report was made, on the link's clock. A real board does not tell, so there it is when the link received
    /// the report: on SPI the start of the exchange, on USB the moment at which the operating system handed it over,
    /// which between two reads is up to 1 ms after its arrival (WIRE-94).
    pub at: Stamp,
    /// The number of the report, counted from 0 since the link was opened. A gap means that reports were dropped.
    pub sequence: u64,
    /// How many reports have been dropped so far because the program did not read them in time.
    pub dropped: u64,
}

/// Counters of a link since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkStats {
    /// Command frames written.
    pub written: u64,
    /// Reports handed to the program.
    pub read: u64,
    /// Reports dropped because the program did not read them in time; the oldest are dropped first.
    pub reports_dropped: u64,
    /// Writes that ended with an error.
    pub write_errors: u64,
    /// Reads that ended with an error.
    pub read_errors: u64,
    /// Incomplete reports that were skipped: empty or short transfers on USB.
    pub reports_short: u64,
    /// USB transfers that failed on the wire and were started again.
    pub transfers_failed: u64,
    /// Frames missing from the recording because the file could not be written fast enough or at all.
    pub record_dropped: u64,
    /// Faults injected by the keys `fault.*`.
    pub faults: fault::FaultStats,
    /// The board's own counters; `None` for a real board, which does not report them.
    pub board: Option<crate::engine::Counters>,
    /// Why the board's last change of state failed, known for a board in this process only; `None` if it did not fail
    /// or the link cannot know. [`StateFailure::explain`](crate::engine::StateFailure::explain) turns it into text.
    pub state_failure: Option<crate::engine::StateFailure>,
    /// The network of the board answers no more, so that the board makes no reports: the cable to the first slave is cut, its card or
    /// its chip is gone. Known for a board in this process only.
    pub network_down: bool,
}

/// A way to exchange frames with one ECM-SK board.
///
/// Frames are passed on whole and unchanged. Reading, writing and closing may happen in three different threads. Every
/// wait ends: by its time limit, by the loss of the board, or by [`Link::close`].
pub trait Link: Send + Sync {
    /// Name, slot size, clock and default limits of the link.
    fn info(&self) -> LinkInfo;

    /// What the server of the board knows of the slaves behind it; `None` if nothing is known. The board itself is not
    /// asked.
    fn network(&self) -> Option<KnownNetwork> {
        None
    }

    /// Hands a command frame to the board and returns when that happened.
    ///
    /// # Errors
    /// The board has not taken the frame: [`LinkError::Timeout`], [`LinkError::Lost`], [`LinkError::Closed`],
    /// [`LinkError::Cancelled`], [`LinkError::WrongSlot`], [`LinkError::Io`]. Only after [`LinkError::Unsure`], which
    /// occurs on a network, it may have taken it or not.
    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError>;

    /// Stores the oldest unread report in `out`; without one, `out` is left as it is.
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

    /// Ends at once the calls that are now waiting in one direction; they fail with [`LinkError::Cancelled`]. Later
    /// calls are not affected.
    fn cancel(&self, dir: Dir);

    /// Ends every wait and releases the board. A second call does nothing.
    fn close(&self);

    /// Closes the link of a program that ends without having closed it properly, for example by a crash. In contrast to
    /// [`Link::close`], the server of a board on the network then brings the axes that the program has moved to a
    /// standstill (`ecmsk serve tcp`), as it does when a program is killed. A recording is completed in either case.
    fn vanish(&self) {
        self.close();
    }

    /// Whether the board is still connected. Nothing is read or written, and the call does not wait.
    ///
    /// # Errors
    /// [`LinkError::Lost`] once the board is gone, [`LinkError::Closed`] after [`Link::close`].
    fn check(&self) -> Result<(), LinkError>;

    /// The counters since the link was opened.
    fn stats(&self) -> LinkStats;
}

/// The longest time that one call of [`Link::pass`] advances: a day. \[OURS] Simulating a day takes minutes of
/// computing; larger values, up to the 2^63 ns that the type can hold, can only be a mistake.
pub const PASS_MAX: Duration = Duration::from_secs(24 * 60 * 60);

/// Returns an error for a time longer than [`PASS_MAX`].
#[cfg_attr(
    not(any(feature = "sim", feature = "tcp")),
    allow(dead_code, reason = "no link of virtual time is in the build")
)]
pub(crate) fn check_pass(time: Duration) -> Result<(), LinkError> {
    if time <= PASS_MAX {
        return Ok(());
    }
    Err(LinkError::Io {
        what: format!("let {} of the board's time pass", Span(time)),
        message: format!("one call lets at most {} pass; call it several times", Span(PASS_MAX)),
    })
}

/// How far a failed attempt to open a board advances its virtual clock \[OURS], so that a program that opens the board
/// again and again after SW_RESET sees it start up.
pub(crate) const FAILED_OPEN: Duration = Duration::from_millis(50);

/// How [`open`] decides whether a simulated board that this process already has is used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// A board is found again by the same `name=`. A link without a name gets a board of its own, which ends with the
    /// link.
    ByName,
    /// A board is found again by the same `name=` or, without a name, by the same options. The C library does this, so
    /// that a program that closes and opens its link again finds its board as it left it.
    ByUri,
}

/// Opens the link of that URI.
///
/// ```
/// use ecmsk::link::{self, Share, Wait};
/// use ecmsk::sk::{Frame, MasterResponse, MasterState, SlotSize, StateByte};
///
/// let board = link::open("sim:?slaves=drive*2&clock=virtual", Share::ByName)?;
/// let mut report = Frame::new();
/// board.read(&mut report, Wait::Forever)?;
/// let answer = MasterResponse::decode(&report.slot(SlotSize::Bytes12, 0));
/// assert_eq!(answer.state, StateByte::reached(MasterState::PreOp));
/// # Ok::<(), ecmsk::link::LinkError>(())
/// ```
///
/// # Errors
/// [`LinkError::Uri`], [`LinkError::Unsupported`], [`LinkError::NoBoard`], [`LinkError::InUse`], [`LinkError::Io`].
pub fn open(uri: &str, share: Share) -> Result<Arc<dyn Link>, LinkError> {
    open_with(uri, share, false)
}

/// As [`open`], for callers that do not need an exact [`LinkStats::reports_dropped`]. On Windows a board on USB takes
/// frames faster while its reports are not read, and reports that are dropped then are not counted. A link with a
/// recording behaves as with [`open`].
///
/// # Errors
/// Those of [`open`].
pub fn open_uncounted(uri: &str, share: Share) -> Result<Arc<dyn Link>, LinkError> {
    open_with(uri, share, true)
}

fn open_with(uri: &str, share: Share, uncounted: bool) -> Result<Arc<dyn Link>, LinkError> {
    let uri = uri::LinkUri::parse(uri)?;
    let options = options::CommonOptions::from_uri(&uri)?;
    let mut link = connect(&uri, &options, share, uncounted && options.record.is_none())?;
    if options.fault.any() {
        link = Arc::new(fault::FaultLink::new(link, options.fault));
    }
    // The recording wraps the fault injection, so it holds what the program has seen.
    let Some(path) = &options.record else { return Ok(link) };
    let info = link.info();
    let meta = RecordMeta::now(&info, info.opened_at);
    Ok(Arc::new(record::RecordLink::new(link, path, &meta)?))
}

/// The simulated board of a `sim:` or `xf-sim:` link without a link around it. It has just been switched on, and its time advances
/// only when the caller advances it. Of the URI, only the keys that describe the board and its network have an effect.
///
/// # Errors
/// [`LinkError::Uri`], [`LinkError::Script`], [`LinkError::ManufacturerObjects`], [`LinkError::NoBoard`].
#[cfg(feature = "sim")]
pub fn model(uri: &uri::LinkUri) -> Result<crate::engine::Board, LinkError> {
    sim::model(uri)
}

#[cfg_attr(
    not(all(feature = "sim", feature = "usb")),
    allow(unused_variables, reason = "some of them concern links that are not in the build")
)]
fn connect(
    uri: &uri::LinkUri,
    options: &options::CommonOptions,
    share: Share,
    uncounted: bool,
) -> Result<Arc<dyn Link>, LinkError> {
    match uri.scheme() {
        #[cfg(feature = "sim")]
        keys::Scheme::Sim | keys::Scheme::XfSim => Ok(Arc::new(sim::open(uri, options, share)?)),
        #[cfg(all(feature = "spi", target_os = "linux"))]
        keys::Scheme::Spi => spi::open(uri, options),
        #[cfg(all(feature = "tcp", any(unix, windows)))]
        keys::Scheme::Tcp => tcp::open(uri, options),
        #[cfg(all(feature = "usb", any(unix, windows)))]
        keys::Scheme::Usb => usb::open(uri, options, uncounted),
        #[cfg(any(all(feature = "spi", target_os = "linux"), all(feature = "usb", unix)))]
        keys::Scheme::XfSpi | keys::Scheme::XfUsb => Ok(Arc::new(chip::board::open(uri)?)),
        #[cfg(all(feature = "nic", target_os = "linux"))]
        keys::Scheme::Nic => Ok(Arc::new(nic::open(uri, options)?)),
        #[allow(unreachable_patterns, reason = "a build may have every link")]
        other => Err(LinkError::Unsupported { scheme: other.name().into(), hint: other.instead() }),
    }
}
