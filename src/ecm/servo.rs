//! Switching axes on and off, and clearing alarms.

use std::time::Duration;

use super::config::Slave;
use super::core::{Sent, Task};
use super::marks::Echo;
use super::session::Session;
use super::{Ecm, EcmError};
use crate::cia402::Statusword;
use crate::sk::{DriveResponse, RawSlot, SlaveCommand, SlotCommand};

const HINT: &str = "look at the drive's display; mains power, enable inputs and alarms keep a drive off";

/// \[OURS] How long axes that did not come on may take to be told to stay off.
const TAKE_BACK: Duration = Duration::from_secs(1);

impl Ecm {
    /// Switches axes on and waits until all are in Operation enabled: of a pulse module with slots of 16 bytes both. They
    /// stand where they are. Those that are on already are left alone. If one does not come on, all that this call has told
    /// to are switched off again: none starts by itself later.
    ///
    /// # Errors
    /// [`EcmError::Alarm`] at once if one of them has an alarm, [`EcmError::IsHoming`], [`EcmError::SlaveLost`],
    /// [`EcmError::Timeout`], [`EcmError::WrongState`], [`EcmError::NoSuchSlave`], [`EcmError::WrongKind`],
    /// [`EcmError::Link`].
    pub fn servo_on(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let mut commands = self.axis_commands("servo_on", slaves, SlaveCommand::ServoOn)?;
        // The board ignores it for an axis that homes (SK-7.43), which is on anyway.
        let homing = self.core.lock()?.homing;
        if let Some(slave) = slaves.iter().copied().find(|slave| homing & 1 << slave != 0) {
            return Err(EcmError::IsHoming { slave });
        }
        self.refuse_lost(slaves)?;
        slaves.iter().try_for_each(|slave| self.second_word(*slave).map(drop))?;
        {
            let session = self.core.lock()?;
            slaves.iter().try_for_each(|slave| refuse_alarm(&session, *slave))?;
            // In the frame of a stream the command would stand where the axis's next target does.
            commands.retain(|(slave, _)| !session.is_on(*slave as u8));
        }
        if commands.is_empty() {
            return Ok(());
        }
        let limit = self.core.options.servo_limit;
        let ended = self.until("switching on", &commands, |session, slave, _| {
            refuse_alarm(session, slave)?;
            Ok(session.statusword(slave).is_enabled())
        });
        let ended =
            ended.and_then(|()| self.until_second("switching on", &commands, limit, |word| word.is_enabled(), true));
        ended.map_err(|error| self.take_back(&commands, error))
    }

