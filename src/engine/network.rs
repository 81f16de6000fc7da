//! The state of the network (SK-4): boot, changes of state, failures, and the recovery of lost slaves. This file
//! decides which step comes next; `jobs.rs` runs the job of the bus for it.

use crate::fieldbus::{Ns, SlaveSet};
use crate::sk::{MasterState, StateByte};

/// A step of a boot or of a change of state, which a job of the bus carries out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Scan the network for slaves, at boot.
    Scan,
    /// Bring all found slaves to PreOP, at boot.
    Boot,
    /// Map the process data, before the change from PreOP to SafeOP.
    Configure,
    /// Bring all slaves to this state.
    Move(MasterState),
    /// Bring lost slaves to PreOP, from whatever state they are in.
    RecoverToPreOp,
    /// Map the process data of the recovering slaves again.
    RecoverConfigure,
    /// Bring the recovering slaves to the state of the network.
    RecoverTo(MasterState),
}

/// How long the first attempt of a recovery waits for all lost slaves together; then the recovery continues without the
/// silent slaves \[OURS]. An SDO has the same timeout.
const RECOVERY_TIMEOUT_NS: Ns = 1_000_000_000;
/// How long each further attempt waits for silent slaves \[OURS]. A slave that is connected and works answers within
/// this time.
const RECOVERY_RETRY_TIMEOUT_NS: Ns = 100_000_000;

/// How far the recovery of lost slaves has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Recovery {
    #[default]
    NotBegun,
    InPreOp,
    Configured,
    /// The lost slaves were brought back. A slave that is lost after this is brought back only by the next SET_STATE.
    Done,
}

/// A requested change of state that has not ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Change {
    target: MasterState,
    deadline: Ns,
    /// When the engine first looked for a step of this change, board time; `None`: the request is newer than the last
    /// cycle. SDO requests from before this time are carried out before the slaves are configured.
    seen_at: Option<Ns>,
    /// Whether [`Step::Configure`] has begun, with the settings declared by then.
    configuring: bool,
    configured: bool,
    /// Whether other settings were declared during the configuration, so that all slaves have to start in PreOP again.
    declared_anew: bool,
    recovery: Recovery,
    /// The lost slaves that this change still has to bring back: those that were lost when the recovery began, without
    /// those that have refused. `None`: the recovery has not begun.
    to_recover: Option<SlaveSet>,
    /// The slaves in `to_recover` that have not answered in this attempt: it continues without them.
    unanswered: SlaveSet,
    /// Whether a lost slave has refused a step of the recovery.
    refused: bool,
}

impl Change {
    const fn to(target: MasterState, deadline: Ns) -> Self {
        Self {
            target,
            deadline,
            seen_at: None,
            configuring: false,
            configured: false,
            declared_anew: false,
            recovery: Recovery::NotBegun,
            to_recover: None,
            unanswered: SlaveSet::EMPTY,
            refused: false,
        }
    }
}

/// The state of the network, and the change of state in progress.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Network {
    /// The last state that all slaves have reached; `None`: none yet since the boot.
    reached: Option<MasterState>,
    failed: bool,
    found: u8,
    scanned: bool,
    /// Whether PreOP was reached since the board booted: USB and SPI answer then.
    talks: bool,
    change: Option<Change>,
    /// The newest SET_STATE since the last cycle, if another change was in progress already. The next cycle may show that
    /// this other change has failed; then the newest request begins as a change of its own.
    newest: Option<Change>,
    /// The slaves that are lost: they have left the state of the network by themselves, and are not back.
    lost: SlaveSet,
    /// The lost slaves that the present change is bringing back now.
    recovering: SlaveSet,
}

impl Step {
    /// Whether this is the first step of bringing lost slaves back.
    fn begins_recovery(self) -> bool {
        match self {
            Self::RecoverToPreOp => true,
            Self::RecoverTo(to) => to <= MasterState::PreOp,
            _ => false,
        }
    }
}

impl Network {
    /// The state that decides which commands are allowed; `None`: the network is booting.
    pub(super) const fn state(&self) -> Option<MasterState> {
        self.reached
    }

