//! Switching axes on and off, and clearing alarms.

use std::time::Duration;

use super::exchange::marks::Echo;
use super::exchange::{Sent, Session, Task};
use super::{Ecm, EcmError};
use crate::ethercat::cia402::Statusword;
use crate::link::LinkError;
use crate::sk::{RawSlot, SlaveCommand, SlotCommand};

const HINT: &str = "look at the drive's display; mains power, enable inputs and alarms keep a drive off";

/// \[OURS] The time limit for switching axes off again after `servo_on` has failed for some of them.
const SWITCH_OFF_LIMIT: Duration = Duration::from_secs(1);

impl Ecm {
    /// Switches axes on and waits until all are in Operation enabled. With 16-byte slots this includes the second
    /// channel of an HSP. The axes hold their present positions. Axes that are on already get no command. If an axis
    /// does not come on, all axes that got a command are switched off again, so that none comes on by itself later.
    ///
    /// # Errors
    /// [`EcmError::Alarm`] at once if an axis has an alarm, [`EcmError::IsHoming`] if one is homing, [`EcmError::SlaveLost`] if
    /// a slave is lost, [`EcmError::Timeout`] if an axis does not come on in time, [`EcmError::WrongState`] outside OP,
    /// [`EcmError::NoSuchSlave`] and [`EcmError::WrongKind`] for a slave that is not configured or has no axis,
    /// [`EcmError::Link`] if the link fails.
    pub fn servo_on(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let mut commands = self.axis_commands("servo_on", slaves, SlaveCommand::ServoOn)?;
        // The board ignores SV_ON for an axis that is homing (SK-7.43); such an axis is on in any case.
        let homing = self.exchange.lock()?.homing.active;
        if let Some(slave) = slaves.iter().copied().find(|slave| homing.contains(*slave)) {
            return Err(EcmError::IsHoming { slave });
        }
        self.refuse_lost(slaves)?;
        slaves.iter().try_for_each(|slave| self.second_statusword(*slave).map(drop))?;
        {
            let session = self.exchange.lock()?;
            slaves.iter().try_for_each(|slave| session.refuse_alarm(*slave))?;
            // An axis that is on gets no SV_ON: in a frame of a stream it would replace the axis's next target.
            commands.retain(|(slave, _)| !session.is_on(*slave as u8));
        }
        if commands.is_empty() {
            return Ok(());
        }
        let limit = self.exchange.options.servo_limit;
        let ended = self.until("switching on", &commands, |session, slave, _| {
            session.refuse_alarm(slave)?;
            Ok(session.statusword(slave).is_enabled())
        });
        let ended =
            ended.and_then(|()| self.until_second("switching on", &commands, limit, |word| word.is_enabled(), true));
        ended.map_err(|error| self.switch_off_again(&commands, error))
    }

    /// Switches off the axes of `commands` after `servo_on` has failed. Returns `error`. The text of a timeout then also
    /// says whether switching off has succeeded.
    fn switch_off_again(&self, commands: &[(usize, RawSlot)], error: EcmError) -> EcmError {
        // A call that another thread has cancelled leaves a link that works.
        if error.is_of_link() && !matches!(error, EcmError::Link(LinkError::Cancelled { .. })) {
            return error;
        }
        let size = match self.exchange.lock() {
            Ok(session) if session.in_op() => session.size,
            // The board is closed, or the network is not in OP. Outside OP the drives are off, so nothing is left to do.
            _ => return error,
        };
        let off = SlotCommand::from(SlaveCommand::ServoOff).encode(size);
        let off: Vec<_> = commands.iter().map(|(slave, _)| (*slave, off)).collect();
        let told = self.switch_off_within(&off, SWITCH_OFF_LIMIT);
        match error {
            EcmError::Timeout { what, waited, seen, hint } => {
                let told = match told {
                    Ok(()) => "all of them were switched off again (SV_OFF)".to_owned(),
                    Err(error) => format!("switching them off again failed ({error}), they may come on by themselves"),
                };
                EcmError::Timeout { what, waited, seen: format!("{seen}, {told}"), hint }
            }
            other => {
                if let Err(error) = told {
                    log::warn!("axes that did not come on may do so by themselves: {error}");
                }
                other
            }
        }
    }

    /// Switches axes off and waits until none is in Operation enabled. A vertical axis without a brake drops.
    ///
    /// # Errors
    /// As [`Ecm::servo_on`], except for alarms: a drive with an alarm is off.
    pub fn servo_off(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let commands = self.axis_commands("servo_off", slaves, SlaveCommand::ServoOff)?;
        if commands.is_empty() {
            return Ok(());
        }
        let limit = self.exchange.options.servo_limit;
        self.find_lost(limit)?;
        self.switch_off_within(&commands, limit)?;
        self.until_second("switching off", &commands, limit, |word| !word.is_enabled(), false)
    }

