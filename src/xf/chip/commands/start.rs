//! Commands that take time are started, if none runs and their arguments are right.

use super::{Outcome, Refused, done_if};
use crate::coe::SdoScope;
use crate::ethercat::{AlState, Ns};
use crate::xf::EtherCatState;
use crate::xf::chip::Chip;
use crate::xf::chip::flash::Flash;
use crate::xf::chip::jobs::{Job, SdoJob, StateJob};
use crate::xf::chip::network::Network;
use crate::xf::request::{FlashBytes, FoeRequest, Request, SDO_DATA_MAX, SdoOperation, SdoRequest, Slaves};

/// The shortest cycle that ECAT_INIT_OP takes, nanoseconds. `[OURS]`
pub const SYNC0_MIN_NS: u32 = 50_000;

impl<N: Network> Chip<N> {
    /// Starts a command that takes time, or refuses an unknown one.
    pub(super) fn start(&mut self, request: &Request<'_>) -> Outcome {
        let job = self.job_for(request).ok_or(Refused)?;
        done_if(self.start_job(job))
    }

    /// The update of states that a header asks for. `[OURS]` By control bit 1, as the manuals have it, where the
    /// vendor's header has bit 0; it takes time beside the packet's own command. False: a command runs.
    pub(in crate::xf::chip) fn start_update(&mut self) -> bool {
        self.start_job(Job::StateUpdate)
    }

    /// `None`: an argument is wrong, or nobody knows the command.
    ///
    /// `[OURS]` A slave that was not found is a wrong argument.
    fn job_for(&self, request: &Request<'_>) -> Option<Job> {
        Some(match request {
            Request::EcatInit(init) => {
                let sync0 = init.dc.sync0_ns;
                (sync0 == 0 || sync0 >= SYNC0_MIN_NS).then_some(Job::Init(*init))?
            }
            Request::Reconfig(_) | Request::ConfigMap(_) => Job::Map,
            Request::InitDc(_) => Job::InitDc,
            Request::DcSync(dc_sync) => self.found(dc_sync.slaves).then_some(Job::DcSync(*dc_sync))?,
            Request::PdoConfigSet(set) => {
                self.found(set.config().slave.into()).then_some(Job::PdoConfigSet(*set.config()))?
            }
            Request::PdoConfigRequest(get) => self.found(get.slave.into()).then_some(Job::PdoConfigRequest(*get))?,
            Request::SdoRequest(sdo) => self.found(sdo.slave.into()).then(|| Job::Sdo(self.sdo_job(sdo)))?,
            Request::StateSet(set) => self.change_job(set.slaves, set.state, false)?,
            Request::StateCheck(check) => self.change_job(check.slaves, check.state, true)?,
            Request::StateUpdate(_) => Job::StateUpdate,
            Request::FifoInit(_) => Job::FifoInit,
            Request::FoeRequest(foe) => flash_job(foe)?,
            _ => return None,
        })
    }

    /// Whether there are slaves, and this one is among them.
    pub(super) fn found(&self, slaves: Slaves) -> bool {
        match slaves {
            Slaves::One(slave) => slave.get() < self.bus.count,
            Slaves::All => self.bus.count > 0,
        }
    }

    fn sdo_job(&self, request: &SdoRequest<'_>) -> SdoJob {
        let (mut data, mut writes) = ([0; SDO_DATA_MAX], false);
        let bytes = match request.operation {
            SdoOperation::Read { bytes } => bytes.into(),
            SdoOperation::Write(written) => {
                writes = true;
                // The request holds 256 bytes at most.
                data[..written.len()].copy_from_slice(written);
                written.len()
            }
        };
        let scope: SdoScope = request.scope;
        let deadline = self.now.saturating_add(Ns::from(request.timeout_us) * 1_000);
        SdoJob { slave: request.slave.get(), object: request.object, scope, deadline, bytes, writes, data }
    }

    fn change_job(&self, slaves: Slaves, state: EtherCatState, updates: bool) -> Option<Job> {
        let target = match state {
            EtherCatState::Init => Some(AlState::Init),
            EtherCatState::PreOp => Some(AlState::PreOp),
            EtherCatState::SafeOp => Some(AlState::SafeOp),
            EtherCatState::Op => Some(AlState::Op),
            EtherCatState::Boot => None,
        };
        self.found(slaves).then_some(Job::State(StateJob { slaves, target, updates }))
    }
}

/// `None`: it is a transfer of a file, or reaches behind the flash memory.
fn flash_job(request: &FoeRequest<'_>) -> Option<Job> {
    match *request {
        FoeRequest::ReadFlash { start, bytes } => {
            let bytes = bytes.get() as u16;
            Flash::has(start.get(), bytes.into()).then_some(Job::ReadFlash { start: start.get(), bytes })
        }
        FoeRequest::WriteFlash { start, data } if Flash::has(start.get(), data.len()) => {
            let mut written = [0; FlashBytes::MAX.get() as usize];
            written.get_mut(..data.len())?.copy_from_slice(data);
            Some(Job::WriteFlash { start: start.get(), bytes: data.len() as u16, data: written })
        }
        _ => None,
    }
}
