//! The native Rust API: one ECM-SK over any link, made so that the wrong thing is hard to do.
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
//! [`Ecm`] may be shared by threads: calls take turns report by report, and a command of one thread rides in the frames
//! of another thread's [`Stream`]. Every call has a limit ([`Options`]). A board that is lost stays lost
//! ([`LinkError::Lost`]): opening another [`Ecm`] is the program's decision ([`Ecm::open_when_there`]).
//!
//! Positions, velocities and torques are those of the wire, counts and 0.1 %; a [`Scale`] of an axis converts positions.
//! On a link of virtual time limits are the board's time; on any other the machine's.

mod aim;
mod board;
mod brake;
mod close;
mod config;
mod core;
mod credit;
mod error;
mod failure;
mod homing;
mod io;
mod leftover;
mod marks;
mod options;
mod ramp;
mod scale;
mod sdo;
mod second;
mod servo;
mod session;
mod snapshot;
mod state;
mod still;
mod stream;
#[cfg_attr(not(feature = "serve"), allow(dead_code, reason = "a server stops the axes of others"))]
mod succeed;
mod targets;
mod watch;

use std::sync::Arc;
use std::time::Duration;

pub use board::CrcSwitches;
pub use config::{Axis, Config, ConfigError, DEFAULT_GUARD_COUNTS, DEFAULT_STANDSTILL_COUNTS, Guard, Slave};
pub use error::{EcmError, Suspect};
pub use failure::Failure;
pub use homing::{Homing, HomingPhase, HomingProgress};
pub use options::{CLOSE_LIMIT, Close, Options};
pub use scale::Scale;
pub use sdo::SdoValue;
pub use session::{News, Stats};
pub use snapshot::{SlaveView, Snapshot};
pub use stream::{Stream, StreamStats};
#[cfg_attr(not(feature = "serve"), allow(unused_imports, reason = "a server stops the axes of others"))]
pub(crate) use succeed::Succeeded;
pub use watch::Watch;

use self::core::Core;
use crate::link::{self, Link, LinkError, LinkInfo, Share, Wait};
use crate::sk::{Frame, SlotSize, StateByte};

/// Reports that are looked at to find the slot size out. \[OURS]
const PROBE_REPORTS: usize = 3;

/// One board.
pub struct Ecm {
    core: Core,
    done: bool,
}

impl Ecm {
    /// Opens the board of a link's URI, as it is: nothing is sent, a network in OP goes on.
    ///
    /// # Errors
    /// [`EcmError::Link`], [`EcmError::SlotUnknown`], [`EcmError::NoReport`].
    pub fn open(uri: &str) -> Result<Self, EcmError> {
        Self::open_with(uri, Options::default())
    }

    /// As [`Ecm::open`], with settings.
    ///
    /// # Errors
    /// As [`Ecm::open`], and [`EcmError::Setting`].
    pub fn open_with(uri: &str, options: Options) -> Result<Self, EcmError> {
        check(&options)?;
        Self::over(link::open(uri, Share::ByName)?, options)
    }

    /// The board behind a link that is open; closing the [`Ecm`] closes the link.
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
        let ecm = Self { core: Core::new(link, info, size, options), done: false };
        match ecm.next_cycle(options.read_limit) {
            Ok(_) => Ok(ecm),
            Err(error) => {
                ecm.core.shut(true);
                Err(error)
            }
        }
    }

    /// The board's slot size, found or given.
    ///
    /// # Errors
    /// [`EcmError::Busy`], [`EcmError::Link`] once it is closed.
    pub fn slot_size(&self) -> Result<SlotSize, EcmError> {
        Ok(self.core.lock()?.size)
    }

    /// What the link says of itself.
    pub const fn link_info(&self) -> &LinkInfo {
        &self.core.info
    }

    /// The newest report there is, without waiting for another one.
    ///
    /// # Errors
    /// [`EcmError::Link`], [`EcmError::Busy`].
    pub fn snapshot(&self) -> Result<Snapshot, EcmError> {
        let mut session = self.core.lock()?;
        self.core.catch_up(&mut session)?;
        Ok(session.snapshot())
    }

    /// The next report: one of each cycle if it is called often enough.
    ///
    /// # Errors
    /// [`EcmError::NoReport`], [`EcmError::Timeout`], [`EcmError::Link`], [`EcmError::Busy`].
    pub fn next_cycle(&self, limit: Duration) -> Result<Snapshot, EcmError> {
        let limit = limit.min(core::LONGEST);
        let deadline = self.core.now() + limit;
        let began = self.core.now();
        let mut session = self.core.lock()?;
        let before = session.stats.reports;
        loop {
            self.core.round(&mut session, deadline)?;
            if session.stats.reports > before {
                return Ok(session.snapshot());
            }
            self.core.check_silence(&session, began, "the next cycle")?;
            let waited = self.core.now().saturating_sub(began);
            if waited >= limit {
                return Err(EcmError::NoReport { what: "the next cycle", waited, bad_crc: session.stats.bad_crc });
            }
            self.core.pause(&mut session, || {})?;
        }
    }

    /// The network's state, by the newest report.
    ///
    /// # Errors
    /// As [`Ecm::snapshot`].
    pub fn state(&self) -> Result<StateByte, EcmError> {
        Ok(self.snapshot()?.state())
    }

    /// Counts since the board was opened.
    ///
    /// # Errors
    /// [`EcmError::Busy`], [`EcmError::Link`] once it is closed.
    pub fn stats(&self) -> Result<Stats, EcmError> {
        Ok(self.core.lock()?.stats)
    }

    /// What is worth a line in a log, since the last call; the newest 64.
    ///
    /// # Errors
    /// As [`Ecm::stats`].
    pub fn take_news(&self) -> Result<Vec<News>, EcmError> {
        Ok(self.core.lock()?.news())
    }
}

/// docs/GUIDE.md: its programs run as tests.
#[cfg(all(doctest, feature = "sim"))]
#[doc = include_str!("../docs/GUIDE.md")]
struct Guide;

/// Which slot size the reports of a link have that does not know: that whose CRC is right (it has to be switched on).
fn probe(link: &dyn Link, info: &LinkInfo, options: &Options) -> Result<SlotSize, EcmError> {
    let mut report = Frame::new();
    for _ in 0..PROBE_REPORTS {
        match link.read(&mut report, Wait::For(options.read_limit.min(core::LONGEST))) {
            Ok(_) => {}
            Err(LinkError::Timeout { waited, .. }) => {
                return Err(EcmError::NoReport { what: "opening", waited, bad_crc: 0 });
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
