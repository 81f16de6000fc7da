//! Closing: what becomes of the axes. Within 2 s, also when dropped.

use super::core::Task;
use super::options::{CLOSE_LIMIT, Close};
use super::{Ecm, EcmError, ramp};
use crate::sk::{RawSlot, SlaveCommand, SlotCommand};

impl Ecm {
    /// Closes the board, within 2 s. The link is closed in any case.
    ///
    /// Only axes that are configured or adopted are touched.
    ///
    /// # Errors
    /// Why axes may still move or be on: [`EcmError::Timeout`], [`EcmError::NoReport`], [`EcmError::Link`].
    pub fn close(mut self, how: Close) -> Result<(), EcmError> {
        self.end(how)
    }

    pub(super) fn end(&mut self, how: Close) -> Result<(), EcmError> {
        if self.done {
            return Ok(());
        }
        self.done = true;
        let rested = match how {
            Close::Leave => Ok(()),
            Close::Hold | Close::ServoOff => self.rest(how == Close::ServoOff),
        };
        self.core.shut();
        rested
    }

    pub(super) fn rest(&self, off: bool) -> Result<(), EcmError> {
        self.core.link.check()?;
        let deadline = self.core.now() + CLOSE_LIMIT;
        let mut session = self.core.lock()?;
        ramp::to_standstill(self, &mut session, deadline)?;
        session.targets.clear();
        if !off || !session.in_op() {
            return Ok(());
        }
        let slot = SlotCommand::from(SlaveCommand::ServoOff).encode(session.size);
        let axes = session.plan.slaves().filter(|(_, config)| config.axis().is_some());
        let commands: Vec<(usize, RawSlot)> = axes.map(|(slave, _)| (usize::from(slave), slot)).collect();
        drop(session);
        if commands.is_empty() {
            return Ok(());
        }
        let task = Task {
            what: "switching off",
            hint: "switch the drives off by hand",
            limit: deadline.saturating_sub(self.core.now()),
            commands: &commands,
            resend: true,
        };
        self.core.run(
            &task,
            |session, _| {
                let off = commands.iter().all(|(slave, _)| !session.statusword(*slave as u8).is_enabled());
                Ok(off.then_some(()))
            },
            |session| format!("the board is in {}", session.board.state),
        )
    }
}

impl Drop for Ecm {
    fn drop(&mut self) {
        if let Err(error) = self.end(self.core.options.close) {
            log::warn!("closing the board: {error}");
        }
    }
}
