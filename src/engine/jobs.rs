//! What takes longer than a cycle: the engine's side of the bus's jobs.

use super::network::Step;
use super::restore::Restore;
use super::{Axis, Engine, Event, Head, StateFailure};
use crate::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::{
    AlState, AxisOut, BusConfig, Configured, Fieldbus, Job, JobDone, MAX_AXES, MAX_SLAVES, Ns, Refusal, Role,
    SlaveConfig, SlaveSet,
};
use crate::sk::{DriveSync, MasterState, SlaveKind};

/// What the bus is doing for the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Work {
    pub(super) step: Step,
    /// The bus gives it up then, if it is a change of state.
    until: Ns,
}

/// Whose SDO transfer the bus does. A host's runs beside a change of state (SK-6): a slave that is waited for does not
/// keep the others from answering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transfer {
    Host,
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

/// The state that a step is on the way to.
const fn leads_to(step: Step) -> MasterState {
    match step {
        Step::Scan | Step::Boot | Step::Fetch => MasterState::PreOp,
        Step::Configure | Step::Reconfigure => MasterState::SafeOp,
        Step::Move(to) | Step::Return(to) => to,
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
    /// Takes the ends of the jobs under way and starts the next ones.
    pub(super) fn run_jobs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if std::mem::take(&mut self.cancel_job) && self.job.take().is_some() {
            bus.cancel_job();
        }
        if std::mem::take(&mut self.cancel_transfer) && self.transfer.take().is_some() {
            bus.cancel_sdo();
        }
        while let Some(done) = bus.poll_job(now) {
            self.finish(done, now, bus);
        }
        self.give_up_late_or_obsolete(now, bus);
        if self.job.is_none() {
            self.start_step(now, bus);
        }
        self.start_host_sdo(now, bus);
        if self.job.is_none() && self.transfer.is_none() {
            self.start_restore(now, bus);
        }
    }

    /// A change has its time (SK-4 \[OURS]: 10 s) whatever the bus does, and a way up that nobody wants any more ends.
    fn give_up_late_or_obsolete(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        let late = self.v.network.deadline().is_some_and(|deadline| now >= deadline);
        if late {
            let target = self.job.map_or(MasterState::PreOp, |work| leads_to(work.step));
            self.fail_state(StateFailure::Late { target }, now);
        }
        if let Some(Work { step, .. }) = self.job
            && (late || self.v.network.is_obsolete(step))
        {
            bus.cancel_job();
            self.job = None;
        }
    }

    /// Starts the next step, when no transfer is under way: it may be one to a slave that is to be configured or moved.
    fn start_step(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        while self.transfer.is_none()
            && let Some(step) = self.v.network.next_step()
        {
            if step == Step::Configure
                && let Some(why) = self.lacks_process_data()
            {
                self.fail_state(why, now);
                continue;
            }
            if !self.may_begin(step) {
                return;
            }
            self.v.network.begin(step);
            let until = self.time_of(step, now);
            let Some(job) = self.network_job(step, until.saturating_sub(now)) else {
                // Nobody has to move: the state is reached.
                self.step_done(step, now);
                continue;
            };
            if bus.start(job, now).is_ok() {
                self.job = Some(Work { step, until });
            }
            return;
        }
    }

    fn start_host_sdo(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.holds_mode_write(now) {
            return;
        }
        let Some(request) = self.v.sdo.waiting(self.config.sdo_timeout_ns) else { return };
        // SK-6 [OURS]: a lost slave is not asked, even if it could answer again, nor one that was never found.
        if request.slave > self.v.network.found() || self.v.network.lost().contains(request.slave) {
            self.v.sdo.started();
            return self.sdo_done(Err(AbortCode::TIMEOUT), now);
        }
        // While slaves are looked for or configured the bus is busy.
        if self.transfer.is_none() && bus.start(Job::Sdo(request), now).is_ok() {
            self.v.sdo.started();
            self.transfer = Some(Transfer::Host);
        }
    }

    /// When a step is given up.
    fn time_of(&self, step: Step, now: Ns) -> Ns {
        let change_ends = self.v.network.deadline().unwrap_or(now.saturating_add(self.config.state_timeout_ns));
        self.v
            .network
            .patience(step, change_ends.saturating_sub(now))
            .map_or(change_ends, |ns| change_ends.min(now + ns))
    }

    fn network_job(&mut self, step: Step, timeout_ns: Ns) -> Option<Job> {
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

    /// Whether programs have declared something else than what the network was configured with, or is just being.
    pub(super) fn is_declared_otherwise(&self) -> bool {
        let otherwise = |n: usize| (self.v.roles[n], self.v.syncs[n]) != (self.declared_role(n), self.v.modes[n].1);
        self.v.cycle_in_op != self.v.cycle || (0..usize::from(self.v.network.found())).any(otherwise)
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

    /// The mode that a slave (from 1) was given by DRIVE_MODE; 0 for one that is declared as one without a mode.
    pub(super) fn declared_mode(&self, slave: usize) -> u8 {
        self.declared_role(slave - 1).mode().map_or(0, |mode| mode.code())
    }

    /// SK-7 \[OURS]: DRIVE_MODE 10 for an HSP and other than 8 for a STEP fail PreOP to SafeOP, whoever the slave is.
    fn lacks_process_data(&self) -> Option<StateFailure> {
        let lacking = (0..usize::from(self.v.network.found())).find(|n| !self.declared_role(*n).has_process_data());
        lacking.map(|n| StateFailure::Mode { slave: n as u8 + 1, kind: self.v.kinds[n] })
    }

    /// The change under way ends where it is.
    fn fail_state(&mut self, why: StateFailure, at: Ns) {
        self.v.network.fail();
        self.v.failure = Some(why);
        self.log.push(Event::StateFailed { at, why });
    }

    /// What a slave's refusal means for a step.
    fn failure_of(&self, step: Step, refusal: Refusal) -> StateFailure {
        let kind = usize::from(refusal.slave).checked_sub(1).and_then(|n| self.v.kinds.get(n));
        let configuring = matches!(step, Step::Configure | Step::Reconfigure);
        StateFailure::of(refusal, configuring, leads_to(step), kind.copied().unwrap_or_default())
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

    fn finish(&mut self, done: JobDone, now: Ns, bus: &mut dyn Fieldbus) {
        match done {
            JobDone::Sdo(result) => match self.transfer.take() {
                Some(Transfer::Host) => self.sdo_done(result, now),
                Some(Transfer::Restore(restore)) => {
                    self.restored(restore, result, now);
                    // SK-6 [OURS]: a request that came during transfers of the board's own runs next.
                    self.start_host_sdo(now, bus);
                }
                None => {}
            },
            done => {
                let Some(work) = self.job.take() else { return };
                self.work_done(work, done, now);
            }
        }
    }

    fn work_done(&mut self, Work { step, until }: Work, done: JobDone, now: Ns) {
        match (step, done) {
            (Step::Scan, JobDone::Scan { found }) => {
                self.v.network.scanned(found.min(self.config.slot.max_slaves() as u8));
                self.v.failure = (found == 0).then_some(StateFailure::NoSlave);
            }
            (Step::Configure | Step::Reconfigure, JobDone::Configure(Ok(Configured { second_axes, disturbed }))) => {
                let others = match step {
                    Step::Reconfigure => self.v.second_axes.difference(self.v.network.returning()),
                    _ => SlaveSet::EMPTY,
                };
                self.set_second_axes(others.union(second_axes));
                self.step_done(step, now);
                if step == Step::Reconfigure {
                    self.note_disturbed(disturbed, now);
                }
            }
            (_, JobDone::State(Ok(()))) => self.step_done(step, now),
            (
                Step::Fetch | Step::Reconfigure | Step::Return(_),
                JobDone::State(Err(refusal)) | JobDone::Configure(Err(refusal)),
            ) => {
                let silent = refusal.al_status == 0 && refusal.abort.is_none();
                self.v.network.stays_away(refusal.slave, silent);
                self.v.failure = Some(self.failure_of(step, refusal));
            }
            // The change has got more time since: the step begins again.
            (Step::Move(_), JobDone::State(Err(_)))
                if now >= until && self.v.network.deadline().is_some_and(|deadline| deadline > until) => {}
            (_, JobDone::State(Err(refusal)) | JobDone::Configure(Err(refusal))) => {
                self.fail_state(self.failure_of(step, refusal), now);
            }
            _ => self.v.network.fail(),
        }
    }

    /// Nothing is asked of an axis that is none any more.
    pub(super) fn set_second_axes(&mut self, second_axes: SlaveSet) {
        for slave in self.v.second_axes.difference(second_axes).iter().map(usize::from) {
            self.v.axes[slave - 1][1] = Axis::default();
            self.outputs.slaves[slave - 1][1] = AxisOut::default();
        }
        self.v.second_axes = second_axes;
    }

    fn step_done(&mut self, step: Step, now: Ns) {
        let was_op = self.v.network.in_op();
        match step {
            Step::Configure => self.modes_configured(self.all_slaves()),
            Step::Reconfigure => self.modes_configured(self.v.network.returning()),
            _ => {}
        }
        self.v.network.done(step);
        if !self.state().is_failed() {
            self.v.failure = None;
        }
        self.slaves_moved(step, now);
        if was_op != self.v.network.in_op() {
            // OP begins and ends with an empty FIFO and with axes that ask for nothing.
            self.clear_fifo();
            self.leave_homing_with_op(now);
            self.forget_commanded();
            self.v.axes = [[Axis::default(); MAX_AXES]; MAX_SLAVES];
            if was_op && self.unknown() > 0 {
                // What lies ahead has not been executed.
                self.v.heads = self.shown;
            }
            self.v.heads.iter_mut().for_each(Head::outputs_off);
            self.shown = self.v.heads;
        }
        if self.v.network.state() < Some(MasterState::SafeOp) {
            // On the way up every mode is written.
            self.v.restores.cancel_all();
        }
        if !was_op && self.v.network.in_op() {
            // What SafeOP has shown goes into the first outputs: they hold every axis where it is.
            self.answer_axes();
            self.begin_outputs();
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
        if let Err(code) = result {
            self.counters.sdo_aborted += 1;
            let (slave, object, write) = (transfer.slave, transfer.object, transfer.write.is_some());
            self.log.push(Event::SdoAborted { at: now, slave, object, write, code });
        }
        let Some((_, value)) = transfer.write else { return };
        if let Some(axis) = mode_object(transfer.object)
            && written_well
        {
            self.mode_written(transfer.slave, axis, value as u8, now);
        }
    }
}
