//! Switching axes on and off, and clearing alarms.

use super::config::Slave;
use super::core::Task;
use super::session::Session;
use super::{Ecm, EcmError};
use crate::cia402::Statusword;
use crate::sk::{DriveResponse, RawSlot, SlaveCommand, SlotCommand};

const HINT: &str = "look at the drive's display; mains power, enable inputs and alarms keep a drive off";

impl Ecm {
    /// Switches axes on and waits until all are in Operation enabled. They stand where they are.
    ///
    /// # Errors
    /// [`EcmError::Alarm`] at once if one of them has an alarm, [`EcmError::IsHoming`], [`EcmError::Timeout`],
    /// [`EcmError::WrongState`], [`EcmError::NoSuchSlave`], [`EcmError::WrongKind`], [`EcmError::Link`].
    pub fn servo_on(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let commands = self.axis_commands("servo_on", slaves, SlaveCommand::ServoOn)?;
        // The board ignores it for an axis that homes (SK-7.43), which is on anyway.
        let homing = self.core.lock()?.homing;
        if let Some(slave) = slaves.iter().copied().find(|slave| homing & 1 << slave != 0) {
            return Err(EcmError::IsHoming { slave });
        }
        self.until("switching on", &commands, slaves, |session, slave| {
            refuse_alarm(session, slave)?;
            Ok(session.statusword(slave).is_enabled())
        })
    }

    /// Switches axes off and waits until none is in Operation enabled. An axis without a brake drops.
    ///
    /// # Errors
    /// As [`Ecm::servo_on`], but for alarms: a drive with an alarm is off.
    pub fn servo_off(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let commands = self.axis_commands("servo_off", slaves, SlaveCommand::ServoOff)?;
        self.until("switching off", &commands, slaves, |session, slave| Ok(!session.statusword(slave).is_enabled()))
    }

    /// Resets alarms and waits until they are gone. The axes are off then. Some alarms need power off and on.
    ///
    /// # Errors
    /// [`EcmError::Alarm`] for one that stays, else as [`Ecm::servo_on`].
    pub fn clear_alarm(&self, slaves: &[u8]) -> Result<(), EcmError> {
        let commands = self.axis_commands("clear_alarm", slaves, SlaveCommand::AlarmClear)?;
        let has_fault = |session: &Session, slave| session.statusword(slave).0 & Statusword::FAULT != 0;
        let done = self.until("an alarm clear", &commands, slaves, |session, slave| Ok(!has_fault(session, slave)));
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
        slaves: &[u8],
        is_done: impl Fn(&Session, u8) -> Result<bool, EcmError>,
    ) -> Result<(), EcmError> {
        let limit = self.core.options.servo_limit;
        let task = Task { what, hint: HINT, limit, commands, resend: true };
        self.core.run(
            &task,
            |session, _| {
                for slave in slaves {
                    if !is_done(session, *slave)? {
                        return Ok(None);
                    }
                }
                Ok(Some(()))
            },
            |session| {
                let words = slaves.iter().map(|slave| {
                    let word = session.statusword(*slave);
                    let state = word.state().map_or("unknown", |state| state.name());
                    format!("slave {slave} is in {state} (0x{:04X})", word.0)
                });
                words.collect::<Vec<_>>().join(", ")
            },
        )
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
    if session.statusword(slave).0 & Statusword::FAULT == 0 {
        return Ok(());
    }
    let code = match session.plan.slave(slave) {
        Some(Slave::Hsp(_)) => 0,
        _ => DriveResponse::decode(&session.slot(slave.into())).error_code,
    };
    Err(EcmError::Alarm { slave, code })
}
