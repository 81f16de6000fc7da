//! Stopping the axes of a program that has ended without closing its board. A server does this, since it has seen the
//! program's frames. `watch.rs` derives the state of the network from frames and reports, `seen.rs` that of one slave.

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
    /// All axes are stationary. `discarded`: how many FIFO entries were discarded for that.
    Stand { discarded: u16 },
    /// The server has not seen the configuration of the network, so it does not know the axes; moving ones go on.
    /// `discarded`: the number of entries that waited for a threshold and were discarded.
    Unknown { discarded: u16 },
}

impl Ecm {
    /// As [`Ecm::adopt`], for a network that another program has run until now. `watch` has followed the frames of that program
    /// and supplies its configuration and its last commands, so that closing can bring its axes to a standstill. If `watch` has
    /// seen no SET_AXIS, the slaves are not known and none is adopted; that is no error.
    ///
    /// # Errors
    /// As [`Ecm::adopt`].
    pub fn take_over(&self, watch: &Watch) -> Result<(), EcmError> {
        let Some(config) = watch.config() else { return Ok(()) };
        self.adopt(&config)?;
        let mut session = self.exchange.lock()?;
        for (slave, seen) in (1..=config.slaves.len() as u8).zip(&watch.slaves) {
            session.targets.assume(slave, seen.last);
        }
        Ok(())
    }

    /// Takes over the network of a program that has ended, as far as the program's frames show it, and reads a report
    /// that was made after its last frame. `watch` returns the state from all frames and reports so far. If this fails,
    /// nothing was sent, and the state of the axes is unknown.
    pub(crate) fn see_what_is_left(&self, watch: &dyn Fn() -> Watch) -> Result<(), EcmError> {
        self.take_over(&watch())?;
        self.next_of_now()
    }

    /// Stops the axes that an ended program has left moving, within the time limit of [`Ecm::close`]; call it after
    /// [`see_what_is_left`](Self::see_what_is_left). If `off` is set the axes are switched off, too.
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

    /// Waits for a report that is made after this call began. Earlier reports do not show the effect of the ended
    /// program's last frames.
    fn next_of_now(&self) -> Result<(), EcmError> {
        let limit = self.exchange.options.read_limit;
        if !self.exchange.info.virtual_time {
            // No earlier report is waiting, since the server has passed them to its clients. The board may have been
            // making the first new report when the program's last frame arrived, so the second one is awaited.
            self.next_cycle(limit)?;
            return self.next_cycle(limit).map(drop);
        }
        let now = self.exchange.clock();
        let is_old = |at: Stamp| Duration::from_nanos(at.0) < now;
        while is_old(self.next_cycle(limit)?.meta.at) {}
        // A report made at this very moment may not show the ended program's last frames yet, so one more is awaited.
        self.next_cycle(limit).map(drop)
    }
}
