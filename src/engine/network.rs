//! The state of the network (SK-4): boot, changes of state, failures, and the recovery of lost slaves. It decides which
//! step comes next; `jobs.rs` runs the job of the bus for it.

use crate::fieldbus::{Ns, SlaveSet};
use crate::sk::{MasterState, StateByte};

/// A step of boot or of a change of state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Find the slaves, at boot.
    Scan,
    /// Bring all slaves that were found to PreOP, at boot.
    Boot,
    /// Map the process data, before the change from PreOP to SafeOP.
    Configure,
    /// Bring the slaves to that state.
    Move(MasterState),
    /// Bring lost slaves to PreOP, whichever state they are in.
    RecoverToPreOp,
    /// Map the process data of those slaves again.
    RecoverConfigure,
    /// Bring those slaves to the state of the network.
    RecoverTo(MasterState),
}

/// How long the recovery waits for all lost slaves together, until it goes on without those that do not answer \[OURS].
/// It is the time after which an SDO fails, too.
const RECOVERY_TIMEOUT_NS: Ns = 1_000_000_000;
/// How long it waits each time after that, since slaves that answer have done so by then \[OURS].
const RECOVERY_RETRY_TIMEOUT_NS: Ns = 100_000_000;

/// How far the recovery of lost slaves has got.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Recovery {
    #[default]
    NotBegun,
    InPreOp,
    Configured,
    /// The slaves are back. Those that were lost since then wait for the next SET_STATE.
    Done,
}

/// A change of state under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Change {
    target: MasterState,
    deadline: Ns,
    /// The first look of the jobs at it; `None`: it came since their last one.
    seen_at: Option<Ns>,
    /// [`Step::Configure`] has begun, with the declarations of that time.
    configuring: bool,
    configured: bool,
    /// Something else was declared since, so that all slaves have to start in PreOP again.
    declared_anew: bool,
    recovery: Recovery,
    /// The lost slaves that the change still has to bring back: those that were lost when the recovery began, without
    /// those that have refused; `None`: it has not begun.
    to_recover: Option<SlaveSet>,
    /// The slaves among them that have not answered in this round, so that the others go on without them.
    unanswered: SlaveSet,
    /// A lost slave has refused.
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

/// The state of the network and the change under way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Network {
    /// The last state that all slaves have reached; `None`: none yet since the boot.
    reached: Option<MasterState>,
    failed: bool,
    found: u8,
    scanned: bool,
    /// PreOP was reached since the board booted, so that USB and SPI answer.
    talks: bool,
    change: Option<Change>,
    /// The newest request since the jobs were looked at, beside a change that was under way already. Should that change turn out
    /// to have failed, this one begins.
    newest: Option<Change>,
    /// The slaves that have left the state of the network by themselves.
    lost: SlaveSet,
    /// The slaves among them that the change under way is bringing back now.
    recovering: SlaveSet,
}

impl Step {
    /// Whether it is the first step of a recovery.
    fn begins_recovery(self) -> bool {
        match self {
            Self::RecoverToPreOp => true,
            Self::RecoverTo(to) => to <= MasterState::PreOp,
            _ => false,
        }
    }
}

impl Network {
    /// The state that decides which commands are allowed.
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

    /// Whether the host interface answers.
    pub(super) const fn talks(&self) -> bool {
        self.talks
    }

    /// How many slaves were found at boot.
    pub(super) const fn found(&self) -> u8 {
        self.found
    }

    /// Whether all slaves are in that state, and nothing else was asked for.
    pub(super) fn rests_in(&self, state: MasterState) -> bool {
        self.reached == Some(state) && self.change.is_none() && !self.failed && self.lost.is_empty()
    }

    /// The slaves that are lost.
    pub(super) const fn lost(&self) -> SlaveSet {
        self.lost
    }

    /// The lost slaves that the change under way is bringing back now.
    pub(super) const fn recovering(&self) -> SlaveSet {
        self.recovering
    }

