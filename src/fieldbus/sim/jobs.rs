//! The jobs and SDOs of the simulated bus: their effects, their durations, and their errors.

use super::configure::configure;
use super::{SimBus, Station};
use crate::ethercat::coe::AbortCode;
use crate::fieldbus::{
    AlState, BusConfig, Configured, Job, JobDone, MAX_AXES, MAX_SLAVES, Ns, Outputs, Refusal, Role, SdoDone,
    SdoRequest, SlaveSet,
};
use crate::sk::DriveSync;
use crate::slave::AlStatus;

/// A job of the simulated bus that is running.
pub(super) struct RunningJob {
    pub(super) job: Job,
    /// When the present step of the job ends.
    due: Ns,
    /// When a change of state times out.
    deadline: Ns,
    /// The slave that the job configures next.
    next: u8,
    second_axes: SlaveSet,
}

impl RunningJob {
    pub(super) const IDLE: Self = Self { job: Job::Scan, due: 0, deadline: 0, next: 0, second_axes: SlaveSet::EMPTY };
}

/// A running SDO.
pub(super) struct RunningSdo {
    request: SdoRequest,
    due: Ns,
    deadline: Ns,
}

/// What follows a step of a change of state.
enum Progress {
    /// All slaves are in the target state.
    Done,
    /// Another step follows, with this duration in ns.
    Next(Ns),
    Refused(Refusal),
}

impl SimBus {
    pub(super) fn begin(&self, job: Job, now: Ns) -> RunningJob {
        let (part_ns, timeout_ns) = match job {
            Job::Scan => (self.timing.scan_ns + self.timing.scan_slave_ns * Ns::from(self.reachable_slaves()), Ns::MAX),
            Job::Configure(_) => (self.timing.configure_slave_ns, Ns::MAX),
            Job::State { target, slaves, timeout_ns } => {
                (self.next_change_ns(target, self.not_in_target_state(target, slaves)), timeout_ns)
            }
        };
        let (due, deadline) = (now + part_ns, now.saturating_add(timeout_ns));
        RunningJob { job, due, deadline, next: 1, second_axes: SlaveSet::EMPTY }
    }

    pub(super) fn begin_sdo(&self, request: SdoRequest, now: Ns) -> RunningSdo {
        let delay_ns = self.handle.sdo_delay_ns(request.slave);
        let due = now.saturating_add(self.timing.sdo_ns).saturating_add(delay_ns);
        RunningSdo { request, due, deadline: now.saturating_add(request.timeout_ns) }
    }

    pub(super) fn end_of_sdo(&mut self, sdo: &RunningSdo, now: Ns) -> Option<SdoDone> {
        let RunningSdo { request, due, deadline } = sdo;
        if now >= *due && due <= deadline && self.has_mailbox(request.slave) {
            return Some(self.transfer(request));
        }
        (now >= *deadline).then_some(Err(AbortCode::TIMEOUT))
    }

    pub(super) fn advance(&mut self, job: &mut RunningJob, now: Ns) -> Option<JobDone> {
        let RunningJob { job, due, deadline, next, second_axes } = job;
        match job {
            Job::Scan => (now >= *due).then(|| JobDone::Scan { found: self.scan() }),
            Job::Configure(config) => {
                while *next <= self.found {
                    if !config.selected.contains(*next) {
                        *next += 1;
                        continue;
                    }
                    if now < *due {
                        return None;
                    }
                    match self.configure_station(config, *next) {
                        Err(refusal) => return Some(JobDone::Configure(Err(refusal))),
                        Ok(true) => second_axes.insert(*next),
                        Ok(false) => {}
                    }
                    *next += 1;
                    *due += self.timing.configure_slave_ns;
                }
                Some(JobDone::Configure(Ok(Configured { second_axes: *second_axes, ..Configured::default() })))
            }
            Job::State { target, slaves, .. } => {
                while now >= *due && *due <= *deadline {
                    match self.change_states(*target, *slaves) {
                        Progress::Done => return Some(JobDone::State(Ok(()))),
                        Progress::Refused(refusal) => return Some(JobDone::State(Err(refusal))),
                        Progress::Next(takes) => *due += takes,
                    }
                }
                let late = self.not_in_target_state(*target, *slaves).iter().next().unwrap_or(1);
                (now >= *deadline).then_some(JobDone::State(Err(Refusal::no_answer(late))))
            }
        }
    }

    /// The number of slaves that a scan counts: those that frames reach. A silent slave counts too: it forwards frames,
    /// but does not process them.
    fn reachable_slaves(&self) -> u8 {
        self.stations.len().min(MAX_SLAVES).min(self.handle.reach().into()) as u8
    }

