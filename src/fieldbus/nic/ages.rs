//! The age of the inputs of each slave, and which inputs are stale.

use crate::ethercat::{Ns, SlaveSet};
use crate::fieldbus::{MAX_SLAVES, is_stale};

/// How old the inputs of one slave are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Age {
    /// The number of cycles since the cycle in which the inputs were received.
    cycles: u32,
    /// When the first cycle without new inputs was sent, on the network card's clock.
    since: Ns,
}

/// How old the inputs of each slave are.
#[derive(Debug)]
pub(super) struct Ages {
    of: [Age; MAX_SLAVES],
    /// The slaves whose inputs are older than the newest cycle.
    pub(super) held: SlaveSet,
    /// The slaves that are lost because their inputs are stale.
    pub(super) stale: SlaveSet,
}

impl Default for Ages {
    fn default() -> Self {
        Self { of: [Age::default(); MAX_SLAVES], held: SlaveSet::EMPTY, stale: SlaveSet::EMPTY }
    }
}

impl Ages {
    /// Resets the age of a slave's inputs: they are from the newest cycle, or the slave has no inputs that could get
    /// old.
    pub(super) const fn renew(&mut self, slave: u8) {
        self.held.remove(slave);
        self.of[slave as usize - 1] = Age { cycles: 0, since: 0 };
    }

    /// Counts a cycle without new inputs of a slave, and `unanswered` cycles directly before it that had no answer.
    /// Returns whether the inputs have become stale with this cycle. `sent_at`: when the cycle was sent. `searched`:
    /// when the newest complete search for missing slaves began. If it began after the first cycle without new inputs,
    /// the inputs become stale earlier ([`is_stale`]).
    pub(super) fn hold(&mut self, slave: u8, sent_at: Ns, unanswered: u32, cycle_ns: Ns, searched: Option<Ns>) -> bool {
        self.held.insert(slave);
        let age = &mut self.of[usize::from(slave) - 1];
        if age.cycles == 0 {
            age.since = sent_at;
        }
        age.cycles = age.cycles.saturating_add(1).saturating_add(unanswered);
        let is_new = !self.stale.contains(slave) && is_stale(age.cycles, cycle_ns, searched > Some(age.since));
        if is_new {
            self.stale.insert(slave);
        }
        is_new
    }

    /// Resets the age of a slave's inputs, which are then neither held nor stale: the slave is below SafeOP, or was
    /// brought back from a loss.
    pub(super) const fn forget(&mut self, slave: u8) {
        self.renew(slave);
        self.stale.remove(slave);
    }
}