    pub(super) const fn in_op(&self) -> bool {
        matches!(self.reached, Some(MasterState::Op))
    }

    /// The state as byte 2 of slot 0 shows it.
    pub(super) const fn state_byte(&self) -> StateByte {
        match self.reached {
            Some(state) if !self.failed && self.lost.is_empty() => StateByte::reached(state),
            None if !self.failed => StateByte::NETWORK_INIT,
            last_good => StateByte::failed(last_good),
        }
    }

    /// Whether the host interface (USB, SPI) answers.
    pub(super) const fn talks(&self) -> bool {
        self.talks
    }

    /// How many slaves were found at boot.
    pub(super) const fn found(&self) -> u8 {
        self.found
    }

    /// Whether all slaves are in this state, and there is no lost slave, no failure and no request for another state.
    pub(super) fn rests_in(&self, state: MasterState) -> bool {
        self.reached == Some(state) && self.change.is_none() && !self.failed && self.lost.is_empty()
    }

    /// The slaves that are lost.
    pub(super) const fn lost(&self) -> SlaveSet {
        self.lost
    }

    /// The lost slaves that the change in progress is bringing back now.
    pub(super) const fn recovering(&self) -> SlaveSet {
        self.recovering
    }

    /// Whether slaves that do not answer at present count as lost. In OP they always do, and in SafeOP except during a
    /// change to OP, which waits for them until its deadline. Below SafeOP no process data are exchanged, and the next
    /// change of state finds missing slaves.
    ///
    /// SK-4 \[OURS]: `awaits` means that the first step of the change has not begun, because it is not known yet which
    /// slaves an earlier, failed change has left behind. Meanwhile silent slaves count as lost in SafeOP, whatever the
    /// target is.
    pub(super) fn notices_losses(&self, awaits: bool) -> bool {
        match self.reached {
            Some(MasterState::Op) => true,
            Some(MasterState::SafeOp) => {
                awaits || self.change.is_none_or(|change| change.target <= MasterState::SafeOp)
            }
            _ => false,
        }
    }

    /// Marks slaves as lost, until a SET_STATE brings them back.
    pub(super) fn mark_lost(&mut self, slaves: SlaveSet) {
        self.lost = self.lost.union(slaves);
    }

    /// Marks slaves as lost that have left the state of the network because a recovery configured other slaves. The
    /// same recovery brings them back.
    pub(super) fn mark_disturbed(&mut self, slaves: SlaveSet) {
        if slaves.is_empty() {
            return;
        }
        self.mark_lost(slaves);
        if let Some(change) = &mut self.change {
            self.recovering = self.recovering.union(slaves);
            change.to_recover = Some(change.to_recover.unwrap_or(self.lost).union(slaves));
        }
    }

    /// SET_STATE. Returns false if the present state does not accept it (Init accepts Init and PreOP only).
    ///
    /// A request during a change replaces the target, and with `new_declarations` also the configuration. A request
    /// that changes nothing does not extend the deadline \[OURS], so that a program that sends SET_STATE in every frame
    /// still sees a failure. A request for the present state acknowledges a failure. Every accepted request brings lost
    /// slaves back.
    pub(super) fn request(&mut self, target: MasterState, deadline: Ns, new_declarations: bool) -> bool {
        let Some(state) = self.reached else { return false };
        if state == MasterState::Init && target > MasterState::PreOp {
            return false;
        }
        if target == state && !self.failed && self.lost.is_empty() && self.change.is_none() {
            return true;
        }
        let new = Change::to(target, deadline);
        if self.newest.is_some() || self.change.is_some_and(|change| change.seen_at.is_some()) {
            self.newest = Some(new);
        }
        self.change = Some(match self.change {
            Some(change) if change.configuring && new_declarations => Change { declared_anew: true, ..new },
            // Slaves that were lost after the recovery of this change are brought back, too.
            Some(change) if change.target == target && change.recovery == Recovery::Done && !self.lost.is_empty() => {
                Change { recovery: Recovery::NotBegun, to_recover: None, refused: false, ..change }
            }
            Some(change) if change.target == target => change,
            Some(Change { configuring, configured, declared_anew, .. }) => {
                Change { configuring, configured, declared_anew, ..new }
            }
            None => new,
        });
        true
    }

