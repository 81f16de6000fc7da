//! How a host talks to one ECM: the seam [`Link`], the URI that names one, and the links and wrappers there are.

#[cfg(feature = "sim")]
mod boards;
pub mod config;
pub mod engine;
mod episodes;
pub mod fault;
mod fraction;
pub mod keys;
mod layer;
#[cfg(feature = "sim")]
pub mod makers;
mod network;
pub mod options;
pub mod record;
mod rejections;
#[cfg(feature = "sim")]
pub mod script;
#[cfg(feature = "sim")]
mod sim;
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

use std::borrow::Cow;
use std::sync::Arc;
use std::time::Duration;

#[cfg(feature = "sim")]
#[doc(hidden)]
pub use boards::forget_parked;
pub use fraction::Fraction;
pub use layer::Layer;
pub use network::KnownNetwork;

use crate::recording::RecordMeta;
pub use crate::sk::Dir;
use crate::sk::{Frame, SlotSize};
use crate::span::Span;

/// How long a call may wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// Until it is done, the board is lost or the link is closed.
    Forever,
    /// At most that long.
    For(Duration),
    /// Not at all.
    Now,
}

/// What a link says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkInfo {
    /// The URI in its normal form.
    pub name: String,
    /// The board's slot size, if the link knows it.
    pub slot: Option<SlotSize>,
    /// Whether time is virtual: it passes by calls only, and no wait takes real time.
    pub virtual_time: bool,
    /// When the link was opened, on its own clock.
    pub opened_at: Stamp,
    /// Default limit of a read, from `read_timeout_ms`.
    pub read_wait: Wait,
    /// Default limit of a write, from `write_timeout_ms`.
    pub write_wait: Wait,
}

/// When a command frame was handed over: nanoseconds on the link's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp(pub u64);

/// What is known of a report besides its bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadMeta {
    /// When it was made, on the link's clock; of a real board when the link took it: on SPI the begin of the exchange, on
    /// USB the moment that the system handed it over, which between two reads is up to 1 ms after it came (WIRE-94).
    pub at: Stamp,
    /// Its number since the link was opened, from 0; a gap means reports that were dropped.
    pub sequence: u64,
    /// Reports dropped so far because nobody read them.
    pub dropped: u64,
}

/// Counters of a link since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkStats {
    /// Frames written.
    pub written: u64,
    /// Reports handed out.
    pub read: u64,
    /// Reports dropped because nobody read them (the oldest goes first).
    pub reports_dropped: u64,
    /// Writes that ended with an error.
    pub write_errors: u64,
    /// Reads that ended with an error.
    pub read_errors: u64,
    /// Reports that were no whole ones and were skipped: empty or short transfers on USB.
    pub reports_short: u64,
    /// Transfers that failed on the wire, and were begun again.
    pub transfers_failed: u64,
    /// Frames that a recording could not take.
    pub record_dropped: u64,
    /// Faults that were put in on the way, `fault.*`.
    pub faults: fault::FaultStats,
    /// The board's own counters, where the link can see them (the engine's links).
    pub board: Option<crate::engine::Counters>,
    /// Why the board's state has failed, where the link can see it (the engine's links); `None`: it has not, or nobody
    /// knows. [`StateFailure::explain`](crate::engine::StateFailure::explain) makes the text.
    pub state_failure: Option<crate::engine::StateFailure>,
}

