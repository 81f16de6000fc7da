//! Scan, changes of state and SDOs: the requests to the master, and the evaluation of their results.

use super::ages::Ages;
use super::configure::Configuring;
use super::{NicBus, NicWires, RunningSdo};
use crate::ethercat::coe::SdoScope;
use crate::ethercat::registers::AlStatusRegister;
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::{Job, JobDone, Refusal, SdoRequest, leaving_op_ns};
use crate::master::{self, JobId, MailboxError, Master, Pace, ScanError, SdoError, StateError, StateReason};
use crate::sk::CycleTime;

/// A running job of the bus.
pub(super) enum Running {
    Scan {
        job: master::Job<Result<u8, ScanError>>,
        /// Whether this is the second scan of the job, after a first one that was disturbed.
        is_second: bool,
    },
    Configure(Box<Configuring>),
    State(Change),
}

/// A running change of state of the slaves.
#[derive(Clone, Copy)]
pub(super) struct Change {
    /// The job of the master that changes the state; `None`: none is running, and the master gets the request at
    /// `again_at`.
    job: Option<master::Job<Result<(), StateError>>>,
    target: AlState,
    slaves: SlaveSet,
    /// `again_at`: when the master gets the request for the change, for the first time or again. `until`: when the
    /// change times out. Both are times of the network card's clock.
    again_at: Ns,
    until: Ns,
    /// Whether the change takes all slaves out of OP and was not requested from the master yet. The outputs in the
    /// board's FIFO are sent first, since they belong to commands from before SET_STATE.
    sends_first: bool,
    /// Whether all slaves were requested to leave OP. The bus then accepts no more outputs, because no slave would use
    /// them.
    takes_no_more: bool,
    /// The slaves that were in OP when this change requested a lower state of them.
    left_op: SlaveSet,
}

/// The time after which the state is requested again from a slave that has not answered, ns. \[OURS]
const AGAIN_NS: Ns = 20_000_000;

/// A running SDO transfer of a value of at most 4 bytes, as a job of the master.
#[derive(Clone, Copy, Debug)]
pub(super) enum Transfer {
    Upload(master::Job<Result<u32, SdoError>>),
    Download(master::Job<Result<(), SdoError>>),
}

impl Transfer {
    pub(super) const fn id(self) -> JobId {
        match self {
            Self::Upload(job) => job.id(),
            Self::Download(job) => job.id(),
        }
    }

    /// Takes the result once the transfer has ended: the value that was read, or `None` after a download.
    pub(super) fn take(self, master: &mut Master) -> Option<Result<Option<u32>, SdoError>> {
        match self {
            Self::Upload(job) => Some(master.take(job)?.map(Some)),
            Self::Download(job) => Some(master.take(job)?.map(|()| None)),
        }
    }
}

/// The error of an SDO transfer that finds the slave's mailbox busy: the master is fetching an emergency, or an answer
/// to an abandoned request. The transfer is repeated.
pub(super) const BUSY: SdoError = SdoError::Mailbox(MailboxError::Busy);

/// The refusal by a slave that answers, with its AL status code. If the slave reports no code, the code is
/// [`Refusal::WITHOUT_REASON`].
fn told(slave: u8, code: AlStatus) -> Refusal {
    Refusal::of(slave, if code == AlStatus::NONE { AlStatus(Refusal::WITHOUT_REASON) } else { code })
}

impl<W: NicWires> NicBus<W> {
    pub(super) fn begin(&mut self, job: Job) {
        self.job = match job {
            Job::Scan => {
                self.forget_slaves();
                Some(Running::Scan { job: self.master.lock().scan(), is_second: false })
            }
            Job::Configure(config) => {
                self.set_cycle(config.cycle);
                let mut configuring = self.spare.take().unwrap_or_else(|| Configuring::place(&self.master));
                configuring.begin_all(config, self.found);
                Some(Running::Configure(configuring))
            }
            Job::State { target, slaves, timeout_ns } => {
                let slaves = slaves.intersection(self.all());
                let now = self.wires.now();
                let until = now.saturating_add(timeout_ns);
                let mut change = Change {
                    job: None,
                    target,
                    slaves,
                    again_at: now,
                    until,
                    sends_first: false,
                    takes_no_more: false,
                    left_op: SlaveSet::EMPTY,
                };
                let in_op = self.in_op();
                if target < AlState::Op && !in_op.is_empty() && in_op.difference(slaves).is_empty() {
                    change.again_at = now.saturating_add(leaving_op_ns(in_op.len()));
                    change.sends_first = true;
                } else {
                    self.ask(&mut change);
                }
                Some(Running::State(change))
            }
        };
    }

