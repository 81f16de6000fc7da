//! The network's state (SK-4): boot, changes on the way up and down, failures, lost slaves. Decides which job the bus
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
    /// Map process data, on the way from PreOP to SafeOP.
    Configure,
    /// Bring the slaves to that state.
    Move(MasterState),
    /// Bring lost ones to PreOP, wherever they have fallen.
    Fetch,
    /// Map the process data of those.
    Reconfigure,
    /// Bring those to the state that the others are in.
    Return(MasterState),
}

/// So long lost slaves are waited for together, until those that do not answer are left behind \[OURS]: a slave that is
/// silent for so long ends an SDO, too.
const FETCH_NS: Ns = 1_000_000_000;
/// And so long each time after that: who answers is there already \[OURS].
const FETCH_AGAIN_NS: Ns = 100_000_000;

/// How far the lost slaves have come on their way back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Way {
    #[default]
    Ahead,
    InPreOp,
    Configured,
    /// They are back. Who was lost since then waits for the next SET_STATE.
    Back,
}

/// A change under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Change {
    target: MasterState,
    deadline: Ns,
    /// Its Configure has begun, with what was declared then.
    configuring: bool,
    configured: bool,
    /// Something else was declared since: all begin in PreOP again.
    anew: bool,
    way: Way,
    /// Lost slaves that it still has to bring back: those that were lost when it began, but for those that have refused.
    awaited: Option<SlaveSet>,
    /// Those of them that the others do not wait for: they have not answered in this round.
    silent: SlaveSet,
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
            anew: false,
            way: Way::Ahead,
            awaited: None,
            silent: SlaveSet::EMPTY,
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
    /// Those of them that the change under way brings back together now.
    returning: SlaveSet,
}

