//! The state of one slave as frames and reports show it: its mode, its last command, and whether it may be homing.

use crate::ecm::config::{Axis, Slave, modes};
use crate::ecm::exchange::cyclic_targets::Outputs;
use crate::ethercat::cia402::{Mode, Statusword};
use crate::sk::{CommandId, DriveSync, FIFO_ENTRIES, RawSlot, SlaveCommand, SlaveKind, SlotCommand, SlotSize};

/// What frames and reports have shown of one slave.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    mode: Option<(Mode, DriveSync)>,
    /// The last motion command (CSP, CSV, CST) to the slave; `None` if it is not known.
    pub(super) last: Option<SlaveCommand>,
    /// The digital outputs of an HSP's two channels in the last motion command. They are off when the network comes to
    /// OP. They stay known even if the board may not have executed that command: as a rule it repeats the outputs of
    /// the commands before it.
    pub(super) outputs: Outputs,
    homing: Homing,
}

/// The phase of a homing, as far as frames and reports show it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Homing {
    /// The slave is not homing.
    #[default]
    No,
    /// GO_HOME was written `reports` reports ago, and may wait in the FIFO. `missed`: reports were lost since, and one of
    /// them may have shown that GO_HOME was executed.
    Asked { reports: u16, missed: bool },
    /// A report has shown GO_HOME as executed. The axis may be homing until a later report shows a motion command: the
    /// board ignores motion commands during homing, and does not show their ids (SK-3).
    Executed,
}

/// \[OURS] If this many reports do not show GO_HOME as executed and none was lost, the board has rejected it: by then
/// the board has executed every entry of the FIFO.
const GO_HOME_REPORTS_MAX: u16 = 2 * FIFO_ENTRIES;

impl Seen {
    /// Whether the slave may be homing: GO_HOME was written, and no later report shows a motion command.
    pub(super) fn may_be_homing(&self) -> bool {
        self.homing != Homing::No
    }

    /// Notes that reports were lost. If GO_HOME waits for its execution, a lost report may have shown that it was
    /// executed, so the slave may be homing.
    pub(super) fn missed(&mut self) {
        if let Homing::Asked { missed, .. } = &mut self.homing {
            *missed = true;
        }
    }

    /// Forgets the last command, because the board may not have executed it.
    pub(super) fn forget_targets(&mut self) {
        self.last = None;
    }

    /// Forgets all but the mode that DRIVE_MODE has set (SK-4.42), because the slave was configured anew or the network
    /// has left OP.
    pub(super) fn forget_all_but_the_mode(&mut self) {
        *self = Self { mode: self.mode, ..Self::default() };
    }

    /// Reads the slave's slot of a command frame. `set_up`: the network is below SafeOP, where DRIVE_MODE is accepted.
    /// `in_op`: the network is in OP and the slave has axes, so that motion commands are executed.
    pub(super) fn command(&mut self, slot: &RawSlot, size: SlotSize, set_up: bool, in_op: bool) {
        let Ok(SlotCommand { command, .. }) = SlotCommand::decode(slot, size) else { return };
        match command {
            SlaveCommand::DriveMode { mode, sync } if set_up => self.mode = Some((mode, sync)),
            _ if !in_op => {}
            SlaveCommand::Csp(_) | SlaveCommand::Csv(_) | SlaveCommand::Cst(_) => {
                self.last = Some(command);
                if let SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion) = command {
                    self.outputs = [motion.first.outputs, motion.second.outputs];
                }
            }
            SlaveCommand::GoHome => {
                self.forget_targets();
                self.homing = Homing::Asked { reports: 0, missed: false };
            }
            SlaveCommand::ServoOff | SlaveCommand::AlarmClear => self.forget_targets(),
            // Such a slot has no target: the axis holds its last target.
            SlaveCommand::GetStatus
            | SlaveCommand::DriveMode { .. }
            | SlaveCommand::ServoOn
            | SlaveCommand::IoRead
            | SlaveCommand::IoWrite(_)
            | SlaveCommand::AbortHome
            | SlaveCommand::Other(_) => {}
        }
    }

    /// Reads the slave's slot of a report: the id of the last executed command, and the statusword.
    pub(super) fn report(&mut self, id: u8, statusword: Statusword) {
        let follows = CommandId::from_code(id).is_motion();
        self.homing = match self.homing {
            // The report shows GO_HOME as executed, also if the frame with it was not seen.
            _ if id == CommandId::GoHome.code() => Homing::Executed,
            Homing::Executed if follows => Homing::No,
            Homing::Asked { reports, missed } if reports < GO_HOME_REPORTS_MAX => {
                Homing::Asked { reports: reports + 1, missed }
            }
            Homing::Asked { missed: true, .. } => Homing::Executed,
            Homing::Asked { .. } => Homing::No,
            other => other,
        };
        if !statusword.is_enabled() {
            if self.homing == Homing::Executed {
                self.homing = Homing::No;
            }
            // An axis that went off loses its targets in the board (SK-7.18).
            self.forget_targets();
        }
    }

    /// The configuration of the slave: the kind that SET_AXIS has declared, and the mode that DRIVE_MODE has set. Without
    /// DRIVE_MODE it is CSP with distributed clocks.
    pub(super) fn slave(&self, kind: Option<SlaveKind>) -> Slave {
        let kind = kind.unwrap_or(SlaveKind::None);
        let (mode, sync) = self.mode.unwrap_or((Mode::Csp, DriveSync::DcSync));
        let mode = if modes(kind).contains(&mode) { mode } else { Mode::Csp };
        Slave::with_axis(kind, Axis { mode, sync, ..Axis::CSP })
    }
}
