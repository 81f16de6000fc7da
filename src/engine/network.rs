//! The network's state (SK-4): boot, changes on the recovery up and down, failures, lost slaves. Decides which job the bus
//! does next.

use crate::fieldbus::{Ns, SlaveSet};
use crate::sk::{MasterState, StateByte};

/// A step of boot or of a change: what the bus is asked to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Look for slaves.
    Scan,
    /// Bring all slaves found to PreOP, at boot.
    Boot,
    /// Map process data, on the recovery from PreOP to SafeOP.
    Configure,
    /// Bring the slaves to that state.
    Move(MasterState),
    /// Bring lost ones to PreOP, wherever they have fallen.
    RecoverToPreOp,
    /// Map the process data of those.
    RecoverConfigure,
    /// Bring those to the state that the others are in.
    RecoverTo(MasterState),
}

/// So long lost slaves are waited for together, until those that do not answer are left behind \[OURS]: a slave that is
/// silent for so long ends an SDO, too.
const RECOVERY_TIMEOUT_NS: Ns = 1_000_000_000;
/// And so long each time after that: who answers is there already \[OURS].
const RECOVERY_RETRY_TIMEOUT_NS: Ns = 100_000_000;

/// How far the lost slaves have come on their recovery back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Recovery {
    #[default]
    EntryAhead,
    InPreOp,
    Configured,
    /// They are back. Who was lost since then waits for the next SET_STATE.
    Done,
}

/// A change under recovery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Change {
    target: MasterState,
    deadline: Ns,
    /// Its Configure has op_start, with what was declared then.
    configuring: bool,
    configured: bool,
    /// Something else was declared since: all begin in PreOP again.
    declared_anew: bool,
    recovery: Recovery,
    /// Lost slaves that it still has to bring back: those that were lost when it began, but for those that have refused.
    to_recover: Option<SlaveSet>,
    /// Those of them that the others do not wait for: they have not answered in this round.
    unanswered: SlaveSet,
    /// Some lost slave has refused.
    refused: bool,
}

impl Change {
    const fn to(target: MasterState, deadline: Ns) -> Self {
        Self {
            target,
            deadline,
            configuring: false,
            configured: false,
            declared_anew: false,
            recovery: Recovery::EntryAhead,
            to_recover: None,
            unanswered: SlaveSet::EMPTY,
            refused: false,
        }
    }
}

/// Where the network is and where it goes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Network {
    /// The last state that all slaves reached; `None` before the first.
    reached: Option<MasterState>,
    failed: bool,
    found: u8,
    scanned: bool,
    /// PreOP was reached since the board booted: USB and SPI talk.
    talks: bool,
    change: Option<Change>,
    /// Slaves that did not stay where the network is.
    lost: SlaveSet,
    /// Those of them that the change under recovery brings back together now.
    recovering: SlaveSet,
}

impl Step {
    /// Whether lost slaves begin their recovery back with it.
    fn begins_recovery(self) -> bool {
        match self {
            Self::RecoverToPreOp => true,
            Self::RecoverTo(to) => to <= MasterState::PreOp,
            _ => false,
        }
    }
}

impl Network {
    /// The state by which commands are allowed.
    pub(super) const fn state(&self) -> Option<MasterState> {
        self.reached
    }

    pub(super) const fn in_op(&self) -> bool {
        matches!(self.reached, Some(MasterState::Op))
    }

    /// Byte 2 of slot 0.
    pub(super) const fn state_byte(&self) -> StateByte {
        match self.reached {
            Some(state) if !self.failed && self.lost.is_empty() => StateByte::reached(state),
            None if !self.failed => StateByte::NETWORK_INIT,
            last_good => StateByte::failed(last_good),
        }
    }

    /// Whether the host interface is up.
    pub(super) const fn talks(&self) -> bool {
        self.talks
    }

    /// Slaves found at boot.
    pub(super) const fn found(&self) -> u8 {
        self.found
    }

    /// Slaves that are lost.
    pub(super) const fn lost(&self) -> SlaveSet {
        self.lost
    }

    /// Those of them that the change under recovery brings back together now.
    pub(super) const fn recovering(&self) -> SlaveSet {
        self.recovering
    }

    /// Whether slaves that do not answer now are lost: in OP always. In SafeOP too, but on the recovery up to OP: that change
    /// has its time for them. Below SafeOP nothing is exchanged that would be missed, and the next change finds out.
    /// SK-4 \[OURS]
    pub(super) fn notices_losses(&self) -> bool {
        match self.reached {
            Some(MasterState::Op) => true,
            Some(MasterState::SafeOp) => self.change.is_none_or(|change| change.target <= MasterState::SafeOp),
            _ => false,
        }
    }

    /// Slaves are lost, until a SET_STATE brings them back.
    pub(super) fn mark_lost(&mut self, slaves: SlaveSet) {
        self.lost = self.lost.union(slaves);
    }

    /// Slaves have fallen from the network's state because others were configured, which are on their recovery back: these go
    /// with them.
    pub(super) fn mark_disturbed(&mut self, slaves: SlaveSet) {
        if slaves.is_empty() {
            return;
        }
        self.mark_lost(slaves);
        if let Some(change) = &mut self.change {
            self.recovering = self.recovering.union(slaves);
            change.to_recover = Some(change.to_recover.unwrap_or(SlaveSet::EMPTY).union(slaves));
        }
    }