/// Why a link call failed. Every variant says what happened, to what, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// The URI or one of its keys is wrong.
    #[error(transparent)]
    Uri(#[from] uri::UriError),
    /// The file that names the link cannot be used.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// The objects of a simulated slave's maker are wrong.
    #[cfg(feature = "sim")]
    #[error(transparent)]
    Makers(#[from] makers::MakersError),
    /// The script is wrong.
    #[cfg(feature = "sim")]
    #[error(transparent)]
    Script(#[from] script::ScriptError),
    /// The link is not part of this build, or not yet of any.
    #[error("link `{scheme}:` is not in this build; {hint}")]
    Unsupported {
        /// Scheme.
        scheme: String,
        /// What to do.
        hint: String,
    },
    /// No board answers.
    #[error("no board at `{name}`: {reason}")]
    NoBoard {
        /// Which link.
        name: String,
        /// What was found instead and what to do.
        reason: String,
    },
    /// The link was told another slot size than the board's reports have.
    #[error(
        "`{name}` says slot={}, but slots of the board's reports have {} bytes (CONFIG2 {}); write slot={} into the link, \
         and use a program for slots of that size",
        given.bytes(), found.bytes(), config2(*found), found.bytes()
    )]
    WrongSlot {
        /// Which link.
        name: String,
        /// What the link says.
        given: SlotSize,
        /// What the reports have.
        found: SlotSize,
    },
    /// Somebody else has it open.
    #[error("`{name}` is in use{by}; close it there, or {instead}")]
    InUse {
        /// Which link.
        name: String,
        /// By whom, ` by ...`, where known.
        by: String,
        /// What else can be done.
        instead: &'static str,
    },
    /// The wait's limit has passed.
    #[error("{dir} {}: {what}", how_long(*waited))]
    Timeout {
        /// Which call.
        dir: Dir,
        /// The limit.
        waited: Duration,
        /// What was waited for.
        what: &'static str,
    },
    /// No report will come by itself: on a virtual clock nothing else can happen while one waits.
    #[error(
        "the board has been silent since {} of its time ({cycles} cycles); plug the cable to the first slave, then read again",
        Span(Duration::from_nanos(*.since_ns))
    )]
    Silent {
        /// When the last report was made.
        since_ns: u64,
        /// Cycles without one.
        cycles: u64,
    },
    /// The board went away (unplugged, SW_RESET).
    #[error("the board at `{name}` is gone: {reason}; open it again")]
    Lost {
        /// Which link.
        name: String,
        /// Why.
        reason: Cow<'static, str>,
    },
    /// The connection to the board's server ended while a frame was on its way.
    #[error(
        "the connection to `{name}` ended while a frame was on its way ({reason}): whether the board took it is not \
         known; open it again and look at the board before you send anything twice"
    )]
    Unsure {
        /// Which link.
        name: String,
        /// How it ended.
        reason: String,
    },
    /// The link was closed, by this or another thread.
    #[error("the link is closed; open it first")]
    Closed,
    /// The call was ended by [`Link::cancel`].
    #[error("the {dir} was cancelled")]
    Cancelled {
        /// Which call.
        dir: Dir,
    },
    /// The operating system said no.
    #[error("{what}: {message}")]
    Io {
        /// What was tried, on what.
        what: String,
        /// The system's words.
        message: String,
    },
}

const fn config2(size: SlotSize) -> &'static str {
    match size {
        SlotSize::Bytes12 => "low",
        SlotSize::Bytes16 => "high",
    }
}

fn how_long(waited: Duration) -> String {
    if waited.is_zero() { "did not wait".to_owned() } else { format!("timed out after {}", Span(waited)) }
}

/// A way to exchange frames with one ECM.
///
/// Frames move whole and untouched. Reader, writer and closer may be three threads; every wait ends by its limit, by
/// loss of the board or by [`Link::close`].
pub trait Link: Send + Sync {
    /// What the link is.
    fn info(&self) -> LinkInfo;

    /// What whoever serves the link knows of the network; `None`: nothing is known. Nothing is asked of the board.
    fn network(&self) -> Option<KnownNetwork> {
        None
    }

    /// Hands a command frame to the board.
    ///
    /// # Errors
    /// [`LinkError::Timeout`], [`LinkError::Lost`], [`LinkError::Closed`], [`LinkError::Cancelled`], [`LinkError::Io`];
    /// [`LinkError::WrongSlot`]; the frame was not taken then. [`LinkError::Unsure`] on a network: nobody knows.
    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError>;

    /// The oldest report not yet read; `out` is left alone if there is none.
    ///
    /// # Errors
    /// As [`Link::write`], and [`LinkError::Silent`] on a virtual clock.
    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError>;

