//! Homing with progress. One at a time, as the board wants it (SK-7.27).

use std::time::Duration;

use super::core::Task;
use super::servo::{declared, refuse_alarm, require_op};
use super::session::Session;
use super::{Ecm, EcmError};
use crate::cia402::{MODES_OF_OPERATION, Mode, Statusword};
use crate::coe::ObjectAddress;
use crate::sk::{CommandId, SlaveCommand, SlotCommand};

/// \[OURS] A result that stood from the beginning counts after that time: bits 12 and 13 may be those of an earlier
/// homing, which the drive clears when it begins.
const STANDS: Duration = Duration::from_millis(100);
const HINT: &str = "check method, speeds and switches; the axis was told to end homing";

/// How to home: the objects of CiA 402 that are written before GO_HOME. What is `None` stays as the drive has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Homing {
    /// 0x6098: homing method.
    pub method: i8,
    /// 0x6099:1, speed while it looks for the switch, the drive's units.
    pub switch_speed: Option<u32>,
    /// 0x6099:2, speed while it looks for zero, the drive's units.
    pub zero_speed: Option<u32>,
    /// 0x609A, the drive's units.
    pub acceleration: Option<u32>,
    /// 0x607C, home offset in counts.
    pub offset: Option<i32>,
    /// How long the motion may take; it is aborted then.
    pub limit: Duration,
}

impl Homing {
    /// That method, all else as the drive has it, within a minute.
    pub const fn method(method: i8) -> Self {
        let limit = Duration::from_secs(60);
        Self { method, switch_speed: None, zero_speed: None, acceleration: None, offset: None, limit }
    }
}

/// How far homing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingPhase {
    /// Objects are written.
    Preparing,
    /// The axis moves.
    Moving,
    /// Home is found; the mode is set back.
    Restoring,
}

/// What a homing axis does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HomingProgress {
    /// How far it is.
    pub phase: HomingPhase,
    /// Actual position, counts.
    pub position: i32,
    /// Statusword: bit 10 target reached, 12 homing attained, 13 homing error.
    pub statusword: Statusword,
    /// Since the call.
    pub elapsed: Duration,
}

impl Ecm {
    /// Homes an axis that is on: writes the objects, starts, waits, and sets the mode back, which the firmware 1.5 does
    /// not do by itself. `progress` is called with each report.
    ///
    /// # Errors
    /// [`EcmError::HomingFailed`], [`EcmError::Alarm`], [`EcmError::NotEnabled`], [`EcmError::SdoAborted`] for an object
    /// or method the drive has not got, [`EcmError::Timeout`], [`EcmError::Busy`] while another homing runs,
    /// [`EcmError::WrongState`], [`EcmError::WrongKind`], [`EcmError::NoSuchSlave`], [`EcmError::Link`].
    pub fn home(&self, slave: u8, homing: &Homing, mut progress: impl FnMut(&HomingProgress)) -> Result<(), EcmError> {
        let began = self.core.now();
        let turn = self.core.homing_turn.try_lock().ok_or(EcmError::Busy { what: "homing" })?;
        let go = self.axis_commands("homing", &[slave], SlaveCommand::GoHome)?;
        let mode = {
            let mut session = self.core.lock()?;
            let config = declared(&session, slave)?;
            refuse_alarm(&session, slave)?;
            let statusword = session.statusword(slave);
            if !statusword.is_enabled() {
                return Err(EcmError::NotEnabled { slave, statusword });
            }
            session.homing |= 1 << slave;
            session.aborted = 0;
            session.drop_targets(1 << slave);
            self.core.changed();
            config.axis().map_or(Mode::Csp, |axis| axis.mode)
        };
        let mut tell = |phase, session: &Session| {
            let position = session.slot(slave.into()).data1 as i32;
            let elapsed = self.core.now().saturating_sub(began);
            progress(&HomingProgress { phase, position, statusword: session.statusword(slave), elapsed });
        };
        let prepared = self.prepare(slave, homing, &mut tell);
        let done = prepared.and_then(|()| self.go(slave, &go, homing.limit, &mut tell));
        // The mode is set back whether that is heard or not.
        let aborted = if let Err(EcmError::Timeout { .. }) = done { self.abort_homing() } else { Ok(()) };
        // It ends homing on either firmware, and the axis takes targets again.
        let restored = self.core.lock().and_then(|session| {
            tell(HomingPhase::Restoring, &session);
            drop(session);
            self.sdo_write(slave, ObjectAddress::new(MODES_OF_OPERATION, 0), mode.code())
        });
        self.core.lock()?.homing &= !(1 << slave);
        self.core.changed();
        drop(turn);
        done.and(aborted).and(restored)
    }

