//! Stopping the axes of a program that has ended without closing its board. A server does this that the program's frames have
//! passed through: `watch.rs` keeps what they and the reports tell, `seen.rs` what they tell of one slave.

mod seen;
mod watch;

use std::time::Duration;

pub use watch::Watch;

use super::standstill::{self, LeftBehind};
use super::{Ecm, EcmError};
use crate::link::Stamp;
use crate::sk::MasterState;

/// What became of the axes of a program that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Succeeded {
    /// The network is not in OP, where no axis moves by commands.
    NotInOp,
    /// The axes stand. So many entries of the FIFO were discarded.
    Stand { discarded: u16 },
    /// It was not seen how the network was configured: it is not known which axes move, and they go on. So many entries that
    /// waited for a threshold were discarded.
    Unknown { discarded: u16 },
}

impl Ecm {
    /// As [`Ecm::adopt`], for a network that another program has run until now. What that program commanded last is known too,
    /// so that closing can bring it to a standstill.
    ///
    /// # Errors
    /// As [`Ecm::adopt`]. A network of which nothing is known is adopted as one without slaves.
    pub fn take_over(&self, watch: &Watch) -> Result<(), EcmError> {
        let Some(config) = watch.config() else { return Ok(()) };
        self.adopt(&config)?;
        let mut session = self.exchange.lock()?;
        for (slave, seen) in (1..=config.slaves.len() as u8).zip(&watch.slaves) {
            session.targets.assume(slave, seen.last);
        }
        Ok(())
    }

    /// Takes over the network of a program that has ended, as far as its frames tell, and reads a report that was made after its
    /// last frame. `watch` gives what the frames and the reports told, up to the newest report. After an error nothing is known,
    /// and nothing was sent.
    pub(crate) fn see_what_is_left(&self, watch: &dyn Fn() -> Watch) -> Result<(), EcmError> {
        self.take_over(&watch())?;
        self.next_of_now()
    }

    /// Brings the axes to a standstill that a program which has ended has left moving, within the limits of [`Ecm::close`];
    /// after [`see_what_is_left`](Self::see_what_is_left). With `off` they are switched off, too.
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

    /// Reads a report that was made from now on: older ones do not show the last frames of the program that has ended.
    fn next_of_now(&self) -> Result<(), EcmError> {
        let limit = self.exchange.options.read_limit;
        if !self.exchange.info.virtual_time {
            // Older reports have gone to the clients. A frame may have arrived while the first report was made.
            self.next_cycle(limit)?;
            return self.next_cycle(limit).map(drop);
        }
        let now = self.exchange.clock();
        let is_old = |at: Stamp| Duration::from_nanos(at.0) < now;
        while is_old(self.next_cycle(limit)?.meta.at) {}
        // A report of this very moment may have been made before the last frames arrived.
        self.next_cycle(limit).map(drop)
    }
}
