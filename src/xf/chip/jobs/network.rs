//! Jobs for initialisation, process data, clocks and changes of state.

use super::{JobResult, Lengths, PartStart, Progress, StateJob, pdos};
use crate::ethercat::coe::AbortCode;
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::NetworkState;
use crate::xf::chip::Chip;
use crate::xf::chip::bus::KnownNetwork;
use crate::xf::chip::network::{
    EnterError, Entered, EnteringSlaves, List, Operation, SLAVES_MAX, SlaveNetwork, SlaveSetup,
};
use crate::xf::request::{DcSync, EcatInit, ReferenceClock, Slaves};

impl<N: SlaveNetwork> Chip<N> {
    /// Begins ECAT_INIT_OP: forgets the previous network and scans the present one.
    pub(super) fn begin_init(&mut self, init: &EcatInit) -> PartStart {
        let old = std::mem::replace(&mut self.bus, KnownNetwork::new(self.timing.cycle_ns));
        (self.bus.lrw, self.bus.wkc_limit) = (old.lrw, old.wkc_limit);
        self.fifos.build(0, 0);
        self.phy_link = self.network.has_link();
        self.fifo_on = init.fifo_on;
        if !self.phy_link {
            return PartStart::FAILED;
        }
        self.ask_for(Operation::Scan)
    }

    /// Ends ECAT_INIT_OP. `[OURS]` The slaves are then in Init; a network without slaves is an error. The chip's own
    /// clock is the reference clock if the request says so; firmware before 0x22 always uses the clock of the first
    /// slave.
    pub(super) fn end_init(&mut self, init: &EcatInit, found: u8) -> Progress {
        self.bus.count = found;
        if found == 0 {
            return Progress::Failed;
        }
        self.bus.initialised = true;
        let is_newer = self.profile.is_newer();
        if is_newer {
            self.bus.lrw = init.lrw;
        }
        self.network.set_reference(!is_newer || init.reference_clock == ReferenceClock::FirstSlave);
        if init.dc.sync0_ns > 0 {
            self.bus.cycle_ns = init.dc.sync0_ns.into();
        }
        // The request may have changed the cycle time: the next cycle begins one new cycle time from now.
        self.next_cycle = self.now + self.bus.cycle_ns;
        for slave in self.bus.slaves() {
            self.bus.known[usize::from(slave)].dc = init.dc;
        }
        self.update_states();
        self.end_init_dc()
    }

    /// Begins the layout of process data. It is possible only in PreOP, where the slaves' mailboxes answer and the
    /// mapping may be changed.
    ///
    /// `[OURS]` If any slave is in another state the job fails. FIFOs that exceed their memory set the FIFO error, but the job
    /// succeeds.
    pub(super) fn begin_map(&mut self) -> PartStart {
        let is_preop = |slave| self.network.state(slave) == Some(AlState::PreOp);
        if self.bus.count == 0 || !self.bus.slaves().all(is_preop) {
            return PartStart::FAILED;
        }
        self.begin_layout()
    }

    pub(super) fn end_map(&mut self, lengths: Result<Lengths, AbortCode>) -> Progress {
        if !self.lay_out(lengths) {
            return Progress::Failed;
        }
        self.bus.polls = self.bus.wants_polled;
        for slave in self.bus.slaves() {
            self.network.keep_mail(slave, self.bus.is_polled(slave));
        }
        Progress::Done
    }

    fn begin_layout(&mut self) -> PartStart {
        self.bus.mapped = false;
        let mut assigned = List::<_, SLAVES_MAX>::empty([None; 2]);
        self.bus.slaves().for_each(|slave| assigned.push(self.bus.assigned_lengths(slave)));
        self.ask_network(|requests| async move { JobResult::Lengths(pdos::lengths(&requests, &assigned).await) })
    }

    /// Stores where each slave's outputs and inputs are in the process images, and allocates the FIFOs. Returns false if a
    /// slave's mapping could not be read, or if the data exceed the process images.
    fn lay_out(&mut self, lengths: Result<Lengths, AbortCode>) -> bool {
        match lengths {
            Ok(lengths) => {
                self.bus.lay_out(&lengths);
                self.build_fifos();
                true
            }
            Err(abort) => {
                self.sdo.abort = abort;
                false
            }
        }
    }

    /// Ends ECAT_INIT_DC_OP: activates the clock of each slave that has one, with the times of ECAT_INIT_OP or ECAT_DCSYNC,
    /// unless its AssignActivate is 0.
    pub(super) fn end_init_dc(&mut self) -> Progress {
        if !self.bus.initialised {
            return Progress::Failed;
        }
        let mut any = false;
        for slave in self.bus.slaves() {
            let known = &mut self.bus.known[usize::from(slave)];
            known.dc_active = known.dc.assign_activate != 0 && self.network.has_dc(slave);
            any |= known.dc_active;
        }
        self.bus.dc_stable_at = any.then_some(self.now + self.timing.dc_settle_ns);
        Progress::Done
    }

    pub(super) fn end_dc_sync(&mut self, request: &DcSync) -> Progress {
        for slave in self.chosen(request.slaves) {
            self.bus.known[usize::from(slave)].dc = request.dc;
        }
        Progress::Done
    }

    /// The slaves that a request names, as far as they were found.
    pub(in crate::xf::chip) fn chosen(&self, slaves: Slaves) -> std::ops::Range<u8> {
        match slaves {
            Slaves::All => self.bus.slaves(),
            Slaves::One(slave) => slave.get()..(slave.get() + 1).min(self.bus.count.max(slave.get())),
        }
    }

