//! Stopping the axes of a program that has ended without closing its board. A server through which the program's frames
//! have passed does this: `watch.rs` has the state of the network that frames and reports show, `seen.rs` that of one
//! slave.

mod seen;
mod watch;

use std::time::Duration;

pub use watch::Watch;

use super::standstill::{self, LeftBehind};
use super::{Ecm, EcmError};
use crate::link::Stamp;
use crate::sk::MasterState;

/// The result of stopping the axes of a program that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Succeeded {
    /// The network is not in OP, so that no axis follows commands.
    NotInOp,
    /// The axes are stationary. `discarded`: the number of FIFO entries that were discarded.
    Stand { discarded: u16 },
    /// The configuration of the network was not seen: moving axes are unknown and go on. `discarded`: the number of
    /// entries that waited for a threshold and were discarded.
    Unknown { discarded: u16 },
}

impl Ecm {
    /// As [`Ecm::adopt`], for a network that another program has run until now. The last commands of that program are
    /// known from `watch`, so that closing can bring its axes to a standstill.
    ///
    /// # Errors
    /// As [`Ecm::adopt`]. An unknown network is adopted as one without slaves.
    pub fn take_over(&self, watch: &Watch) -> Result<(), EcmError> {
        let Some(config) = watch.config() else { return Ok(()) };
        self.adopt(&config)?;
        let mut session = self.exchange.lock()?;
        for (slave, seen) in (1..=config.slaves.len() as u8).zip(&watch.slaves) {
            session.targets.assume(slave, seen.last);
        }
        Ok(())
    }

    /// Takes over the network of a program that has ended, as far as its frames show it, and reads a report that was
    /// made after its last frame. `watch` returns what frames and reports have shown, up to the newest report. After an
    /// error nothing is known, and nothing was sent.
    pub(crate) fn see_what_is_left(&self, watch: &dyn Fn() -> Watch) -> Result<(), EcmError> {
        self.take_over(&watch())?;
        self.next_of_now()
    }

    /// Stops the axes that an ended program has left moving, within the time limit of [`Ecm::close`]; call it after
    /// [`see_what_is_left`](Self::see_what_is_left). With `off` the axes are switched off, too.
    pub(crate) fn succeed(&self, watch: &Watch, off: bool) -> Result<Succeeded, EcmError> {
        if watch.state() != Some(MasterState::Op) {
            return Ok(Succeeded::NotInOp);
        }
        let mut left = LeftBehind {
            is_foreign: true,
            homing: watch.homing().collect(),
            has_threshold: watch.has_threshold(),
            ..LeftBehind::default()
        };
        if watch.config().is_none() {
            let deadline = self.exchange.now() + super::CLOSE_LIMIT;
            let mut session = self.exchange.lock()?;
            standstill::discard_held(self, &mut session, deadline, &mut left)?;
            return Ok(Succeeded::Unknown { discarded: left.discarded });
        }
        self.take_over(watch)?;
        self.bring_to_rest(off, &mut left)?;
        Ok(Succeeded::Stand { discarded: left.discarded })
    }

    /// Reads a report that is made from now on: older reports do not show the last frames of the ended program.
    fn next_of_now(&self) -> Result<(), EcmError> {
        let limit = self.exchange.options.read_limit;
        if !self.exchange.info.virtual_time {
            // The clients have read the older reports. A frame may have arrived while the first new report was made.
            self.next_cycle(limit)?;
            return self.next_cycle(limit).map(drop);
        }
        let now = self.exchange.clock();
        let is_old = |at: Stamp| Duration::from_nanos(at.0) < now;
        while is_old(self.next_cycle(limit)?.meta.at) {}
        // A report made at this very moment may not include the last frames.
        self.next_cycle(limit).map(drop)
    }
}
