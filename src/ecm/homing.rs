//! Homing of one axis, or of several axes whose GO_HOME commands share a frame (SK-7.27), with progress for the caller.

use std::cell::RefCell;
use std::time::Duration;

use super::exchange::{EFFECT_REPORTS_MAX, Session, Task};
use super::{Ecm, EcmError};
use crate::ethercat::SlaveSet;
use crate::ethercat::cia402::{MODES_OF_OPERATION, Mode, Statusword};
use crate::ethercat::coe::ObjectAddress;
use crate::sk::{CommandId, RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] After GO_HOME, bits 12 and 13 of the statusword may still be those of an earlier homing, until the drive
/// clears them. If no report has shown them clear, they count as the result of this homing after this time.
const OLD_RESULT_MAX: Duration = Duration::from_millis(100);
const HINT: &str = "check method, speeds and switches; the axis was told to end homing";

/// The CiA 402 objects of homing, which are written before GO_HOME. An object that is `None` is not written: the drive
/// keeps its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Homing {
    /// 0x6098: homing method.
    pub method: i8,
    /// 0x6099:1, speed during the search for the switch, in the drive's units.
    pub switch_speed: Option<u32>,
    /// 0x6099:2, speed during the search for zero, in the drive's units.
    pub zero_speed: Option<u32>,
    /// 0x609A, homing acceleration, in the drive's units.
    pub acceleration: Option<u32>,
    /// 0x607C, home offset in counts.
    pub offset: Option<i32>,
    /// The time limit of the motion, after which homing is aborted.
    pub limit: Duration,
}

impl Homing {
    /// Homing by `method`, with all other objects as they are in the drive, and a time limit of one minute.
    pub const fn method(method: i8) -> Self {
        let limit = Duration::from_secs(60);
        Self { method, switch_speed: None, zero_speed: None, acceleration: None, offset: None, limit }
    }
}

/// The phase of the homing of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingPhase {
    /// The objects of the axis are being written.
    Preparing,
    /// The axis moves.
    Moving,
    /// The motion has ended; the mode of operation is being restored.
    Restoring,
}

/// The progress of an axis that is being homed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HomingProgress {
    /// Slave, from 1.
    pub slave: u8,
    /// The phase of the homing.
    pub phase: HomingPhase,
    /// Actual position, counts.
    pub position: i32,
    /// Statusword: bit 10 target reached, 12 homing attained, 13 homing error.
    pub statusword: Statusword,
    /// Time since the call of [`Ecm::home`].
    pub elapsed: Duration,
}

impl Ecm {
    /// Homes an axis that is switched on: writes its objects, sends GO_HOME, waits for the end, and restores the mode
    /// of operation, which firmware 1.5 does not do by itself. `progress` is called with each report and may use the
    /// board, too.
    ///
    /// On an HSP this homes the first channel. The second channel cannot be homed alone. If a program has written mode
    /// 6 to 0x6860, the second channel starts together with the first. Only its own statusword (0x6841, by
    /// [`Ecm::sdo_read`]) shows how its homing ends.
    ///
    /// # Errors
    /// [`EcmError::HomingFailed`] if homing ends without "homing attained", [`EcmError::Alarm`] if the drive has an alarm,
    /// [`EcmError::NotEnabled`] if the axis is off, [`EcmError::SdoAborted`] for an object or method that the drive does not
    /// have, [`EcmError::Timeout`] after the time limit, [`EcmError::Busy`] while another homing runs, [`EcmError::WrongState`]
    /// outside OP, [`EcmError::WrongKind`] and [`EcmError::NoSuchSlave`] for a slave that has no axis or is not configured,
    /// [`EcmError::Link`] if the link fails.
    pub fn home(&self, slave: u8, homing: &Homing, progress: impl FnMut(&HomingProgress)) -> Result<(), EcmError> {
        self.home_all(&[(slave, *homing)], progress)
    }