    /// Whether slaves that do not answer now are lost. In OP they always are, and in SafeOP except during a change to OP,
    /// which waits for them until its deadline. Below SafeOP no process data are exchanged, and the next change of state
    /// finds out. SK-4 \[OURS] A change that has not begun any step, because it `awaits` what the one before has left
    /// behind, waits for nobody yet.
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

    /// Marks slaves as lost that have left the state of the network because others were configured in a recovery. The same
    /// recovery brings them back.
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

    /// SET_STATE. False: this state does not accept it (Init accepts Init and PreOP only).
    ///
    /// A request during a change replaces its target, and with `new_declarations` the configuration, too. A request that
    /// changes nothing does not give the change more time \[OURS], so that a program that sends SET_STATE in every frame
    /// sees a failure, too. A request for the present state acknowledges a failure. Every request that is accepted brings
    /// lost slaves back.
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
            // Slaves that were lost since the others came back come back, too.
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

    /// The next step; `None`: there is nothing to do.
    pub(super) fn next_step(&self) -> Option<Step> {
        let Some(state) = self.reached else {
            return Some(if self.scanned { Step::Boot } else { Step::Scan });
        };
        let change = self.change?;
        Some(match (state, change.target) {
            // A change to a lower state does not wait for lost slaves: they are recovered after it [OURS].
            (from, to) if to < from => Step::Move(to),
            (from, _) if !self.lost.is_empty() && change.recovery != Recovery::Done => {
                Self::recovery_step(from, change.recovery)
            }
            (from, to) if to == from => Step::Move(to),
            // Some slaves may be in a higher state than others: all start again in the state that all have reached [OURS].
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

    /// The jobs are looked at.
    pub(super) fn see(&mut self, now: Ns) {
        if let Some(change) = &mut self.change {
            change.seen_at.get_or_insert(now);
        }
    }

    /// The ends of all jobs are known.
    pub(super) fn seen(&mut self) {
        self.newest = None;
    }

    /// When the change under way was seen first; `None`: there is none.
    pub(super) fn change_seen_at(&self) -> Option<Ns> {
        self.change.and_then(|change| change.seen_at)
    }

    /// Notes that a step begins.
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

    /// How long a step may take, when the change has `left` until its deadline; `None`: until the deadline.
    ///
    /// A slave that does not answer does not delay the recovery of the others \[OURS]: they come back without it, and
    /// then it is asked again until the deadline.
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

    /// A slave does not come back with the others: it has not answered (`silent`), or it has refused and is not asked
    /// again.
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

    /// Whether the step under way no longer leads to the target, because another state was requested.
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

    /// The state to which the change under way leads; `None`: there is none.
    pub(super) fn target(&self) -> Option<MasterState> {
        self.change.map(|change| change.target)
    }

    /// When the change under way has failed; `None`: there is none.
    pub(super) fn deadline(&self) -> Option<Ns> {
        self.change.map(|change| change.deadline)
    }

    pub(super) fn scanned(&mut self, found: u8) {
        // Slaves that have not come to PreOP at boot have failed until they do, however often they are tried.
        self.failed = found == 0 || self.failed && self.found > 0;
        self.found = found;
        self.scanned = found > 0;
    }

    /// A step has succeeded.
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

    /// Lost slaves are back in the state of the network.
    fn recovered(&mut self, state: MasterState) {
        let Some(change) = &mut self.change else { return };
        // A request that has replaced the change meanwhile brings back the others that are lost, too.
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

    /// A step has failed, or the change took too long: the change ends where it is, without another attempt. At boot the
    /// board scans again.
    ///
    /// SK-4: a SET_STATE that has come since the cycle before does what it would do a cycle later.
    pub(super) fn fail(&mut self) {
        self.failed = true;
        self.change = self.newest.take();
        self.scanned &= self.reached.is_some();
    }
}

#[cfg(test)]
mod tests;
