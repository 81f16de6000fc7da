//! A decoded report: the state of the board and its slaves in one cycle.

use std::sync::Arc;

use super::config::Slave;
use super::network::Network;
use crate::address::scale::Scale;
use crate::link::ReadMeta;
use crate::sk::{DriveResponse, Frame, HspResponse, IoResponse, MasterResponse, SdoResponse, SlotSize, StateByte};

/// The decoded slot of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveView {
    /// A drive or a stepper.
    Drive(DriveResponse),
    /// A pulse module.
    Hsp(HspResponse),
    /// An IO slave.
    Io(IoResponse),
}

/// A decoded report: the board and all slaves in the same cycle. Slots of slaves are refreshed in OP only (SK-3).
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Time and sequence number of the report. A gap between two sequence numbers means that reports were lost or not read.
    pub meta: ReadMeta,
    /// Slot 0: the state, the CRC error count, the FIFO.
    pub board: MasterResponse,
    pub(super) frame: Frame,
    pub(super) size: SlotSize,
    pub(super) network: Arc<Network>,
}

impl Snapshot {
    /// The state byte of the network.
    pub const fn state(&self) -> StateByte {
        self.board.state
    }

    /// The number of configured slaves.
    pub fn slaves(&self) -> usize {
        self.network.count
    }

    /// The slot of a slave, decoded by its configured kind; `None` for a slave that is unused or not configured.
    pub fn slave(&self, slave: u8) -> Option<SlaveView> {
        let slot = |slave: u8| self.frame.slot(self.size, slave.into());
        match self.network.slave(slave)? {
            Slave::Drive(_) | Slave::Step(_) => Some(SlaveView::Drive(DriveResponse::decode(&slot(slave)))),
            Slave::Hsp(_) => Some(SlaveView::Hsp(HspResponse::decode(&slot(slave), self.size))),
            Slave::Io => Some(SlaveView::Io(IoResponse::decode(&slot(slave)))),
            Slave::Unused => None,
        }
    }

    /// The slot of a drive or a stepper; `None` if the slave is neither.
    pub fn drive(&self, slave: u8) -> Option<DriveResponse> {
        match self.slave(slave)? {
            SlaveView::Drive(drive) => Some(drive),
            _ => None,
        }
    }

    /// The actual position of a slave's first axis, counts; `None` if the slave has no axis.
    pub fn position(&self, slave: u8) -> Option<i32> {
        match self.slave(slave)? {
            SlaveView::Drive(drive) => Some(drive.position),
            SlaveView::Hsp(hsp) => Some(hsp.first.position),
            SlaveView::Io(_) => None,
        }
    }

    /// The actual position of a slave's first axis in the units of its [`Scale`]; `None` if the slave has no axis.
    pub fn position_units(&self, slave: u8) -> Option<f64> {
        let scale: Scale = self.network.slave(slave)?.axis()?.scale;
        Some(scale.to_units(self.position(slave)?))
    }

    /// The SDO slot, with the answer to the last SDO transfer that ended.
    pub fn sdo(&self) -> SdoResponse {
        SdoResponse::decode(&self.frame.slot(self.size, self.size.sdo_slot()))
    }

    /// The raw bytes of the report.
    pub const fn frame(&self) -> &Frame {
        &self.frame
    }
}
