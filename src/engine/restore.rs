//! The mode after homing (SK-7, firmware 1.7): SDO transfers of the board's own that write DRIVE_MODE's mode back.

use super::homing::HomingEnd;
use super::jobs::{SdoOwner, mode_object};
use super::{Engine, Event};
use crate::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{Fieldbus, Job, MAX_AXES, MAX_SLAVES, Ns, SdoRequest, SlaveSet};
use crate::sk::MasterState;

/// A transfer that fails is tried so often \[OURS]; then the drive stays in mode 6, which is counted and logged.
const TRIES: u8 = 3;

/// The axis whose mode is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Restore {
    slave: u8,
    axis: usize,
}

/// Modes to be written back.
#[derive(Clone, Copy, Debug)]
pub(super) struct Restores {
    due: [SlaveSet; MAX_AXES],
    /// Transfers that failed, of those that are due.
    failed: [[u8; MAX_AXES]; MAX_SLAVES],
    running: Option<Restore>,
}

impl Restores {
    pub(super) const fn new() -> Self {
        Self { due: [SlaveSet::EMPTY; MAX_AXES], failed: [[0; MAX_AXES]; MAX_SLAVES], running: None }
    }

    /// Whether one for that slave is due or under way.
    pub(super) fn concern(&self, slave: u8) -> bool {
        self.due.iter().any(|due| due.contains(slave)) || self.running.is_some_and(|running| running.slave == slave)
    }

    /// Whatever is not under way is not done any more.
    pub(super) fn cancel_all(&mut self) {
        *self = Self { running: self.running, ..Self::new() };
    }

    /// As [`Self::cancel_all`], of one slave.
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

impl Engine {
    /// Homing of that axis has ended, and its mode may change.
    pub(super) fn restore_later(&mut self, slave: usize, axis: usize) {
        if self.config.firmware.restores_mode() {
            self.volatile.restores.due[axis].insert(slave as u8);
        }
    }

    /// Starts the next transfer, if one is due: of those that have failed least often, and not before all axes of its
    /// slave are done.
    pub(super) fn start_restore(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.volatile.restores.due.iter().all(|due| due.is_empty()) {
            return;
        }
        // A lost slave takes nothing.
        let not_yet = self.homing_slaves().union(self.volatile.network.lost());
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
        if bus.start(Job::Sdo(request), now).is_ok() {
            self.volatile.restores.running = Some(restore);
            self.sdo_owner = Some(SdoOwner::Restore(restore));
        }
    }

    /// The transfer under way has ended.
    pub(super) fn restored(&mut self, restore: Restore, result: Result<u32, AbortCode>, now: Ns) {
        self.volatile.restores.running = None;
        match result {
            Ok(mode) => {
                self.volatile.modes_written[usize::from(restore.slave) - 1][restore.axis] = mode as u8;
                self.volatile.restores.cancel(restore);
            }
            // On the way up the mode is written anyway.
            Err(_) if self.volatile.network.state() < Some(MasterState::SafeOp) => {
                self.volatile.restores.cancel(restore)
            }
            Err(code) => {
                let failures = self.volatile.restores.failures(restore);
                *failures += 1;
                if *failures >= TRIES {
                    self.give_up_restore(restore, code, now);
                }
            }
        }
    }

    /// A host's write of a mode of operation went well: it is the mode that counts.
    pub(super) fn mode_written(&mut self, slave: u8, axis: usize, mode: u8, now: Ns) {
        self.volatile.modes_written[usize::from(slave) - 1][axis] = mode;
        self.volatile.restores.cancel(Restore { slave, axis });
        self.end_homing_of_axis(slave.into(), axis, HomingEnd::ModeWritten, now);
        // The mode has changed: there is nothing to wait for, and nothing to write back.
        let since = self.answers_valid_from(now);
        let homing = &mut self.volatile.axes[usize::from(slave) - 1][axis].homing;
        homing.skip_standstill();
        homing.mode_written(since);
    }

    /// Whether the host's transfer that waits has to wait on: it writes the mode of an axis that was homing, which it
    /// ends, and that axis does not stand yet.
    pub(super) fn holds_mode_write(&mut self, now: Ns) -> bool {
        let Some((slave, axis)) = self
            .volatile
            .sdo
            .waiting_write()
            .and_then(|(slave, object)| mode_object(object).map(|axis| (usize::from(slave), axis)))
        else {
            return false;
        };
        self.end_homing_of_axis(slave, axis, HomingEnd::ModeWritten, now);
        self.volatile.axes[slave - 1][axis].homing.is_ending()
    }

    /// A slave is lost: nothing can be written to it.
    pub(super) fn give_up_restore_of_lost(&mut self, slave: u8, axis: usize, now: Ns) {
        let restore = Restore { slave, axis };
        if self.volatile.restores.due[axis].contains(slave) && self.volatile.restores.running != Some(restore) {
            self.give_up_restore(restore, AbortCode::TIMEOUT, now);
        }
    }

    fn give_up_restore(&mut self, restore: Restore, code: AbortCode, at: Ns) {
        self.volatile.restores.cancel(restore);
        self.counters.modes_not_restored += 1;
        self.log.push(Event::ModeNotRestored { at, slave: restore.slave, axis: restore.axis as u8, code });
    }
}
