//! Closing a board: stops its axes and switches them off if wanted. Closing ends within 2 s, also when an [`Ecm`] is
//! dropped.

use std::time::Duration;

use super::LeftBehind;
use crate::ecm::exchange::Task;
use crate::ecm::options::{CLOSE_LIMIT, Close};
use crate::ecm::{Ecm, EcmError};
use crate::sk::{RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] The part of [`CLOSE_LIMIT`], the time limit of closing, that is reserved for switching the axes off.
const SWITCH_OFF_TIME: Duration = Duration::from_millis(200);

impl Ecm {
    /// Closes the board within 2 s. The link is closed in any case. Only axes that are configured ([`Ecm::configure`]) or
    /// adopted ([`Ecm::adopt`]) get commands.
    ///
    /// # Errors
    /// After any of these errors axes may still be moving or on: [`EcmError::Timeout`] if an axis still moves or is on after
    /// the time limit, [`EcmError::SlaveLost`] if a slave is lost, [`EcmError::NoReport`] if the board is silent,
    /// [`EcmError::Link`] if the link fails. With [`Close::ServoOff`] axes that do not come to a standstill are switched off
    /// all the same.
    pub fn close(mut self, how: Close) -> Result<(), EcmError> {
        self.end(how)
    }

    pub(in crate::ecm) fn end(&mut self, how: Close) -> Result<(), EcmError> {
        if self.done {
            return Ok(());
        }
        self.done = true;
        let rested = match how {
            Close::Leave => Ok(()),
            Close::Hold | Close::ServoOff => self.bring_to_rest(how == Close::ServoOff, &mut LeftBehind::default()),
        };
        // If the axes could not be stopped, a server behind the link is informed and may stop them.
        self.exchange.shut(rested.is_ok());
        rested
    }

    /// Ramps moving axes to a standstill, and switches all axes off if `off` is set, within the time limit of closing.
    pub(in crate::ecm) fn bring_to_rest(&self, off: bool, left: &mut LeftBehind) -> Result<(), EcmError> {
        self.exchange.link.check()?;
        let deadline = self.exchange.now() + CLOSE_LIMIT;
        let mut session = self.exchange.lock()?;
        let ramped = if off { deadline.saturating_sub(SWITCH_OFF_TIME) } else { deadline };
        let stood = super::to_standstill(self, &mut session, ramped, left);
        session.targets.clear();
        let is_silent =
            matches!(&stood, Err(error) if error.is_of_link() || matches!(error, EcmError::NoReport { .. }));
        if !off || !session.in_op() || is_silent {
            return stood;
        }
        let slot = SlotCommand::from(SlaveCommand::ServoOff).encode(session.size);
        let axes = session.network.slaves().filter(|(_, config)| config.axis().is_some());
        let commands: Vec<(usize, RawSlot)> = axes.map(|(slave, _)| (usize::from(slave), slot)).collect();
        drop(session);
        if commands.is_empty() {
            return stood;
        }
        // Axes are switched off even if one does not come to a standstill.
        let left = deadline.saturating_sub(self.exchange.now());
        let found = self.find_lost(left);
        let switched = self.switch_off_within(&commands, deadline.saturating_sub(self.exchange.now()));
        stood.and(found).and(switched)
    }

    /// Switches axes off and waits for at most `limit` until they are off. It does not wait for lost slaves: if there
    /// are any, it returns an error once all other axes are off.
    pub(in crate::ecm) fn switch_off_within(
        &self,
        commands: &[(usize, RawSlot)],
        limit: Duration,
    ) -> Result<(), EcmError> {
        let task = Task::new("switching off", "switch the drives off by hand", limit, commands);
        let mut lost = None;
        self.exchange.run(&task, |session, sent| {
            if !session.in_op() {
                return Ok(Some(()));
            }
            let mut is_off = |slave: u8| {
                let is_lost = session.lost.contains(slave);
                if is_lost {
                    lost = Some(EcmError::SlaveLost { slave: Some(slave), found: session.board().state });
                }
                is_lost || session.probably_executed(sent) && !session.statusword(slave).is_enabled()
            };
            Ok(commands.iter().all(|(slave, _)| is_off(*slave as u8)).then_some(()))
        })?;
        lost.map_or(Ok(()), Err)
    }
}

impl Drop for Ecm {
    fn drop(&mut self) {
        if let Err(error) = self.end(self.exchange.options.close) {
            log::warn!("closing the board: {error}");
        }
    }
}
