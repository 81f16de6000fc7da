//! Commands that take time, as jobs. One job runs at a time; at its end its results are stored, or it reports an error.
//!
//! A job has one or more parts. A part starts a [`Procedure`] with its requests to the network, and ends when these are
//! answered and the part's own duration ([`ChipTiming`](super::ChipTiming)) has passed. A network of slave models answers at
//! once, so there the requests are made at the end of that duration.

mod job;
mod network;
mod pdos;
mod requests;
mod transfers;
mod wire;

use super::Chip;
use super::network::{List, Operation, OperationAnswer, SLAVES_MAX, SlaveNetwork};
use crate::ethercat::coe::AbortCode;
use crate::ethercat::{AlStatus, Ns};
use crate::xf::request::PdoConfig;
use crate::xf::{DataSize, Errors};
pub(super) use job::{DatagramJob, EepromJob, FileJob, Job, SdoJob, StateJob};
use requests::Procedure;
pub(super) use requests::Requests;

/// The sizes of each slave's outputs and inputs, in bytes.
pub(super) type Lengths = List<[u16; 2], SLAVES_MAX>;

/// A running job, with the state of its present part.
pub(super) struct ActiveJob {
    pub job: Job,
    /// The time at which the job's requests to the network begin.
    begin_at: Ns,
    /// The earliest end of the job, or of its present part.
    pub due: Ns,
    procedure: Option<Procedure>,
    result: Option<JobResult>,
}

impl ActiveJob {
    /// Whether this is an initialisation that is still waiting for the network port.
    pub const fn waits_for_port(&self) -> bool {
        matches!(self.job, Job::Init(_)) && self.procedure.is_none() && self.result.is_none()
    }

    /// Shortens the wait for the network port by `ns`, because the port is ready that much earlier.
    pub const fn skip(&mut self, ns: Ns) {
        self.due -= ns;
        self.begin_at = self.begin_at.saturating_sub(ns);
    }

    /// The time of the next step if the network does not answer earlier; `None` if only an answer continues the job.
    const fn next_event(&self) -> Option<Ns> {
        match (&self.result, &self.procedure) {
            (Some(_), _) => Some(self.due),
            (None, None) => Some(self.begin_at),
            (None, Some(_)) => self.job.deadline(),
        }
    }
}

/// The result of a job's requests to the network.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
pub(super) enum JobResult {
    /// The present part of the job makes no requests to the network.
    Nothing,
    /// The requests could not be made: the network has no link or no slaves, slaves are not in the state that the job needs,
    /// or the chip refuses the target state.
    Failed,
    /// The network did not answer in time.
    TimedOut,
    Answer(OperationAnswer),
    /// The sizes of each slave's outputs and inputs, in bytes; or the abort code of the SDO transfer that failed.
    Lengths(Result<Lengths, AbortCode>),
    Pdos(Result<PdoConfig, AbortCode>),
}

/// What starting a part of a job returns: a procedure whose requests the network still has to answer, or the result, if the
/// part needs no requests or all of them were answered at once.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
enum PartStart {
    Procedure(Procedure),
    Result(JobResult),
}

/// The end of a part of a job, and how the job continues.
pub(super) enum Progress {
    Done,
    /// Another part follows. It ends at this time at the earliest.
    Next(Ns),
    /// The same part begins again at this time.
    Again(Ns),
    Failed,
}

/// The data that SDO_REQ has read, and the abort code of the last transfer.
pub(super) struct SdoResult {
    pub data: [u8; DataSize::MAX.bytes()],
    /// Number of bytes read; `None` before the first read.
    pub len: Option<usize>,
    /// The abort code; 0 if the transfer succeeded.
    pub abort: AbortCode,
}

impl SdoResult {
    pub const fn new() -> Self {
        Self { data: [0; DataSize::MAX.bytes()], len: None, abort: AbortCode(0) }
    }
}

impl<N: SlaveNetwork> Chip<N> {
    /// Starts a job; returns false if another one is running.
    pub(super) fn start_job(&mut self, job: Job) -> bool {
        if self.job.is_some() {
            return false;
        }
        let due = self.now.saturating_add(self.first_part_ns(&job));
        let begin_at = match job {
            _ if !self.network.takes_time() => due,
            Job::Init(_) => self.port_ready_at.max(self.now),
            _ => self.now,
        };
        self.job = Some(ActiveJob { job, begin_at, due, procedure: None, result: None });
        if self.network.takes_time() {
            self.run_job();
        }
        true
    }

    /// Gives up the running job, the update of states that would follow it, and the operation that the network is executing for it.
    pub(super) fn drop_job(&mut self) {
        (self.job, self.update_is_due) = (None, false);
        self.network.give_up();
    }

