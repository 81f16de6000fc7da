//! The targets for the next step of a stream. A target is checked when the program sets it. The checks use a copy of
//! the session's state, so that they take no lock.

use std::sync::Arc;

use crate::address::scale::SoftLimits;
use crate::ecm::EcmError;
use crate::ecm::config::{Axis, Guard, Slave};
use crate::ecm::exchange::Session;
use crate::ecm::exchange::cyclic_targets::Outputs;
use crate::ecm::network::Network;
use crate::ethercat::SlaveSet;
use crate::ethercat::cia402::{Mode, Statusword};
use crate::sk::{
    AxisTarget, CommandId, Frame, HspResponse, MasterState, Motion, RawSlot, SlaveCommand, SlotCommand, SlotSize,
    StateByte,
};

/// The targets of the next step, and the copy of the session's state for their checks.
pub(super) struct CheckedTargets {
    /// The generation counter of the session when the copy was made. If the session's counter differs, the copy is out of
    /// date.
    pub(super) changes: u64,
    size: SlotSize,
    network: Arc<Network>,
    state: StateByte,
    /// Whether any axis may get a target: the network is in OP, and the FIFO was not cleared since the stream began.
    takes_targets: bool,
    /// Slaves whose axes are being homed.
    homing: SlaveSet,
    lost: SlaveSet,
    /// Slaves that take no target, because they are homing or lost, or because their second channel is off.
    refused: SlaveSet,
    /// The digital outputs last sent to HSPs, by slot.
    outputs: [Outputs; SlotSize::Bytes12.slots()],
    /// The number of FIFO clears when the stream began, and when the state was copied. If they differ, the stream takes
    /// no more targets.
    fifo_clears: [u64; 2],
    report: Frame,
    /// The number of reports read when the state was copied. If the session has read more, `report` is copied again.
    reports: u64,
    /// The targets of the next step, by slot.
    next: Frame,
    /// Slaves that have a target in `next`.
    set: SlaveSet,
}

impl CheckedTargets {
    pub(super) fn new(session: &mut Session, changes: u64) -> Self {
        let _ = session.targets.take_withdrawn();
        let mut targets = Self {
            changes,
            size: session.size,
            network: Arc::clone(&session.network),
            state: session.board().state,
            takes_targets: false,
            homing: SlaveSet::EMPTY,
            lost: SlaveSet::EMPTY,
            refused: SlaveSet::EMPTY,
            outputs: *session.targets.outputs(),
            fifo_clears: [session.fifo_clears; 2],
            report: Frame::clone(&session.reports.newest),
            reports: session.stats.reports,
            next: Frame::new(),
            set: SlaveSet::EMPTY,
        };
        targets.copy_checks(session);
        targets
    }

    /// Copies the state of the session again, if the generation counter `changes` differs from that of the copy.
    pub(super) fn refresh(&mut self, session: &mut Session, changes: u64) {
        self.drop_withdrawn(session);
        if self.changes == changes {
            return;
        }
        self.changes = changes;
        if !Arc::ptr_eq(&self.network, &session.network) {
            self.network = Arc::clone(&session.network);
        }
        self.copy_checks(session);
        self.outputs = *session.targets.outputs();
        if self.reports != session.stats.reports {
            self.reports = session.stats.reports;
            self.report.clone_from(&session.reports.newest);
        }
    }

    fn copy_checks(&mut self, session: &Session) {
        self.state = session.board().state;
        self.fifo_clears[1] = session.fifo_clears;
        self.takes_targets = session.in_op() && self.require_uncleared().is_ok();
        self.homing = session.homing.active;
        self.lost = session.lost;
        self.refused = self.homing.union(self.lost).union(session.second_channels.off());
    }

    /// Passes the targets to the session for its next frame.
    pub(super) fn hand_over(&mut self, session: &mut Session) {
        self.drop_withdrawn(session);
        session.targets.set_all(&self.next, self.set);
    }

    /// Drops targets for axes whose targets the session has withdrawn, because these axes went off or are homing.
    fn drop_withdrawn(&mut self, session: &mut Session) {
        let withdrawn = session.targets.take_withdrawn();
        for slave in withdrawn.intersection(self.set).iter() {
            self.next.put(self.size, slave.into(), &RawSlot::ZERO);
        }
        self.set = self.set.difference(withdrawn);
    }

    /// Returns an error if the FIFO was cleared since the stream began: targets would not continue the positions of the
    /// axes.
    pub(super) const fn require_uncleared(&self) -> Result<(), EcmError> {
        if self.fifo_clears[0] == self.fifo_clears[1] { Ok(()) } else { Err(EcmError::Cleared) }
    }

    /// The settings of a slave's axis.
    pub(super) fn axis(&self, slave: u8) -> Result<&Axis, EcmError> {
        self.network.axis(slave, "a target")
    }

    /// Sets the target of a slave for the next step, after all checks. `guard`: whether the guard of the axis is
    /// applied.
    pub(super) fn set(&mut self, slave: u8, command: SlaveCommand, guard: bool) -> Result<(), EcmError> {
        let wanted = match command {
            SlaveCommand::Csv(_) => Mode::Csv,
            SlaveCommand::Cst(_) => Mode::Cst,
            _ => Mode::Csp,
        };
        let axis = self.check_axis(slave, wanted)?;
        if let SlaveCommand::Csp(motion) = &command {
            self.check_limits(slave, motion.first.target, axis.limits)?;
            if let (Guard::Within(limit), true) = (axis.guard, guard) {
                self.check_guard(slave, motion, limit)?;
            }
        }
        self.put(slave, command);
        Ok(())
    }

