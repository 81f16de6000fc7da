//! GO_HOME, ABORT_HOME and everything that ends homing (SK-7), for all slaves. `homing.rs` has the homing of one axis.

use super::commands::check_kind;
use super::homing::{Answer, HomingEnd, HomingEvent};
use super::{Engine, Event, EventKind, Reason};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::{CycleDone, MAX_AXES, MAX_SLAVES, Ns, SlaveSet};
use crate::sk::{CommandId, Frame, SlaveCommand, SlotKind};

/// Whether a slave is homing, or is finishing the steps after homing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum HomingPhase {
    /// The slave is not homing.
    #[default]
    Idle,
    /// GO_HOME was executed, and at least one axis of the slave is still homing.
    Homing,
    /// Homing has ended, and the board has not yet restored the mode that DRIVE_MODE has set. Firmware 1.5 restores no modes:
    /// there the slave is [`HomingPhase::Idle`] at once.
    Restoring,
}

impl Engine {
    /// The homing phase of a slave (from 1). Unless it is [`HomingPhase::Idle`], all commands for the slave except
    /// SV_OFF, ALM_CLR and ABORT_HOME are ignored.
    pub fn homing_phase(&self, slave: u8) -> HomingPhase {
        let Some(axes) = usize::from(slave).checked_sub(1).and_then(|n| self.axes.get(n)) else {
            return HomingPhase::Idle;
        };
        if !self.volatile.homing_active.contains(slave) && !self.volatile.restores.concern(slave) {
            return HomingPhase::Idle;
        }
        if axes.iter().any(|axis| axis.homing.is_homing()) {
            return HomingPhase::Homing;
        }
        let restoring = axes.iter().any(|axis| axis.homing.is_ending()) || self.volatile.restores.concern(slave);
        if restoring && self.config.firmware.restores_mode() { HomingPhase::Restoring } else { HomingPhase::Idle }
    }

    /// The slaves that have an axis that is homing.
    pub(super) fn homing_slaves(&self) -> SlaveSet {
        let mut slaves = SlaveSet::EMPTY;
        if self.volatile.homing_active.is_empty() {
            return slaves;
        }
        for slave in self.volatile.homing_active.iter() {
            if self.axes[usize::from(slave) - 1].iter().any(|axis| axis.homing.is_homing()) {
                slaves.insert(slave);
            }
        }
        slaves
    }

    /// Decides whether a motion command is ignored because the slave is homing, and if so counts it in
    /// [`Counters::ignored_homing`](super::Counters).
    ///
    /// A slave that was homing before this frame still counts as homing if an ABORT_HOME in an earlier slot has ended
    /// its homing \[OURS]: so the order of the slots does not change the result of a command.
    pub(super) fn ignores_motion(&mut self, slave: usize) -> bool {
        let slave = slave as u8;
        let ignored = self.homing_before.contains(slave) || self.homing_phase(slave) != HomingPhase::Idle;
        self.counters.ignored_homing += u64::from(ignored);
        ignored
    }

    /// GO_HOME. Homing starts after all slots of the frame are executed, for those axes of the slave whose 0x6060 /
    /// 0x6860 is 6. On a module of two channels with 12-byte slots only axis 1 may start, as every command there moves
    /// axis 1 alone (SK-3 \[OURS]).
    ///
    /// SK-7 \[OURS]: for a drive that SV_ON has not brought to Operation enabled the command is rejected and not kept, so that
    /// a later SV_ON does not make it start homing. If one of several axes is not enabled, none of them starts.
    pub(super) fn go_home(&mut self, slave: usize) -> Result<(), Reason> {
        let axes = 1 + usize::from(self.carries_two_channels(slave));
        let modes = self.volatile.modes_written[slave - 1];
        let is_chosen = |axis: &usize| modes[*axis] == Mode::Homing.code();
        if !(0..axes).any(|axis| is_chosen(&axis)) {
            return Err(Reason::NotInHomingMode);
        }
        if self.homing_elsewhere {
            return Err(Reason::HomingElsewhere);
        }
        let axes_of_slave = &self.axes[slave - 1];
        if !(0..axes).filter(is_chosen).all(|axis| axes_of_slave[axis].is_on()) {
            return Err(Reason::NotEnabled);
        }
        self.go_homes.insert(slave as u8);
        Ok(())
    }

    /// Called when all slots of a frame were executed: starts the homing of all slaves with a GO_HOME in the frame
    /// together. SK-7 \[OURS]: an ABORT_HOME in the same frame prevents that, whichever slot holds it.
    #[inline]
    pub(super) fn start_homing(&mut self) {
        let slaves = std::mem::take(&mut self.go_homes);
        if std::mem::take(&mut self.aborts_homing) {
            self.counters.ignored_homing += slaves.len() as u64;
            return;
        }
        for slave in slaves.iter().map(usize::from) {
            let modes = self.volatile.modes_written[slave - 1];
            let axes = 1 + usize::from(self.carries_two_channels(slave));
            for (axis, mode) in self.axes[slave - 1].iter_mut().zip(modes).take(axes) {
                if mode == Mode::Homing.code() {
                    axis.homing.start();
                }
            }
            self.volatile.homing_active.insert(slave as u8);
        }
    }