    /// SET_STATE. False: this state does not accept it (Init accepts Init and PreOP only).
    ///
    /// A request during a change replaces its target, and with `new_declarations` what is to be configured. One that
    /// replaces nothing does not give the change more time \[OURS]: a program that asks in every frame shall see a failure,
    /// too. A request for the state the network is in acknowledges a failure. Every accepted one brings lost slaves back.
    pub(super) fn request(&mut self, target: MasterState, deadline: Ns, new_declarations: bool) -> bool {
        let Some(state) = self.reached else { return false };
        if state == MasterState::Init && target > MasterState::PreOp {
            return false;
        }
        if target == state && !self.failed && self.lost.is_empty() && self.change.is_none() {
            return true;
        }
        let new = Change::to(target, deadline);
        self.change = Some(match self.change {
            Some(change) if change.configuring && new_declarations => Change { declared_anew: true, ..new },
            // Who was lost since others came back comes back as well.
            Some(change) if change.target == target && change.recovery == Recovery::Done && !self.lost.is_empty() => {
                Change { recovery: Recovery::EntryAhead, to_recover: None, refused: false, ..change }
            }
            Some(change) if change.target == target => change,
            Some(Change { configuring, configured, declared_anew, .. }) => {
                Change { configuring, configured, declared_anew, ..new }
            }
            None => new,
        });
        true
    }

    /// What the bus is to do next; `None`: nothing.
    pub(super) fn next_step(&self) -> Option<Step> {
        let Some(state) = self.reached else {
            return Some(if self.scanned { Step::Boot } else { Step::Scan });
        };
        let change = self.change?;
        Some(match (state, change.target) {
            // Nobody waits for the lost ones on the recovery down: they follow [OURS].
            (from, to) if to < from => Step::Move(to),
            (from, _) if !self.lost.is_empty() && change.recovery != Recovery::Done => {
                Self::recovery_step(from, change.recovery)
            }
            (from, to) if to == from => Step::Move(to),
            // Some slaves may have gone further than others: all begin where all have been [OURS].
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
            Recovery::EntryAhead => Step::RecoverToPreOp,
            Recovery::InPreOp => Step::RecoverConfigure,
            Recovery::Configured | Recovery::Done => Step::RecoverTo(state),
        }
    }

    /// A step begins.
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

    /// How long a step is waited for, of the time that the change has left; `None`: as long as that.
    ///
    /// A dead slave does not keep those back that could come \[OURS]: who does not answer is left behind, the others come
    /// back without it, and then it is asked again while there is time.
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

    /// A slave does not come back with the others: it says nothing, or it refuses and is not asked again.
    pub(super) fn recovery_failed(&mut self, slave: u8, silent: bool) {
        let Some(change) = &mut self.change else { return };
        if !self.recovering.contains(slave) {
            return self.fail();
        }
        let to_recover = change.to_recover.get_or_insert(self.recovering);
        if silent {
            change.unanswered.insert(slave);
        } else {
            to_recover.remove(slave);
            change.refused = true;
        }
        let nobody_left = to_recover.is_empty();
        self.recovering.remove(slave);
        if self.recovering.is_empty() {
            (change.recovery, change.unanswered) = (Recovery::EntryAhead, SlaveSet::EMPTY);
            if nobody_left {
                self.fail();
            }
        }
    }

    /// Whether the step under recovery no longer leads to the target: the recovery up was given up.
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

    /// When the change under recovery has failed.
    pub(super) fn deadline(&self) -> Option<Ns> {
        self.change.map(|change| change.deadline)
    }

    pub(super) fn scanned(&mut self, found: u8) {
        self.found = found;
        self.scanned = found > 0;
        self.failed = found == 0;
    }

    /// A step ended well. Says what was reached, if a state was.
    pub(super) fn done(&mut self, step: Step) -> Option<MasterState> {
        let state = match step {
            Step::Scan => return None,
            Step::Configure => {
                if let Some(change) = &mut self.change {
                    change.configured = true;
                }
                return None;
            }
            Step::RecoverToPreOp => {
                self.set_recovery(Recovery::InPreOp);
                return None;
            }
            Step::RecoverConfigure => {
                self.set_recovery(Recovery::Configured);
                return None;
            }
            Step::RecoverTo(state) => {
                self.lost = self.lost.difference(self.recovering);
                self.recovered(state);
                return None;
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
        Some(state)
    }

    /// Lost slaves are back in the network's state.
    fn recovered(&mut self, state: MasterState) {
        let Some(change) = &mut self.change else { return };
        let to_recover = change.to_recover.map_or(SlaveSet::EMPTY, |to_recover| to_recover.difference(self.recovering));
        change.to_recover = Some(to_recover);
        if !to_recover.is_empty() {
            (change.recovery, change.unanswered) = (Recovery::EntryAhead, SlaveSet::EMPTY);
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

    /// A step failed, or the change took too long: it ends where it is, without retries. At boot the board looks for
    /// slaves again.
    pub(super) fn fail(&mut self) {
        self.failed = true;
        self.change = None;
        self.scanned &= self.reached.is_some();
    }
}

#[cfg(test)]
mod tests;