    /// The next step of the boot or of the change in progress; `None`: no step is needed.
    pub(super) fn next_step(&self) -> Option<Step> {
        let Some(state) = self.reached else {
            return Some(if self.scanned { Step::Boot } else { Step::Scan });
        };
        let change = self.change?;
        Some(match (state, change.target) {
            // A change to a lower state does not wait for lost slaves: their recovery follows it [OURS].
            (from, to) if to < from => Step::Move(to),
            (from, _) if !self.lost.is_empty() && change.recovery != Recovery::Done => {
                Self::recovery_step(from, change.recovery)
            }
            (from, to) if to == from => Step::Move(to),
            // Some slaves may be in a higher state than others: all go back to the last state that all have reached,
            // and start from there [OURS].
            (from, change_to) if self.failed || change.declared_anew && change_to > from => Step::Move(from),
            (MasterState::Init, _) => Step::Move(MasterState::PreOp),
            (MasterState::PreOp, _) if !change.configured => Step::Configure,
            (MasterState::PreOp, _) => Step::Move(MasterState::SafeOp),
            _ => Step::Move(MasterState::Op),
        })
    }

    fn recovery_step(state: MasterState, recovery: Recovery) -> Step {
        match recovery {
            _ if state <= MasterState::PreOp => Step::RecoverTo(state),
            Recovery::NotBegun => Step::RecoverToPreOp,
            Recovery::InPreOp => Step::RecoverConfigure,
            Recovery::Configured | Recovery::Done => Step::RecoverTo(state),
        }
    }

    /// Called when the engine looks for the next step at `now`. For a new change it keeps this time as [`Change::seen_at`].
    pub(super) fn see(&mut self, now: Ns) {
        if let Some(change) = &mut self.change {
            change.seen_at.get_or_insert(now);
        }
    }

    /// Called when all jobs that ended in this cycle were handled. If another change was in progress at the last SET_STATE, it
    /// has not failed in this cycle, so [`Self::newest`] is not needed any more.
    pub(super) fn seen(&mut self) {
        self.newest = None;
    }

    /// When the engine first looked for a step of the present change; `None`: not yet, or no change is in progress.
    pub(super) fn change_seen_at(&self) -> Option<Ns> {
        self.change.and_then(|change| change.seen_at)
    }

    /// Records that the job for a step begins.
    pub(super) fn begin(&mut self, step: Step) {
        let Some(change) = &mut self.change else { return };
        match step {
            Step::Configure => change.configuring = true,
            _ if step.begins_recovery() => {
                let to_recover = change.to_recover.get_or_insert(self.lost);
                self.recovering = to_recover.difference(change.unanswered);
            }
            _ => {}
        }
    }

    /// How long a step may take when the change has `left` until its deadline; `None`: until the deadline.
    ///
    /// A silent slave does not delay the recovery of the others \[OURS]: they come back without it, and afterwards the
    /// board tries the silent one again until the deadline.
    pub(super) fn step_timeout(&self, step: Step, left: Ns) -> Option<Ns> {
        let change = self.change?;
        let alone = change.to_recover.is_some_and(|to_recover| to_recover.len() <= 1);
        match step {
            _ if alone => None,
            _ if step.begins_recovery() => {
                Some(if change.unanswered.is_empty() { RECOVERY_TIMEOUT_NS } else { RECOVERY_RETRY_TIMEOUT_NS })
            }
            Step::RecoverTo(_) => Some(left / 2),
            _ => None,
        }
    }

    /// Called when a slave does not come back with the others: it has not answered (`silent`), or it has refused and is
    /// not tried again.
    pub(super) fn recovery_failed(&mut self, slave: u8, silent: bool) {
        let Some(change) = &mut self.change else { return };
        if !self.recovering.contains(slave) {
            return self.fail();
        }
        let to_recover = change.to_recover.get_or_insert(self.lost);
        if silent {
            change.unanswered.insert(slave);
        } else {
            to_recover.remove(slave);
            change.refused = true;
        }
        let nobody_left = to_recover.is_empty();
        self.recovering.remove(slave);
        if self.recovering.is_empty() {
            (change.recovery, change.unanswered) = (Recovery::NotBegun, SlaveSet::EMPTY);
            if nobody_left {
                self.fail();
            }
        }
    }

