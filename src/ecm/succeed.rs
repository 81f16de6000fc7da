//! Stopping the axes of a program that is gone, for whoever serves its board and has seen its frames pass.

use std::time::Duration;

use super::leftover::{self, Left};
use super::watch::Watch;
use super::{Ecm, EcmError};
use crate::link::Stamp;
use crate::sk::MasterState;

/// What became of the axes of a program that is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Succeeded {
    /// The network is not in OP: nothing is moved by it.
    NotInOp,
    /// They stand; so many entries of the FIFO were dropped.
    Stand { dropped: u16 },
    /// Nobody has seen how the network was configured: what moves is not known, and goes on. Entries that waited behind a
    /// threshold were dropped.
    Unknown { dropped: u16 },
}

impl Ecm {
    /// Sees what a program that is gone has left. `watch` gives what its frames and the reports said, up to the newest report.
    /// After an error nothing is known, and nothing was sent.
    pub(crate) fn see_what_is_left(&self, watch: &dyn Fn() -> Watch) -> Result<(), EcmError> {
        self.take_over(&watch())?;
        self.next_of_now()
    }

    /// Brings to a standstill what a program that is gone has left moving, within the limits of [`Ecm::close`], once it was
    /// [seen](Self::see_what_is_left).
    pub(crate) fn succeed(&self, watch: &Watch, off: bool) -> Result<Succeeded, EcmError> {
        if watch.state() != Some(MasterState::Op) {
            return Ok(Succeeded::NotInOp);
        }
        let mut left = Left {
            is_foreign: true,
            homing: watch.homing().fold(0, |slaves, slave| slaves | 1 << slave),
            has_threshold: watch.has_threshold(),
            ..Left::default()
        };
        if watch.config().is_none() {
            let deadline = self.core.now() + super::CLOSE_LIMIT;
            let mut session = self.core.lock()?;
            if let Err(error) = leftover::drop_held(self, &mut session, deadline, &mut left) {
                let _ = leftover::cut_short(self, &mut session, &left);
                return Err(error);
            }
            return Ok(Succeeded::Unknown { dropped: left.dropped });
        }
        self.take_over(watch)?;
        self.rest(off, &mut left)?;
        Ok(Succeeded::Stand { dropped: left.dropped })
    }

    /// Reads a report that was made from now on: older ones do not show the last frames of the program that is gone.
    fn next_of_now(&self) -> Result<(), EcmError> {
        let limit = self.core.options.read_limit;
        if !self.core.info.virtual_time {
            // Those of before have gone to the clients. A frame may have arrived while the first one was made.
            self.next_cycle(limit)?;
            return self.next_cycle(limit).map(drop);
        }
        let now = self.core.now();
        let is_old = |at: Stamp| Duration::from_nanos(at.0) < now;
        while is_old(self.next_cycle(limit)?.meta.at) {}
        // One of this very moment may have been made before the last frames arrived.
        self.next_cycle(limit).map(drop)
    }
}
