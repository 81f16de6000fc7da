//! Outputs that may not have reached all slaves: those of cycles with a working counter that was too low, until it is known
//! which slaves missed them. The count is an upper bound \[OURS]: outputs that are not known to have reached a slave count.

use crate::ethercat::Ns;

/// A cycle that has come back.
pub(super) struct Cycle {
    /// When it was sent, on the wires' clock.
    pub(super) sent_at: Ns,
    /// The outputs that it carried for the first time.
    pub(super) outputs: Option<u64>,
    /// The newest outputs that were sent.
    pub(super) sent: Option<u64>,
    /// Its working counter, and what that is when every slave answers.
    pub(super) working_counters: [u16; 2],
    /// A slave that is not named has missed it, or is in a lower state.
    pub(super) is_short: bool,
    /// Slaves are lost.
    pub(super) has_lost: bool,
    /// All slaves that are not lost have obeyed it, for certain.
    pub(super) is_obeyed: bool,
    /// A job is under way, by which slaves may come and go.
    pub(super) has_job: bool,
}

/// The outputs that may not have reached slaves which are not known as lost yet.
#[derive(Debug, Default)]
pub(super) struct UnreachedOutputs {
    /// The id of the first outputs that may not have reached all slaves, while not all of them answer.
    from: Option<u64>,
    /// How many sets of outputs that are since then.
    sets: u32,
    /// The working counter of the newest cycle.
    counted: u16,
    /// When the newest cycle was sent that had fewer answers than the one before, until the states are known since.
    fewer_at: Option<Ns>,
    /// When the states were asked for that were read last.
    read_at: Option<Ns>,
    /// The ids of the first outputs after those states were known, and after the ones before them: what was sent before has found all
    /// slaves in OP that were not lost.
    known_from: [u64; 2],
}

/// The id of the outputs that come next.
fn after(sent: Option<u64>) -> u64 {
    sent.map_or(0, |sent| sent + 1)
}

impl UnreachedOutputs {
    /// The id of the first outputs that may not have reached all slaves; `None`: they reach all.
    pub(super) const fn from(&self) -> Option<u64> {
        self.from
    }

    /// Other slaves are there.
    pub(super) fn forget(&mut self, sent: Option<u64>) {
        let known_from = [after(sent); 2];
        *self = Self { counted: self.counted, read_at: self.read_at, known_from, ..Self::default() };
    }

    /// A cycle has come back. How many sets of outputs may not have reached a slave that nobody will name any more.
    pub(super) fn take_cycle(&mut self, cycle: &Cycle) -> u32 {
        let [counted, expected] = cycle.working_counters;
        let before = std::mem::replace(&mut self.counted, counted);
        if counted >= expected {
            self.fewer_at = None;
        } else if counted < before && !cycle.has_job {
            self.fewer_at = Some(cycle.sent_at);
        }
        // Some lost slaves answer and others do not, and their states may be that of a slave which is not named yet. So fewer answers
        // than before may be its, until the states of all have been read.
        if cycle.is_short || cycle.has_lost && self.fewer_at.is_some() {
            // What was repeated had reached everybody before.
            self.from = self.from.or(cycle.outputs).or(cycle.sent.map(|sent| sent + 1));
            self.sets += u32::from(cycle.outputs.is_some());
            return 0;
        }
        self.from = None;
        if cycle.is_obeyed {
            self.known_from = [after(cycle.sent); 2];
        }
        std::mem::take(&mut self.sets)
    }

    /// The states of all slaves were asked for at `read`, and have come: who was not named is in OP.
    pub(super) fn note_states(&mut self, read: Option<Ns>, sent: Option<u64>) {
        if read == self.read_at {
            return;
        }
        self.read_at = read;
        self.fewer_at = self.fewer_at.filter(|at| read < Some(*at));
        let [known_from, _] = self.known_from;
        self.known_from = [after(sent), known_from];
    }

    /// A slave is named as lost: the id of the first outputs that may not have reached it, as far as that is known. One that leaves OP
    /// and still counts is not seen if another one is lost (`is_hidden`) that is in the same state.
    pub(super) fn name(&mut self, is_hidden: bool) -> Option<u64> {
        self.sets = 0;
        let [_, unseen_from] = self.known_from;
        self.from.or(is_hidden.then_some(unseen_from))
    }
}