    /// Lets that much time pass on a link of virtual time ([`LinkInfo::virtual_time`]) and says what time it is then:
    /// reports made meanwhile are kept or dropped as if nobody had read. A link on the real clock does nothing, its time
    /// passes by itself, and says `None`. One call lets [`PASS_MAX`] pass at most, in steps, so that [`Link::close`] of another
    /// thread ends it.
    ///
    /// # Errors
    /// [`LinkError::Lost`], [`LinkError::Closed`]; [`LinkError::Io`] for more than [`PASS_MAX`], nothing has passed then.
    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        let _ = time;
        Ok(None)
    }

    /// Ends the waits under way in one direction, at once; later calls are not touched.
    fn cancel(&self, dir: Dir);

    /// Ends every wait and gives the board back. Closing twice is harmless.
    fn close(&self);

    /// As [`Link::close`], for a program that ends without having closed its link: it has vanished. The server of a board
    /// on the network brings to a standstill what it moves (`ecmsk serve tcp`), as it does when a program is killed; a
    /// recording is complete all the same.
    fn vanish(&self) {
        self.close();
    }

    /// Whether the board is still there. Nothing is read, written or waited for.
    ///
    /// # Errors
    /// [`LinkError::Lost`] once the board is gone, [`LinkError::Closed`] after [`Link::close`].
    fn check(&self) -> Result<(), LinkError>;

    /// Counters since the link was opened.
    fn stats(&self) -> LinkStats;
}

/// What one call of [`Link::pass`] lets pass at most: a day. \[OURS] It takes minutes of computing; 2^63 ns would take
/// centuries, and nobody can have meant that.
pub const PASS_MAX: Duration = Duration::from_secs(24 * 60 * 60);

/// Refuses to let more than [`PASS_MAX`] pass.
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

/// LIB: what a failed open costs a board on virtual time \[OURS], so that a loop that opens again after SW_RESET ends.
pub(crate) const FAILED_OPEN: Duration = Duration::from_millis(50);

/// Which boards of this process a link finds again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// Those with the same `name=`: a link without a name is a board of its own, which ends with it.
    ByName,
    /// Those with the same name or, without one, with the same options: the library for applications, where a program
    /// that closes and opens again finds its board as it was.
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

/// As [`open`], for a caller to whom it does not matter how many reports nobody has read: on Windows a board on USB takes
/// frames faster while none is read, and [`LinkStats::reports_dropped`] then says less than were dropped. A link that
/// records does as ever.
///
/// # Errors
/// As [`open`].
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
    // The recording is around the faults: it holds what the program has seen.
    let Some(path) = &options.record else { return Ok(link) };
    let info = link.info();
    let meta = RecordMeta::now(&info, info.opened_at);
    Ok(Arc::new(record::RecordLink::new(link, path, &meta)?))
}

/// The board of a `sim:` link without the link: just switched on, on a time that passes by its caller alone. Of the link's
/// keys those count that say what the board and its network are.
///
/// # Errors
/// [`LinkError::Uri`], [`LinkError::Script`], [`LinkError::NoBoard`].
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
        keys::Scheme::Sim => Ok(Arc::new(sim::open(uri, options, share)?)),
        #[cfg(all(feature = "spi", target_os = "linux"))]
        keys::Scheme::Spi => spi::open(uri, options),
        #[cfg(all(feature = "tcp", any(unix, windows)))]
        keys::Scheme::Tcp => tcp::open(uri, options),
        #[cfg(all(feature = "usb", any(unix, windows)))]
        keys::Scheme::Usb => usb::open(uri, options, uncounted),
        #[cfg(not(target_os = "linux"))]
        keys::Scheme::Spi => Err(LinkError::Unsupported {
            scheme: keys::Scheme::Spi.name().into(),
            hint: "it is a link of Linux: serve the board by `ecmsk serve tcp` on the machine it is wired to, and name it \
                   here by tcp://HOST:PORT"
                .into(),
        }),
        #[allow(unreachable_patterns, reason = "a build may have every link")]
        other => Err(LinkError::Unsupported {
            scheme: other.name().into(),
            hint: "to run without a board use `sim:`, for example ECMSK_LINK='sim:?slaves=drive*2'; \
                   `ecmsk link help` lists the links there are"
                .into(),
        }),
    }
}