    /// The duration of the next step towards the target state. It depends on the state, the direction, and the number of slaves
    /// that are not in the target state.
    pub(super) fn next_change_ns(&self, job: &StateJob) -> Ns {
        let slaves = self.chosen(job.slaves);
        match (job.target, self.next_state(job)) {
            (Some(target), Some(next)) => {
                let moving = slaves.filter(|slave| self.network.state(*slave) != Some(target)).count() as u8;
                self.timing.change_ns(next, self.goes_up(job, target), moving)
            }
            _ => self.timing.down_ns,
        }
    }

    /// Whether any of the chosen slaves is below the target state.
    fn goes_up(&self, job: &StateJob, target: AlState) -> bool {
        self.chosen(job.slaves).filter_map(|slave| self.network.state(slave)).any(|state| state < target)
    }

    /// The next state for the slaves in the lowest state: the state above it, but at most the target. `None` if all
    /// slaves that answer are in the target state, or if none answers.
    fn next_state(&self, job: &StateJob) -> Option<AlState> {
        let target = job.target?;
        let states = self.chosen(job.slaves).filter_map(|slave| self.network.state(slave));
        let lowest = states.filter(|state| *state != target).min()?;
        Some(lowest.above().min(target))
    }

    /// Begins one step of a change of state. Slaves go up together, one state at a time, beginning with those in the
    /// lowest state; they go down in a single step.
    ///
    /// `[OURS]` If process data are not laid out yet, this is done before the step to SafeOP. The lengths are those
    /// that the host has set, otherwise those of the slaves' mapping objects.
    pub(super) fn begin_change(&mut self, job: &mut StateJob) -> PartStart {
        let Some(target) = job.target else {
            self.note_boot(job);
            return PartStart::FAILED;
        };
        let next = self.next_state(job).unwrap_or(target);
        if next >= AlState::SafeOp && !self.bus.mapped {
            return self.begin_layout();
        }
        job.has_failed = false;
        let mut slaves = EnteringSlaves::empty((0, AlState::Init));
        for slave in self.chosen(job.slaves) {
            let to = match self.network.state(slave) {
                Some(state) if state > target => target,
                Some(state) if state < next => next,
                Some(state) if state == target => target,
                Some(_) => continue,
                None => {
                    job.has_failed = true;
                    self.bus.update(&self.network, slave);
                    continue;
                }
            };
            if self.set_up(slave, to) {
                slaves.push((slave, to));
            } else {
                job.has_failed = true;
            }
        }
        self.ask_for(Operation::Enter(slaves))
    }

    /// Ends the layout of process data that a change to SafeOP needs first. The step of the change of state then begins again
    /// at once, now with process data laid out.
    pub(super) fn end_layout(&mut self, lengths: Result<Lengths, AbortCode>) -> Progress {
        if self.lay_out(lengths) { Progress::Again(self.now) } else { Progress::Failed }
    }

    /// Writes a slave's settings for SafeOP if it goes there; other states need none. Returns false, with the AL status code
    /// 0x17 (invalid sync manager configuration), if the slave does not support them.
    fn set_up(&mut self, slave: u8, to: AlState) -> bool {
        let place = &mut self.bus.places[usize::from(slave)];
        if self.network.takes_time() {
            // If the slave goes to a lower state, the expected working counter includes only the contribution of that
            // state from now on.
            place.commanded = place.commanded.min(to);
        }
        if to != AlState::SafeOp || self.network.state(slave) != Some(AlState::PreOp) {
            return true;
        }
        let known = &self.bus.known[usize::from(slave)];
        let setup = SlaveSetup {
            output_bytes: place.output_bytes,
            input_bytes: place.input_bytes,
            sync: known.dc_active.then_some(known.dc),
        };
        let is_set = self.network.set_up(slave, &setup);
        if !is_set {
            self.refuse(slave, AlStatus::INVALID_SYNC_MANAGER);
        }
        is_set
    }

    pub(super) fn end_change(&mut self, job: &StateJob, slaves: &Entered) -> Progress {
        let mut has_failed = job.has_failed;
        for (slave, to, entered) in slaves.iter().copied() {
            has_failed |= entered.is_err();
            self.note_entered(slave, to, entered);
        }
        if job.updates {
            self.update_states();
        }
        let is_there = |slave| self.network.state(slave) == job.target;
        if has_failed {
            Progress::Failed
        } else if self.chosen(job.slaves).all(is_there) {
            Progress::Done
        } else {
            Progress::Next(self.now + self.next_change_ns(job))
        }
    }

    /// Records the result of a slave's change of state. `[OURS]` The state that ECAT_STATE_GET reports is updated too, without
    /// ECAT_STATE_UPDATE.
    fn note_entered(&mut self, slave: u8, to: AlState, entered: Result<(), EnterError>) {
        match entered {
            Ok(()) => {
                self.bus.places[usize::from(slave)].commanded = to;
                self.note_refusal(slave, AlStatus::NONE);
            }
            Err(EnterError::CommandRefused(status)) => self.note_refusal(slave, status),
            Err(EnterError::NoAnswer) => {}
        }
        self.bus.update(&self.network, slave);
    }

    fn note_boot(&mut self, job: &StateJob) {
        for slave in self.chosen(job.slaves) {
            self.refuse(slave, AlStatus::INVALID_CHANGE);
        }
    }

    /// Sets the AL status code and the error bit of a slave in the chip's memory when the chip itself refuses a change
    /// of state: to Boot, or to SafeOP with settings that the slave does not support.
    fn refuse(&mut self, slave: u8, status: AlStatus) {
        self.bus.update(&self.network, slave);
        let known = &mut self.bus.known[usize::from(slave)];
        known.al_status = status.0;
        known.state = NetworkState(known.state.0 | NetworkState::ERROR);
    }
}
