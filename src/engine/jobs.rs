//! The jobs of the bus, which take longer than a cycle: when the engine starts each of them, and what it does at their
//! end. `network.rs` decides which steps a change of state needs.

use super::network::Step;
use super::restore::{SdoOwner, mode_object, mode_write};
use super::{Axis, Engine, Event, EventKind, SlotHead, StateFailure};
use crate::ethercat::coe::AbortCode;
use crate::fieldbus::{
    AlState, AxisOut, BusConfig, Configured, Fieldbus, Job, JobDone, MAX_AXES, Ns, Refusal, Role, SdoDone, SlaveConfig,
    SlaveSet,
};
use crate::sk::{DriveSync, MasterState};

/// How long after the last declaring command (SET_AXIS, SET_DC, DRIVE_MODE) the engine passes the declared configuration
/// to the bus, which may begin to configure slaves early. Programs send these commands one after the other, 2 ms apart
/// (LIB-21), and the bus should get the complete configuration. \[OURS]
const DECLARED_NS: Ns = 10_000_000;

/// The job of the bus that carries out the present step of a boot or of a change of state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NetworkJob {
    /// The step that the job carries out.
    pub(super) step: Step,
    /// For a job that changes the state of slaves: the board time at which the bus ends it with a timeout.
    until: Ns,
}

const fn al_state(state: MasterState) -> AlState {
    match state {
        MasterState::Init => AlState::Init,
        MasterState::PreOp => AlState::PreOp,
        MasterState::SafeOp => AlState::SafeOp,
        MasterState::Op => AlState::Op,
    }
}

/// The state that the network has after this step.
const fn target_of(step: Step) -> MasterState {
    match step {
        Step::Scan | Step::Boot | Step::RecoverToPreOp => MasterState::PreOp,
        Step::Configure | Step::RecoverConfigure => MasterState::SafeOp,
        Step::Move(to) | Step::RecoverTo(to) => to,
    }
}

