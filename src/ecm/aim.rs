//! Targets on their way into the next frame: what they are checked by, without asking the session for each.

use std::sync::Arc;

use super::EcmError;
use super::config::{Axis, Guard, Slave};
use super::session::Session;
use super::snapshot::Plan;
use super::targets::{Outputs, bits};
use crate::cia402::{Mode, Statusword};
use crate::sk::{
    AxisTarget, DriveResponse, Frame, HspResponse, MasterState, Motion, RawSlot, SlaveCommand, SlotCommand, SlotSize,
    StateByte,
};

/// A look at the session, and the slots of the next frame.
pub(super) struct Aim {
    /// How often anything had changed when it was taken.
    pub(super) changes: u64,
    size: SlotSize,
    plan: Arc<Plan>,
    state: StateByte,
    homing: u64,
    /// Slaves that are lost, and those whose second channel is off, a bit each.
    lost: u64,
    second_off: u64,
    outputs: [Outputs; SlotSize::Bytes12.slots()],
    /// Times the FIFO had been cleared when the stream began, and now.
    clears: [u64; 2],
    report: Frame,
    /// Reports there were when it was taken.
    reports: u64,
    next: Frame,
    /// Slaves that have a target in `next`, a bit each.
    some: u64,
}

impl Aim {
    pub(super) fn new(session: &mut Session, changes: u64) -> Self {
        session.dropped = 0;
        Self {
            changes,
            size: session.size,
            plan: Arc::clone(&session.plan),
            state: session.board.state,
            homing: session.homing,
            lost: session.lost,
            second_off: session.second.off(),
            outputs: *session.targets.outputs(),
            clears: [session.clears; 2],
            report: Frame::clone(&session.report),
            reports: session.stats.reports,
            next: Frame::new(),
            some: 0,
        }
    }

    /// Sees what the session knows now.
    pub(super) fn look(&mut self, session: &mut Session, changes: u64) {
        self.drop_dead(session);
        if self.changes == changes {
            return;
        }
        self.changes = changes;
        if !Arc::ptr_eq(&self.plan, &session.plan) {
            self.plan = Arc::clone(&session.plan);
        }
        self.state = session.board.state;
        self.homing = session.homing;
        self.lost = session.lost;
        self.second_off = session.second.off();
        self.outputs = *session.targets.outputs();
        self.clears[1] = session.clears;
        if self.reports != session.stats.reports {
            self.reports = session.stats.reports;
            self.report.clone_from(&session.report);
        }
    }

    /// Puts the targets into the session's next frame.
    pub(super) fn go(&mut self, session: &mut Session) {
        self.drop_dead(session);
        session.targets.take(&self.next, self.some);
    }

    /// Axes that went off meanwhile, or home, have no target here either.
    fn drop_dead(&mut self, session: &mut Session) {
        let dropped = std::mem::take(&mut session.dropped);
        for slave in bits(dropped & self.some) {
            self.next.put(self.size, slave, &RawSlot::ZERO);
        }
        self.some &= !dropped;
    }

    /// Whether the stream still leads on from where the axes are.
    pub(super) const fn leads_on(&self) -> Result<(), EcmError> {
        if self.clears[0] == self.clears[1] { Ok(()) } else { Err(EcmError::Cleared) }
    }

    /// The settings of a slave's axis.
    pub(super) fn axis(&self, slave: u8) -> Result<&Axis, EcmError> {
        // Each of 40 axes comes by here in a cycle: no error is made that is then dropped.
        let none = || EcmError::NoSuchSlave { slave, declared: self.plan.count };
        let config = self.plan.slave(slave).ok_or_else(none)?;
        config.axis().ok_or_else(|| EcmError::WrongKind {
            slave,
            kind: config.kind().name(),
            what: "a target",
            wanted: "a drive, STEP or HSP",
        })
    }

    /// Takes a target for the next step, if everything allows it.
    pub(super) fn at(&mut self, slave: u8, command: SlaveCommand, guard: bool) -> Result<(), EcmError> {
        let wanted = match command {
            SlaveCommand::Csv(_) => Mode::Csv,
            SlaveCommand::Cst(_) => Mode::Cst,
            _ => Mode::Csp,
        };
        let axis_guard = self.takes(slave, wanted)?;
        if let (SlaveCommand::Csp(motion), Guard::Within(limit), true) = (&command, axis_guard, guard) {
            self.check_guard(slave, motion, limit)?;
        }
        self.put(slave, command);
        Ok(())
    }

