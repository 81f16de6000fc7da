//! The checks of the slave controller's registers before a change of the AL state, and after later changes of sync
//! managers. The device has its own checks.
//!
//! Source: ETG.1000.6 6.4, ETG.1020, and the behaviour of public slave stacks; rules ECAT-11.

use super::Controller;
use super::application::{Application, active_len};
use super::mailbox::{ANSWERS, REQUESTS};
use crate::ethercat::AlStatus;
use crate::ethercat::registers::{BufferMode, DL_STATUS, DlStatus, RAM, SmDirection, SyncActivation, SyncManager};
use crate::ethercat::sii::{MailboxArea, Sii};

/// \[OURS] The maximum size of a mailbox, bytes: what one datagram can write.
pub const MAILBOX_BYTES_MAX: u16 = 1486;
/// \[OURS] The minimum SYNC0 cycle time with which a slave goes to SafeOP, ns.
pub const SYNC0_CYCLE_MIN_NS: u32 = 100_000;
impl Application {
    /// Checks that the EEPROM is loaded, and that both mailbox sync managers are enabled in mailbox mode with the right
    /// direction, a valid length and separate areas in RAM.
    pub(super) fn check_mailbox(&self, controller: &Controller) -> Result<(), AlStatus> {
        if DlStatus(controller.memory.u16(DL_STATUS)).0 & DlStatus::SII_LOADED == 0 {
            return Err(AlStatus::EEPROM_ERROR);
        }
        if !self.has_mailbox {
            return Ok(());
        }
        let [requests, answers] = [REQUESTS, ANSWERS].map(|n| controller.managers.registers(n));
        let is_right = |manager: &SyncManager, direction| {
            let end = u32::from(manager.start) + u32::from(manager.len);
            manager.is_enabled()
                && manager.control.mode() == BufferMode::Mailbox
                && manager.control.direction() == direction
                && (controller.settings().mailbox_bytes_min..=MAILBOX_BYTES_MAX).contains(&manager.len)
                && manager.start >= RAM
                && end as usize <= controller.memory.end()
        };
        let overlap = u32::from(requests.start) < u32::from(answers.start) + u32::from(answers.len)
            && u32::from(answers.start) < u32::from(requests.start) + u32::from(requests.len);
        let all_right = is_right(&requests, SmDirection::Write) && is_right(&answers, SmDirection::Read) && !overlap;
        if all_right { Ok(()) } else { Err(AlStatus::INVALID_MAILBOX) }
    }

    /// Checks direction, mode and area of the process data sync managers; the device checks their lengths. A sync manager that
    /// is off or has a length of 0 passes. Inputs are checked first: if both are wrong, the AL status code names the inputs.
    pub(super) fn check_areas(&self, controller: &Controller) -> Result<[SyncManager; 2], AlStatus> {
        let outputs = controller.managers.registers(self.managers.outputs);
        let inputs = controller.managers.registers(self.managers.inputs);
        for (manager, direction, code) in [
            (&inputs, SmDirection::Read, AlStatus::INVALID_INPUTS),
            (&outputs, SmDirection::Write, AlStatus::INVALID_OUTPUTS),
        ] {
            if active_len(manager) == 0 {
                continue;
            }
            let buffers = if manager.control.mode() == BufferMode::Mailbox { 1 } else { 3 };
            let end = u32::from(manager.start) + buffers * u32::from(manager.len);
            let is_in_ram = manager.start >= RAM && end as usize <= controller.memory.end();
            if manager.control.direction() != direction || manager.control.mode() == BufferMode::Unknown || !is_in_ram {
                return Err(code);
            }
        }
        Ok([outputs, inputs])
    }

    /// Checks that sync managers and distributed clocks allow SafeOP. The device checks the lengths.
    pub(super) fn check_process_data(&self, controller: &Controller) -> Result<(), AlStatus> {
        let [outputs, inputs] = self.check_areas(controller)?;
        let activation = controller.sync_activation();
        if activation.contains(SyncActivation::ACTIVATE) {
            let [sync0, sync1] = [SyncActivation::SYNC0, SyncActivation::SYNC1].map(|bit| activation.contains(bit));
            if sync1 && !sync0 {
                return Err(AlStatus::INVALID_DC_SYNC);
            }
            if sync0 && controller.sync0_cycle_ns() < SYNC0_CYCLE_MIN_NS {
                return Err(AlStatus::INVALID_SYNC0_CYCLE);
            }
        } else if [&outputs, &inputs]
            .into_iter()
            .any(|manager| active_len(manager) > 0 && manager.control.mode() == BufferMode::Mailbox)
        {
            return Err(AlStatus::NEEDS_THREE_BUFFERS);
        }
        Ok(())
    }

    /// Checks that the mailbox sync managers are those that the EEPROM defines for bootstrap.
    pub(super) fn check_boot_mailbox(controller: &Controller) -> Result<(), AlStatus> {
        let Ok(areas) = Sii::new(controller.eeprom()).map(|sii| sii.info().boot_mailbox) else {
            return Err(AlStatus::EEPROM_ERROR);
        };
        let is_right = |n, area: MailboxArea, direction| {
            let manager = controller.managers.registers(n);
            manager.is_enabled()
                && manager.control.mode() == BufferMode::Mailbox
                && manager.control.direction() == direction
                && (manager.start, manager.len) == (area.start, area.len)
        };
        let all_right =
            is_right(REQUESTS, areas.receive, SmDirection::Write) && is_right(ANSWERS, areas.send, SmDirection::Read);
        if all_right { Ok(()) } else { Err(AlStatus::INVALID_BOOT_MAILBOX) }
    }
}
