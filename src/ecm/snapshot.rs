//! One report with its meaning: what board and slaves said in one cycle.

use std::sync::Arc;
use std::time::Duration;

use super::config::{Config, Slave};
use super::scale::Scale;
use crate::link::ReadMeta;
use crate::sk::{DriveResponse, Frame, HspResponse, IoResponse, MasterResponse, SdoResponse, SlotSize, StateByte};

/// What slaves are configured as: a copy of the [`Config`] that allocates nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    slaves: [Slave; SlotSize::Bytes12.max_slaves()],
    pub(super) count: usize,
    pub(super) cycle_ns: Option<u64>,
    /// Slaves that are HSPs, a bit each.
    pub(super) hsps: u64,
}

impl Plan {
    pub(super) const NONE: Self =
        Self { slaves: [Slave::Unused; SlotSize::Bytes12.max_slaves()], count: 0, cycle_ns: None, hsps: 0 };

    pub(super) fn of(config: &Config) -> Self {
        let mut plan = Self::NONE;
        for (place, slave) in plan.slaves.iter_mut().zip(&config.slaves) {
            *place = *slave;
        }
        let is_hsp = |(_, slave): &(usize, &Slave)| matches!(slave, Slave::Hsp(_));
        let hsps = (1..).zip(&config.slaves).filter(is_hsp).fold(0, |hsps, (slave, _)| hsps | 1 << slave);
        Self { hsps, count: config.slaves.len(), cycle_ns: Some(u64::from(config.cycle_us) * 1000), ..plan }
    }

    /// The EtherCAT cycle, never zero; where it is not known that of the factory setting.
    pub(super) fn cycle(&self) -> Duration {
        Duration::from_nanos(self.cycle_ns.unwrap_or(1_000_000))
    }

    /// Slave 1..; `None` if it is not configured.
    pub(super) fn slave(&self, slave: u8) -> Option<&Slave> {
        self.slaves[..self.count].get(usize::from(slave).checked_sub(1)?)
    }

    /// The slaves with their numbers.
    pub(super) fn slaves(&self) -> impl Iterator<Item = (u8, &Slave)> {
        (1..).zip(&self.slaves[..self.count])
    }
}

/// What a slave said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveView {
    /// A drive or a stepper.
    Drive(DriveResponse),
    /// A pulse module.
    Hsp(HspResponse),
    /// An IO slave.
    Io(IoResponse),
}

/// The newest report: board and all slaves in one cycle. Slaves are fresh in OP only (SK-3).
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// When it was made and its number; a gap means reports nobody read.
    pub meta: ReadMeta,
    /// Slot 0: state, CRC error count, FIFO.
    pub board: MasterResponse,
    pub(super) frame: Frame,
    pub(super) size: SlotSize,
    pub(super) plan: Arc<Plan>,
}

impl Snapshot {
    /// The network's state.
    pub const fn state(&self) -> StateByte {
        self.board.state
    }

    /// How many slaves are configured.
    pub fn slaves(&self) -> usize {
        self.plan.count
    }

    /// What a slave said, by its configured kind; `None` for one that is unused or not configured.
    pub fn slave(&self, slave: u8) -> Option<SlaveView> {
        let slot = |slave: u8| self.frame.slot(self.size, slave.into());
        match self.plan.slave(slave)? {
            Slave::Drive(_) | Slave::Step(_) => Some(SlaveView::Drive(DriveResponse::decode(&slot(slave)))),
            Slave::Hsp(_) => Some(SlaveView::Hsp(HspResponse::decode(&slot(slave), self.size))),
            Slave::Io => Some(SlaveView::Io(IoResponse::decode(&slot(slave)))),
            Slave::Unused => None,
        }
    }

    /// What a drive or a stepper said; `None` if the slave is none.
    pub fn drive(&self, slave: u8) -> Option<DriveResponse> {
        match self.slave(slave)? {
            SlaveView::Drive(drive) => Some(drive),
            _ => None,
        }
    }

    /// Actual position of a slave's (first) axis, in counts.
    pub fn position(&self, slave: u8) -> Option<i32> {
        match self.slave(slave)? {
            SlaveView::Drive(drive) => Some(drive.position),
            SlaveView::Hsp(hsp) => Some(hsp.first.position),
            SlaveView::Io(_) => None,
        }
    }

    /// Actual position of a slave's (first) axis, in its units ([`Scale`]).
    pub fn position_units(&self, slave: u8) -> Option<f64> {
        let scale: Scale = self.plan.slave(slave)?.axis()?.scale;
        Some(scale.to_units(self.position(slave)?))
    }

    /// The SDO slot: the last transfer that ended.
    pub fn sdo(&self) -> SdoResponse {
        SdoResponse::decode(&self.frame.slot(self.size, self.size.sdo_slot()))
    }

    /// The report as it came.
    pub const fn frame(&self) -> &Frame {
        &self.frame
    }
}
