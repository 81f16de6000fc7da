//! Restores the mode of operation after homing (SK-7, firmware 1.7): during homing 0x6060 is 6, and afterwards the board writes
//! the mode that DRIVE_MODE has set, by SDO transfers of its own.

use super::homing::HomingEnd;
use super::{Engine, Event, EventKind};
use crate::ethercat::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{Fieldbus, MAX_AXES, MAX_SLAVES, Ns, SdoRequest, SlaveSet};
use crate::sk::MasterState;

/// The number of attempts to restore a mode \[OURS]. If all fail, the drive stays in homing mode, which is counted and
/// logged.
const ATTEMPTS_MAX: u8 = 3;

/// An axis whose mode of operation the board restores after homing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Restore {
    slave: u8,
    axis: usize,
}

/// The side that requested the running SDO transfer. A transfer of the host may run during a change of state (SK-6), so
/// that a slave that is slow to change its state does not block the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SdoOwner {
    Host,
    Restore(Restore),
}

/// Which axes wait for the restore of their mode of operation, and the restore in progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct Restores {
    /// For each axis number, the slaves on which the mode of that axis has to be restored.
    due: [SlaveSet; MAX_AXES],
    /// For each axis in `due`: how many attempts to restore its mode have failed.
    failed: [[u8; MAX_AXES]; MAX_SLAVES],
    running: Option<Restore>,
}

impl Restores {
    pub(super) const fn new() -> Self {
        Self { due: [SlaveSet::EMPTY; MAX_AXES], failed: [[0; MAX_AXES]; MAX_SLAVES], running: None }
    }

    /// Whether the mode of operation of an axis of this slave is being restored after homing, or still has to be.
    pub(super) fn concern(&self, slave: u8) -> bool {
        self.due.iter().any(|due| due.contains(slave)) || self.running.is_some_and(|running| running.slave == slave)
    }

    /// Gives up restoring any modes of operation. A transfer in progress continues.
    pub(super) fn cancel_all(&mut self) {
        *self = Self { running: self.running, ..Self::new() };
    }

    /// Gives up restoring modes of operation on one slave. A transfer in progress continues.
    pub(super) fn cancel_slave(&mut self, slave: u8) {
        (0..MAX_AXES).for_each(|axis| self.cancel(Restore { slave, axis }));
    }

    fn cancel(&mut self, Restore { slave, axis }: Restore) {
        self.due[axis].remove(slave);
        self.failed[usize::from(slave) - 1][axis] = 0;
    }

    fn failures(&mut self, Restore { slave, axis }: Restore) -> &mut u8 {
        &mut self.failed[usize::from(slave) - 1][axis]
    }
}

/// The axis (from 0) to which an object for the mode of operation belongs: 0 for 0x6060, 1 for 0x6860. `None` for any
/// other object.
pub(super) const fn mode_object(object: ObjectAddress) -> Option<usize> {
    const SECOND: u16 = MODES_OF_OPERATION + SECOND_AXIS_OFFSET;
    match (object.index, object.sub) {
        (MODES_OF_OPERATION, 0) => Some(0),
        (SECOND, 0) => Some(1),
        _ => None,
    }
}

/// The slave and axis (from 0) whose mode of operation a download to this object writes; `None`: it writes no mode.
pub(super) fn mode_write((slave, object): (u8, ObjectAddress)) -> Option<(usize, usize)> {
    Some((slave.into(), mode_object(object)?))
}

impl Engine {
    /// Called when the homing of an axis has ended and its mode may change: schedules the restore of the mode.
    pub(super) fn restore_later(&mut self, slave: usize, axis: usize) {
        if self.config.firmware.restores_mode() {
            self.volatile.restores.due[axis].insert(slave as u8);
        }
    }

    /// Starts restoring the mode of the next axis. Axes with fewer failed attempts go first, so that one that fails does not
    /// hold up the others. A slave has to wait while one of its axes is homing.
    pub(super) fn start_restore(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.volatile.restores.due.iter().all(|due| due.is_empty()) {
            return;
        }
        // A lost slave takes no SDO, so its mode cannot be written.
        let not_yet = self.homing_slaves().union(self.network().lost());
        let restores = &mut self.volatile.restores;
        let due = (0..MAX_AXES).flat_map(|axis| restores.due[axis].iter().map(move |slave| Restore { slave, axis }));
        let ready = due.filter(|restore| !not_yet.contains(restore.slave));
        let next = ready.min_by_key(|restore| restores.failed[usize::from(restore.slave) - 1][restore.axis]);
        let Some(restore) = next else { return };
        let Some(mode) = self.role(restore.slave.into()).mode() else {
            return self.volatile.restores.cancel(restore);
        };
        let request = SdoRequest {
            slave: restore.slave,
            object: ObjectAddress::new(MODES_OF_OPERATION + SECOND_AXIS_OFFSET * restore.axis as u16, 0),
            write: Some((SdoSize::One, mode.code().into())),
            timeout_ns: self.config.sdo_timeout_ns,
        };
        if bus.start_sdo(request, now).is_ok() {
            self.volatile.restores.running = Some(restore);
            self.sdo_owner = Some(SdoOwner::Restore(restore));
        }
    }

