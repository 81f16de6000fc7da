//! Prepares the configuration that the next change to SafeOP needs, while no job or SDO is requested.
//!
//! The preparation writes no object of a slave, so that the SDO transfers of a program read the same values as without
//! it. If the declared cycle time is new, the preparation restarts the chip's network with that time. Then it reads
//! whether the slaves already have their mapping. If all slaves have it, or a mapping of the same length, the chip lays
//! out the process data in its process image. Every request to the bus interrupts the preparation; the values that were
//! read by then are kept.

use super::chip_bus::ChipBus;
use super::jobs::{Part, Running};
use crate::ethercat::Ns;
use crate::ethercat::coe::ObjectAddress;
use crate::fieldbus::{BusConfig, SdoRequest};
use crate::xf::host::{HostState, Wires};

/// How long the preparation waits after an SDO, because another SDO often follows, ns. \[OURS]
const QUIET_NS: Ns = 10_000_000;

/// The declared configuration, and when its preparation may begin.
#[derive(Clone, Debug, Default)]
pub(super) struct Ahead {
    declared: Option<BusConfig>,
    /// The earliest time at which the preparation begins, on the clock of the wires to the chip.
    not_before: Ns,
}

/// Whether a download to this object may change the mapping of a slave, or its synchronization. \[OURS] Objects of the
/// device profiles do not change it. Any other object may: 0x1011, for example, restores the defaults.
const fn may_change_mapping(object: ObjectAddress) -> bool {
    !matches!(object.index, 0x6000..=0x9FFF)
}

/// Whether an object belongs to the mapping or the assignment of process data.
const fn is_mapping(object: ObjectAddress) -> bool {
    matches!(object.index, 0x1600..=0x1C2F)
}

impl<W: Wires> ChipBus<W> {
    /// Sets the configuration to prepare, as declared by the programs' commands so far.
    pub(super) fn declare(&mut self, config: &BusConfig) {
        self.ahead = Ahead { declared: Some(*config), not_before: self.wires.now() };
    }

    /// Begins or continues the preparation, unless a job, an SDO transfer or the reading of the slaves' states is
    /// running. \[OURS] So the chip may execute its command RECONFIG_OP long before SafeOP, and SDO transfers may
    /// follow this command.
    pub(super) fn go_ahead(&mut self, now: Ns) {
        let Some(config) = self.ahead.declared else { return };
        if self.sdo.is_some() {
            self.ahead.not_before = now.saturating_add(QUIET_NS);
        }
        let is_free = self.job.is_none() && !self.is_watching() && self.host.state() == HostState::Running;
        if is_free && now >= self.ahead.not_before {
            self.begin_job(Some(Running::ahead(config)));
        }
    }

    /// Ends the preparation, even if a slave has not answered. It is not repeated until the next call of
    /// [`Self::declare`].
    pub(super) fn end_ahead(&mut self) {
        self.ahead.declared = None;
    }

    /// Interrupts the preparation so that a requested job or SDO can begin. Returns false if that is not possible: a
    /// requested job is running, or the network is being initialised.
    pub(super) fn make_way(&mut self) -> bool {
        match &self.job {
            None => true,
            Some(job) if job.is_ahead && self.part != Part::StartsNetwork && self.next_job.is_none() => {
                self.job = None;
                self.abandon_asked();
                true
            }
            Some(_) => false,
        }
    }

    /// Called when an SDO transfer of the host begins. A download that may change the mapping invalidates the bus's
    /// record of the slave's objects.
    pub(super) fn note_sdo(&mut self, request: &SdoRequest) {
        if request.write.is_some() && may_change_mapping(request.object) {
            self.network.forget_objects(request.slave);
            if is_mapping(request.object) {
                self.network.remapped.insert(request.slave);
            }
        }
    }
}
