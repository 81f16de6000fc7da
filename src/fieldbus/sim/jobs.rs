//! Jobs of the simulated bus: what they do, when, and how they fail.

use super::configure::configure;
use super::{SimBus, Station};
use crate::coe::AbortCode;
use crate::fieldbus::{
    AlState, BusConfig, Configured, Job, JobDone, MAX_AXES, MAX_SLAVES, Ns, Outputs, Refusal, Role, SdoRequest,
    SlaveSet,
};
use crate::slave::AlStatus;

/// A job under way. `due`: when its next part ends.
#[allow(clippy::large_enum_variant, reason = "there are two, and boxing it would allocate")]
pub(super) enum Running {
    Scan { due: Ns },
    Configure { config: BusConfig, next: u8, second_axes: SlaveSet, due: Ns },
    State { target: AlState, slaves: SlaveSet, due: Ns, deadline: Ns },
    Sdo { request: SdoRequest, due: Ns, deadline: Ns },
}

impl Running {
    /// Whether an SDO may run beside it.
    pub(super) const fn leaves_mailboxes(&self) -> bool {
        matches!(self, Self::State { .. })
    }
}

/// How one part of a change of state went.
enum Part {
    /// Everybody is there.
    Done,
    /// The next part takes so long.
    Next(Ns),
    Refused(Refusal),
}

impl SimBus {
    pub(super) fn begin(&self, job: Job, now: Ns) -> Running {
        match job {
            Job::Scan => Running::Scan {
                due: now + self.timing.scan_ns + self.timing.scan_slave_ns * Ns::from(self.countable()),
            },
            Job::Configure(config) => {
                let due = now + self.timing.configure_slave_ns;
                Running::Configure { config, next: 1, second_axes: SlaveSet::EMPTY, due }
            }
            Job::State { target, slaves, timeout_ns } => {
                let due = now + self.next_change_ns(target, self.unsettled(target, slaves));
                Running::State { target, slaves, due, deadline: now.saturating_add(timeout_ns) }
            }
            Job::Sdo(request) => {
                let delay_ns = self.handle.sdo_delay_ns(request.slave);
                let due = now.saturating_add(self.timing.sdo_ns).saturating_add(delay_ns);
                Running::Sdo { request, due, deadline: now.saturating_add(request.timeout_ns) }
            }
        }
    }

    pub(super) fn advance(&mut self, job: &mut Running, now: Ns) -> Option<JobDone> {
        match job {
            Running::Scan { due } => (now >= *due).then(|| JobDone::Scan { found: self.scan() }),
            Running::Configure { config, next, second_axes, due } => {
                while *next <= self.found {
                    if !config.who.contains(*next) {
                        *next += 1;
                        continue;
                    }
                    if now < *due {
                        return None;
                    }
                    match self.configure_slave(config, *next) {
                        Err(refusal) => return Some(JobDone::Configure(Err(refusal))),
                        Ok(true) => second_axes.insert(*next),
                        Ok(false) => {}
                    }
                    *next += 1;
                    *due += self.timing.configure_slave_ns;
                }
                Some(JobDone::Configure(Ok(Configured { second_axes: *second_axes, ..Configured::default() })))
            }
            Running::State { target, slaves, due, deadline } => {
                while now >= *due && *due <= *deadline {
                    match self.change_states(*target, *slaves) {
                        Part::Done => return Some(JobDone::State(Ok(()))),
                        Part::Refused(refusal) => return Some(JobDone::State(Err(refusal))),
                        Part::Next(takes) => *due += takes,
                    }
                }
                let late = self.unsettled(*target, *slaves).iter().next().unwrap_or(1);
                (now >= *deadline).then_some(JobDone::State(Err(Refusal { slave: late, al_status: 0, abort: None })))
            }
            Running::Sdo { request, due, deadline } => {
                if now >= *due && *due <= *deadline && self.has_mailbox(request.slave) {
                    return Some(JobDone::Sdo(self.transfer(request)));
                }
                (now >= *deadline).then_some(JobDone::Sdo(Err(AbortCode::TIMEOUT)))
            }
        }
    }

    /// Slaves that a frame counts on its way: a silent one too, it still passes frames.
    fn countable(&self) -> u8 {
        self.stations.len().min(MAX_SLAVES).min(self.handle.reach().into()) as u8
    }