    /// The time of the next step of the running job; `None` if no job is running, or if only an answer continues it.
    pub(super) fn next_job_event(&self) -> Option<Ns> {
        let running = self.job.as_ref()?;
        let work = running.procedure.as_ref().and_then(|_| self.network.next_work());
        match (running.next_event(), work) {
            (Some(event), Some(work)) => Some(event.min(work)),
            (event, work) => event.or(work),
        }
    }

    /// The duration of the first or only part of a job, ns. For ECAT_INIT_OP it includes the wait for the network port; for
    /// SDO_REQ the timeout of the command limits it.
    fn first_part_ns(&self, job: &Job) -> Ns {
        let timing = &self.timing;
        let count = Ns::from(self.bus.count);
        match job {
            Job::Init(_) => self.port_ready_at.saturating_sub(self.now) + timing.init_ns,
            Job::Map => timing.reconfig_ns + timing.slave_ns * count,
            Job::InitDc | Job::DcSync(_) => timing.dc_ns,
            Job::PdoConfigSet(_) | Job::PdoConfigRequest(_) => timing.pdo_config_ns,
            Job::Sdo(sdo) => {
                let takes = timing.sdo_ns.saturating_add(self.network.sdo_delay_ns(sdo.slave));
                takes.min(sdo.deadline.saturating_sub(self.now))
            }
            Job::State(state) => self.next_change_ns(state),
            Job::StateUpdate => timing.update_ns,
            Job::FifoInit => timing.fifo_init_ns,
            Job::ReadFlash { .. } | Job::WriteFlash { .. } | Job::File(_) => timing.flash_ns,
            Job::SetManager(_) | Job::SetFmmus | Job::Datagram(_) => timing.datagram_ns,
            Job::Eeprom(_) | Job::ReceiveMail { .. } => timing.sdo_ns,
        }
    }

    /// Continues the running job: makes its requests to the network, and ends the job or a part of it when the answer
    /// has come and the duration has passed.
    pub(super) fn run_job(&mut self) {
        while let Some(mut running) = self.job.take() {
            let result = match self.ask(&mut running) {
                RequestProgress::Result(result) => result,
                RequestProgress::Waits => {
                    self.job = Some(running);
                    return;
                }
            };
            match self.end_part(&mut running.job, result) {
                Progress::Done => self.update_if_due(),
                Progress::Next(due) => {
                    running.due = due.max(self.now + 1);
                    running.begin_at = if self.network.takes_time() { self.now } else { running.due };
                    self.job = Some(running);
                }
                Progress::Again(at) => {
                    (running.due, running.begin_at) = (at, at);
                    self.job = Some(running);
                }
                Progress::Failed => {
                    self.raise(Errors::NON_IMMEDIATE);
                    self.update_if_due();
                }
            }
        }
    }

    /// Called at the end of a job: starts the update of states that its packet has requested.
    fn update_if_due(&mut self) {
        if std::mem::take(&mut self.update_is_due) {
            self.start_job(Job::StateUpdate);
        }
    }

    /// Makes the requests of the present part from `begin_at` on. Returns their result once they are answered and the time
    /// `due` has come.
    fn ask(&mut self, running: &mut ActiveJob) -> RequestProgress {
        if running.result.is_none() && running.procedure.is_none() {
            if self.now < running.begin_at {
                return RequestProgress::Waits;
            }
            match self.begin_part(&mut running.job) {
                PartStart::Procedure(procedure) => running.procedure = Some(procedure),
                PartStart::Result(result) => running.result = Some(result),
            }
        }
        if let Some(procedure) = &mut running.procedure {
            running.result = procedure.run(&mut self.network);
            let is_late = running.job.deadline().is_some_and(|deadline| self.now >= deadline);
            if running.result.is_none() && is_late {
                self.network.give_up();
                (running.result, running.due) = (Some(JobResult::TimedOut), self.now);
            }
            if running.result.is_some() {
                running.procedure = None;
            }
        }
        let is_due = self.now >= running.due;
        running.result.take_if(|_| is_due).map_or(RequestProgress::Waits, RequestProgress::Result)
    }

