//! Stopping the axes of a program that has ended without closing its board. A server does this, since it has seen the
//! program's frames. `watch.rs` derives the state of the network from frames and reports, `seen.rs` that of one slave.

mod seen;
mod watch;

use std::time::Duration;

pub use watch::Watch;

use super::config::{Axis, Config, Slave, modes};
use super::standstill::{self, LeftBehind};
use super::{Ecm, EcmError};
use crate::ethercat::cia402::Mode;
use crate::link::Stamp;
use crate::sk::{CommandId, MasterState};

/// The result of stopping the axes of a program that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Succeeded {
    /// The network is not in OP, so that no axis follows commands.
    NotInOp,
    /// All axes are stationary. `discarded`: how many FIFO entries were discarded for that.
    Stand { discarded: u16 },
    /// The server has not seen the configuration of the network, so it does not know the axes; moving axes go on.
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
        for ((slave, config), seen) in (1..).zip(&config.slaves).zip(&watch.slaves) {
            session.targets.assume(slave, seen.last);
            if matches!(config, Slave::Hsp(_)) {
                session.targets.assume_outputs(slave, seen.outputs);
            }
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
        // If the slot size became known only now, `watch` has read no report. Then the newest report of the session
        // shows the state.
        let in_op = match watch.state() {
            Some(state) => state == MasterState::Op,
            None => self.exchange.lock()?.in_op(),
        };
        if !in_op {
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

    /// Brings the axes of a network that another program has left running to a standstill, within the time limit of
    /// [`Ecm::close`], and switches them off with `off`. `config` is the configuration of the network, where the mode
    /// of an axis counts only if reports do not show another one. Homing is aborted; entries in the FIFO are executed
    /// first, as when a board is closed, and a threshold for them is reset. A stationary HSP keeps its digital outputs.
    /// A moving HSP is braked with its outputs switched off, because their values are not known. Returns whether the
    /// network is in OP: if it is not, no axis follows commands, and nothing is sent.
    ///
    /// ```
    /// use ecmsk::ecm::{Config, Ecm};
    ///
    /// let ecm = Ecm::open("sim:?slaves=drive&clock=virtual")?;
    /// assert!(!ecm.stop(&Config::drives(1), false)?, "the board was just switched on, and is in PreOP");
    /// # Ok::<(), ecmsk::ecm::EcmError>(())
    /// ```
    ///
    /// # Errors
    /// [`EcmError::Config`] if the configuration is invalid. As [`Ecm::close`] if axes may still be moving or on.
    pub fn stop(&self, config: &Config, off: bool) -> Result<bool, EcmError> {
        self.adopt(config)?;
        self.next_of_now()?;
        let session = self.exchange.lock()?;
        if !session.in_op() {
            return Ok(false);
        }
        let executed = |slave: u8| CommandId::from_code(session.slot(slave.into()).id);
        let mut left =
            LeftBehind { is_foreign: true, has_threshold: true, outputs_unknown: true, ..LeftBehind::default() };
        let mut seen = config.clone();
        for (number, slave) in (1..).zip(&mut seen.slaves) {
            let Some(axis) = slave.axis().copied() else { continue };
            let mode = match executed(number) {
                CommandId::GoHome => {
                    left.homing.insert(number);
                    continue;
                }
                CommandId::Csp => Mode::Csp,
                CommandId::Csv => Mode::Csv,
                CommandId::Cst => Mode::Cst,
                _ => continue,
            };
            if modes(slave.kind()).contains(&mode) {
                *slave = Slave::with_axis(slave.kind(), Axis { mode, ..axis });
            }
        }
        drop(session);
        self.adopt(&seen)?;
        self.bring_to_rest(off, &mut left)?;
        Ok(true)
    }

    /// Waits for a report that is made after this call began. Earlier reports do not show the effect of the ended
    /// program's last frames.
    fn next_of_now(&self) -> Result<(), EcmError> {
        let limit = self.exchange.options.read_limit;
        if !self.exchange.info.virtual_time {
            // No earlier report is left in the queue, since the server has passed all of them to its clients. The board
            // may have been making the first new report when the program's last frame arrived, so the second one is
            // awaited.
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