    fn scan(&mut self) -> u8 {
        self.found = self.countable();
        self.lost = SlaveSet::EMPTY;
        self.outputs = Outputs::default();
        self.held = false;
        for slave in 1..=self.found {
            let answers = self.answers(slave);
            let station = self.station(slave);
            (station.brought, station.process_data) = (AlState::Init, None);
            if answers {
                // Down is open to every slave; one that stays up all the same shows when it is to go up.
                let _ = station.slave.enter(AlState::Init);
            }
        }
        self.found
    }

    /// Whether the slave is a pulse module of two channels.
    fn configure_slave(&mut self, config: &BusConfig, slave: u8) -> Result<bool, Refusal> {
        let wanted = &config.slaves[usize::from(slave) - 1];
        if !self.answers(slave) {
            // Nobody waits for a slave that is not used (SK-4 [OURS]).
            let unused = wanted.role == Role::Unused;
            return if unused { Ok(false) } else { Err(Refusal { slave, al_status: 0, abort: None }) };
        }
        let Station { slave: device, process_data, .. } = self.station(slave);
        if device.state() == AlState::PreOp {
            *process_data = None;
        }
        let configured = configure(&mut **device, wanted).map_err(|refusal| Refusal { slave, ..refusal })?;
        *process_data = configured;
        Ok(configured.is_some_and(|data| data.axes() > 1))
    }

    /// Slaves of the set that were found and are not where they shall be.
    fn unsettled(&self, target: AlState, slaves: SlaveSet) -> SlaveSet {
        let mut unsettled = SlaveSet::EMPTY;
        for slave in (1..=self.found).filter(|slave| slaves.contains(*slave)) {
            if !self.answers(slave) || self.lost.contains(slave) || self.state(slave) != target {
                unsettled.insert(slave);
            }
        }
        unsettled
    }

    /// The next change on the way: slaves go up step by step and together, the lowest first, and down at once. `None`:
    /// nobody who has to move answers.
    fn next_change(&self, target: AlState, unsettled: SlaveSet) -> Option<(AlState, AlState)> {
        let moving = unsettled.iter().filter(|slave| self.answers(*slave));
        moving.map(|slave| self.state(slave)).min().map(|from| (from, above(from).min(target)))
    }

    fn next_change_ns(&self, target: AlState, unsettled: SlaveSet) -> Ns {
        match self.next_change(target, unsettled) {
            Some((from, to)) => self.timing.change_ns(from, to, unsettled.len()),
            None => self.timing.retry_ns,
        }
    }

    fn change_states(&mut self, target: AlState, slaves: SlaveSet) -> Part {
        let unsettled = self.unsettled(target, slaves);
        let mut refused = None;
        if let Some((_, next)) = self.next_change(target, unsettled) {
            for slave in unsettled.iter() {
                let state = self.state(slave);
                let to = if state >= target { target } else { next };
                let waits = state < target && state >= next;
                if self.answers(slave)
                    && !waits
                    && let Err(AlStatus(al_status)) = self.enter(slave, to)
                {
                    refused = refused.or(Some(Refusal { slave, al_status, abort: None }));
                }
            }
        }
        let unsettled = self.unsettled(target, slaves);
        match refused {
            Some(refusal) => Part::Refused(refusal),
            None if unsettled.is_empty() => Part::Done,
            None => Part::Next(self.next_change_ns(target, unsettled)),
        }
    }

    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), AlStatus> {
        if let Some(status) = self.handle.refusal(slave, state) {
            return Err(status);
        }
        let station = self.station(slave);
        station.slave.enter(state)?;
        if state == AlState::Op && station.brought != AlState::Op {
            // What was sent before it left OP is not meant for now.
            self.outputs.slaves[usize::from(slave) - 1] = [Default::default(); MAX_AXES];
        }
        self.station(slave).brought = state;
        self.lost.remove(slave);
        Ok(())
    }

    fn has_mailbox(&self, slave: u8) -> bool {
        (1..=self.found).contains(&slave) && self.answers(slave) && self.state(slave) > AlState::Init
    }

    fn transfer(&mut self, request: &SdoRequest) -> Result<u32, AbortCode> {
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

const fn above(state: AlState) -> AlState {
    match state {
        AlState::Init => AlState::PreOp,
        AlState::PreOp => AlState::SafeOp,
        AlState::SafeOp | AlState::Op => AlState::Op,
    }
}
