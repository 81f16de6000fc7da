//! The configuration of the slaves, in a form that is read for every report and every frame without heap allocations.

use std::time::Duration;

use super::EcmError;
use super::config::{Axis, Config, Slave};
use crate::ethercat::{MAX_SLAVES, SlaveSet};
use crate::sk::{DriveResponse, RawSlot};

/// A copy of a [`Config`] with its slaves in an array, so that it needs no heap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Network {
    slaves: [Slave; MAX_SLAVES],
    /// The number of configured slaves.
    pub(super) count: usize,
    /// The EtherCAT cycle, ns; `None`: not known.
    pub(super) cycle_ns: Option<u64>,
    /// The slaves that are pulse modules (HSP).
    pub(super) hsps: SlaveSet,
}

impl Network {
    /// The network before it is configured: it has no slaves.
    pub(super) const NONE: Self =
        Self { slaves: [Slave::Unused; MAX_SLAVES], count: 0, cycle_ns: None, hsps: SlaveSet::EMPTY };

    pub(super) fn of(config: &Config) -> Self {
        let mut network = Self::NONE;
        for (place, slave) in network.slaves.iter_mut().zip(&config.slaves) {
            *place = *slave;
        }
        network.count = config.slaves.len();
        network.cycle_ns = Some(u64::from(config.cycle_us) * 1000);
        let is_hsp = |(_, slave): &(u8, &Slave)| matches!(slave, Slave::Hsp(_));
        network.hsps = network.slaves().filter(is_hsp).map(|(slave, _)| slave).collect();
        network
    }

    /// The EtherCAT cycle, never 0; the factory setting of 1 ms if it is not known.
    pub(super) fn cycle(&self) -> Duration {
        Duration::from_nanos(self.cycle_ns.unwrap_or(1_000_000))
    }

    /// The configuration of a slave, from 1; `None` if that slave is not configured.
    pub(super) fn slave(&self, slave: u8) -> Option<&Slave> {
        self.slaves[..self.count].get(usize::from(slave).checked_sub(1)?)
    }

    /// The configuration of a slave; an error if it is not configured.
    pub(super) fn declared(&self, slave: u8) -> Result<&Slave, EcmError> {
        // Called for up to 40 axes in each cycle. Making the error in advance costs little, since it needs no heap
        // allocation.
        self.slave(slave).ok_or(EcmError::NoSuchSlave { slave, declared: self.count })
    }

    /// The settings of a slave's axis; an error if it has none. `what` names the call, for the error.
    pub(super) fn axis(&self, slave: u8, what: &'static str) -> Result<&Axis, EcmError> {
        let config = self.declared(slave)?;
        config.axis().ok_or_else(|| EcmError::wrong_kind(slave, config.kind(), what, "a drive, STEP or HSP"))
    }

    /// The error for a slave with an alarm. `slot` is its slot in a report, which has the error code of a drive.
    pub(super) fn alarm(&self, slave: u8, slot: &RawSlot) -> EcmError {
        let code = match self.slave(slave) {
            Some(Slave::Hsp(_)) => 0,
            _ => DriveResponse::decode(slot).error_code,
        };
        EcmError::Alarm { slave, code }
    }

    /// The configured slaves, with their numbers.
    pub(super) fn slaves(&self) -> impl Iterator<Item = (u8, &Slave)> {
        (1..).zip(&self.slaves[..self.count])
    }
}