    /// Handles the end of the transfer that restores the mode of an axis.
    pub(super) fn restored(&mut self, restore: Restore, result: Result<u32, AbortCode>, now: Ns) {
        self.volatile.restores.running = None;
        match result {
            Ok(mode) => {
                self.note_mode(restore.slave, restore.axis, mode as u8);
                self.volatile.restores.cancel(restore);
            }
            // Below SafeOP nothing has to be restored, since the next change to SafeOP writes the mode.
            Err(_) if self.network().state() < Some(MasterState::SafeOp) => self.volatile.restores.cancel(restore),
            Err(code) => {
                let failures = self.volatile.restores.failures(restore);
                *failures += 1;
                if *failures >= ATTEMPTS_MAX {
                    self.give_up_restore(restore, code, now);
                }
            }
        }
    }

    /// Called when the host has written a mode of operation by SDO: the board does not overwrite it by a restore.
    ///
    /// SK-6.5 \[OURS]: on a pulse module of two channels each axis has a mode of its own, so that the write concerns the homing
    /// of that axis alone. A program may set the mode of the axis that is home while the other one is still homing.
    pub(super) fn mode_written(&mut self, slave: u8, axis: usize, mode: u8, now: Ns) {
        self.note_mode(slave, axis, mode);
        self.volatile.restores.cancel(Restore { slave, axis });
        self.end_homing_of_axis(slave.into(), axis, HomingEnd::ModeWritten, now);
        // The mode has already changed, so the board does not wait for a standstill of the axis first.
        let since = self.answers_valid_from(now);
        let homing = &mut self.axes[usize::from(slave) - 1][axis].homing;
        homing.skip_standstill();
        homing.mode_written(since);
    }

    /// Called when a write of 0x6060 has succeeded: the axis is in this mode, and takes targets if DRIVE_MODE has set the same
    /// mode.
    fn note_mode(&mut self, slave: u8, axis: usize, mode: u8) {
        let n = usize::from(slave) - 1;
        self.volatile.modes_written[n][axis] = mode;
        let in_mode = self.role(slave.into()).mode().is_some_and(|declared| declared.code() == mode);
        let newest = self.inputs.slaves[n][axis].statusword.state();
        self.axes[n][axis].mode_written(newest, in_mode);
    }

    /// Returns whether the waiting SDO transfer of the host has to wait longer, because it writes the mode of an axis
    /// that has not come to a standstill after homing. If the axis is still homing, this ends the homing first, because
    /// the host wants another mode.
    pub(super) fn holds_mode_write(&mut self, now: Ns) -> bool {
        let Some((slave, axis)) = self.volatile.sdo.waiting_write().and_then(mode_write) else { return false };
        self.end_homing_of_axis(slave, axis, HomingEnd::ModeWritten, now);
        self.axes[slave - 1][axis].homing.is_ending()
    }

    /// Delays a GO_HOME while an earlier SDO write of the host to the mode of the same axis is under way. When that write
    /// ends, it ends homing. If GO_HOME did not wait, its homing would be ended in the middle of the motion, while the
    /// CSP target is still a position from before homing.
    pub(super) fn hold_go_home(&mut self) {
        let Some((slave, axis)) = self.volatile.sdo.running_write().and_then(mode_write) else { return };
        self.axes[slave - 1][axis].homing.wait();
    }

    /// Stops restoring the mode of an axis because its slave is lost.
    pub(super) fn give_up_restore_of_lost(&mut self, slave: u8, axis: usize, now: Ns) {
        let restore = Restore { slave, axis };
        if self.volatile.restores.due[axis].contains(slave) && self.volatile.restores.running != Some(restore) {
            self.give_up_restore(restore, AbortCode::TIMEOUT, now);
        }
    }

    fn give_up_restore(&mut self, restore: Restore, code: AbortCode, at: Ns) {
        self.volatile.restores.cancel(restore);
        self.counters.modes_not_restored += 1;
        self.log.push(Event {
            at,
            kind: EventKind::ModeNotRestored { slave: restore.slave, axis: restore.axis as u8, code },
        });
    }
}