    /// Resets the alarms of axes and waits until the drives show none. Afterwards the axes are off. Some alarms need a
    /// power cycle. Axes without an alarm get no command.
    ///
    /// # Errors
    /// [`EcmError::Alarm`] for an alarm that stays, otherwise as [`Ecm::servo_on`].
    pub fn clear_alarm(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let mut commands = self.axis_commands("clear_alarm", slaves, SlaveCommand::AlarmClear)?;
        self.refuse_lost(slaves)?;
        slaves.iter().try_for_each(|slave| self.second_statusword(*slave).map(drop))?;
        {
            let session = self.exchange.lock()?;
            commands.retain(|(slave, _)| session.refuse_alarm(*slave as u8).is_err());
        }
        if commands.is_empty() {
            return Ok(());
        }
        let limit = self.exchange.options.servo_limit;
        let has_fault = |session: &Session, slave| session.statusword(slave).0 & Statusword::FAULT != 0;
        let done = self.until("an alarm clear", &commands, |session, slave, sent| {
            Ok(session.probably_executed(sent) && !has_fault(session, slave))
        });
        let no_fault = |word: Statusword| word.0 & Statusword::FAULT == 0;
        let done = done.and_then(|()| self.until_second("an alarm clear", &commands, limit, no_fault, false));
        if let Err(EcmError::Timeout { .. }) = done {
            let session = self.exchange.lock()?;
            slaves.iter().try_for_each(|slave| session.refuse_alarm(*slave))?;
        }
        done
    }

    /// Sends a command to each axis and waits until `is_done` is true for all of them, for at most
    /// [`Options::servo_limit`](super::Options::servo_limit).
    fn until(
        &self,
        what: &'static str,
        commands: &[(usize, RawSlot)],
        is_done: impl Fn(&Session, u8, Sent) -> Result<bool, EcmError>,
    ) -> Result<(), EcmError> {
        let seen = |session: &Session| {
            let words = commands.iter().map(|(slave, _)| {
                let word = session.statusword(*slave as u8);
                let state = word.state().map_or("unknown", |state| state.name());
                format!("slave {slave} is in {state} (0x{:04X})", word.0)
            });
            words.collect::<Vec<_>>().join(", ")
        };
        let task = Task::new(what, HINT, self.exchange.options.servo_limit, commands).seen(&seen);
        self.exchange.run(&task, |session, sent| {
            session.require_op(what)?;
            for (slave, _) in commands {
                if !is_done(session, *slave as u8, sent)? {
                    return Ok(None);
                }
            }
            Ok(Some(()))
        })
    }

    /// Reads the statuswords of second channels until `is_right` is true for each, for at most `limit`. With `no_alarm`
    /// an alarm is returned as an error at once.
    fn until_second(
        &self,
        what: &'static str,
        commands: &[(usize, RawSlot)],
        limit: Duration,
        is_right: impl Fn(Statusword) -> bool,
        no_alarm: bool,
    ) -> Result<(), EcmError> {
        let began = self.exchange.now();
        for slave in commands.iter().map(|(slave, _)| *slave as u8) {
            while let Some(word) = self.second_statusword(slave)?.filter(|word| !is_right(*word)) {
                if no_alarm {
                    self.exchange.lock()?.refuse_alarm(slave)?;
                }
                let waited = self.exchange.now().saturating_sub(began);
                if waited >= limit {
                    let seen = format!("the second channel of slave {slave} shows 0x{:04X}", word.0);
                    return Err(EcmError::Timeout { what, waited, seen, hint: HINT });
                }
            }
        }
        Ok(())
    }

    /// If the state byte shows lost slaves, finds out within `limit` which ones: a lost slave does not return the mark of
    /// a frame, and is then in [`Session::lost`]. An empty command in slot 0 is sent, because only a frame with a command
    /// has a mark.
    pub(super) fn find_lost(&self, limit: Duration) -> Result<(), EcmError> {
        {
            let session = self.exchange.lock()?;
            if !session.in_op() || !session.board().state.is_failed() {
                return Ok(());
            }
        }
        let task = Task::new("looking for lost slaves", HINT, limit, &[(0, RawSlot::ZERO)]);
        self.exchange.run(&task, |session, sent| Ok((!session.in_op() || session.executed(sent)).then_some(())))
    }

    /// Returns an error if a slave is lost, since its slot shows old values.
    fn refuse_lost(&self, slaves: &[u8]) -> Result<(), EcmError> {
        self.find_lost(self.exchange.options.servo_limit)?;
        let session = self.exchange.lock()?;
        let found = session.board().state;
        if !session.in_op() || !found.is_failed() {
            return Ok(());
        }
        if session.marks.echo == Echo::No {
            return Err(EcmError::SlaveLost { slave: None, found });
        }
        match slaves.iter().copied().find(|slave| session.lost.contains(*slave)) {
            Some(slave) => Err(EcmError::SlaveLost { slave: Some(slave), found }),
            None => Ok(()),
        }
    }

    /// Builds `command` for each of these axes.
    ///
    /// # Errors
    /// [`EcmError::WrongState`] outside OP, [`EcmError::NoSuchSlave`] and [`EcmError::WrongKind`] for a slave that is not
    /// configured or has no axis.
    pub(super) fn axis_commands(
        &self,
        what: &'static str,
        slaves: &[u8],
        command: SlaveCommand,
    ) -> Result<Vec<(usize, RawSlot)>, EcmError> {
        let session = self.exchange.lock_in_op(what)?;
        let slot = SlotCommand::from(command).encode(session.size);
        let command_of = |slave: &u8| session.network.axis(*slave, what).map(|_| (usize::from(*slave), slot));
        slaves.iter().map(command_of).collect()
    }
}
