//! Initialisation, process data, clocks, changes of state.

use super::{Progress, StateJob};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::chip::Chip;
use crate::xf::chip::bus::Bus;
use crate::xf::chip::network::{EnterError, Network};
use crate::xf::request::{DcSync, EcatInit, Slaves};

impl<N: Network> Chip<N> {
    /// `[OURS]` The slaves are in Init then; a network without slaves is an error.
    pub(super) fn end_init(&mut self, init: &EcatInit) -> Progress {
        let old = std::mem::replace(&mut self.bus, Bus::new(self.timing.cycle_ns));
        (self.bus.lrw, self.bus.wkc_limit) = (old.lrw, old.wkc_limit);
        self.fifos.build(0, 0);
        self.phy_link = self.network.has_link();
        self.fifo_on = init.fifo_on;
        if !self.phy_link {
            return Progress::Failed;
        }
        self.bus.count = self.network.scan();
        if self.bus.count == 0 {
            return Progress::Failed;
        }
        self.bus.initialised = true;
        if self.profile.is_newer() {
            self.bus.lrw = init.lrw;
        }
        if init.dc.sync0_ns > 0 {
            self.bus.cycle_ns = init.dc.sync0_ns.into();
        }
        // The cycles of the new network begin now.
        self.next_cycle = self.now + self.bus.cycle_ns;
        for slave in self.bus.slaves() {
            self.bus.known[usize::from(slave)].dc = init.dc;
        }
        self.update_states();
        self.end_init_dc()
    }

    /// Process data are laid out in PreOP, in which the slaves' mailboxes answer and their mapping may be changed.
    ///
    /// `[OURS]` In another state it fails. FIFOs that do not fit are a FIFO error and no failure.
    pub(super) fn end_map(&mut self) -> Progress {
        let is_preop = |slave| self.network.state(slave) == Some(AlState::PreOp);
        if self.bus.count == 0 || !self.bus.slaves().all(is_preop) {
            return Progress::Failed;
        }
        if let Err(abort) = self.bus.map(&mut self.network) {
            self.sdo.abort = abort;
            return Progress::Failed;
        }
        self.build_fifos();
        Progress::Done
    }

    /// Slaves with clocks take their times, if AssignActivate is not 0.
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

    /// The slaves that are found, of those that are named.
    pub(in crate::xf::chip) fn chosen(&self, slaves: Slaves) -> std::ops::Range<u8> {
        match slaves {
            Slaves::All => self.bus.slaves(),
            Slaves::One(slave) => slave.get()..(slave.get() + 1).min(self.bus.count.max(slave.get())),
        }
    }

    /// How long the next change on the way to the target takes.
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

    /// Whether a slave is below the target.
    fn goes_up(&self, job: &StateJob, target: AlState) -> bool {
        self.chosen(job.slaves).filter_map(|slave| self.network.state(slave)).any(|state| state < target)
    }

    /// The state that slaves in the lowest one enter next: one above, or the target. `None`: all are there, or none
    /// answers.
    fn next_state(&self, job: &StateJob) -> Option<AlState> {
        let target = job.target?;
        let states = self.chosen(job.slaves).filter_map(|slave| self.network.state(slave));
        let lowest = states.filter(|state| *state != target).min()?;
        Some(lowest.above().min(target))
    }

    /// One change of state: slaves go up one state at a time and together, those in the lowest first; they go down at
    /// once.
    pub(super) fn end_change(&mut self, job: &StateJob) -> Progress {
        let Some(target) = job.target else {
            self.note_boot(job);
            return Progress::Failed;
        };
        let next = self.next_state(job).unwrap_or(target);
        if next >= AlState::SafeOp && !self.bus.mapped && self.layout().is_err() {
            return Progress::Failed;
        }
        let mut has_failed = false;
        for slave in self.chosen(job.slaves) {
            let to = match self.network.state(slave) {
                Some(state) if state > target => target,
                Some(state) if state < next => next,
                Some(state) if state == target => target,
                Some(_) => continue,
                None => {
                    has_failed = true;
                    self.bus.update(&self.network, slave);
                    continue;
                }
            };
            has_failed |= !self.enter(slave, to);
        }
        if job.updates {
            self.update_states();
        }
        let is_there = |slave| self.network.state(slave) == Some(target);
        if has_failed {
            Progress::Failed
        } else if self.chosen(job.slaves).all(is_there) {
            Progress::Done
        } else {
            Progress::Next(self.now + self.next_change_ns(job))
        }
    }

    /// `[OURS]` Process data that are not laid out are before SafeOP, as the slaves have them.
    fn layout(&mut self) -> Result<(), ()> {
        self.bus.map(&mut self.network).map_err(|abort| self.sdo.abort = abort)?;
        self.build_fifos();
        Ok(())
    }

    /// `[OURS]` The state that a slave has entered is in the chip's memory at once.
    fn enter(&mut self, slave: u8, to: AlState) -> bool {
        let place = &self.bus.places[usize::from(slave)];
        if to == AlState::SafeOp && self.network.state(slave) == Some(AlState::PreOp) {
            self.network.set_sync_managers(slave, place.output_bytes, place.input_bytes);
            let known = &self.bus.known[usize::from(slave)];
            self.network.set_sync_cycle(slave, known.dc_active.then_some(known.dc.sync0_ns.into()));
        }
        let entered = self.network.enter(slave, to);
        match entered {
            Ok(()) => {
                self.bus.places[usize::from(slave)].commanded = to;
                self.note_refusal(slave, AlStatus(0));
            }
            Err(EnterError::Refused(status)) => self.note_refusal(slave, status),
            Err(EnterError::NoAnswer) => {}
        }
        self.bus.update(&self.network, slave);
        entered.is_ok()
    }

    fn note_boot(&mut self, job: &StateJob) {
        for slave in self.chosen(job.slaves) {
            self.note_refusal(slave, AlStatus::INVALID_CHANGE);
            self.bus.update(&self.network, slave);
        }
    }
}
