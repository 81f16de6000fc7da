//! Homing with progress: one axis, or several that start in one frame, as the board wants it (SK-7.27).

use std::cell::RefCell;
use std::time::Duration;

use super::core::Task;
use super::servo::{declared, refuse_alarm, require_op};
use super::session::Session;
use super::{Ecm, EcmError};
use crate::cia402::{MODES_OF_OPERATION, Mode, Statusword};
use crate::coe::ObjectAddress;
use crate::sk::{CommandId, RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] A result that stood from the beginning counts after that time: bits 12 and 13 may be those of an earlier
/// homing, which the drive clears when it begins.
const STANDS: Duration = Duration::from_millis(100);
/// \[OURS] GO_HOME that has no answer after so many reports was lost: more than the FIFO and a handshake take.
const LOST: u64 = 200;
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
    /// Which slave it is.
    pub slave: u8,
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
    /// not do by itself. `progress` is called with each report; it may use the board too.
    ///
    /// Of an HSP it homes the first channel. The second one cannot be homed alone: where a program has written 6 to its
    /// 0x6860 it begins with the first one, and only its own statusword (0x6841, by [`Ecm::sdo_read`]) tells how it ends.
    ///
    /// # Errors
    /// [`EcmError::HomingFailed`], [`EcmError::Alarm`], [`EcmError::NotEnabled`], [`EcmError::SdoAborted`] for an object
    /// or method the drive has not got, [`EcmError::Timeout`], [`EcmError::Busy`] while another homing runs,
    /// [`EcmError::WrongState`], [`EcmError::WrongKind`], [`EcmError::NoSuchSlave`], [`EcmError::Link`].
    pub fn home(&self, slave: u8, homing: &Homing, progress: impl FnMut(&HomingProgress)) -> Result<(), EcmError> {
        self.home_all(&[(slave, *homing)], progress)
    }

    /// Homes several axes together: all objects are written first, one frame starts them, and it waits for the last. The
    /// longest of their limits holds for all. If one fails, homing of the others is ended too, and the error is that of
    /// the one.
    ///
    /// ```
    /// use ecmsk::ecm::{Config, Ecm, Homing};
    /// use ecmsk::sk::MasterState;
    ///
    /// let ecm = Ecm::open("sim:?slaves=drive*2&clock=virtual")?;
    /// ecm.configure(&Config::drives(2))?;
    /// ecm.set_state(MasterState::Op)?;
    /// ecm.servo_on(&[1, 2])?;
    /// ecm.home_all(&[(1, Homing::method(33)), (2, Homing::method(34))], |_| {})?;
    /// # Ok::<(), ecmsk::ecm::EcmError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Ecm::home`], and [`EcmError::Setting`] for a slave that is named twice.
    pub fn home_all(&self, axes: &[(u8, Homing)], mut progress: impl FnMut(&HomingProgress)) -> Result<(), EcmError> {
        let began = self.core.now();
        let slaves: Vec<u8> = axes.iter().map(|(slave, _)| *slave).collect();
        if let Some((n, slave)) = slaves.iter().enumerate().find(|(n, slave)| slaves[..*n].contains(slave)) {
            let found = format!("slave {slave} at place {}", n + 1);
            return Err(EcmError::Setting { what: "the list of axes to home", found, allowed: "each slave once" });
        }
        let turn = self.core.homing_turn.try_lock().ok_or(EcmError::Busy { what: "homing" })?;
        let go = self.axis_commands("homing", &slaves, SlaveCommand::GoHome)?;
        if slaves.is_empty() {
            return Ok(());
        }
        let modes = self.reserve(&slaves)?;
        let mut tell = |slave: u8, phase| -> Result<(), EcmError> {
            // The program's own function, without the session: it may call what it likes.
            let told = Told { slave, phase }.now(&*self.core.lock()?, self.core.now().saturating_sub(began));
            progress(&told);
            Ok(())
        };
        let limit = axes.iter().map(|(_, homing)| homing.limit).max().unwrap_or_default();
        let prepared = axes.iter().try_for_each(|(slave, homing)| self.prepare(*slave, homing, &mut tell));
        let done = prepared.and_then(|()| self.go(&slaves, &go, limit, began, &mut progress));
        let started = self.core.lock().is_ok_and(|session| session.going != 0);
        // \[OURS] Nothing homes any more when this returns. One axis that failed has ended by itself.
        let goes_on = match &done {
            Ok(()) => false,
            Err(EcmError::HomingFailed { .. } | EcmError::Alarm { .. }) => slaves.len() > 1,
            Err(_) => true,
        };
        let aborted = if started && goes_on { self.abort_homing() } else { Ok(()) };
        // It ends homing on either firmware, and the axes take targets again; all are tried, whether that is heard or not.
        let mut restored = Ok(());
        for (slave, mode) in slaves.iter().zip(modes) {
            let told = self.core.lock().map(|session| {
                Told { slave: *slave, phase: HomingPhase::Restoring }
                    .now(&session, self.core.now().saturating_sub(began))
            });
            let one = told.and_then(|told| {
                progress(&told);
                self.sdo_write(*slave, ObjectAddress::new(MODES_OF_OPERATION, 0), mode.code())
            });
            restored = restored.and(one);
        }
        let released =
            self.core.lock().map(|mut session| slaves.iter().for_each(|slave| session.homing &= !(1 << slave)));
        self.core.changed();
        drop(turn);
        done.and(aborted).and(restored).and(released)
    }

    /// Takes axes that can home out of what streams may move; gives their modes.
    fn reserve(&self, slaves: &[u8]) -> Result<Vec<Mode>, EcmError> {
        let mut session = self.core.lock()?;
        let mut modes = Vec::with_capacity(slaves.len());
        for slave in slaves.iter().copied() {
            let config = declared(&session, slave)?;
            refuse_alarm(&session, slave)?;
            let statusword = session.statusword(slave);
            if !statusword.is_enabled() {
                return Err(EcmError::NotEnabled { slave, statusword });
            }
            modes.push(config.axis().map_or(Mode::Csp, |axis| axis.mode));
        }
        let homing = slaves.iter().fold(0, |homing, slave| homing | 1 << slave);
        session.homing |= homing;
        (session.aborted, session.going) = (0, 0);
        session.drop_targets(homing);
        self.core.changed();
        Ok(modes)
    }

    fn prepare(
        &self,
        slave: u8,
        homing: &Homing,
        tell: &mut impl FnMut(u8, HomingPhase) -> Result<(), EcmError>,
    ) -> Result<(), EcmError> {
        let object = ObjectAddress::new;
        tell(slave, HomingPhase::Preparing)?;
        refuse_aborted(&*self.core.lock()?, slave)?;
        self.sdo_write(slave, object(MODES_OF_OPERATION, 0), Mode::Homing.code())?;
        self.sdo_write(slave, object(0x6098, 0), homing.method)?;
        refuse_aborted(&*self.core.lock()?, slave)?;
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
        slaves: &[u8],
        commands: &[(usize, RawSlot)],
        limit: Duration,
        began: Duration,
        progress: &mut impl FnMut(&HomingProgress),
    ) -> Result<(), EcmError> {
        // A repeat after its end would start another homing: a lost frame is an error.
        let task = Task { what: "homing", hint: HINT, limit, commands, resend: false, own: true };
        let mut axes: Vec<Search> = slaves.iter().map(|slave| Search::of(*slave)).collect();
        let told = RefCell::new(Vec::new());
        let mut tell_all = || told.take().iter().for_each(&mut *progress);
        let mut sent_at = None;
        let done = self.core.run_with(
            &task,
            |session| {
                require_op(session, "homing")?;
                slaves.iter().try_for_each(|slave| refuse_aborted(session, *slave))?;
                session.going = session.homing;
                Ok(())
            },
            |session, sent| {
                require_op(session, "homing")?;
                let reports = session.stats.reports;
                let lost = reports - *sent_at.get_or_insert(reports) > LOST;
                let mut all = true;
                for axis in &mut axes {
                    let slot = usize::from(axis.slave);
                    axis.taken |= session.answer(sent, slot, CommandId::GoHome.code()).is_some();
                    let elapsed = self.core.now().saturating_sub(began);
                    let mut tell = |slave, phase| told.borrow_mut().push(Told { slave, phase }.now(session, elapsed));
                    all &= axis.look(session, session.executed(sent) || lost, &mut tell)?;
                }
                Ok(all.then_some(()))
            },
            &mut tell_all,
            |session| {
                let words = slaves.iter().map(|slave| {
                    let word = session.statusword(*slave).0;
                    format!("slave {slave} shows statusword 0x{word:04X}")
                });
                words.collect::<Vec<_>>().join(", ")
            },
        );
        tell_all();
        done
    }

    /// Ends the homing of all slaves: ABORT_HOME. A call of [`Ecm::home`] in another thread ends with
    /// [`EcmError::HomingFailed`]. Without any homing nothing is sent.
    ///
    /// # Errors
    /// [`EcmError::Timeout`], [`EcmError::WrongState`], [`EcmError::Link`].
    pub fn abort_homing(&self) -> Result<(), EcmError> {
        let (slot, command) = {
            let mut session = self.core.lock()?;
            self.core.catch_up(&mut session)?;
            require_op(&session, "abort_homing")?;
            if session.homing == 0 {
                return Ok(());
            }
            session.aborted = session.homing;
            // Its objects are written yet: it ends before it begins.
            if session.going == 0 {
                return Ok(());
            }
            let slave = session.homing.trailing_zeros() as usize;
            (slave, SlotCommand::from(SlaveCommand::AbortHome).encode(session.size))
        };
        let limit = self.core.options.servo_limit;
        let task =
            Task { what: "ending homing", hint: HINT, limit, commands: &[(slot, command)], resend: true, own: false };
        self.core.run(
            &task,
            |session, sent| Ok(session.executed(sent).then_some(())),
            |session| format!("the board is in {}", session.board.state),
        )
    }
}

