//! The native Rust API: one ECM-SK over any link. Before it sends a command to the board, the API checks the state of
//! the network, the mode and alarms of the axis, the distance of a target from the actual position, and the room in the
//! FIFO.
//!
//! ```
//! use ecmsk::ecm::{Close, Config, Ecm};
//! use ecmsk::sk::MasterState;
//!
//! let ecm = Ecm::open("sim:?slaves=drive*2&clock=virtual")?;
//! ecm.configure(&Config::drives(2))?;
//! ecm.set_state(MasterState::Op)?;
//! ecm.servo_on(&[1, 2])?;
//!
//! let mut stream = ecm.stream(16)?;
//! let start = stream.snapshot()?.position(1).unwrap_or_default();
//! for n in 0..1000 {
//!     stream.csp(1, start + n * 10)?;
//!     stream.step()?;
//! }
//! assert_eq!(stream.finish()?.underruns, 0);
//! ecm.close(Close::ServoOff)?;
//! # Ok::<(), ecmsk::ecm::EcmError>(())
//! ```
//!
//! [`Ecm`] may be shared by threads: waiting calls release the board to each other after every report, and commands of
//! one thread travel in the frames of another thread's [`Stream`]. Every call has a timeout ([`Options`]). A lost board
//! stays lost ([`LinkError::Lost`]): the program decides whether to open another [`Ecm`] ([`Ecm::open_when_there`]).
//!
//! Positions are in counts, velocities in the drive's units and torques in 0.1 %, as in the frames; the [`Scale`] of an
//! axis converts positions. Timeouts are in board time on a link with virtual time, and in machine time on any other
//! link.
//!
//! # How to read the source
//!
//! In this order:
//!
//! 1. Values that a program passes and gets: `options.rs`, `config.rs`, `snapshot.rs`, `error.rs`, `failure.rs`;
//!    `network.rs` has the configuration in a form without heap allocations, for the other files.
//! 2. `exchange/`: sends frames and receives reports for all calls of all threads, and keeps the state of the board.
//! 3. The calls, one file for each subject: `machine.rs` opens the board of a machine file, `state.rs` configures the network
//!    and changes its state, `servo.rs` switches axes, `io.rs`, `sdo.rs`, `homing.rs`, and `board.rs` for the board itself.
//!    Each call sends a `Task` through the exchange and checks reports until it is done.
//! 4. `stream/`: targets for all axes in every cycle.
//! 5. `standstill/`: how moving axes are brought to a standstill when a stream ends or a board is closed.
//! 6. `takeover/`: how a server stops the axes of a program that has ended without closing its board.

mod board;
mod config;
mod error;
mod exchange;
mod failure;
mod homing;
mod io;
mod machine;
mod network;
mod options;
mod sdo;
mod servo;
mod snapshot;
mod standstill;
mod state;
mod stream;
mod takeover;

use std::sync::Arc;
use std::time::Duration;

pub use board::CrcSwitches;
pub use config::{Axis, Config, ConfigError, DEFAULT_GUARD_COUNTS, DEFAULT_STANDSTILL_COUNTS, Guard, Slave};
pub use error::{EcmError, Suspect};
pub use exchange::{News, Stats};
pub use failure::Failure;
pub use homing::{Homing, HomingPhase, HomingProgress};
pub use options::{CLOSE_LIMIT, Close, Options};
pub use sdo::SdoValue;
pub use snapshot::{SlaveView, Snapshot};
pub use standstill::HeldBack;
pub use stream::{Stream, StreamStats};
pub(crate) use takeover::Succeeded;
pub use takeover::Watch;

pub use crate::address::scale::{Scale, Scales, SoftLimits};

use self::exchange::{Exchange, Waited};
use crate::link::{Link, LinkError, LinkInfo, Share, Wait};
use crate::open;
use crate::sk::{Frame, SlotSize, StateByte};

/// The number of reports that are read at most to find the slot size. If none of them shows it, opening fails. \[OURS]
const PROBE_REPORTS: usize = 3;

