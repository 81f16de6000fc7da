//! How old the inputs of each slave are, and which are stale.

use crate::ethercat::{Ns, SlaveSet};
use crate::fieldbus::{MAX_SLAVES, is_stale};

/// The age of a slave's inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Age {
    /// Cycles since those from which they are.
    cycles: u32,
    /// When the first one without new ones was sent, on the wires' clock.
    since: Ns,
}

/// The ages of all inputs.
#[derive(Debug)]
pub(super) struct Ages {
    of: [Age; MAX_SLAVES],
    /// The slaves whose inputs are not those of the newest cycle.
    pub(super) held: SlaveSet,
    /// The slaves that are lost since their inputs are stale.
    pub(super) stale: SlaveSet,
}

impl Default for Ages {
    fn default() -> Self {
        Self { of: [Age::default(); MAX_SLAVES], held: SlaveSet::EMPTY, stale: SlaveSet::EMPTY }
    }
}

impl Ages {
    /// The inputs of a slave are those of the newest cycle, or it has none.
    pub(super) const fn renew(&mut self, slave: u8) {
        self.held.remove(slave);
        self.of[slave as usize - 1] = Age { cycles: 0, since: 0 };
    }

    /// A cycle that was sent at that time, and so many before it that were not answered, have not brought the inputs of a slave. Whether
    /// these are stale, and were not before. `searched`: when it was asked last who is missing.
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

    /// A slave is below SafeOP, or back.
    pub(super) const fn forget(&mut self, slave: u8) {
        self.renew(slave);
        self.stale.remove(slave);
    }
}