    /// Homes several axes together: writes the objects of all, starts them with one frame, and waits for the last one.
    /// The longest of their time limits applies to all. If one axis fails, the homing of the others is aborted, and the
    /// call returns the error of that axis.
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
        let began = self.exchange.now();
        let slaves: Vec<u8> = axes.iter().map(|(slave, _)| *slave).collect();
        if let Some((n, slave)) = slaves.iter().enumerate().find(|(n, slave)| slaves[..*n].contains(slave)) {
            let found = format!("slave {slave} at place {}", n + 1);
            return Err(EcmError::Setting { what: "the list of axes to home", found, allowed: "each slave once" });
        }
        let turn = self.exchange.homing_turn.try_lock().ok_or(EcmError::Busy { what: "homing" })?;
        let go = self.axis_commands("homing", &slaves, SlaveCommand::GoHome)?;
        if slaves.is_empty() {
            return Ok(());
        }
        let modes = self.reserve(&slaves)?;
        let limit = axes.iter().map(|(_, homing)| homing.limit).max().unwrap_or_default();
        let prepared = axes.iter().try_for_each(|(slave, homing)| {
            self.tell(*slave, HomingPhase::Preparing, began, &mut progress)?;
            self.prepare(*slave, homing)
        });
        let done = prepared.and_then(|()| self.go(&slaves, &go, limit, began, &mut progress));
        let started = self.exchange.lock().is_ok_and(|session| !session.homing.started.is_empty());
        // \[OURS] No axis may still be homing when this call returns. With the errors HomingFailed and Alarm the homing
        // of one axis has ended by itself, so only other axes may still be homing.
        let goes_on = match &done {
            Ok(()) => false,
            Err(EcmError::HomingFailed { .. } | EcmError::Alarm { .. }) => slaves.len() > 1,
            Err(_) => true,
        };
        let aborted = if started && goes_on { self.abort_homing() } else { Ok(()) };
        // Writing the mode of operation ends homing in firmware 1.5 and 1.7, and lets the axes take targets again. The
        // mode is written to all axes, even if some writes fail.
        let mut restored = Ok(());
        for (slave, mode) in slaves.iter().zip(modes) {
            let told = self.tell(*slave, HomingPhase::Restoring, began, &mut progress);
            let mode_of = ObjectAddress::new(MODES_OF_OPERATION, 0);
            restored = restored.and(told.and_then(|()| self.sdo_write(*slave, mode_of, mode.code())));
        }
        let released = self
            .exchange
            .lock()
            .map(|mut session| slaves.iter().for_each(|slave| session.homing.active.remove(*slave)));
        self.exchange.changed();
        drop(turn);
        done.and(aborted).and(restored).and(released)
    }

    /// Checks that the axes can be homed, and removes the targets that a stream repeats for them. Returns the modes of
    /// operation to restore.
    fn reserve(&self, slaves: &[u8]) -> Result<Vec<Mode>, EcmError> {
        let mut session = self.exchange.lock()?;
        let mut modes = Vec::with_capacity(slaves.len());
        for slave in slaves.iter().copied() {
            let config = *session.network.declared(slave)?;
            session.refuse_alarm(slave)?;
            let statusword = session.statusword(slave);
            if !statusword.is_enabled() {
                return Err(EcmError::NotEnabled { slave, statusword });
            }
            modes.push(config.axis().map_or(Mode::Csp, |axis| axis.mode));
        }
        let homing: SlaveSet = slaves.iter().copied().collect();
        session.homing.active = session.homing.active.union(homing);
        (session.homing.aborted, session.homing.started) = (SlaveSet::EMPTY, SlaveSet::EMPTY);
        session.targets.withdraw(homing);
        self.exchange.changed();
        Ok(modes)
    }

    /// Reports the progress of an axis to the program.
    fn tell(
        &self,
        slave: u8,
        phase: HomingPhase,
        began: Duration,
        progress: &mut impl FnMut(&HomingProgress),
    ) -> Result<(), EcmError> {
        let elapsed = self.exchange.now().saturating_sub(began);
        // The callback may call functions of the board, so it runs without the lock of the session.
        let told = progress_of(&*self.exchange.lock()?, slave, phase, elapsed);
        progress(&told);
        Ok(())
    }

    /// Writes the mode of operation, the method and the other objects of homing to one axis by SDO.
    fn prepare(&self, slave: u8, homing: &Homing) -> Result<(), EcmError> {
        let object = ObjectAddress::new;
        refuse_aborted(&*self.exchange.lock()?, slave)?;
        self.sdo_write(slave, object(MODES_OF_OPERATION, 0), Mode::Homing.code())?;
        self.sdo_write(slave, object(0x6098, 0), homing.method)?;
        refuse_aborted(&*self.exchange.lock()?, slave)?;
        let Homing { switch_speed, zero_speed, acceleration, offset, .. } = *homing;
        let given = [(0x6099, 1, switch_speed), (0x6099, 2, zero_speed), (0x609A, 0, acceleration)].into_iter();
        for (index, sub, value) in given.filter_map(|(index, sub, value)| Some((index, sub, value?))) {
            self.sdo_write(slave, object(index, sub), value)?;
        }
        offset.map_or(Ok(()), |offset| self.sdo_write(slave, object(0x607C, 0), offset))
    }

    /// Sends GO_HOME to all axes in one frame, and waits for at most `limit` until all have attained home.
    fn go(
        &self,
        slaves: &[u8],
        commands: &[(usize, RawSlot)],
        limit: Duration,
        began: Duration,
        progress: &mut impl FnMut(&HomingProgress),
    ) -> Result<(), EcmError> {
        // GO_HOME must not be sent again: if homing has already ended, a second GO_HOME would start it anew. So a lost
        // frame is an error.
        let seen = |session: &Session| {
            let words = slaves.iter().map(|slave| {
                let word = session.statusword(*slave).0;
                format!("slave {slave} shows statusword 0x{word:04X}")
            });
            words.collect::<Vec<_>>().join(", ")
        };
        let task = Task::new("homing", HINT, limit, commands).once().exclusive().seen(&seen);
        let mut axes: Vec<AxisHoming> = slaves.iter().map(|slave| AxisHoming::of(*slave)).collect();
        let told = RefCell::new(Vec::new());
        let mut tell_all = || told.take().iter().for_each(&mut *progress);
        let mut sent_at = None;
        let done = self.exchange.run_with(
            &task,
            |session| {
                session.require_op("homing")?;
                slaves.iter().try_for_each(|slave| refuse_aborted(session, *slave))?;
                session.homing.started = session.homing.active;
                Ok(())
            },
            |session, sent| {
                session.require_op("homing")?;
                let reports = session.stats.reports;
                let is_lost = reports - *sent_at.get_or_insert(reports) > EFFECT_REPORTS_MAX;
                let mut all = true;
                for axis in &mut axes {
                    let slot = usize::from(axis.slave);
                    axis.taken |= session.answer(sent, slot, CommandId::GoHome.code()).is_some();
                    let elapsed = self.exchange.now().saturating_sub(began);
                    let tell = |slave, phase| told.borrow_mut().push(progress_of(session, slave, phase, elapsed));
                    all &= axis.read(session, session.executed(sent) || is_lost, tell)?;
                }
                Ok(all.then_some(()))
            },
            &mut tell_all,
        );
        tell_all();
        done
    }

    /// Aborts the homing of all slaves (ABORT_HOME). A call of [`Ecm::home`] in another thread ends with
    /// [`EcmError::HomingFailed`]. If no axis is being homed, nothing is sent.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] if the board does not answer in time, [`EcmError::WrongState`] outside OP, [`EcmError::Link`] if
    /// the link fails.
    pub fn abort_homing(&self) -> Result<(), EcmError> {
        let (slot, command) = {
            let mut session = self.exchange.lock_in_op("abort_homing")?;
            let Some(slave) = session.homing.active.iter().next() else { return Ok(()) };
            session.homing.aborted = session.homing.active;
            // The objects are still being written, so no axis is homing yet. `aborted` is set, so the call that homes
            // returns an error instead of sending GO_HOME.
            if session.homing.started.is_empty() {
                return Ok(());
            }
            (usize::from(slave), SlotCommand::from(SlaveCommand::AbortHome).encode(session.size))
        };
        let (limit, commands) = (self.exchange.options.servo_limit, [(slot, command)]);
        let task = Task::new("ending homing", HINT, limit, &commands);
        self.exchange.run(&task, |session, sent| Ok(session.executed(sent).then_some(())))
    }
}