    fn prepare(
        &self,
        slave: u8,
        homing: &Homing,
        tell: &mut impl FnMut(HomingPhase, &Session),
    ) -> Result<(), EcmError> {
        let object = ObjectAddress::new;
        tell(HomingPhase::Preparing, &*self.core.lock()?);
        self.sdo_write(slave, object(MODES_OF_OPERATION, 0), Mode::Homing.code())?;
        self.sdo_write(slave, object(0x6098, 0), homing.method)?;
        if let Some(speed) = homing.switch_speed {
            self.sdo_write(slave, object(0x6099, 1), speed)?;
        }
        if let Some(speed) = homing.zero_speed {
            self.sdo_write(slave, object(0x6099, 2), speed)?;
        }
        if let Some(acceleration) = homing.acceleration {
            self.sdo_write(slave, object(0x609A, 0), acceleration)?;
        }
        if let Some(offset) = homing.offset {
            self.sdo_write(slave, object(0x607C, 0), offset)?;
        }
        Ok(())
    }

    fn go(
        &self,
        slave: u8,
        commands: &[(usize, crate::sk::RawSlot)],
        limit: Duration,
        tell: &mut impl FnMut(HomingPhase, &Session),
    ) -> Result<(), EcmError> {
        // A repeat after its end would start another homing: a lost frame shows as a timeout.
        let task = Task { what: "homing", hint: HINT, limit, commands, resend: false };
        let failed = |why| Err(EcmError::HomingFailed { slave, why });
        let (mut seen_clear, mut since, mut taken) = (false, None, false);
        self.core.run(
            &task,
            |session, sent| {
                require_op(session, "homing")?;
                let word = session.statusword(slave);
                let id = CommandId::from_code(session.slot(slave.into()).id);
                taken |= id == CommandId::GoHome;
                if !taken && !session.credit.ran(sent.number) {
                    return Ok(None);
                }
                tell(HomingPhase::Moving, session);
                refuse_alarm(session, slave)?;
                if session.aborted & 1 << slave != 0 {
                    return failed("it was aborted");
                }
                if !word.is_enabled() {
                    return failed("the drive was switched off");
                }
                // Without a stream nothing follows in the slot, so a board that has taken it shows it.
                if !taken && session.pacer.is_none() {
                    return failed("the board did not take GO_HOME");
                }
                let (attained, error) = (word.0 & Statusword::BIT12 != 0, word.0 & Statusword::BIT13 != 0);
                seen_clear |= !attained && !error;
                let now = session.meta.map_or(0, |meta| meta.at.0);
                let stood = Duration::from_nanos(now - *since.get_or_insert(now)) >= STANDS;
                if !seen_clear && !stood {
                    return Ok(None);
                }
                if error {
                    return failed("the drive reports a homing error (statusword bit 13)");
                }
                Ok((attained && word.0 & Statusword::TARGET_REACHED != 0).then_some(()))
            },
            |session| format!("slave {slave} shows statusword 0x{:04X}", session.statusword(slave).0),
        )
    }

    /// Ends the homing of all slaves: ABORT_HOME. A call of [`Ecm::home`] in another thread ends with
    /// [`EcmError::HomingFailed`]. Without any homing nothing is sent.
    ///
    /// # Errors
    /// [`EcmError::Timeout`], [`EcmError::WrongState`], [`EcmError::Link`].
    pub fn abort_homing(&self) -> Result<(), EcmError> {
        let (slot, command) = {
            let mut session = self.core.lock()?;
            require_op(&session, "abort_homing")?;
            if session.homing == 0 {
                return Ok(());
            }
            session.aborted = session.homing;
            let slave = session.homing.trailing_zeros() as usize;
            (slave, SlotCommand::from(SlaveCommand::AbortHome).encode(session.size))
        };
        let limit = self.core.options.servo_limit;
        let task = Task { what: "ending homing", hint: HINT, limit, commands: &[(slot, command)], resend: true };
        self.core.run(
            &task,
            |session, sent| Ok(session.credit.ran(sent.number).then_some(())),
            |session| format!("the board is in {}", session.board.state),
        )
    }
}
