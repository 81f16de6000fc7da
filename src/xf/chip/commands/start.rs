//! Starts commands that take time, if none is running and their arguments are valid.

use super::{CommandOutcome, CommandRefused, done_if};
use crate::ethercat::coe::SdoScope;
use crate::ethercat::{AlState, Ns};
use crate::xf::EtherCatState;
use crate::xf::chip::Chip;
use crate::xf::chip::flash::Flash;
use crate::xf::chip::jobs::{DatagramJob, EepromJob, FileJob, Job, SdoJob, StateJob};
use crate::xf::chip::network::SlaveNetwork;
use crate::xf::request::{
    EepromRequest, FlashBytes, FoeFile, FoeRequest, RAW_DATA_MAX, RawRequest, ReceiveMailbox, Request, SDO_DATA_MAX,
    SdoOperation, SdoRequest, Slaves,
};

/// The shortest SYNC0 cycle that ECAT_INIT_OP accepts, in nanoseconds; 0, no SYNC0, is accepted too. `[OURS]`
pub const SYNC0_MIN_NS: u32 = 50_000;

impl<N: SlaveNetwork> Chip<N> {
    /// Starts a command that takes time; refuses an unknown command.
    pub(super) fn start(&mut self, request: &Request<'_>) -> CommandOutcome {
        let job = self.job_for(request).ok_or(CommandRefused)?;
        done_if(self.start_job(job))
    }

    /// Starts the update of states that a header requests. `[OURS]` The manuals request the update by control bit 1,
    /// the vendor's header by bit 0; the model uses bit 1. The update takes time in addition to the packet's own
    /// command: if that command is still running, the update follows it. Returns false if a command of an earlier
    /// packet is still running; `was_busy` says whether one was running before the packet.
    pub(in crate::xf::chip) fn start_update(&mut self, was_busy: bool) -> bool {
        let starts = self.start_job(Job::StateUpdate);
        self.update_is_due |= !starts && !was_busy;
        starts || !was_busy
    }

    /// The job for a command that takes time: the command with its checked arguments. `None` if an argument is invalid or the
    /// command is unknown.
    ///
    /// `[OURS]` The number of a slave that was not found is an invalid argument.
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
            Request::FoeRequest(FoeRequest::Upload(file)) => self.file_job(file, false)?,
            Request::FoeRequest(FoeRequest::Download(file)) => self.file_job(file, true)?,
            Request::FoeRequest(foe) => flash_job(foe)?,
            Request::ConfigSyncManager(set) => self.found(set.slave.into()).then_some(Job::SetManager(*set))?,
            Request::ConfigFmmu(set) => self.found(set.slave.into()).then_some(Job::SetFmmus)?,
            Request::EepromRequest(eeprom) => self.found(eeprom.slave.into()).then(|| self.eeprom_job(eeprom))?,
            Request::RawRequest(raw) => self.datagram_job(raw)?,
            Request::ReceiveMailbox(ReceiveMailbox::Request { slave }) => {
                self.found((*slave).into()).then_some(Job::ReceiveMail { slave: slave.get() })?
            }
            _ => return None,
        })
    }

    /// Whether this slave, or any slave for "all", was found.
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
                // The slice fits: a request holds at most 256 bytes.
                data[..written.len()].copy_from_slice(written);
                written.len()
            }
        };
        let scope: SdoScope = request.scope;
        let deadline = self.deadline(request.timeout_us);
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
        self.found(slaves).then_some(Job::State(StateJob { slaves, target, updates, has_failed: false }))
    }

    fn eeprom_job(&self, request: &EepromRequest) -> Job {
        Job::Eeprom(EepromJob {
            slave: request.slave.get(),
            position: request.position,
            operation: request.operation,
            deadline: self.deadline(request.timeout_us),
        })
    }

    /// The job for a datagram. `[OURS]` No datagram can be sent before the network was initialised; a negative timeout
    /// is an invalid argument.
    fn datagram_job(&self, request: &RawRequest<'_>) -> Option<Job> {
        let timeout_us = u32::try_from(request.timeout_us).ok().filter(|_| self.bus.initialised)?;
        let mut data = [0; RAW_DATA_MAX];
        data.get_mut(..request.data.len())?.copy_from_slice(request.data);
        Some(Job::Datagram(DatagramJob {
            operation: request.operation,
            adp: request.adp,
            ado: request.ado,
            logical: request.logical,
            timeout_us: request.timeout_us,
            deadline: self.deadline(timeout_us),
            working_counter: -1,
            bytes: request.data.len(),
            data,
        }))
    }

    /// The job for a file transfer. `[OURS]` The timeout of the request limits the wait for each packet of the slave, not the
    /// whole transfer. A file without a name, and a download from beyond the flash memory, are invalid arguments.
    fn file_job(&self, file: &FoeFile<'_>, downloads: bool) -> Option<Job> {
        let is_in_memory = !downloads || Flash::has(file.start.get(), file.bytes as usize);
        (self.found(file.slave.into()) && is_in_memory && !file.name.is_empty()).then(|| {
            Job::File(FileJob {
                slave: file.slave.get(),
                name: file.name.to_vec(),
                password: file.password,
                start: file.start.get(),
                bytes: file.bytes,
                timeout_ns: Ns::from(file.timeout_us) * 1_000,
                downloads,
            })
        })
    }

    /// The end of a timeout that begins now, in the chip's time, ns.
    fn deadline(&self, timeout_us: u32) -> Ns {
        self.now.saturating_add(Ns::from(timeout_us) * 1_000)
    }
}

/// The job for an access to the flash memory; `None` if it reaches beyond the memory.
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