fn refuse_aborted(session: &Session, slave: u8) -> Result<(), EcmError> {
    if !session.homing.aborted.contains(slave) {
        return Ok(());
    }
    Err(EcmError::HomingFailed { slave, why: "it was aborted" })
}

/// The progress of an axis, from the newest report.
fn progress_of(session: &Session, slave: u8, phase: HomingPhase, elapsed: Duration) -> HomingProgress {
    let position = session.slot(slave.into()).data1 as i32;
    HomingProgress { slave, phase, position, statusword: session.statusword(slave), elapsed }
}

/// Evaluates the statuswords of one axis during its homing, report by report.
struct AxisHoming {
    slave: u8,
    /// Whether the axis's slot has shown the answer to GO_HOME: the board has accepted it.
    taken: bool,
    /// The bits "homing attained" and "homing error" in the first report after GO_HOME was sent. They may be left from
    /// an earlier homing.
    first: Option<(bool, bool)>,
    /// Whether both bits were clear in a later report, so that bits set after it belong to this homing.
    seen_clear: bool,
    /// Whether "homing error" was set by this homing. The error is kept, since the bit may show it for a short time only:
    /// soon after it the board restores the mode of operation, in which bit 13 means something else. If the slaves answer
    /// late, reports may show the error before the answer to GO_HOME.
    failed: bool,
    /// The time of the first report after the answer to GO_HOME, nanoseconds.
    since: Option<u64>,
    /// Whether homing was attained. This is kept because the board may then restore the mode, in which the bits mean
    /// something else.
    home: bool,
}