/// A handle of an open board.
pub struct Ecm {
    exchange: Exchange,
    /// Whether the board was closed already, so that dropping the handle does not close it again.
    done: bool,
}

impl Ecm {
    /// Opens the board at a link URI and leaves it in its present state: nothing is sent, and a network in OP goes on
    /// running.
    ///
    /// # Errors
    /// [`EcmError::Link`] if the link cannot be opened, [`EcmError::SlotUnknown`] if neither the link nor a report shows the
    /// slot size, [`EcmError::NoReport`] if the board makes no report.
    pub fn open(uri: &str) -> Result<Self, EcmError> {
        Self::open_with(uri, Options::default())
    }

    /// As [`Ecm::open`], with timeouts and other settings.
    ///
    /// # Errors
    /// As [`Ecm::open`], and [`EcmError::Setting`] for an option with a value that is not allowed.
    pub fn open_with(uri: &str, options: Options) -> Result<Self, EcmError> {
        check(&options)?;
        Self::over(open::open(uri, Share::ByName)?, options)
    }

    /// Opens the board behind an open link. Closing the [`Ecm`] closes the link.
    ///
    /// # Errors
    /// As [`Ecm::open_with`].
    pub fn over(link: Arc<dyn Link>, options: Options) -> Result<Self, EcmError> {
        check(&options)?;
        let info = link.info();
        let size = match options.slot.or(info.slot) {
            Some(size) => size,
            None => probe(link.as_ref(), &info, &options)?,
        };
        let ecm = Self { exchange: Exchange::new(link, info, size, options), done: false };
        match ecm.next_cycle(options.read_limit) {
            Ok(_) => Ok(ecm),
            Err(error) => {
                ecm.exchange.shut(true);
                Err(error)
            }
        }
    }

    /// Sets a function that can end the waits of calls, for a program that a user may interrupt, or that closes the board
    /// from another thread. Calls that wait for reports call `is_due` at least every 100 ms, in their thread and without
    /// any lock, so it may use the board. If it returns `true`, the call ends with [`EcmError::Interrupted`]. Before
    /// that, [`Ecm::servo_on`] switches off the axes that it was switching on, and [`Ecm::home_all`] aborts the homing.
    /// These steps wait for reports, too, and must not be interrupted: so `is_due` has to return `true` once for each
    /// interruption, and `false` after that.
    ///
    /// The calls of a [`Stream`] do not call `is_due`: a step waits for some cycles only, and the end of a stream has to
    /// stop the axes.
    ///
    /// ```
    /// use std::sync::atomic::{AtomicBool, Ordering};
    /// use std::time::Duration;
    ///
    /// use ecmsk::ecm::{Ecm, EcmError};
    ///
    /// static PRESSED: AtomicBool = AtomicBool::new(false); // set by a handler of signals
    /// let ecm = Ecm::open("sim:?slaves=drive&clock=virtual")?.with_interrupt(|| PRESSED.swap(false, Ordering::Relaxed));
    /// PRESSED.store(true, Ordering::Relaxed);
    /// let error = ecm.sdo_read::<u32>(1, ecmsk::coe::ObjectAddress::new(0x1000, 0)).unwrap_err();
    /// assert_eq!(error, EcmError::Interrupted);
    /// # Ok::<(), EcmError>(())
    /// ```
    #[must_use]
    pub fn with_interrupt(mut self, is_due: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        self.exchange.interrupt = Some(Box::new(is_due));
        self
    }

    /// The slot size of the board: that of the options or of the link, or else the one found in reports.
    ///
    /// # Errors
    /// [`EcmError::Busy`] if another thread uses the board for too long, [`EcmError::Link`] once the board is closed.
    pub fn slot_size(&self) -> Result<SlotSize, EcmError> {
        Ok(self.exchange.lock()?.size)
    }

    /// The name and the properties of the link, for example whether it has virtual time.
    pub const fn link_info(&self) -> &LinkInfo {
        &self.exchange.info
    }