    /// Sets the cycle time in the master, unless the master has it already. The master then times the frames so that
    /// each passes the slave with the reference clock at the beginning of a cycle of that clock.
    fn set_cycle(&mut self, cycle: CycleTime) {
        if std::mem::replace(&mut self.cycle, cycle) != cycle || !self.is_paced {
            self.master.lock().set_pace(Some(Pace { cycle_ns: cycle.ns(), phase_ns: 0 }));
            self.is_paced = true;
        }
    }

    /// The slaves that are in OP, as far as the master has read their states.
    fn in_op(&self) -> SlaveSet {
        self.all().iter().filter(|slave| self.state(*slave) == Some(AlState::Op)).collect()
    }

    /// Whether all slaves are leaving OP, so that the bus accepts no more outputs.
    pub(super) const fn leaves_op(&self) -> bool {
        matches!(self.job, Some(Running::State(Change { takes_no_more: true, .. })))
    }

    fn forget_slaves(&mut self) {
        for station in &mut self.stations {
            (station.commanded, station.process_data) = (AlState::Init, None);
        }
        (self.lost, self.has_new_outputs) = (SlaveSet::EMPTY, false);
        self.lost_from.fill(None);
        self.ages = Ages::default();
        self.missed.forget(self.sent);
    }

    /// Prepares a change of state. Slaves that go to a lower state do not count as lost when they reach it. Slaves that
    /// go to OP get outputs that keep their axes at a standstill until the engine pushes the next outputs.
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

    /// Cancels a running job. The slots of a configuration are kept for the next one.
    pub(super) fn give_up(&mut self, job: Running) {
        match job {
            Running::Scan { job, .. } => self.master.lock().cancel(job),
            Running::State(change) => {
                self.stay_in_op(&change);
                change.job.into_iter().for_each(|job| self.master.lock().cancel(job));
            }
            Running::Configure(mut configuring) => {
                configuring.cancel(&self.master);
                self.spare = Some(configuring);
            }
        }
    }

    /// Called when a change of state has failed or was cancelled. Slaves that were leaving OP count as lost (SK-4.73),
    /// with OP as the state to which they have to be brought back. Until then they must get only outputs that keep
    /// their axes at a standstill.
    fn stay_in_op(&mut self, change: &Change) {
        for slave in change.left_op.iter() {
            self.station_mut(slave).commanded = AlState::Op;
            if !self.lost.contains(slave) {
                self.lost.insert(slave);
                self.lost_from[usize::from(slave) - 1] = self.missed.from();
            }
        }
    }

    pub(super) fn ask_for_sdo(&mut self, request: SdoRequest) {
        let SdoRequest { slave, object, write, timeout_ns } = request;
        let mut master = self.master.lock();
        let transfer = match write {
            // An upload returns at most 4 bytes: the board shows only the first 4 bytes of a longer value (SK-6).
            None => Transfer::Upload(master.upload_number(slave, object, SdoScope::Entry, timeout_ns)),
            Some((size, value)) => {
                let bytes = &value.to_le_bytes()[..usize::from(size.bytes())];
                Transfer::Download(master.download(slave, object, SdoScope::Entry, bytes, timeout_ns))
            }
        };
        self.sdo = Some(RunningSdo { request, transfer, until: self.wires.now().saturating_add(timeout_ns) });
    }

    /// Takes the results of ended jobs from the master. The futures of a configuration take their results themselves.
    pub(super) fn take_ends(&mut self) {
        while let Some(sdo) = self.sdo {
            let Some(result) = sdo.transfer.take(&mut self.master.lock()) else { break };
            self.sdo = None;
            self.end_sdo(sdo, result);
        }
        let mut master = self.master.lock();
        while master.take_event().is_some() {}
        match self.job {
            Some(Running::Scan { job, is_second }) => {
                let Some(ended) = master.take(job) else { return };
                (self.job, self.found) = (None, ended.unwrap_or(0));
                self.job_done = match ended {
                    Ok(found) => Some(JobDone::Scan { found }),
                    // While slaves are being switched on, their number changes and frames get lost for a moment.
                    // \[OURS] One more scan is enough in that case.
                    Err(ScanError::Lost | ScanError::Changed { .. }) if !is_second => {
                        self.job = Some(Running::Scan { job: master.scan(), is_second: true });
                        None
                    }
                    Err(error) => Some(JobDone::NotScanned(error)),
                };
            }
            Some(Running::State(change)) => {
                let Some(ended) = change.job.and_then(|job| master.take(job)) else { return };
                drop(master);
                self.job = None;
                self.end_part(change, ended);
            }
            Some(Running::Configure(_)) | None => {}
        }
    }