    /// As [`CheckedTargets::set`], for a slave of which the program sets only the first axis, in CSP or CSV. On an HSP
    /// the outputs and the target of the second axis keep their last values.
    #[inline]
    pub(super) fn set_first(&mut self, slave: u8, target: i32, mode: Mode, guard: bool) -> Result<(), EcmError> {
        if matches!(self.network.slave(slave), Some(Slave::Hsp(_))) {
            let motion = self.first_of_hsp(slave, target, mode);
            let command = if mode == Mode::Csp { SlaveCommand::Csp(motion) } else { SlaveCommand::Csv(motion) };
            return self.set(slave, command, guard);
        }
        // All kinds except HSP have one axis. This path is kept short, since 40 axes may take it in a cycle.
        let axis = self.check_axis(slave, mode)?;
        let motion = Motion::to(target);
        if mode != Mode::Csp {
            self.put(slave, SlaveCommand::Csv(motion));
            return Ok(());
        }
        self.check_limits(slave, target, axis.limits)?;
        if let (Guard::Within(limit), true) = (axis.guard, guard) {
            check_distance(slave, target, self.actual(slave), limit)?;
        }
        self.put(slave, SlaveCommand::Csp(motion));
        Ok(())
    }

    /// Checks whether a slave takes a target in the mode `wanted` now. Returns its axis.
    #[inline]
    fn check_axis(&self, slave: u8, wanted: Mode) -> Result<Axis, EcmError> {
        if !self.takes_targets {
            return Err(self.why_none());
        }
        let axis = self.axis(slave)?;
        if axis.mode != wanted {
            return Err(EcmError::WrongMode { slave, mode: axis.mode, wanted });
        }
        let statusword = Statusword(self.report.slots(self.size).head(slave.into()).parm.get());
        if self.refused.contains(slave) || !statusword.is_enabled() {
            return Err(self.why_refused(slave, statusword));
        }
        Ok(*axis)
    }

    /// The error for a stream in which no axis may get a target.
    #[cold]
    fn why_none(&self) -> EcmError {
        if self.state.state() == Some(MasterState::Op) {
            EcmError::Cleared
        } else {
            EcmError::WrongState { what: "a target", needs: "OP", found: self.state }
        }
    }

    /// The error for an axis that takes no target: it is homing, lost or off.
    #[cold]
    fn why_refused(&self, slave: u8, statusword: Statusword) -> EcmError {
        if self.homing.contains(slave) {
            EcmError::IsHoming { slave }
        } else if self.lost.contains(slave) {
            EcmError::SlaveLost { slave: Some(slave), found: self.state }
        } else if !statusword.is_enabled() {
            self.why_off(slave, statusword)
        } else {
            EcmError::SecondOff { slave }
        }
    }

    // Always inlined: where the kind of command is known, the compiler then leaves out the code for all other kinds.
    #[inline(always)]
    fn put(&mut self, slave: u8, command: SlaveCommand) {
        self.next.put(self.size, slave.into(), &SlotCommand::from(command).encode(self.size));
        self.set.insert(slave);
    }

    /// The actual position of a slave's first axis, by the newest report.
    #[inline]
    fn actual(&self, slave: u8) -> i32 {
        self.report.slots(self.size).head(slave.into()).data1.get() as i32
    }

    /// The motion of an HSP whose first axis gets `target`. The outputs stay unchanged. The second axis keeps its last
    /// target. If it has had none, it gets its actual position in CSP, and velocity 0 in CSV.
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

    /// The error for an axis that is off, with or without an alarm.
    fn why_off(&self, slave: u8, statusword: Statusword) -> EcmError {
        if statusword.0 & Statusword::FAULT == 0 {
            return EcmError::NotEnabled { slave, statusword };
        }
        self.network.alarm(slave, &self.report.slot(self.size, slave.into()))
    }

    /// Returns an error if a target is beyond the soft limits of the axis and leads further out. An axis that stands, or had
    /// its last target, beyond them may come back.
    #[inline]
    fn check_limits(&self, slave: u8, target: i32, limits: SoftLimits) -> Result<(), EcmError> {
        if limits.contains(target) { Ok(()) } else { self.check_way_back(slave, target, limits) }
    }

    /// As [`CheckedTargets::check_limits`], for a target beyond the limits.
    #[cold]
    fn check_way_back(&self, slave: u8, target: i32, limits: SoftLimits) -> Result<(), EcmError> {
        let last = self.next.slot(self.size, slave.into());
        let last = (CommandId::from_code(last.id) == CommandId::Csp).then_some(last.data1 as i32);
        let covers = |at: i32| SoftLimits::is_covered(limits.excess(target), limits.excess(at));
        if covers(self.actual(slave)) || last.is_some_and(covers) {
            return Ok(());
        }
        Err(EcmError::SoftLimit { slave, target, limits })
    }

    /// Returns an error if a target is farther from the axis's actual position than `limit` counts.
    fn check_guard(&self, slave: u8, motion: &Motion, limit: u32) -> Result<(), EcmError> {
        check_distance(slave, motion.first.target, self.actual(slave), limit)?;
        if self.size == SlotSize::Bytes16 && matches!(self.network.slave(slave), Some(Slave::Hsp(_))) {
            let hsp = HspResponse::decode(&self.report.slot(self.size, slave.into()), self.size);
            check_distance(slave, motion.second.target, hsp.second.position, limit)?;
        }
        Ok(())
    }
}

/// Returns an error if a target is more than `limit` counts from the actual position. Positions wrap around at 32 bits.
#[inline]
fn check_distance(slave: u8, target: i32, actual: i32, limit: u32) -> Result<(), EcmError> {
    if target.wrapping_sub(actual).unsigned_abs() > limit {
        return Err(EcmError::TooFar { slave, target, actual, limit });
    }
    Ok(())
}
