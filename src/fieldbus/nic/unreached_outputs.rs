//! Outputs that may not have reached all slaves: the outputs of cycles with a working counter that was too low, until
//! it is known which slaves missed them. The count is an upper bound \[OURS]: some of these outputs may have reached
//! every slave.

use crate::ethercat::Ns;

/// What the record of unreached outputs needs to know of a cycle whose frames have come back.
pub(super) struct Cycle {
    /// When the frames of the cycle were sent, on the network card's clock.
    pub(super) sent_at: Ns,
    /// The id of the outputs that the cycle carried for the first time. `None`: it repeated the outputs of the previous
    /// cycle, whose id is in `sent`.
    pub(super) outputs: Option<u64>,
    /// The id of the newest outputs that were sent up to this cycle.
    pub(super) sent: Option<u64>,
    /// The working counter of the cycle, and its value if every slave answers.
    pub(super) working_counters: [u16; 2],
    /// Whether a slave that is not known as lost has not processed the outputs of the cycle, as the working counter
    /// shows, or is in a lower AL state than commanded.
    pub(super) is_short: bool,
    /// Whether some slaves are known as lost.
    pub(super) has_lost: bool,
    /// Whether the working counter and the AL states prove that all slaves that are not lost have processed the outputs
    /// of the cycle.
    pub(super) is_obeyed: bool,
    /// Whether a job is running, during which slaves may disappear and come back.
    pub(super) has_job: bool,
}

/// Records the outputs that may not have reached slaves which are not known as lost yet.
#[derive(Debug, Default)]
pub(super) struct UnreachedOutputs {
    /// The id of the first outputs that may have missed a slave that is not known as lost; `None`: there are none.
    from: Option<u64>,
    /// How many sets of outputs, from `from` on, may have missed such a slave.
    sets: u32,
    /// The working counter of the newest cycle.
    counted: u16,
    /// When the newest cycle was sent whose working counter was lower than in the cycle before it. `None` once the AL
    /// states of all slaves have been read since, or the working counter is complete again.
    fewer_at: Option<Ns>,
    /// When the master began the newest complete reading of the AL states of all slaves.
    read_at: Option<Ns>,
    /// For the two newest readings of the AL states, the newest first: the id of the first outputs that were sent after
    /// the reading. All slaves that were not lost were in OP when the outputs with lower ids were sent.
    known_from: [u64; 2],
}

/// The id of the next outputs, after those with the id `sent`.
fn after(sent: Option<u64>) -> u64 {
    sent.map_or(0, |sent| sent + 1)
}

impl UnreachedOutputs {
    /// The id of the first outputs that may have missed a slave that is not known as lost; `None`: there are none.
    pub(super) const fn from(&self) -> Option<u64> {
        self.from
    }

    /// Resets the record after a scan, which may have found other slaves. `sent`: the id of the newest outputs sent so
    /// far, none of which counts any more.
    pub(super) fn forget(&mut self, sent: Option<u64>) {
        let known_from = [after(sent); 2];
        *self = Self { counted: self.counted, read_at: self.read_at, known_from, ..Self::default() };
    }

    /// Evaluates a cycle. Returns 0 as long as it is not known which slave may have missed outputs. Once all slaves
    /// answer again, returns how many sets of outputs may have missed a slave that was never named as lost.
    pub(super) fn take_cycle(&mut self, cycle: &Cycle) -> u32 {
        let [counted, expected] = cycle.working_counters;
        let before = std::mem::replace(&mut self.counted, counted);
        if counted >= expected {
            self.fewer_at = None;
        } else if counted < before && !cycle.has_job {
            self.fewer_at = Some(cycle.sent_at);
        }
        // While slaves are lost the expected working counter is not known, because some lost slaves still answer and
        // others do not. A further slave that leaves its state now may add as much as such a lost slave, so the working
        // counter alone cannot show which one it is. After a lower working counter a further slave counts as possibly
        // lost until the AL states of all slaves have been read.
        if cycle.is_short || cycle.has_lost && self.fewer_at.is_some() {
            // If the cycle repeated outputs, these had reached every slave before. The next outputs are then the first
            // that may have missed a slave.
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

    /// Called when the master knows the AL states of all slaves: each slave that was not named as lost is in OP.
    /// `read`: when the master began to read the states. `sent`: the id of the newest outputs sent so far.
    pub(super) fn note_states(&mut self, read: Option<Ns>, sent: Option<u64>) {
        if read == self.read_at {
            return;
        }
        self.read_at = read;
        self.fewer_at = self.fewer_at.filter(|at| read < Some(*at));
        let [known_from, _] = self.known_from;
        self.known_from = [after(sent), known_from];
    }

    /// Called when a slave is named as lost: returns the id of the first outputs that may not have reached it, as far
    /// as it is known. `is_hidden`: other slaves were lost already. Then a slave that leaves OP but still increments
    /// the working counter may be noticed late: the master cannot tell its increments from those of a lost slave in the
    /// same state.
    pub(super) fn name(&mut self, is_hidden: bool) -> Option<u64> {
        self.sets = 0;
        let [_, unseen_from] = self.known_from;
        self.from.or(is_hidden.then_some(unseen_from))
    }
}
