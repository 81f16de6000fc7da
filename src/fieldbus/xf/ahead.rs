//! The configuration that the next change to SafeOP needs, made while nobody asks anything of the bus.
//!
//! It writes nothing to a slave: it reads whether the slaves have their mapping, and if all have it, or one that is as long, the chip
//! lays the process data out. What a program reads and writes by SDO meanwhile is what it would be without. Whatever is asked of the bus goes first;
//! what was seen by then stays.

use super::chip_bus::ChipBus;
use super::jobs::{Part, Running};
use crate::ethercat::Ns;
use crate::ethercat::coe::ObjectAddress;
use crate::fieldbus::{BusConfig, SdoRequest};
use crate::xf::host::{HostState, Wires};

/// It waits so long behind an SDO, since another one often follows. \[OURS]
const QUIET_NS: Ns = 10_000_000;

/// What is to be made ahead.
#[derive(Clone, Debug, Default)]
pub(super) struct Ahead {
    declared: Option<BusConfig>,
    /// Not before this time of the wires.
    not_before: Ns,
}

/// Whether a download of that object may change what a slave has mapped, or how it is synchronized. \[OURS] Those of the device
/// profiles do not, and any other one may: 0x1011 restores the defaults.
const fn may_change_mapping(object: ObjectAddress) -> bool {
    !matches!(object.index, 0x6000..=0x9FFF)
}

impl<W: Wires> ChipBus<W> {
    /// Declares what the next configuration is to be.
    pub(super) fn declare(&mut self, config: &BusConfig) {
        self.ahead = Ahead { declared: Some(*config), not_before: self.wires.now() };
    }

    /// Begins, or goes on, if nobody asks anything of the bus. \[OURS] RECONFIG_OP may come long before SafeOP, and SDOs after it.
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

    /// It has ended. If a slave has not answered it is not tried again.
    pub(super) fn end_ahead(&mut self) {
        self.ahead.declared = None;
    }

    /// A configuration made ahead makes way for what is asked of the bus. False: something else is under way, or the network is
    /// just being initialised.
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

    /// A host's SDO begins.
    pub(super) fn note_sdo(&mut self, request: &SdoRequest) {
        if request.write.is_some() && may_change_mapping(request.object) {
            self.network.forget_objects(request.slave);
        }
    }
}