    fn scan(&mut self) -> u8 {
        self.found = self.reachable_slaves();
        self.lost = SlaveSet::EMPTY;
        self.outputs = Outputs::default();
        self.has_new_outputs = false;
        for slave in 1..=self.found {
            let answers = self.answers(slave);
            let station = self.station(slave);
            (station.commanded, station.process_data) = (AlState::Init, None);
            if answers {
                // The result is ignored: a slave that refuses Init stays in its state, and the next job that needs
                // another state fails.
                let _ = station.slave.enter(AlState::Init);
            }
        }
        self.found
    }

    /// Configures one slave. Returns whether it is a pulse module with two channels.
    fn configure_station(&mut self, config: &BusConfig, slave: u8) -> Result<bool, Refusal> {
        let wanted = &config.slaves[usize::from(slave) - 1];
        if !self.answers(slave) {
            // A slave that is not used does not have to answer (SK-4 [OURS]).
            let unused = wanted.role == Role::Unused;
            return if unused { Ok(false) } else { Err(Refusal::no_answer(slave)) };
        }
        let Station { slave: device, process_data, .. } = self.station(slave);
        if device.state() == AlState::PreOp {
            *process_data = None;
        }
        device.set_sync_cycle(match wanted.sync {
            DriveSync::FreeRun => None,
            DriveSync::DcSync => Some(config.cycle.ns()),
        });
        let configured = configure(&mut **device, wanted).map_err(|refusal| Refusal { slave, ..refusal })?;
        *process_data = configured;
        Ok(configured.is_some_and(|data| data.axes() > 1))
    }

    /// The slaves of a set that were found and are not in the target state, or do not answer.
    fn not_in_target_state(&self, target: AlState, slaves: SlaveSet) -> SlaveSet {
        let mut not_in_target_state = SlaveSet::EMPTY;
        for slave in (1..=self.found).filter(|slave| slaves.contains(*slave)) {
            if !self.answers(slave) || self.lost.contains(slave) || self.state(slave) != target {
                not_in_target_state.insert(slave);
            }
        }
        not_in_target_state
    }

    /// The next transition on the way to the target state, as old and new state. On the way up all slaves move one
    /// state at a time: first only those in the lowest state move, until the others are in the same state. On the way
    /// down one transition suffices. `None`: none of the slaves that have to change their state answers.
    fn next_change(&self, target: AlState, not_in_target_state: SlaveSet) -> Option<(AlState, AlState)> {
        let moving = not_in_target_state.iter().filter(|slave| self.answers(*slave));
        moving.map(|slave| self.state(slave)).min().map(|from| (from, from.above().min(target)))
    }

    fn next_change_ns(&self, target: AlState, not_in_target_state: SlaveSet) -> Ns {
        match self.next_change(target, not_in_target_state) {
            Some((from, to)) => self.timing.change_ns(from, to, not_in_target_state.len()),
            None => self.timing.retry_ns,
        }
    }

    fn change_states(&mut self, target: AlState, slaves: SlaveSet) -> Progress {
        let not_in_target_state = self.not_in_target_state(target, slaves);
        let mut refused = None;
        if let Some((_, next)) = self.next_change(target, not_in_target_state) {
            for slave in not_in_target_state.iter() {
                let state = self.state(slave);
                let to = if state >= target { target } else { next };
                let waits = state < target && state >= next;
                if self.answers(slave)
                    && !waits
                    && let Err(status) = self.enter(slave, to)
                {
                    refused = refused.or(Some(Refusal::of(slave, status)));
                }
            }
        }
        let not_in_target_state = self.not_in_target_state(target, slaves);
        match refused {
            Some(refusal) => Progress::Refused(refusal),
            None if not_in_target_state.is_empty() => Progress::Done,
            None => Progress::Next(self.next_change_ns(target, not_in_target_state)),
        }
    }

    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), AlStatus> {
        if let Some(status) = self.handle.refusal(slave, state) {
            return Err(status);
        }
        let station = self.station(slave);
        station.slave.enter(state)?;
        if state == AlState::Op && station.commanded != AlState::Op {
            // The outputs that were sent before the slave left OP must not act when it enters OP again.
            self.outputs.slaves[usize::from(slave) - 1] = [Default::default(); MAX_AXES];
        }
        self.station(slave).commanded = state;
        self.lost.remove(slave);
        Ok(())
    }

    fn has_mailbox(&self, slave: u8) -> bool {
        (1..=self.found).contains(&slave) && self.answers(slave) && self.state(slave) > AlState::Init
    }

    fn transfer(&mut self, request: &SdoRequest) -> SdoDone {
        if let Some(code) = self.handle.sdo_abort(request.slave, request.object) {
            return Err(code);
        }
        let device = &mut self.station(request.slave).slave;
        match request.write {
            None => device.upload(request.object).map(|value| value.bits),
            Some((size, value)) => device.download(request.object, size, value).map(|()| value),
        }
    }
}