    /// Continues the running job: sends the request of a change of state once it is due, or polls the futures of a
    /// configuration.
    pub(super) fn run_job(&mut self) {
        self.ask_again();
        let Some(Running::Configure(mut configuring)) = self.job.take_if(|job| matches!(job, Running::Configure(_)))
        else {
            return;
        };
        let Self { master, stations, .. } = self;
        let mut mapped = |slave, data| stations[usize::from(slave) - 1].process_data = data;
        match configuring.run(master, &mut mapped) {
            Some(done) => {
                self.job_done = Some(JobDone::Configure(done));
                self.spare = Some(configuring);
            }
            None => self.job = Some(Running::Configure(configuring)),
        }
    }

    fn end_sdo(&mut self, sdo: RunningSdo, result: Result<Option<u32>, SdoError>) {
        let RunningSdo { request, until, .. } = sdo;
        if result == Err(BUSY) && self.wires.now() < until {
            self.ask_for_sdo(request);
            self.sdo.iter_mut().for_each(|again| again.until = until);
            return;
        }
        let written = request.write.map_or(0, |(_, value)| value);
        self.sdo_done = Some(result.map(|read| read.unwrap_or(written)).map_err(SdoError::abort_code));
    }

    /// Evaluates the result of one request for the change of state. If a slave refuses, the change has failed. If a
    /// slave does not answer, or is busy with another change or its EEPROM, the state is requested again until the
    /// timeout.
    fn end_part(&mut self, change: Change, ended: Result<(), StateError>) {
        let Change { target, slaves, until, .. } = change;
        for slave in slaves.iter() {
            if self.state(slave) == Some(target) {
                self.station_mut(slave).commanded = target;
                self.lost.remove(slave);
                self.ages.forget(slave);
                self.lost_from[usize::from(slave) - 1] = None;
            }
        }
        let now = self.wires.now();
        let refused = || {
            slaves.iter().find_map(|slave| {
                let status = self.master.lock().status(slave).filter(|status| status.is_present)?;
                let is_refused = status.status.contains(AlStatusRegister::ERROR);
                is_refused.then(|| told(slave, status.code))
            })
        };
        let result = match ended.map_err(|StateError { slave, reason, .. }| (refused(), slave, reason)) {
            Ok(()) => Ok(()),
            Err((Some(refusal), ..)) => Err(refusal),
            Err((None, _, StateReason::NoAnswer | StateReason::NotTaken(_) | StateReason::Busy)) if now < until => {
                let again_at = now.saturating_add(AGAIN_NS).min(until);
                self.job = Some(Running::State(Change { job: None, again_at, ..change }));
                return;
            }
            Err((None, slave, StateReason::NoAnswer)) => Err(Refusal::no_answer(slave)),
            Err((None, slave, reason)) => Err(told(slave, reason.code())),
        };
        if result.is_err() {
            self.stay_in_op(&change);
        }
        self.job_done = Some(JobDone::State(result));
    }

    /// Requests the change of state from the master.
    fn ask(&mut self, change: &mut Change) {
        if change.target == AlState::Op {
            // A slave with the commanded state OP gets no request. If it has left OP by itself, it is lost, and the
            // engine has to bring it to PreOP first. With a direct request for OP, an engine that does not know of the
            // loss yet would continue its outputs as if the slave had stayed in OP.
            let is_up = |slave: &u8| self.station(*slave).commanded == AlState::Op;
            change.slaves = change.slaves.iter().filter(|slave| !is_up(slave)).collect();
        } else {
            let was_up = |slave: &u8| self.station(*slave).commanded == AlState::Op;
            change.left_op = change.left_op.union(change.slaves.iter().filter(was_up).collect());
        }
        self.prepare_change(change.target, change.slaves);
        let left = change.until.saturating_sub(self.wires.now());
        change.job = Some(self.master.lock().request_state(change.slaves, change.target, left));
        change.takes_no_more |= std::mem::take(&mut change.sends_first);
    }

    /// Requests the change of state from the master once `again_at` is reached, for the first time or again.
    fn ask_again(&mut self) {
        if let Some(Running::State(mut change @ Change { job: None, again_at, .. })) = self.job
            && self.wires.now() >= again_at
        {
            self.ask(&mut change);
            self.job = Some(Running::State(change));
        }
    }

    /// Called when a cycle has carried no new outputs: all outputs from the board's FIFO were pushed and sent. A change
    /// that has waited for this ([`Change::sends_first`]) takes the slaves out of OP now.
    pub(super) fn all_is_sent(&mut self) {
        let now = self.wires.now();
        if let Some(Running::State(change)) = &mut self.job
            && change.sends_first
        {
            change.again_at = now;
        }
    }
}