    /// Tells axes that did not come on to stay off.
    fn take_back(&self, commands: &[(usize, RawSlot)], error: EcmError) -> EcmError {
        if matches!(error, EcmError::Link(_)) {
            return error;
        }
        let size = match self.core.lock() {
            Ok(session) if session.in_op() => session.size,
            // Out of OP they are off.
            _ => return error,
        };
        let off = SlotCommand::from(SlaveCommand::ServoOff).encode(size);
        let off: Vec<_> = commands.iter().map(|(slave, _)| (*slave, off)).collect();
        let told = self.off_within(&off, TAKE_BACK);
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

    /// Switches axes off and waits until none is in Operation enabled. An axis without a brake drops.
    ///
    /// # Errors
    /// As [`Ecm::servo_on`], but for alarms: a drive with an alarm is off.
    pub fn servo_off(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let commands = self.axis_commands("servo_off", slaves, SlaveCommand::ServoOff)?;
        if commands.is_empty() {
            return Ok(());
        }
        let limit = self.core.options.servo_limit;
        self.find_lost(limit)?;
        self.off_within(&commands, limit)?;
        self.until_second("switching off", &commands, limit, |word| !word.is_enabled(), false)
    }

    /// Resets alarms and waits until they are gone. The axes are off then. Some alarms need power off and on. Axes without
    /// an alarm are left alone.
    ///
    /// # Errors
    /// [`EcmError::Alarm`] for one that stays, else as [`Ecm::servo_on`].
    pub fn clear_alarm(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let mut commands = self.axis_commands("clear_alarm", slaves, SlaveCommand::AlarmClear)?;
        self.refuse_lost(slaves)?;
        slaves.iter().try_for_each(|slave| self.second_word(*slave).map(drop))?;
        {
            let session = self.core.lock()?;
            commands.retain(|(slave, _)| refuse_alarm(&session, *slave as u8).is_err());
        }
        if commands.is_empty() {
            return Ok(());
        }
        let limit = self.core.options.servo_limit;
        let has_fault = |session: &Session, slave| session.statusword(slave).0 & Statusword::FAULT != 0;
        let done = self.until("an alarm clear", &commands, |session, slave, sent| {
            Ok(session.probably_executed(sent) && !has_fault(session, slave))
        });
        let no_fault = |word: Statusword| word.0 & Statusword::FAULT == 0;
        let done = done.and_then(|()| self.until_second("an alarm clear", &commands, limit, no_fault, false));
        if let Err(EcmError::Timeout { .. }) = done {
            let session = self.core.lock()?;
            slaves.iter().try_for_each(|slave| refuse_alarm(&session, *slave))?;
        }
        done
    }

    fn until(
        &self,
        what: &'static str,
        commands: &[(usize, RawSlot)],
        is_done: impl Fn(&Session, u8, Sent) -> Result<bool, EcmError>,
    ) -> Result<(), EcmError> {
        let limit = self.core.options.servo_limit;
        let task = Task { what, hint: HINT, limit, commands, resend: true, own: false };
        self.core.run(
            &task,
            |session, sent| {
                require_op(session, what)?;
                for (slave, _) in commands {
                    if !is_done(session, *slave as u8, sent)? {
                        return Ok(None);
                    }
                }
                Ok(Some(()))
            },
            |session| {
                let words = commands.iter().map(|(slave, _)| {
                    let word = session.statusword(*slave as u8);
                    let state = word.state().map_or("unknown", |state| state.name());
                    format!("slave {slave} is in {state} (0x{:04X})", word.0)
                });
                words.collect::<Vec<_>>().join(", ")
            },
        )
    }

    /// Reads the statuswords of second channels until all are right.
    fn until_second(
        &self,
        what: &'static str,
        commands: &[(usize, RawSlot)],
        limit: Duration,
        is_right: impl Fn(Statusword) -> bool,
        no_alarm: bool,
    ) -> Result<(), EcmError> {
        let began = self.core.now();
        for slave in commands.iter().map(|(slave, _)| *slave as u8) {
            while let Some(word) = self.second_word(slave)?.filter(|word| !is_right(*word)) {
                if no_alarm {
                    refuse_alarm(&*self.core.lock()?, slave)?;
                }
                let waited = self.core.now().saturating_sub(began);
                if waited >= limit {
                    let seen = format!("the second channel of slave {slave} shows 0x{:04X}", word.0);
                    return Err(EcmError::Timeout { what, waited, seen, hint: HINT });
                }
            }
        }
        Ok(())
    }

    /// Finds out which slaves are lost, if the state says that some are.
    pub(super) fn find_lost(&self, limit: Duration) -> Result<(), EcmError> {
        {
            let session = self.core.lock()?;
            if !session.in_op() || !session.board.state.is_failed() {
                return Ok(());
            }
        }
        let commands = &[(0, RawSlot::ZERO)];
        let task = Task { what: "looking for lost slaves", hint: HINT, limit, commands, resend: true, own: false };
        self.core.run(
            &task,
            |session, sent| Ok((!session.in_op() || session.executed(sent)).then_some(())),
            |session| format!("the board is in {}", session.board.state),
        )
    }

    /// Slots of slaves that are lost show what was.
    fn refuse_lost(&self, slaves: &[u8]) -> Result<(), EcmError> {
        self.find_lost(self.core.options.servo_limit)?;
        let session = self.core.lock()?;
        let found = session.board.state;
        if !session.in_op() || !found.is_failed() {
            return Ok(());
        }
        if session.marks.echo == Echo::No {
            return Err(EcmError::SlaveLost { slave: None, found });
        }
        match slaves.iter().copied().find(|slave| session.lost & 1 << slave != 0) {
            Some(slave) => Err(EcmError::SlaveLost { slave: Some(slave), found }),
            None => Ok(()),
        }
    }

    /// The same command for each of those axes, once it is sure that all take it.
    pub(super) fn axis_commands(
        &self,
        what: &'static str,
        slaves: &[u8],
        command: SlaveCommand,
    ) -> Result<Vec<(usize, RawSlot)>, EcmError> {
        let mut session = self.core.lock()?;
        self.core.catch_up(&mut session)?;
        require_op(&session, what)?;
        let slot = SlotCommand::from(command).encode(session.size);
        slaves
            .iter()
            .map(|slave| {
                let config = declared(&session, *slave)?;
                if config.axis().is_none() {
                    let kind = config.kind().name();
                    return Err(EcmError::WrongKind { slave: *slave, kind, what, wanted: "a drive, STEP or HSP" });
                }
                Ok((usize::from(*slave), slot))
            })
            .collect()
    }
}

pub(super) fn require_op(session: &Session, what: &'static str) -> Result<(), EcmError> {
    if session.in_op() { Ok(()) } else { Err(EcmError::WrongState { what, needs: "OP", found: session.board.state }) }
}

pub(super) fn declared(session: &Session, slave: u8) -> Result<Slave, EcmError> {
    let none = EcmError::NoSuchSlave { slave, declared: session.plan.count };
    session.plan.slave(slave).copied().ok_or(none)
}

/// Whether the drive shows an alarm, and which.
pub(super) fn refuse_alarm(session: &Session, slave: u8) -> Result<(), EcmError> {
    let second = session.second.word(slave).unwrap_or_default();
    if (session.statusword(slave).0 | second.0) & Statusword::FAULT == 0 {
        return Ok(());
    }
    let code = match session.plan.slave(slave) {
        Some(Slave::Hsp(_)) => 0,
        _ => DriveResponse::decode(&session.slot(slave.into())).error_code,
    };
    Err(EcmError::Alarm { slave, code })
}