    /// Whether every GO_HOME of this frame is to be rejected because slaves are homing. Called before any slot of the
    /// frame is executed.
    ///
    /// SK-7.27 \[OURS]: if an SV_OFF in the frame ends the homing of another slave, the GO_HOME is rejected all the
    /// same, whichever slot is first. In a frame with an ABORT_HOME no GO_HOME is rejected for this reason, since none
    /// of them starts: each is only answered (SK-7.56).
    pub(super) fn excludes_go_home(&self, frame: &Frame) -> bool {
        self.config.firmware.one_homing_at_a_time()
            && self.is_any_homing_of(self.homing_before)
            && !self.has_abort_home(frame)
    }

    /// Whether a slot of this frame has an ABORT_HOME that is not rejected.
    fn has_abort_home(&self, frame: &Frame) -> bool {
        let size = self.config.slot;
        self.admit(CommandId::AbortHome, SlotKind::Slave).is_ok()
            && (1..=size.max_slaves()).any(|slave| {
                frame.slot(size, slave).id == CommandId::AbortHome.code()
                    && check_kind(&SlaveCommand::AbortHome, self.role(slave)).is_ok()
            })
    }

    /// Whether an axis of these slaves is homing. An axis does not count once a report has shown the result of its homing to
    /// the host, even if the board still waits to accept the result.
    fn is_any_homing_of(&self, slaves: SlaveSet) -> bool {
        slaves.iter().any(|slave| {
            let axes = &self.axes[usize::from(slave) - 1];
            let inputs = &self.inputs.slaves[usize::from(slave) - 1];
            axes.iter().zip(inputs).any(|(axis, input)| {
                axis.homing.is_homing() && !axis.homing.seems_over(self.newest_answered, input.statusword)
            })
        })
    }

    /// ABORT_HOME in the slot of any slave: ends the homing of all slaves, and keeps each GO_HOME of the same frame from
    /// starting.
    pub(super) fn abort_home_in_frame(&mut self, at: Ns) {
        self.aborts_homing = true;
        self.abort_home(at);
    }

    /// Ends the homing of all slaves.
    fn abort_home(&mut self, at: Ns) {
        for slave in 1..=MAX_SLAVES {
            self.end_homing(slave, HomingEnd::Aborted, at);
        }
    }

    /// Ends the homing of all axes of a slave. `end` is the cause.
    pub(super) fn end_homing(&mut self, slave: usize, end: HomingEnd, at: Ns) {
        for axis in 0..MAX_AXES {
            self.end_homing_of_axis(slave, axis, end, at);
        }
    }

    /// Ends the homing of one axis. `end` is the cause.
    pub(super) fn end_homing_of_axis(&mut self, slave: usize, axis: usize, end: HomingEnd, at: Ns) {
        if self.axes[slave - 1][axis].homing.end(end) {
            self.log.push(Event { at, kind: EventKind::HomingEnded { slave: slave as u8, axis: axis as u8, end } });
        }
    }

    /// Evaluates the inputs of a cycle for all axes that are homing or have not finished the steps after a homing.
    pub(super) fn answer_homing(&mut self, done: &CycleDone) {
        let (outputs_received, period_ns) = (self.newest_answered, self.period_ns());
        if self.volatile.homing_active.is_empty() {
            return;
        }
        // The inputs of some slaves were kept from an earlier cycle (`held`). They do not answer the outputs of this
        // cycle, so these slaves are left out.
        for slave in self.volatile.homing_active.difference(self.inputs.held).iter().map(usize::from) {
            if self.axes[slave - 1].iter().all(|axis| axis.homing.is_idle()) {
                self.volatile.homing_active.remove(slave as u8);
                continue;
            }
            for axis in 0..MAX_AXES {
                let homing = &mut self.axes[slave - 1][axis].homing;
                if homing.is_idle() {
                    continue;
                }
                let statusword = self.inputs.slaves[slave - 1][axis].statusword;
                match homing.take_answer(&Answer { statusword, outputs_received, period_ns }) {
                    Some(HomingEvent::Ended(end)) => {
                        self.log.push(Event {
                            at: done.at,
                            kind: EventKind::HomingEnded { slave: slave as u8, axis: axis as u8, end },
                        });
                    }
                    Some(HomingEvent::AtStandstill) => self.restore_later(slave, axis),
                    None => {}
                }
            }
        }
    }

    /// Ends the homing of a lost slave and stops restoring its mode, since the slave answers no SDO.
    pub(super) fn end_homing_of_lost(&mut self, slave: usize, at: Ns) {
        self.end_homing(slave, HomingEnd::Lost, at);
        for axis in 0..MAX_AXES {
            let homing = &mut self.axes[slave - 1][axis].homing;
            if homing.is_ending() {
                homing.skip_standstill();
                self.restore_later(slave, axis);
            }
            self.give_up_restore_of_lost(slave as u8, axis, at);
        }
    }

    /// Called when the network leaves OP: ends all homing. The board restores the modes of operation while the network is
    /// in SafeOP. In a lower state it does not, since the next change to SafeOP writes the modes anyway.
    pub(super) fn leave_homing_with_op(&mut self, at: Ns) {
        for slave in 1..=MAX_SLAVES {
            self.end_homing(slave, HomingEnd::LeftOp, at);
            for axis in 0..MAX_AXES {
                if self.axes[slave - 1][axis].homing.is_ending() {
                    self.restore_later(slave, axis);
                }
            }
        }
    }
}
