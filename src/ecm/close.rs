//! Closing: what becomes of the axes. Within 2 s, also when dropped.

use std::cell::Cell;
use std::time::Duration;

use super::core::Task;
use super::leftover::Left;
use super::options::{CLOSE_LIMIT, Close};
use super::{Ecm, EcmError, ramp};
use crate::sk::{RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] What of the limit is left for switching off.
const SWITCH_OFF: Duration = Duration::from_millis(200);

impl Ecm {
    /// Closes the board, within 2 s. The link is closed in any case.
    ///
    /// Only axes that are configured or adopted are touched.
    ///
    /// # Errors
    /// Why axes may still move or be on: [`EcmError::Timeout`], [`EcmError::SlaveLost`],
    /// [`EcmError::NoReport`], [`EcmError::Link`]. With [`Close::ServoOff`] axes that do not come to rest are switched off all
    /// the same.
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
            Close::Hold | Close::ServoOff => self.rest(how == Close::ServoOff, &mut Left::default()),
        };
        // Whoever serves the board may still bring to rest what this could not.
        self.core.shut(rested.is_ok());
        rested
    }

    pub(super) fn rest(&self, off: bool, left: &mut Left) -> Result<(), EcmError> {
        self.core.link.check()?;
        let deadline = self.core.now() + CLOSE_LIMIT;
        let mut session = self.core.lock()?;
        let ramped = if off { deadline.saturating_sub(SWITCH_OFF) } else { deadline };
        let stood = ramp::to_standstill(self, &mut session, ramped, left);
        session.targets.clear();
        if !off || !session.in_op() || matches!(stood, Err(EcmError::NoReport { .. } | EcmError::Link(_))) {
            return stood;
        }
        let slot = SlotCommand::from(SlaveCommand::ServoOff).encode(session.size);
        let axes = session.plan.slaves().filter(|(_, config)| config.axis().is_some());
        let commands: Vec<(usize, RawSlot)> = axes.map(|(slave, _)| (usize::from(slave), slot)).collect();
        drop(session);
        if commands.is_empty() {
            return stood;
        }
        // Also where one does not come to rest: the axes shall be off then.
        let left = deadline.saturating_sub(self.core.now());
        let found = self.find_lost(left);
        let switched = self.off_within(&commands, deadline.saturating_sub(self.core.now()));
        stood.and(found).and(switched)
    }

    /// Switches axes off; a lost one is not waited for.
    pub(super) fn off_within(&self, commands: &[(usize, RawSlot)], limit: Duration) -> Result<(), EcmError> {
        let task = Task {
            what: "switching off",
            hint: "switch the drives off by hand",
            limit,
            commands,
            resend: true,
            own: false,
        };
        let lost = Cell::new(None);
        self.core.run(
            &task,
            |session, sent| {
                if !session.in_op() {
                    return Ok(Some(()));
                }
                let is_off = |slave: u8| {
                    let gone = session.lost & 1 << slave != 0;
                    if gone {
                        lost.set(Some(EcmError::SlaveLost { slave: Some(slave), found: session.board.state }));
                    }
                    gone || session.probably_executed(sent) && !session.statusword(slave).is_enabled()
                };
                Ok(commands.iter().all(|(slave, _)| is_off(*slave as u8)).then_some(()))
            },
            |session| format!("the board is in {}", session.board.state),
        )?;
        lost.take().map_or(Ok(()), Err)
    }
}

impl Drop for Ecm {
    fn drop(&mut self) {
        if let Err(error) = self.end(self.core.options.close) {
            log::warn!("closing the board: {error}");
        }
    }
}