fn refuse_aborted(session: &Session, slave: u8) -> Result<(), EcmError> {
    if session.aborted & 1 << slave == 0 {
        return Ok(());
    }
    Err(EcmError::HomingFailed { slave, why: "it was aborted" })
}

/// What is told of an axis.
struct Told {
    slave: u8,
    phase: HomingPhase,
}

impl Told {
    fn now(&self, session: &Session, elapsed: Duration) -> HomingProgress {
        let Self { slave, phase } = *self;
        let position = session.slot(slave.into()).data1 as i32;
        HomingProgress { slave, phase, position, statusword: session.statusword(slave), elapsed }
    }
}

/// One axis on its way home, report by report.
struct Search {
    slave: u8,
    /// The board has taken GO_HOME.
    taken: bool,
    /// Neither a home nor an error was shown once.
    seen_clear: bool,
    /// When it was looked at first.
    since: Option<u64>,
    /// It is home. The board may have set the mode back since, and its bits mean something else.
    home: bool,
}

impl Search {
    const fn of(slave: u8) -> Self {
        Self { slave, taken: false, seen_clear: false, since: None, home: false }
    }

    /// Whether it is home; `ran`: the frame with GO_HOME was executed for sure, or will not be.
    fn look(&mut self, session: &Session, ran: bool, tell: &mut impl FnMut(u8, HomingPhase)) -> Result<bool, EcmError> {
        let slave = self.slave;
        let failed = |why| Err(EcmError::HomingFailed { slave, why });
        let word = session.statusword(slave);
        if !self.taken && !ran {
            return Ok(false);
        }
        if !self.home {
            tell(slave, HomingPhase::Moving);
        }
        refuse_alarm(session, slave)?;
        if session.aborted & 1 << slave != 0 {
            return failed("it was aborted");
        }
        if !word.is_enabled() {
            return failed("the drive was switched off");
        }
        // Bits of an earlier homing may stand: without its answer nothing of them counts.
        if !self.taken {
            return failed("the board did not take GO_HOME, or its frame was lost");
        }
        let (attained, error) = (word.0 & Statusword::BIT12 != 0, word.0 & Statusword::BIT13 != 0);
        self.seen_clear |= !attained && !error;
        let now = session.meta.map_or(0, |meta| meta.at.0);
        let stood = Duration::from_nanos(now - *self.since.get_or_insert(now)) >= STANDS;
        if !self.seen_clear && !stood {
            return Ok(false);
        }
        if error && !self.home {
            return failed("the drive reports a homing error (statusword bit 13)");
        }
        self.home |= attained && word.0 & Statusword::TARGET_REACHED != 0;
        Ok(self.home)
    }
}
