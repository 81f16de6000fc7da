//! Commands for the chip itself, and for reading the state of the CiA 402 helper.

use super::{CommandOutcome, DONE, answered, done_if};
use crate::ethercat::cia402::Statusword;
use crate::xf::chip::Chip;
use crate::xf::chip::network::SlaveNetwork;
use crate::xf::request::{AsyncResetActions, MotorNumber};
use crate::xf::response::{Answer, DriveStateByte, FirmwareVersion};
use crate::xf::{DataSize, Errors};

impl<N: SlaveNetwork> Chip<N> {
    /// SPI_RECONFIG_OP sets the size of the data segment of packets. The new size applies to the next command packet
    /// and to the answer of SPI_RECONFIG_OP itself.
    pub(super) fn set_size(&mut self, size: DataSize) -> CommandOutcome {
        let is_allowed = !self.profile.size_is_fixed;
        if is_allowed {
            self.size = size;
        }
        done_if(is_allowed)
    }

    pub(super) fn version(&self, data: &mut [u8]) -> CommandOutcome {
        let (version, identity) = (self.profile.version, self.profile.identity);
        Ok(FirmwareVersion { version, identity }.encode(data)?)
    }

    /// CRC_ERR_CNT_CLR: clears the number of damaged packets. `[OURS]` The return byte is that number before it was cleared.
    pub(super) fn clear_crc_errors(&mut self, data: &mut [u8]) -> CommandOutcome {
        Ok(std::mem::take(&mut self.crc_errors).encode(data)?)
    }

    /// ASYNCCMD_RESET. `[OURS]` The running command is given up by the actions 1 (clear busy) and 4 (give up) and has no
    /// further effects; action 4 also reports it as failed.
    pub(super) fn reset_job(&mut self, actions: AsyncResetActions) -> CommandOutcome {
        if actions.contains(AsyncResetActions::GIVE_UP) && self.job.is_some() {
            self.raise(Errors::NON_IMMEDIATE);
        }
        if actions.contains(AsyncResetActions::GIVE_UP) || actions.contains(AsyncResetActions::CLEAR_BUSY) {
            self.drop_job();
        }
        if actions.contains(AsyncResetActions::SKIP_PORT_WAIT) {
            self.skip_port_wait();
        }
        DONE
    }

    /// Makes the network port ready now, so that an ECAT_INIT_OP that waits for the port continues.
    fn skip_port_wait(&mut self) {
        let skipped = self.port_ready_at.saturating_sub(self.now);
        self.port_ready_at -= skipped;
        if let Some(running) = self.job.as_mut().filter(|running| running.waits_for_port()) {
            running.skip(skipped);
        }
    }

    /// The newest statusword of an axis; `None` if the axis is not configured.
    pub(super) fn statusword(&self, motor: MotorNumber) -> Option<Statusword> {
        self.helper.statusword(motor.get(), self.bus.places(), &self.bus.inputs)
    }

    pub(super) fn drive_state(&self, motor: MotorNumber, data: &mut [u8]) -> CommandOutcome {
        // Only the bits of the statusword that encode the state (XF EN 778).
        let state = |word: Statusword| DriveStateByte((word.0 & Statusword::STATE_BITS) as u8);
        answered(self.statusword(motor).map(state), data)
    }
}