impl AxisHoming {
    const fn of(slave: u8) -> Self {
        Self { slave, taken: false, first: None, seen_clear: false, failed: false, since: None, home: false }
    }

    /// Evaluates the newest report. Returns whether homing is attained. `ran`: the board has executed the frame with
    /// GO_HOME, or [`EFFECT_REPORTS_MAX`] reports have not shown that, so that the frame counts as lost.
    fn read(&mut self, session: &Session, ran: bool, tell: impl FnOnce(u8, HomingPhase)) -> Result<bool, EcmError> {
        let slave = self.slave;
        let failed = |why| Err(EcmError::HomingFailed { slave, why });
        let word = session.statusword(slave);
        let (attained, error) = (word.0 & Statusword::BIT12 != 0, word.0 & Statusword::BIT13 != 0);
        let first = *self.first.get_or_insert((attained, error));
        self.failed |= error && !self.home && (self.seen_clear || !first.1);
        self.seen_clear |= !attained && !error;
        if !self.taken && !ran {
            return Ok(false);
        }
        if !self.home {
            tell(slave, HomingPhase::Moving);
        }
        session.refuse_alarm(slave)?;
        if session.homing.aborted.contains(slave) {
            return failed("it was aborted");
        }
        if !word.is_enabled() {
            return failed("the drive was switched off");
        }
        // The slot shows no answer to GO_HOME, so bits 12 and 13 are left from an earlier homing.
        if !self.taken {
            return failed("the board did not take GO_HOME, or its frame was lost");
        }
        let now = session.reports.at().0;
        let is_valid = Duration::from_nanos(now - *self.since.get_or_insert(now)) >= OLD_RESULT_MAX;
        // "Homing error" was set in the first report, and no report has shown both bits clear: the error counts for
        // this homing, even if the bit is clear now.
        let still_failed = first.1 && !self.seen_clear && (is_valid || !error);
        if (self.failed || still_failed) && !self.home {
            return failed("the drive reports a homing error (statusword bit 13)");
        }
        if !self.seen_clear && !is_valid {
            return Ok(false);
        }
        self.home |= attained && word.0 & Statusword::TARGET_REACHED != 0;
        Ok(self.home)
    }
}