    /// Whether the running step no longer leads to the target, because another state was requested.
    pub(super) fn is_obsolete(&self, step: Step) -> bool {
        match (step, self.change, self.reached) {
            (Step::Configure, Some(change), Some(state)) => change.target <= state,
            (Step::Move(to), Some(change), Some(state)) => {
                to > state && (change.declared_anew || change.target <= state)
            }
            (Step::RecoverToPreOp | Step::RecoverConfigure | Step::RecoverTo(_), Some(change), Some(state)) => {
                change.target < state
            }
            _ => false,
        }
    }

    /// The target state of the present change; `None`: no change is in progress.
    pub(super) fn target(&self) -> Option<MasterState> {
        self.change.map(|change| change.target)
    }

    /// The time at which the present change fails if it has not ended; `None`: no change is in progress.
    pub(super) fn deadline(&self) -> Option<Ns> {
        self.change.map(|change| change.deadline)
    }

    pub(super) fn scanned(&mut self, found: u8) {
        // A scan without slaves is a failure, which the next scan with slaves ends. `self.found` is the result of the
        // scan before: if it found slaves and the network has failed since, these have not reached PreOP. Then the
        // network counts as failed until they reach PreOP, also after further scans.
        self.failed = found == 0 || self.failed && self.found > 0;
        self.found = found;
        self.scanned = found > 0;
    }

    /// Updates the state of the network after a step that has succeeded.
    pub(super) fn done(&mut self, step: Step) {
        let state = match step {
            Step::Scan => return,
            Step::Configure => {
                if let Some(change) = &mut self.change {
                    change.configured = true;
                }
                return;
            }
            Step::RecoverToPreOp => return self.set_recovery(Recovery::InPreOp),
            Step::RecoverConfigure => return self.set_recovery(Recovery::Configured),
            Step::RecoverTo(state) => {
                self.lost = self.lost.difference(self.recovering);
                return self.recovered(state);
            }
            Step::Boot => MasterState::PreOp,
            Step::Move(to) => to,
        };
        self.reached = Some(state);
        self.failed = false;
        self.talks |= step == Step::Boot;
        let all_here = self.lost.is_empty();
        match &mut self.change {
            Some(change) if change.target == state && (all_here || change.recovery == Recovery::Done) => {
                self.change = None
            }
            Some(change) => (change.configuring, change.configured, change.declared_anew) = (false, false, false),
            None => {}
        }
    }

    /// Called when an attempt of the recovery has ended: its slaves are back in the state of the network, `state`.
    fn recovered(&mut self, state: MasterState) {
        let Some(change) = &mut self.change else { return };
        // If a new request has replaced the change meanwhile, the recovery of the new change has not begun and covers
        // all lost slaves. Those that are not back yet are still to be recovered.
        let to_recover = change.to_recover.unwrap_or(self.lost).difference(self.recovering);
        change.to_recover = Some(to_recover);
        if !to_recover.is_empty() {
            (change.recovery, change.unanswered) = (Recovery::NotBegun, SlaveSet::EMPTY);
            return;
        }
        change.recovery = Recovery::Done;
        if change.refused {
            self.fail();
        } else if !self.failed && change.target == state {
            self.change = None;
        }
    }

    fn set_recovery(&mut self, recovery: Recovery) {
        if let Some(change) = &mut self.change {
            change.recovery = recovery;
        }
    }

    /// Called when a step has failed, or the change took too long: the change ends in the present state, without another
    /// attempt. At boot the board scans again.
    ///
    /// SK-4: a SET_STATE that has come since the previous cycle begins now as a new change, as if it had come after the
    /// failure.
    pub(super) fn fail(&mut self) {
        self.failed = true;
        self.change = self.newest.take();
        self.scanned &= self.reached.is_some();
    }
}

#[cfg(test)]
mod tests;