    /// Starts a procedure that makes requests to the network.
    fn ask_network<F: Future<Output = JobResult> + Send + 'static>(
        &mut self,
        procedure: impl FnOnce(Requests) -> F,
    ) -> PartStart {
        self.requests.begin(&mut self.network, procedure)
    }

    /// Starts a procedure that makes one request to the network and returns its answer as the result.
    fn ask_for(&mut self, operation: Operation) -> PartStart {
        self.ask_network(|requests| async move { JobResult::Answer(requests.ask(operation).await) })
    }

    fn begin_part(&mut self, job: &mut Job) -> PartStart {
        if job.deadline().is_some_and(|deadline| self.now >= deadline) {
            return PartStart::Result(JobResult::TimedOut);
        }
        match job {
            Job::Init(init) => self.begin_init(init),
            Job::Map => self.begin_map(),
            Job::PdoConfigSet(config) => {
                let config = *config;
                self.ask_network(|requests| async move {
                    JobResult::Answer(OperationAnswer::Written(pdos::set(&requests, &config).await))
                })
            }
            Job::PdoConfigRequest(request) => {
                let (request, form) = (*request, self.profile.pdo_config);
                self.ask_network(|requests| async move { JobResult::Pdos(pdos::read(&requests, &request, form).await) })
            }
            Job::Sdo(sdo) => self.begin_sdo(sdo),
            Job::State(state) => self.begin_change(state),
            Job::StateUpdate => self.ask_for(Operation::ReadStates),
            Job::SetManager(request) => self.begin_set_manager(request),
            Job::Eeprom(job) => self.begin_eeprom(job),
            Job::Datagram(job) => self.begin_datagram(job),
            Job::File(job) => self.begin_file(job),
            Job::ReceiveMail { slave } => self.ask_for(Operation::ReceiveMail { slave: *slave }),
            Job::InitDc
            | Job::DcSync(_)
            | Job::FifoInit
            | Job::ReadFlash { .. }
            | Job::WriteFlash { .. }
            | Job::SetFmmus => PartStart::Result(JobResult::Nothing),
        }
    }

    fn end_part(&mut self, job: &mut Job, result: JobResult) -> Progress {
        match (job, result) {
            (_, JobResult::Failed) => Progress::Failed,
            (Job::Init(init), JobResult::Answer(OperationAnswer::Scanned(found))) => self.end_init(init, found),
            (Job::Map, JobResult::Lengths(lengths)) => self.end_map(lengths),
            (Job::InitDc, _) => self.end_init_dc(),
            (Job::DcSync(dc_sync), _) => self.end_dc_sync(dc_sync),
            (Job::PdoConfigSet(_), JobResult::Answer(OperationAnswer::Written(set))) => self.end_pdo_transfer(set),
            (Job::PdoConfigRequest(_), JobResult::Pdos(read)) => {
                let read = read.map(|config| self.pdo_config = Some(config));
                self.end_pdo_transfer(read)
            }
            (Job::Sdo(sdo), result) => self.end_sdo(sdo, result),
            (Job::State(_), JobResult::Lengths(lengths)) => self.end_layout(lengths),
            (Job::State(state), JobResult::Answer(OperationAnswer::Entered(slaves))) => self.end_change(state, &slaves),
            (Job::StateUpdate, _) => {
                self.update_states();
                Progress::Done
            }
            (Job::FifoInit, _) => done_if(self.build_fifos()),
            (Job::ReadFlash { start, bytes }, _) => {
                self.flash.read(*start, *bytes);
                Progress::Done
            }
            (Job::WriteFlash { start, bytes, data }, _) => {
                self.flash.write(*start, &data[..usize::from(*bytes)]);
                Progress::Done
            }
            (Job::SetManager(request), JobResult::Answer(OperationAnswer::ManagerSet(is_set))) => {
                self.end_set_manager(request, is_set)
            }
            (Job::SetFmmus, _) => Progress::Done,
            (Job::Eeprom(_), result) => self.end_eeprom(result),
            (Job::Datagram(job), result) => self.end_datagram(job, result),
            (Job::File(job), JobResult::Answer(OperationAnswer::File(result))) => self.end_file(job, result),
            (Job::ReceiveMail { .. }, JobResult::Answer(OperationAnswer::Mail(mail))) => self.end_mail(mail),
            // Cannot happen: each kind of job gets only the kind of answer that its own request has.
            _ => Progress::Failed,
        }
    }

    /// Allocates the FIFOs for the present process data; returns false if they exceed the memory. `[OURS]` That is a
    /// FIFO error.
    pub(super) fn build_fifos(&mut self) -> bool {
        let fits = self.fifos.build(self.bus.rx_bytes, self.bus.tx_bytes);
        if !fits {
            self.raise(Errors::FIFO);
        }
        fits
    }

    fn update_states(&mut self) {
        for slave in self.bus.slaves() {
            self.bus.update(&self.network, slave);
        }
    }

    fn note_refusal(&mut self, slave: u8, status: AlStatus) {
        self.bus.known[usize::from(slave)].al_status = status.0;
    }
}

/// The outcome of `Chip::ask`: the result of the present part of the job, or the need to wait.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
enum RequestProgress {
    Result(JobResult),
    /// The time for the requests (`begin_at`) or for the end of the part (`due`) has not come, or the network has not
    /// answered yet.
    Waits,
}

impl PartStart {
    /// The requests to the network cannot be made, so the job fails when its duration has passed.
    const FAILED: Self = Self::Result(JobResult::Failed);
}

const fn done_if(done: bool) -> Progress {
    if done { Progress::Done } else { Progress::Failed }
}
