//! The state of one slave as frames and reports show it: its mode, its last command, and whether it may be homing.

use crate::ecm::config::{Axis, Slave, modes};
use crate::ethercat::cia402::{Mode, Statusword};
use crate::sk::{CommandId, DriveSync, FIFO_ENTRIES, RawSlot, SlaveCommand, SlaveKind, SlotCommand, SlotSize};

/// The known state of one slave.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    mode: Option<(Mode, DriveSync)>,
    /// The last motion command (CSP, CSV, CST).
    pub(super) last: Option<SlaveCommand>,
    homing: Homing,
}

/// The phase of a homing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Homing {
    /// The slave is not homing.
    #[default]
    No,
    /// GO_HOME was written `reports` reports ago: its entry may wait in the FIFO. `missed`: a report was lost that may
    /// have shown it as executed.
    Asked { reports: u16, missed: bool },
    /// A report has shown GO_HOME as executed. The axis may be homing until a later report shows a motion command: the
    /// board ignores motion commands during homing, and does not show their ids (SK-3).
    Executed,
}

/// \[OURS] A GO_HOME that does not appear in this many reports was rejected, if no report was lost: every entry has
/// been executed by then.
const GO_HOME_REPORTS_MAX: u16 = 2 * FIFO_ENTRIES;

impl Seen {
    /// Whether the slave may be homing: GO_HOME was written, and no later report shows another command.
    pub(super) fn may_be_homing(&self) -> bool {
        self.homing != Homing::No
    }

    /// Notes that reports were lost before the next one.
    pub(super) fn missed(&mut self) {
        if let Homing::Asked { missed, .. } = &mut self.homing {
            *missed = true;
        }
    }

    /// The last commands may not have been executed.
    pub(super) fn forget_targets(&mut self) {
        self.last = None;
    }

    /// The slave was declared anew, or the network is not in OP. The mode of DRIVE_MODE stays (SK-4.42).
    pub(super) fn forget_all_but_the_mode(&mut self) {
        *self = Self { mode: self.mode, ..Self::default() };
    }

    /// Reads the slave's slot of a command frame.
    pub(super) fn command(&mut self, slot: &RawSlot, size: SlotSize, set_up: bool, in_op: bool) {
        match SlotCommand::decode(slot, size).map(|command| command.command) {
            Ok(SlaveCommand::DriveMode { mode, sync }) if set_up => self.mode = Some((mode, sync)),
            _ if !in_op => {}
            Ok(command @ (SlaveCommand::Csp(_) | SlaveCommand::Csv(_) | SlaveCommand::Cst(_))) => {
                self.last = Some(command);
            }
            Ok(SlaveCommand::GoHome) => {
                self.forget_targets();
                self.homing = Homing::Asked { reports: 0, missed: false };
            }
            Ok(SlaveCommand::ServoOff | SlaveCommand::AlarmClear) => self.forget_targets(),
            // Without a target the axis holds its last one.
            _ => {}
        }
    }

    /// Reads the slave's slot of a report: the id of the last executed command, and the statusword.
    pub(super) fn report(&mut self, id: u8, statusword: Statusword) {
        let follows = [CommandId::Csp, CommandId::Csv, CommandId::Cst].contains(&CommandId::from_code(id));
        self.homing = match self.homing {
            // GO_HOME was executed, whether its frame was seen or not.
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
            // The board has discarded the targets of the slave (SK-7.18).
            self.forget_targets();
        }
    }

    /// The slave as an entry of a configuration, for its declared kind.
    pub(super) fn slave(&self, kind: Option<SlaveKind>) -> Slave {
        let kind = kind.unwrap_or(SlaveKind::None);
        let (mode, sync) = self.mode.unwrap_or((Mode::Csp, DriveSync::DcSync));
        let mode = if modes(kind).contains(&mode) { mode } else { Mode::Csp };
        Slave::with_axis(kind, Axis { mode, sync, ..Axis::CSP })
    }
}
