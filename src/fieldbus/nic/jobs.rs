//! Scan, changes of state and SDOs: what the master is asked for, and what its ends mean.

use super::configure::Configuring;
use super::{NicBus, NicWires, RunningSdo};
use crate::coe::{AbortCode, SdoScope};
use crate::ethercat::{AlState, AlStatus, SlaveSet};
use crate::fieldbus::{Job, JobDone, Refusal, SdoRequest};
use crate::master::{self, JobId, Master, StateError};

/// A job under way that is no SDO.
pub(super) enum Running {
    Scan(JobId),
    Configure(Box<Configuring>),
    State { id: JobId, target: AlState, slaves: SlaveSet },
}

impl Running {
    /// Whether an SDO may run beside this job.
    pub(super) const fn allows_sdo(&self) -> bool {
        matches!(self, Self::State { .. })
    }

    /// Gives up what the master does for it.
    pub(super) fn cancel(self, master: &mut Master) {
        match self {
            Self::Scan(id) | Self::State { id, .. } => master.cancel(id),
            Self::Configure(configuring) => configuring.cancel(master),
        }
    }
}

/// The slave is not where it is wanted, and has given no reason.
const fn no_answer(slave: u8) -> Refusal {
    Refusal { slave, al_status: 0, abort: None }
}

impl<W: NicWires> NicBus<W> {
    pub(super) fn begin(&mut self, job: Job) {
        self.job = match job {
            Job::Scan => {
                self.forget_slaves();
                Some(Running::Scan(self.master.scan()))
            }
            Job::Configure(config) => {
                self.cycle = config.cycle;
                Some(Running::Configure(Box::new(Configuring::new(config, self.found))))
            }
            Job::State { target, slaves, timeout_ns } => {
                let slaves = slaves.intersection(self.all());
                self.prepare_change(target, slaves);
                Some(Running::State { id: self.master.request_state(slaves, target, timeout_ns), target, slaves })
            }
            Job::Sdo(_) => None,
        };
    }

    fn forget_slaves(&mut self) {
        for station in &mut self.stations {
            (station.commanded, station.process_data) = (AlState::Init, None);
        }
        (self.lost, self.short_from, self.has_new_outputs) = (SlaveSet::EMPTY, None, false);
        self.lost_from.fill(None);
    }

    /// Slaves that are led down are not missed on their way, and those led up get outputs with which nothing moves.
    fn prepare_change(&mut self, target: AlState, slaves: SlaveSet) {
        for slave in slaves.iter() {
            let station = self.station_mut(slave);
            if target == AlState::Op && station.commanded != AlState::Op {
                self.holding.insert(slave);
            } else {
                station.commanded = station.commanded.min(target);
            }
        }
    }

    pub(super) fn start_sdo(&mut self, request: SdoRequest) {
        let SdoRequest { slave, object, write, timeout_ns } = request;
        let id = match write {
            None => self.master.upload(slave, object, SdoScope::Entry, timeout_ns),
            Some((size, value)) => {
                let bytes = value.to_le_bytes();
                self.master.download(slave, object, SdoScope::Entry, &bytes[..usize::from(size.bytes())], timeout_ns)
            }
        };
        self.sdo = Some(RunningSdo { request, id });
    }

    /// Takes from the master what has ended.
    pub(super) fn take_ends(&mut self) {
        while let Some((id, done)) = self.master.take_done() {
            if self.sdo.is_some_and(|sdo| sdo.id == id) {
                self.end_sdo(&done);
                continue;
            }
            match self.job.take() {
                Some(Running::Configure(mut configuring)) => {
                    configuring.take(id, &done);
                    self.job = Some(Running::Configure(configuring));
                }
                Some(Running::Scan(running)) if running == id => self.end_scan(&done),
                Some(Running::State { id: running, target, slaves }) if running == id => {
                    self.end_change(target, slaves, &done);
                }
                other => self.job = other,
            }
        }
        while self.master.take_event().is_some() {}
    }

    /// Goes on with the configuration, if one is under way.
    pub(super) fn run_job(&mut self) {
        let Some(Running::Configure(mut configuring)) = self.job.take_if(|job| matches!(job, Running::Configure(_)))
        else {
            return;
        };
        let mut mapped = Vec::new();
        let ended = configuring.run(&mut self.master, &mut |slave, data| mapped.push((slave, data)));
        for (slave, data) in mapped {
            self.station_mut(slave).process_data = data;
        }
        match ended {
            Some(done) => self.ended.push_back(JobDone::Configure(done)),
            None => self.job = Some(Running::Configure(configuring)),
        }
    }

    fn end_sdo(&mut self, done: &master::JobDone) {
        let Some(RunningSdo { request, .. }) = self.sdo.take() else { return };
        let written = request.write.map_or(0, |(_, value)| value);
        let result = match done {
            // Of a longer value the board shows the first 4 bytes (SK-6).
            master::JobDone::Upload(Ok(bytes)) => {
                let mut value = [0; 4];
                value.iter_mut().zip(bytes).for_each(|(to, byte)| *to = *byte);
                Ok(u32::from_le_bytes(value))
            }
            master::JobDone::Download(Ok(())) => Ok(written),
            master::JobDone::Upload(Err(error)) | master::JobDone::Download(Err(error)) => Err(error.abort_code()),
            _ => Err(AbortCode::TIMEOUT),
        };
        self.ended.push_back(JobDone::Sdo(result));
    }

    fn end_scan(&mut self, done: &master::JobDone) {
        self.found = match done {
            master::JobDone::Scan(Ok(found)) => *found,
            _ => 0,
        };
        self.ended.push_back(JobDone::Scan { found: self.found });
    }

    fn end_change(&mut self, target: AlState, slaves: SlaveSet, done: &master::JobDone) {
        for slave in slaves.iter() {
            if self.state(slave) != Some(target) {
                continue;
            }
            self.station_mut(slave).commanded = target;
            self.lost.remove(slave);
            self.lost_from[usize::from(slave) - 1] = None;
        }
        let result = match done {
            master::JobDone::State(Ok(())) => Ok(()),
            master::JobDone::State(Err(StateError { slave, reason, .. })) => {
                let AlStatus(al_status) = reason.code();
                Err(Refusal { al_status, ..no_answer(*slave) })
            }
            _ => Err(no_answer(slaves.iter().next().unwrap_or(1))),
        };
        self.ended.push_back(JobDone::State(result));
    }
}
