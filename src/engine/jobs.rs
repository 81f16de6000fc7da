//! What takes longer than a cycle: the engine's side of the bus's jobs.

use super::network::Step;
use super::restore::Restore;
use super::{Axis, Engine};
use crate::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::{
    AlState, BusConfig, Fieldbus, Job, JobDone, MAX_AXES, MAX_SLAVES, Ns, Role, SlaveConfig, SlaveSet,
};
use crate::sk::{DriveSync, MasterState, SlaveKind};

/// What the bus is doing for us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Work {
    Network(Step),
    HostSdo,
    Restore(Restore),
}

const fn al_state(state: MasterState) -> AlState {
    match state {
        MasterState::Init => AlState::Init,
        MasterState::PreOp => AlState::PreOp,
        MasterState::SafeOp => AlState::SafeOp,
        MasterState::Op => AlState::Op,
    }
}

/// The axis whose mode of operation that object is.
pub(super) const fn mode_object(object: ObjectAddress) -> Option<usize> {
    const SECOND: u16 = MODES_OF_OPERATION + SECOND_AXIS_OFFSET;
    match (object.index, object.sub) {
        (MODES_OF_OPERATION, 0) => Some(0),
        (SECOND, 0) => Some(1),
        _ => None,
    }
}

impl Engine {
    /// Takes the end of the job under way and starts the next one.
    pub(super) fn run_jobs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if std::mem::take(&mut self.cancel_job) && self.job.take().is_some() {
            bus.cancel_job();
        }
        if let Some(work) = self.job
            && let Some(done) = bus.poll_job(now)
        {
            self.job = None;
            self.finish(work, done, now);
            // SK-6 [OURS]: a request that came during transfers of the board's own runs next.
            if matches!(work, Work::Network(Step::Configure) | Work::Restore(_)) {
                self.start_host_sdo(now, bus);
            }
        }
        self.give_up_late_or_obsolete(now, bus);
        if self.job.is_none() {
            self.start_next(now, bus);
        }
    }

    /// A change has its time (SK-4 \[OURS]: 10 s) whatever the bus does, and a way up that nobody wants any more ends.
    fn give_up_late_or_obsolete(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        let late = self.v.network.deadline().is_some_and(|deadline| now >= deadline);
        if late {
            self.v.network.fail();
        }
        if let Some(Work::Network(step)) = self.job
            && (late || self.v.network.is_obsolete(step))
        {
            bus.cancel_job();
            self.job = None;
        }
    }

    fn start_next(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        while let Some(step) = self.v.network.next_step() {
            if step == Step::Configure && !self.has_process_data() {
                self.v.network.fail();
                continue;
            }
            if !self.may_begin(step, bus) {
                break;
            }
            self.v.network.begin(step);
            let Some(job) = self.network_job(step, now) else {
                // Nobody has to move: the state is reached.
                self.step_done(step, now);
                continue;
            };
            if bus.start(job, now).is_ok() {
                self.job = Some(Work::Network(step));
            }
            return;
        }
        self.start_host_sdo(now, bus);
        if self.job.is_none() {
            self.start_restore(now, bus);
        }
    }

    fn start_host_sdo(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.holds_mode_write(now) {
            return;
        }
        let Some(request) = self.v.sdo.waiting(self.config.sdo_timeout_ns) else { return };
        // SK-6 [OURS]: a lost slave is not asked, even if it could answer again.
        if self.v.network.lost().contains(request.slave) {
            self.v.sdo.started();
            return self.sdo_done(Err(AbortCode::TIMEOUT), now);
        }
        if bus.start(Job::Sdo(request), now).is_ok() {
            self.v.sdo.started();
            self.job = Some(Work::HostSdo);
        }
    }

    fn network_job(&mut self, step: Step, now: Ns) -> Option<Job> {
        let timeout_ns = match self.v.network.deadline() {
            Some(deadline) => deadline.saturating_sub(now),
            None => self.config.state_timeout_ns,
        };
        let (target, slaves) = match step {
            Step::Scan => return Some(Job::Scan),
            Step::Configure => return Some(Job::Configure(self.bus_config())),
            Step::Boot => (MasterState::PreOp, self.all_slaves()),
            Step::Move(to) if self.leaves_others_in_preop(to) => (to, self.present(self.used_slaves())),
            Step::Move(to) => (to, self.present(self.all_slaves())),
            Step::Fetch => (MasterState::PreOp, self.v.network.returning()),
            Step::Reconfigure => return Some(Job::Configure(self.last_config(self.v.network.returning()))),
            Step::Return(to) => (to, self.v.network.returning()),
        };
        if slaves.is_empty() {
            return None;
        }
        Some(Job::State { target: al_state(target), slaves, timeout_ns })
    }

    /// Those of a set that are not lost.
    pub(super) fn present(&self, slaves: SlaveSet) -> SlaveSet {
        slaves.difference(self.v.network.lost())
    }

    fn all_slaves(&self) -> SlaveSet {
        SlaveSet::first(self.v.network.found())
    }

    /// Whether a move is one between PreOP and OP: slaves that are not used have no part in it.
    fn leaves_others_in_preop(&self, to: MasterState) -> bool {
        let from = self.v.network.state();
        to > MasterState::PreOp || to == MasterState::PreOp && from > Some(MasterState::PreOp)
    }

    /// SK-4 \[OURS]: a found slave declared as none stays in PreOP and is not waited for.
    pub(super) fn used_slaves(&self) -> SlaveSet {
        let mut slaves = self.all_slaves();
        for slave in 1..=self.v.network.found() {
            if self.v.roles[usize::from(slave) - 1] == Role::Unused {
                slaves.remove(slave);
            }
        }
        slaves
    }

    /// What SET_AXIS and DRIVE_MODE say of slave `n` (from 0).
    const fn declared_role(&self, n: usize) -> Role {
        let (mode, _) = self.v.modes[n];
        match self.v.kinds[n] {
            SlaveKind::Drive => Role::Drive(mode),
            SlaveKind::Step => Role::Step(mode),
            SlaveKind::Hsp => Role::Hsp(mode),
            SlaveKind::Io => Role::Io,
            SlaveKind::None => Role::Unused,
        }
    }

    /// SK-7 \[OURS]: DRIVE_MODE 10 for an HSP and other than 8 for a STEP fail PreOP to SafeOP, whoever the slave is.
    fn has_process_data(&self) -> bool {
        (0..usize::from(self.v.network.found())).all(|n| self.declared_role(n).has_process_data())
    }

    /// The network as programs declared it; from now on it is configured so.
    fn bus_config(&mut self) -> BusConfig {
        self.v.cycle_in_op = self.v.cycle;
        (self.v.roles, self.v.syncs) = ([Role::Unused; MAX_SLAVES], [DriveSync::DcSync; MAX_SLAVES]);
        for n in 0..usize::from(self.v.network.found()) {
            (self.v.roles[n], self.v.syncs[n]) = (self.declared_role(n), self.v.modes[n].1);
        }
        self.last_config(self.all_slaves())
    }

    /// What the network was configured with, for these slaves.
    fn last_config(&self, who: SlaveSet) -> BusConfig {
        let slaves = std::array::from_fn(|n| SlaveConfig { role: self.v.roles[n], sync: self.v.syncs[n] });
        BusConfig { cycle: self.v.cycle_in_op, who, slaves }
    }

    fn finish(&mut self, work: Work, done: JobDone, now: Ns) {
        match (work, done) {
            (Work::Network(Step::Scan), JobDone::Scan { found }) => {
                self.v.network.scanned(found.min(self.config.slot.max_slaves() as u8));
            }
            (Work::Network(step @ (Step::Configure | Step::Reconfigure)), JobDone::Configure(Ok(second_axes))) => {
                let others = match step {
                    Step::Reconfigure => self.v.second_axes.difference(self.v.network.returning()),
                    _ => SlaveSet::EMPTY,
                };
                self.v.second_axes = others.union(second_axes);
                self.step_done(step, now);
            }
            (Work::Network(step), JobDone::State(Ok(()))) => self.step_done(step, now),
            (Work::Network(_), _) => self.v.network.fail(),
            (Work::HostSdo, JobDone::Sdo(result)) => self.sdo_done(result, now),
            (Work::Restore(restore), JobDone::Sdo(result)) => self.restored(restore, result, now),
            (Work::HostSdo | Work::Restore(_), _) => {}
        }
    }

    fn step_done(&mut self, step: Step, now: Ns) {
        let was_op = self.v.network.in_op();
        match step {
            Step::Configure => self.modes_configured(self.all_slaves()),
            Step::Reconfigure => self.modes_configured(self.v.network.returning()),
            _ => {}
        }
        self.v.network.done(step);
        self.slaves_moved(step, now);
        if was_op != self.v.network.in_op() {
            // OP begins and ends with an empty FIFO and with axes that ask for nothing.
            self.clear_fifo();
            self.leave_homing_with_op(now);
            self.forget_commanded();
            self.v.axes = [[Axis::default(); MAX_AXES]; MAX_SLAVES];
            self.shown = self.v.heads;
        }
        if self.v.network.state() < Some(MasterState::SafeOp) {
            // On the way up every mode is written.
            self.v.restores.cancel_all();
        }
        if !was_op && self.v.network.in_op() {
            // What SafeOP has shown goes into the first outputs: they hold every axis where it is.
            self.answer_axes();
        }
    }

    /// "At PreOP -> SafeOP the board writes DRIVE_MODE's value" to 0x6060.
    fn modes_configured(&mut self, who: SlaveSet) {
        for slave in who.iter().map(usize::from) {
            self.v.restores.cancel_slave(slave as u8);
            if let Some(mode) = self.v.roles[slave - 1].mode() {
                self.v.modes_written[slave - 1] = [mode.code(); MAX_AXES];
            }
        }
    }

    fn sdo_done(&mut self, result: Result<u32, AbortCode>, now: Ns) {
        let written_well = result.is_ok();
        let Some(transfer) = self.v.sdo.finish(result) else { return };
        let Some((_, value)) = transfer.write else { return };
        if let Some(axis) = mode_object(transfer.object)
            && written_well
        {
            self.mode_written(transfer.slave, axis, value as u8, now);
        }
    }
}