    /// As [`Aim::at`], a target for the first axis of a slave, in CSP or CSV. What an HSP does besides stays.
    #[inline]
    pub(super) fn first_at(&mut self, slave: u8, target: i32, mode: Mode, guard: bool) -> Result<(), EcmError> {
        let command = if mode == Mode::Csp { SlaveCommand::Csp } else { SlaveCommand::Csv };
        if matches!(self.plan.slave(slave), Some(Slave::Hsp(_))) {
            let motion = self.first_of_hsp(slave, target, mode);
            return self.at(slave, command(motion), guard);
        }
        // Most axes have one alone, and 40 of them come by here in a cycle.
        let axis_guard = self.takes(slave, mode)?;
        if let (Mode::Csp, Guard::Within(limit), true) = (mode, axis_guard, guard) {
            check(slave, target, self.actual(slave), limit)?;
        }
        self.put(slave, command(Motion::to(target)));
        Ok(())
    }

    /// Whether a slave takes a target in that mode now; gives its guard.
    #[inline]
    fn takes(&self, slave: u8, wanted: Mode) -> Result<Guard, EcmError> {
        if self.state.state() != Some(MasterState::Op) {
            return Err(EcmError::WrongState { what: "a target", needs: "OP", found: self.state });
        }
        self.leads_on()?;
        let axis = self.axis(slave)?;
        if axis.mode != wanted {
            return Err(EcmError::WrongMode { slave, mode: axis.mode, wanted });
        }
        if self.homing & 1 << slave != 0 {
            return Err(EcmError::IsHoming { slave });
        }
        if self.lost & 1 << slave != 0 {
            return Err(EcmError::SlaveLost { slave: Some(slave), found: self.state });
        }
        let statusword = Statusword(self.report.slots(self.size).head(slave.into()).parm.get());
        if !statusword.is_enabled() {
            return Err(self.off(slave, statusword));
        }
        if self.second_off & 1 << slave != 0 {
            return Err(EcmError::SecondOff { slave });
        }
        Ok(axis.guard)
    }

    #[inline]
    fn put(&mut self, slave: u8, command: SlaveCommand) {
        self.next.put(self.size, slave.into(), &SlotCommand::from(command).encode(self.size));
        self.some |= 1 << slave;
    }

    /// The actual position of a slave's first axis, by the newest report.
    #[inline]
    fn actual(&self, slave: u8) -> i32 {
        self.report.slots(self.size).head(slave.into()).data1.get() as i32
    }

    /// A target for the first axis of an HSP. What it does besides stays: its outputs, and its second axis, which goes on
    /// with its last target; without one it stays where it is.
    fn first_of_hsp(&self, slave: u8, target: i32, mode: Mode) -> Motion {
        let slot = self.next.slot(self.size, slave.into());
        let motion = match SlotCommand::decode(&slot, self.size).map(|slot| slot.command) {
            Ok(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) => motion,
            _ => {
                let [first, second] = self.outputs[usize::from(slave)];
                let hsp = HspResponse::decode(&self.report.slot(self.size, slave.into()), self.size);
                let rests = if mode == Mode::Csp { hsp.second.position } else { 0 };
                let at = |target, outputs| AxisTarget { target, outputs };
                Motion { first: at(0, first), second: at(rests, second) }
            }
        };
        Motion { first: AxisTarget { target, ..motion.first }, ..motion }
    }

    /// Why an axis that is off takes no target.
    fn off(&self, slave: u8, statusword: Statusword) -> EcmError {
        if statusword.0 & Statusword::FAULT == 0 {
            return EcmError::NotEnabled { slave, statusword };
        }
        let code = match self.plan.slave(slave) {
            Some(Slave::Hsp(_)) => 0,
            _ => DriveResponse::decode(&self.report.slot(self.size, slave.into())).error_code,
        };
        EcmError::Alarm { slave, code }
    }

    /// Refuses targets that are too far away.
    fn check_guard(&self, slave: u8, motion: &Motion, limit: u32) -> Result<(), EcmError> {
        check(slave, motion.first.target, self.actual(slave), limit)?;
        if self.size == SlotSize::Bytes16 && matches!(self.plan.slave(slave), Some(Slave::Hsp(_))) {
            let hsp = HspResponse::decode(&self.report.slot(self.size, slave.into()), self.size);
            check(slave, motion.second.target, hsp.second.position, limit)?;
        }
        Ok(())
    }
}

/// Refuses a target that is too far away. Positions wrap, as the wire's 32 bits do.
#[inline]
fn check(slave: u8, target: i32, actual: i32, limit: u32) -> Result<(), EcmError> {
    if target.wrapping_sub(actual).unsigned_abs() > limit {
        return Err(EcmError::TooFar { slave, target, actual, limit });
    }
    Ok(())
}
