//! What frames and reports tell of one slave: its mode, what was commanded last, and whether it may be homing.

use crate::ecm::config::{Axis, Slave, modes};
use crate::ethercat::cia402::{Mode, Statusword};
use crate::sk::{CommandId, DriveSync, FIFO_ENTRIES, RawSlot, SlaveCommand, SlaveKind, SlotCommand, SlotSize};

/// What is known of one slave.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    mode: Option<(Mode, DriveSync)>,
    /// The last motion command (CSP, CSV, CST).
    pub(super) last: Option<SlaveCommand>,
    homing: Homing,
}

/// How far the homing of an axis is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Homing {
    /// It is not being homed.
    #[default]
    No,
    /// GO_HOME was written, and so many reports have come since: its entry may wait in the FIFO. If a report was missed, that
    /// may have been the one which showed it as executed.
    Asked { reports: u16, missed: bool },
    /// A report has shown GO_HOME as executed. Until a report shows a motion command after that the axis may be homing: the board
    /// ignores motion commands for an axis that is homing, and does not show their ids (SK-3).
    Executed,
}

/// \[OURS] A GO_HOME that so many reports have not shown was rejected, if no report was missed: every entry has been executed by
/// then.
const GO_HOME_REPORTS_MAX: u16 = 2 * FIFO_ENTRIES;

impl Seen {
    /// Whether the axis may be homing: GO_HOME was written, and no report has shown that it follows other commands.
    pub(super) fn may_be_homing(&self) -> bool {
        self.homing != Homing::No
    }

    /// Reports were lost before the next one.
    pub(super) fn missed(&mut self) {
        if let Homing::Asked { missed, .. } = &mut self.homing {
            *missed = true;
        }
    }

    /// It is not certain any more that the last commands were executed.
    pub(super) fn forget_targets(&mut self) {
        self.last = None;
    }

    /// The slave is declared anew, or the network is not in OP. The mode that DRIVE_MODE has set stays (SK-4.42).
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
            // A frame without a target: the axis holds the last one.
            _ => {}
        }
    }

    /// Reads the slave's slot of a report: the command that was executed last, and the statusword.
    pub(super) fn report(&mut self, id: u8, statusword: Statusword) {
        let follows = [CommandId::Csp, CommandId::Csv, CommandId::Cst].contains(&CommandId::from_code(id));
        self.homing = match self.homing {
            // It was executed, whether the frame with it was seen or not.
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
            // The board has discarded its targets (SK-7.18).
            self.forget_targets();
        }
    }

    /// The slave as a configuration has it, if it is declared as that kind.
    pub(super) fn slave(&self, kind: Option<SlaveKind>) -> Slave {
        let kind = kind.unwrap_or(SlaveKind::None);
        let (mode, sync) = self.mode.unwrap_or((Mode::Csp, DriveSync::DcSync));
        let mode = if modes(kind).contains(&mode) { mode } else { Mode::Csp };
        Slave::with_axis(kind, Axis { mode, sync, ..Axis::CSP })
    }
}