    /// The newest report, without waiting for another one.
    ///
    /// # Errors
    /// [`EcmError::Link`] if the link has failed or is closed, [`EcmError::Busy`] if another thread uses the board for too
    /// long.
    pub fn snapshot(&self) -> Result<Snapshot, EcmError> {
        Ok(self.exchange.lock_newest()?.snapshot())
    }

    /// Waits for the next report. If it is called often enough, it returns one report of each cycle.
    ///
    /// # Errors
    /// [`EcmError::NoReport`] if no report comes within `limit` or the board is silent, [`EcmError::Timeout`] if a queued
    /// command cannot be written in time, [`EcmError::Link`] if the link fails, [`EcmError::Busy`] if another thread uses the
    /// board for too long.
    pub fn next_cycle(&self, limit: Duration) -> Result<Snapshot, EcmError> {
        let limit = limit.min(exchange::LIMIT_MAX);
        let began = self.exchange.now();
        let mut waited = Waited::since(began);
        let mut session = self.exchange.lock()?;
        let before = session.stats.reports;
        loop {
            let now = self.exchange.now();
            let left = limit.saturating_sub(waited.until(now, session.network.cycle()));
            self.exchange.round(&mut session, now + left)?;
            if session.stats.reports > before {
                return Ok(session.snapshot());
            }
            self.exchange.check_silence(&session, began, "the next cycle")?;
            let waited = waited.until(self.exchange.now(), session.network.cycle());
            if waited >= limit {
                return Err(self.exchange.no_report("the next cycle", waited, session.stats.bad_crc));
            }
            self.exchange.pause(&mut session, || {})?;
        }
    }

    /// The state of the network in the newest report.
    ///
    /// # Errors
    /// As [`Ecm::snapshot`].
    pub fn state(&self) -> Result<StateByte, EcmError> {
        Ok(self.snapshot()?.state())
    }

    /// Counters of frames, reports and failures since the board was opened.
    ///
    /// # Errors
    /// [`EcmError::Busy`] if another thread uses the board for too long, [`EcmError::Link`] once the board is closed.
    pub fn stats(&self) -> Result<Stats, EcmError> {
        Ok(self.exchange.lock()?.stats)
    }

    /// Takes the events for a log that have occurred since the last call: the newest 64 at most, the oldest first.
    ///
    /// # Errors
    /// As [`Ecm::stats`].
    pub fn take_news(&self) -> Result<Vec<News>, EcmError> {
        Ok(self.exchange.lock()?.news.take())
    }
}

/// Compiles and runs the programs in docs/GUIDE.md as documentation tests of this item.
#[cfg(all(doctest, feature = "sim"))]
#[doc = include_str!("../../docs/GUIDE.md")]
struct Guide;

/// Finds the slot size from reports, if the link does not know it: the size with which the CRC of a report is right.
///
/// # Errors
/// [`EcmError::SlotUnknown`]: no report has a right CRC, for example because the board fills in none.
/// [`EcmError::NoReport`], [`EcmError::Link`].
fn probe(link: &dyn Link, info: &LinkInfo, options: &Options) -> Result<SlotSize, EcmError> {
    let mut report = Frame::new();
    for _ in 0..PROBE_REPORTS {
        match link.read(&mut report, Wait::For(options.read_limit.min(exchange::LIMIT_MAX))) {
            Ok(_) => {}
            Err(LinkError::Timeout { waited, .. }) => {
                let network_down = link.stats().network_down;
                return Err(EcmError::NoReport { what: "opening", waited, bad_crc: 0, network_down });
            }
            Err(error) => return Err(error.into()),
        }
        if let Some(size) = report.size_by_crc() {
            return Ok(size);
        }
    }
    Err(EcmError::SlotUnknown { name: info.name.clone() })
}

fn check(options: &Options) -> Result<(), EcmError> {
    if options.ramp > Options::MAX_RAMP {
        let found = format!("{:?}", options.ramp);
        return Err(EcmError::Setting { what: "ramp", found, allowed: "at most 1.5 s, closing ends within 2 s" });
    }
    Ok(())
}