impl Step {
    /// Whether lost slaves begin their way back with it.
    fn is_first_of_return(self) -> bool {
        match self {
            Self::Fetch => true,
            Self::Return(to) => to <= MasterState::PreOp,
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

    /// Those of them that the change under way brings back together now.
    pub(super) const fn returning(&self) -> SlaveSet {
        self.returning
    }

    /// Whether slaves that do not answer now are lost: in OP always. In SafeOP too, but on the way up to OP: that change
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
    pub(super) fn lose(&mut self, slaves: SlaveSet) {
        self.lost = self.lost.union(slaves);
    }

    /// Slaves have fallen from the network's state because others were configured, which are on their way back: these go
    /// with them.
    pub(super) fn disturb(&mut self, slaves: SlaveSet) {
        if slaves.is_empty() {
            return;
        }
        self.lose(slaves);
        if let Some(change) = &mut self.change {
            self.returning = self.returning.union(slaves);
            change.awaited = Some(change.awaited.unwrap_or(SlaveSet::EMPTY).union(slaves));
        }
    }

    /// SET_STATE. False: this state does not accept it (Init accepts Init and PreOP only).
    ///
    /// A request during a change replaces its target, and with `declared_otherwise` what is to be configured. One that
    /// replaces nothing does not give the change more time \[OURS]: a program that asks in every frame shall see a failure,
    /// too. A request for the state the network is in acknowledges a failure. Every accepted one brings lost slaves back.
    pub(super) fn request(&mut self, target: MasterState, deadline: Ns, declared_otherwise: bool) -> bool {
        let Some(state) = self.reached else { return false };
        if state == MasterState::Init && target > MasterState::PreOp {
            return false;
        }
        if target == state && !self.failed && self.lost.is_empty() && self.change.is_none() {
            return true;
        }
        let new = Change::to(target, deadline);
        self.change = Some(match self.change {
            Some(change) if change.configuring && declared_otherwise => Change { anew: true, ..new },
            // Who was lost since others came back comes back as well.
            Some(change) if change.target == target && change.way == Way::Back && !self.lost.is_empty() => {
                Change { way: Way::Ahead, awaited: None, refused: false, ..change }
            }
            Some(change) if change.target == target => change,
            Some(Change { configuring, configured, anew, .. }) => Change { configuring, configured, anew, ..new },
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
            // Nobody waits for the lost ones on the way down: they follow [OURS].
            (from, to) if to < from => Step::Move(to),
            (from, _) if !self.lost.is_empty() && change.way != Way::Back => Self::step_back(from, change.way),
            (from, to) if to == from => Step::Move(to),
            // Some slaves may have gone further than others: all begin where all have been [OURS].
            (from, change_to) if self.failed || change.anew && change_to > from => Step::Move(from),
            (MasterState::Init, _) => Step::Move(MasterState::PreOp),
            (MasterState::PreOp, _) if !change.configured => Step::Configure,
            (MasterState::PreOp, _) => Step::Move(MasterState::SafeOp),
            _ => Step::Move(MasterState::Op),
        })
    }

    fn step_back(state: MasterState, way: Way) -> Step {
        match way {
            _ if state <= MasterState::PreOp => Step::Return(state),
            Way::Ahead => Step::Fetch,
            Way::InPreOp => Step::Reconfigure,
            Way::Configured | Way::Back => Step::Return(state),
        }
    }

    /// A step begins.
    pub(super) fn begin(&mut self, step: Step) {
        let Some(change) = &mut self.change else { return };
        match step {
            Step::Configure => change.configuring = true,
            _ if step.is_first_of_return() => {
                let awaited = change.awaited.get_or_insert(self.lost);
                self.returning = awaited.difference(change.silent);
            }
            _ => {}
        }
    }

    /// How long a step is waited for, of the time that the change has left; `None`: as long as that.
    ///
    /// A dead slave does not keep those back that could come \[OURS]: who does not answer is left behind, the others come
    /// back without it, and then it is asked again while there is time.
    pub(super) fn patience(&self, step: Step, left: Ns) -> Option<Ns> {
        let change = self.change?;
        let alone = change.awaited.is_some_and(|awaited| awaited.len() <= 1);
        match step {
            _ if alone => None,
            _ if step.is_first_of_return() => Some(if change.silent.is_empty() { FETCH_NS } else { FETCH_AGAIN_NS }),
            Step::Return(_) => Some(left / 2),
            _ => None,
        }
    }

    /// A slave does not come back with the others: it says nothing, or it refuses and is not asked again.
    pub(super) fn stays_away(&mut self, slave: u8, silent: bool) {
        let Some(change) = &mut self.change else { return };
        if !self.returning.contains(slave) {
            return self.fail();
        }
        let awaited = change.awaited.get_or_insert(self.returning);
        if silent {
            change.silent.insert(slave);
        } else {
            awaited.remove(slave);
            change.refused = true;
        }
        let nobody_left = awaited.is_empty();
        self.returning.remove(slave);
        if self.returning.is_empty() {
            (change.way, change.silent) = (Way::Ahead, SlaveSet::EMPTY);
            if nobody_left {
                self.fail();
            }
        }
    }

    /// Whether the step under way no longer leads to the target: the way up was given up.
    pub(super) fn is_obsolete(&self, step: Step) -> bool {
        match (step, self.change, self.reached) {
            (Step::Configure, Some(change), Some(state)) => change.target <= state,
            (Step::Move(to), Some(change), Some(state)) => to > state && (change.anew || change.target <= state),
            (Step::Fetch | Step::Reconfigure | Step::Return(_), Some(change), Some(state)) => change.target < state,
            _ => false,
        }
    }

    /// When the change under way has failed.
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
            Step::Fetch => {
                self.come(Way::InPreOp);
                return None;
            }
            Step::Reconfigure => {
                self.come(Way::Configured);
                return None;
            }
            Step::Return(state) => {
                self.lost = self.lost.difference(self.returning);
                self.have_come(state);
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
            Some(change) if change.target == state && (all_here || change.way == Way::Back) => self.change = None,
            Some(change) => (change.configuring, change.configured, change.anew) = (false, false, false),
            None => {}
        }
        Some(state)
    }

    /// Lost slaves are back in the network's state.
    fn have_come(&mut self, state: MasterState) {
        let Some(change) = &mut self.change else { return };
        let awaited = change.awaited.map_or(SlaveSet::EMPTY, |awaited| awaited.difference(self.returning));
        change.awaited = Some(awaited);
        if !awaited.is_empty() {
            (change.way, change.silent) = (Way::Ahead, SlaveSet::EMPTY);
            return;
        }
        change.way = Way::Back;
        if change.refused {
            self.fail();
        } else if !self.failed && change.target == state {
            self.change = None;
        }
    }

    fn come(&mut self, way: Way) {
        if let Some(change) = &mut self.change {
            change.way = way;
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