impl Engine {
    /// Handles the jobs and SDOs of the bus that have ended, and starts the next ones.
    pub(super) fn run_jobs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if std::mem::take(&mut self.cancel_job) && self.job.take().is_some() {
            bus.cancel_job();
        }
        if std::mem::take(&mut self.cancel_sdo) && self.sdo_owner.take().is_some() {
            bus.cancel_sdo();
        }
        self.volatile.network.see(now);
        while let Some(result) = bus.poll_sdo(now) {
            self.sdo_ended(result, now, bus);
        }
        if let Some(done) = bus.poll_job(now) {
            self.job_ended(done, now);
        }
        self.give_up_late_or_obsolete(now, bus);
        self.volatile.network.seen();
        if self.job.is_none() {
            self.start_step(now, bus);
        }
        // SDO transfers of the host and those of the board, which restore modes after homing, alternate. But a host's
        // write of a mode of operation goes first: after it the board no longer has to restore the mode of that axis.
        if self.host_had_turn && self.volatile.sdo.waiting_write().and_then(mode_write).is_none() {
            self.start_restore_if_free(now, bus);
        }
        self.start_host_sdo(now, bus);
        self.start_restore_if_free(now, bus);
        self.tell_declarations(now, bus);
    }

    fn start_restore_if_free(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.job.is_none() && self.sdo_owner.is_none() {
            self.start_restore(now, bus);
        }
    }

    /// Called when SET_AXIS, SET_DC or DRIVE_MODE has declared settings. [`DECLARED_NS`] after the last such command
    /// the bus gets the declared configuration, so that it can prepare it.
    pub(super) const fn declared(&mut self, at: Ns) {
        (self.volatile.has_declared, self.volatile.told_at) = (true, Some(at.saturating_add(DECLARED_NS)));
    }

    /// Passes the declared configuration to the bus while the network stays in PreOP. A bus on which a configuration
    /// takes long may begin with it now, so that the change to SafeOP is faster.
    fn tell_declarations(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        let is_due = self.volatile.told_at.is_some_and(|at| now >= at);
        let is_free = self.job.is_none() && self.sdo_owner.is_none();
        if is_due && is_free && self.network().rests_in(MasterState::PreOp) {
            self.volatile.told_at = None;
            if self.lacks_process_data().is_none() {
                bus.prepare(&self.declared_config(), now);
            }
        }
    }

    /// Ends a change of state as failed if it takes too long (SK-4 \[OURS]: 10 s), whatever the bus does. Cancels the
    /// running job if it is late or leads to a state that is no longer wanted.
    fn give_up_late_or_obsolete(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        let late = self.network().deadline().is_some_and(|deadline| now >= deadline);
        if late {
            let target = self.job.map_or(MasterState::PreOp, |work| target_of(work.step));
            self.fail_state(StateFailure::Late { target }, now);
        }
        if let Some(NetworkJob { step, .. }) = self.job
            && (late || self.network().is_obsolete(step))
        {
            bus.cancel_job();
            self.job = None;
        }
    }

    /// Starts the next step, unless an SDO transfer is in progress: the step may configure or move the slave of the
    /// transfer.
    fn start_step(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        while self.sdo_owner.is_none()
            && let Some(step) = self.network().next_step()
        {
            if step == Step::Configure {
                if let Some(why) = self.lacks_process_data() {
                    self.fail_state(why, now);
                    continue;
                }
                self.start_earlier_sdo(now, bus);
                if self.sdo_owner.is_some() {
                    return;
                }
            }
            if self.awaits_who_was_left(now) || !self.may_begin_step(step) {
                return;
            }
            self.volatile.network.begin(step);
            let until = self.step_deadline(step, now);
            let Some(job) = self.network_job(step, until.saturating_sub(now)) else {
                // No slave has to change its state, so the step is done without a job.
                self.step_done(step, now);
                continue;
            };
            if bus.start(job, now).is_ok() {
                self.job = Some(NetworkJob { step, until });
            }
            return;
        }
    }

    /// Starts an SDO transfer that the host requested before SET_STATE, or in the same frame (SK-6). It runs before the
    /// board configures the slaves, so that the values that the board writes then (0x6060 and others) take precedence.
    fn start_earlier_sdo(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        let Some(seen_at) = self.network().change_seen_at() else { return };
        // The SDO slot may hold a second request besides the waiting one. If the slave of the first is lost, the first
        // ends at once without a transfer, and the second is next. So this runs twice.
        for _ in 0..2 {
            if self.sdo_owner.is_none() && self.volatile.sdo.waits_since(seen_at) {
                self.start_host_sdo(now, bus);
            }
        }
    }

    fn start_host_sdo(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.holds_mode_write(now) {
            return;
        }
        let Some(request) = self.volatile.sdo.waiting(self.config.sdo_timeout_ns) else { return };
        // SK-6 [OURS]: no transfer is started with a slave that was never found or is lost, even if it could answer
        // again.
        if request.slave > self.network().found() || self.network().lost().contains(request.slave) {
            self.volatile.sdo.started();
            return self.sdo_done(Err(AbortCode::TIMEOUT), now);
        }
        // If the bus refuses (during a scan or a configuration), the request stays waiting.
        if self.sdo_owner.is_none() && bus.start_sdo(request, now).is_ok() {
            self.volatile.sdo.started();
            self.sdo_owner = Some(SdoOwner::Host);
        }
    }

    /// When the job of a step times out, board time.
    fn step_deadline(&self, step: Step, now: Ns) -> Ns {
        let change_ends = self.network().deadline().unwrap_or(now.saturating_add(self.config.state_timeout_ns));
        let timeout = self.network().step_timeout(step, change_ends.saturating_sub(now));
        timeout.map_or(change_ends, |ns| change_ends.min(now + ns))
    }

    fn network_job(&mut self, step: Step, timeout_ns: Ns) -> Option<Job> {
        let (target, slaves) = match step {
            Step::Scan => return Some(Job::Scan),
            Step::Configure => return Some(Job::Configure(self.bus_config())),
            Step::Boot => (MasterState::PreOp, self.found_slaves()),
            Step::Move(to) if self.concerns_used_slaves_only(to) => (to, self.present(self.used_slaves())),
            Step::Move(to) => (to, self.present(self.found_slaves())),
            Step::RecoverToPreOp => (MasterState::PreOp, self.network().recovering()),
            Step::RecoverConfigure => return Some(Job::Configure(self.config_for(self.network().recovering()))),
            Step::RecoverTo(to) => (to, self.network().recovering()),
        };
        if slaves.is_empty() {
            return None;
        }
        Some(Job::State { target: al_state(target), slaves, timeout_ns })
    }

    /// The slaves in `slaves` that are not lost.
    pub(super) fn present(&self, slaves: SlaveSet) -> SlaveSet {
        slaves.difference(self.network().lost())
    }

    fn found_slaves(&self) -> SlaveSet {
        SlaveSet::first(self.network().found())
    }

    /// Whether a change to the state `to` concerns only used slaves: between PreOP and OP unused slaves take no part.
    fn concerns_used_slaves_only(&self, to: MasterState) -> bool {
        let from = self.network().state();
        to > MasterState::PreOp || to == MasterState::PreOp && from > Some(MasterState::PreOp)
    }

    /// The slaves that are used. SK-4 \[OURS]: a slave that was found and is declared as not used stays in PreOP, and no
    /// change of state waits for it.
    pub(super) fn used_slaves(&self) -> SlaveSet {
        let mut slaves = self.found_slaves();
        for slave in 1..=self.network().found() {
            if self.volatile.roles[usize::from(slave) - 1] == Role::Unused {
                slaves.remove(slave);
            }
        }
        slaves
    }

    /// Whether SET_AXIS, DRIVE_MODE or SET_DC have declared a configuration that differs from the one in force: the one
    /// that the network has, or that the running change of state applies.
    pub(super) fn has_new_declarations(&self) -> bool {
        let otherwise = |n: usize| {
            (self.volatile.roles[n], self.volatile.syncs[n]) != (self.declared_role(n), self.volatile.modes[n].1)
        };
        self.volatile.cycle_in_op != self.volatile.cycle || (0..usize::from(self.network().found())).any(otherwise)
    }

    /// The role that SET_AXIS and DRIVE_MODE declare for slave `n` (from 0).
    const fn declared_role(&self, n: usize) -> Role {
        let (mode, _) = self.volatile.modes[n];
        Role::of(self.volatile.kinds[n], mode)
    }

    /// The mode of operation that DRIVE_MODE declares for a slave (from 1); 0 for a kind of slave without modes.
    pub(super) fn declared_mode(&self, slave: usize) -> u8 {
        self.declared_role(slave - 1).mode().map_or(0, |mode| mode.code())
    }

    /// Why the network cannot be configured as declared; `None`: it can. SK-7 \[OURS]: an HSP declared with mode 10, or
    /// a STEP with any mode but 8, fails the change from PreOP to SafeOP, whichever slave it is.
    fn lacks_process_data(&self) -> Option<StateFailure> {
        let lacking = (0..usize::from(self.network().found())).find(|n| !self.declared_role(*n).has_process_data());
        lacking.map(|n| StateFailure::Mode { slave: n as u8 + 1, kind: self.volatile.kinds[n] })
    }

    /// Ends the change of state in progress as failed, for the reason `why`.
    fn fail_state(&mut self, why: StateFailure, at: Ns) {
        self.volatile.network.fail();
        self.volatile.left_shown_from = Some(self.answers_valid_from(at));
        self.volatile.failure = Some(why);
        self.log.push(Event { at, kind: EventKind::StateFailed { why } });
    }

    /// Converts the refusal of a step by a slave to the reason of a state failure.
    fn failure_of(&self, step: Step, refusal: Refusal) -> StateFailure {
        let kind = usize::from(refusal.slave).checked_sub(1).and_then(|n| self.volatile.kinds.get(n));
        let configuring = matches!(step, Step::Configure | Step::RecoverConfigure);
        StateFailure::of(refusal, configuring, target_of(step), kind.copied().unwrap_or_default())
    }

    /// The configuration of all slaves as SET_AXIS, SET_DC and DRIVE_MODE have declared it.
    fn declared_config(&self) -> BusConfig {
        let found = usize::from(self.network().found());
        let slaves = std::array::from_fn(|n| match n < found {
            true => SlaveConfig { role: self.declared_role(n), sync: self.volatile.modes[n].1 },
            false => SlaveConfig { role: Role::Unused, sync: DriveSync::DcSync },
        });
        BusConfig { cycle: self.volatile.cycle, selected: self.found_slaves(), slaves }
    }

    /// Puts the declared configuration into force, and returns it.
    fn bus_config(&mut self) -> BusConfig {
        let config = self.declared_config();
        self.volatile.cycle_in_op = config.cycle;
        self.volatile.roles = config.slaves.map(|slave| slave.role);
        self.volatile.syncs = config.slaves.map(|slave| slave.sync);
        config
    }

    /// The configuration that the network has now, for a job that configures only the slaves in `selected`.
    fn config_for(&self, selected: SlaveSet) -> BusConfig {
        let slaves =
            std::array::from_fn(|n| SlaveConfig { role: self.volatile.roles[n], sync: self.volatile.syncs[n] });
        BusConfig { cycle: self.volatile.cycle_in_op, selected, slaves }
    }

    fn sdo_ended(&mut self, result: SdoDone, now: Ns, bus: &mut dyn Fieldbus) {
        match self.sdo_owner.take() {
            Some(SdoOwner::Host) => {
                self.host_had_turn = true;
                self.sdo_done(result, now);
            }
            Some(SdoOwner::Restore(restore)) => {
                self.host_had_turn = false;
                self.restored(restore, result, now);
                // SK-6 [OURS]: a host request that came during a transfer of the board runs next.
                self.start_host_sdo(now, bus);
            }
            None => {}
        }
    }

    fn job_ended(&mut self, done: JobDone, now: Ns) {
        let Some(work) = self.job.take() else { return };
        self.network_job_done(work, done, now);
        if self.volatile.has_declared {
            // The bus has to prepare the declared configuration again: this job has applied the prepared configuration,
            // or slaves have left PreOP and must be configured again.
            self.declared(now);
        }
    }

    fn network_job_done(&mut self, NetworkJob { step, until }: NetworkJob, done: JobDone, now: Ns) {
        use Step::{RecoverConfigure, RecoverTo, RecoverToPreOp};
        match (step, done) {
            (_, JobDone::Scan { found }) => self.scanned(found, StateFailure::NoSlave),
            (_, JobDone::NotScanned(error)) => self.scanned(0, StateFailure::Scan(error)),
            (RecoverConfigure, JobDone::Configure(Ok(Configured { second_axes, disturbed }))) => {
                let others = self.volatile.second_axes.difference(self.network().recovering());
                self.set_second_axes(others.union(second_axes));
                self.step_done(step, now);
                self.note_disturbed(disturbed, now);
            }
            (_, JobDone::Configure(Ok(Configured { second_axes, .. }))) => {
                self.set_second_axes(second_axes);
                self.step_done(step, now);
            }
            (_, JobDone::State(Ok(()))) => self.step_done(step, now),
            (
                RecoverToPreOp | RecoverConfigure | RecoverTo(_),
                JobDone::State(Err(refusal)) | JobDone::Configure(Err(refusal)),
            ) => {
                let silent = refusal.al_status == 0 && refusal.abort.is_none();
                self.volatile.network.recovery_failed(refusal.slave, silent);
                self.volatile.failure = Some(self.failure_of(step, refusal));
            }
            (RecoverToPreOp | RecoverConfigure | RecoverTo(_), JobDone::Beyond(limit)) => {
                let slave = self.network().recovering().iter().next().unwrap_or(1);
                self.volatile.network.recovery_failed(slave, false);
                self.volatile.failure = Some(StateFailure::Hardware(limit));
            }
            (_, JobDone::Beyond(limit)) => self.fail_state(StateFailure::Hardware(limit), now),
            // A repeated SET_STATE has extended the deadline meanwhile, so the timeout of the job is no failure: the
            // step starts again.
            (Step::Move(_), JobDone::State(Err(_)))
                if now >= until && self.network().deadline().is_some_and(|deadline| deadline > until) => {}
            (_, JobDone::State(Err(refusal)) | JobDone::Configure(Err(refusal))) => {
                self.fail_state(self.failure_of(step, refusal), now);
            }
        }
    }

    /// Takes the number of slaves that a scan has found. `without_slaves`: why the network has failed if there are none.
    fn scanned(&mut self, found: u8, without_slaves: StateFailure) {
        let found = found.min(self.config.slot.max_slaves() as u8);
        self.volatile.network.scanned(found);
        // After SW_RESET fewer slaves may be found than before. The outputs of the missing slaves are set to 0: if slaves
        // with these numbers come back, they must not get old outputs.
        self.outputs.slaves[usize::from(found)..].fill(Default::default());
        let before = self.volatile.failure.filter(|why| !why.is_of_scan());
        self.volatile.failure = if found == 0 { Some(without_slaves) } else { before };
    }

    /// Sets which pulse modules have a second axis. Requests and outputs of axes that no longer exist are dropped.
    pub(super) fn set_second_axes(&mut self, second_axes: SlaveSet) {
        for slave in self.volatile.second_axes.difference(second_axes).iter().map(usize::from) {
            self.axes[slave - 1][1] = Axis::default();
            self.outputs.slaves[slave - 1][1] = AxisOut::default();
        }
        self.volatile.second_axes = second_axes;
    }

    fn step_done(&mut self, step: Step, now: Ns) {
        let was_op = self.network().in_op();
        match step {
            Step::Configure => self.modes_configured(self.found_slaves()),
            Step::RecoverConfigure => self.modes_configured(self.network().recovering()),
            _ => {}
        }
        self.volatile.network.done(step);
        if !self.state().is_failed() {
            self.volatile.failure = None;
        }
        self.note_moved(step, now);
        if was_op != self.network().in_op() {
            // OP begins and ends with an empty FIFO, and without pending requests of the axes.
            self.clear_fifo();
            self.leave_homing_with_op(now);
            self.drop_commanded();
            super::axis::reset(&mut self.axes);
            if was_op && self.unconfirmed() > 0 {
                // Commands whose outputs were not sent do not count as executed: the slots show the commands before
                // them.
                self.volatile.heads = self.shown_heads;
            }
            self.volatile.heads.iter_mut().for_each(SlotHead::outputs_off);
            self.shown_heads = self.volatile.heads;
        }
        if self.network().state() < Some(MasterState::SafeOp) {
            // The next change to SafeOP writes the mode of operation of all axes, so nothing has to be restored.
            self.volatile.restores.cancel_all();
        }
        if !was_op && self.network().in_op() {
            // The inputs from SafeOP give the targets of the first outputs in OP, which hold every axis at its
            // position.
            self.answer_axes();
            self.begin_op_outputs();
        }
    }

    /// Called when the bus has configured these slaves. The configuration has also written to 0x6060 the mode that DRIVE_MODE
    /// has set (SK-7.34).
    fn modes_configured(&mut self, slaves: SlaveSet) {
        for slave in slaves.iter().map(usize::from) {
            self.volatile.restores.cancel_slave(slave as u8);
            if let Some(mode) = self.volatile.roles[slave - 1].mode() {
                self.volatile.modes_written[slave - 1] = [mode.code(); MAX_AXES];
            }
        }
    }

    fn sdo_done(&mut self, result: SdoDone, now: Ns) {
        let written_well = result.is_ok();
        let Some(transfer) = self.volatile.sdo.finish(result) else { return };
        if let Err(code) = result {
            self.counters.sdo_aborted += 1;
            let (slave, object, write) = (transfer.slave, transfer.object, transfer.write.is_some());
            self.log.push(Event { at: now, kind: EventKind::SdoAborted { slave, object, write, code } });
        }
        let Some((_, value)) = transfer.write else { return };
        if let Some(axis) = mode_object(transfer.object)
            && written_well
        {
            self.mode_written(transfer.slave, axis, value as u8, now);
        }
    }
}
