//! What takes more than one datagram and is started by the user: scans, changes of state, SDOs.

use std::future::Future;

use super::bus::Task;
use super::shared::Shared;
use super::states::Plan;
use super::watch::Watch;
use super::{Master, ScanError, SdoError, SlaveInfo, StateError, scan, sdo, states};
use crate::coe::{ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Ns, SlaveSet};

/// Names something that was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct JobId(u64);

/// How something that was started has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JobDone {
    /// A scan: how many slaves were found.
    Scan(Result<u8, ScanError>),
    /// A change of state.
    State(Result<(), StateError>),
    /// An object was read.
    Upload(Result<Vec<u8>, SdoError>),
    /// An object was written.
    Download(Result<(), SdoError>),
}

/// What a sequence gives when it has ended.
pub(super) enum Output {
    Scan(Result<Vec<SlaveInfo>, ScanError>),
    Done(JobDone),
}

/// A sequence that was started.
pub(super) struct Running {
    pub(super) id: JobId,
    pub(super) task: Task<Output>,
}

impl Master {
    /// Makes of a sequence's end what is told of it.
    pub(super) fn end(&mut self, output: Output) -> JobDone {
        match output {
            Output::Done(done) => done,
            Output::Scan(Err(error)) => JobDone::Scan(Err(error)),
            Output::Scan(Ok(slaves)) => {
                let found = slaves.len() as u8;
                self.process.reset(slaves.len());
                self.watch = Some(Box::pin(Watch::new(self.bus.clone(), slaves.clone()).run()));
                self.slaves = slaves;
                JobDone::Scan(Ok(found))
            }
        }
    }

    /// Starts a sequence.
    fn start(&mut self, task: impl Future<Output = Output> + Send + 'static) -> JobId {
        self.next_job += 1;
        let id = JobId(self.next_job);
        self.jobs.push(Running { id, task: Box::pin(task) });
        id
    }

    /// How something that was started has ended; each end is given once.
    pub fn take_done(&mut self) -> Option<(JobId, JobDone)> {
        self.done.pop_front()
    }

    /// Gives up something that was started. Its end is never told; what was sent takes effect.
    pub fn cancel(&mut self, id: JobId) {
        self.jobs.retain(|job| job.id != id);
        self.done.retain(|(done, _)| *done != id);
    }

    /// Starts a scan: which slaves there are, who they are. It brings all slaves to Init without a configuration, and gives up
    /// everything else that is under way.
    pub fn scan(&mut self) -> JobId {
        self.jobs.clear();
        self.watch = None;
        self.slaves.clear();
        self.process.reset(0);
        self.bus.with(Shared::reset);
        let bus = self.bus.clone();
        self.start(async move { Output::Scan(scan::scan(bus).await) })
    }

    /// Starts to bring slaves to a state, step by step and each at its own pace, within `timeout_ns`. Errors are acknowledged on
    /// the way. [`JobDone::State`] names the first slave that does not get there; the others do all the same. On the way to
    /// OP there have to be cycles.
    pub fn request_state(&mut self, slaves: SlaveSet, target: AlState, timeout_ns: Ns) -> JobId {
        let plans: Vec<Plan> = slaves.iter().map(|slave| self.plan(slave)).collect();
        let bus = self.bus.clone();
        self.start(async move {
            let until = bus.now().saturating_add(timeout_ns);
            Output::Done(JobDone::State(states::bring_all(bus, plans, target, until).await))
        })
    }

    fn plan(&self, slave: u8) -> Plan {
        let (managers, fmmus) = self.process.registers(slave);
        let sync = self.process.sync(slave);
        let info = self.slave(slave);
        // A station that nobody has does not answer.
        let station = info.map_or(0, |info| info.station);
        Plan { slave, station, mailbox: info.and_then(SlaveInfo::mailbox_managers), managers, fmmus, sync }
    }

    fn target(&self, slave: u8, object: ObjectAddress, scope: SdoScope, timeout_ns: Ns) -> sdo::Target {
        let info = self.slave(slave);
        let (station, mailbox) = info.map_or((0, None), |info| (info.station, info.mailbox));
        sdo::Target { slave, station, mailbox, object, scope, timeout_ns }
    }

    /// Starts to read an object of any length, at most [`VALUE_BYTES_MAX`](super::VALUE_BYTES_MAX). `timeout_ns`: how long the
    /// slave may take for each answer.
    pub fn upload(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, timeout_ns: Ns) -> JobId {
        let (bus, target) = (self.bus.clone(), self.target(slave, object, scope, timeout_ns));
        self.start(async move { Output::Done(JobDone::Upload(sdo::upload(bus, target).await)) })
    }

    /// Starts to write an object. `timeout_ns`: how long the slave may take for each answer.
    pub fn download(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        value: &[u8],
        timeout_ns: Ns,
    ) -> JobId {
        let (bus, target, value) = (self.bus.clone(), self.target(slave, object, scope, timeout_ns), value.to_vec());
        self.start(async move { Output::Done(JobDone::Download(sdo::download(bus, target, value).await)) })
    }
}
