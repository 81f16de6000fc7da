//! What slaves have missed, or may have: cycles in which too few took part, until it is known who that was.

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

/// A cycle that had fewer answers than the one before.
#[derive(Clone, Copy, Debug)]
struct Fewer {
    /// When it was sent, on the wires' clock.
    at: Ns,
    /// A slave was named since, or one that is lost has come or gone.
    is_explained: bool,
    /// The sets of outputs since then that some slave may have missed.
    sets: u32,
}

/// What slaves have missed for which nobody is named yet.
#[derive(Debug, Default)]
pub(super) struct Missed {
    /// The id of the first outputs that may not have reached all slaves, while not all of them answer.
    from: Option<u64>,
    /// How many sets of outputs that are since then.
    sets: u32,
    /// The working counter of the newest cycle.
    counted: u16,
    /// The newest cycle that had fewer answers than the one before, while it is not known who that was.
    fewer: Option<Fewer>,
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

impl Missed {
    /// The id of the first outputs that may not have reached all slaves; `None`: they reach all.
    pub(super) const fn from(&self) -> Option<u64> {
        self.from
    }

    /// Other slaves are there.
    pub(super) fn forget(&mut self) {
        *self = Self { counted: self.counted, read_at: self.read_at, ..Self::default() };
    }

    /// A cycle has come back. How many sets of outputs have not reached a slave that nobody will name any more.
    pub(super) fn take_cycle(&mut self, cycle: &Cycle) -> u32 {
        let sets = u32::from(cycle.outputs.is_some());
        let may_be_short = self.may_lack_one_beside_the_lost(cycle);
        if !cycle.is_short && !may_be_short {
            self.from = None;
            if cycle.is_obeyed {
                self.known_from = [after(cycle.sent); 2];
            }
            return std::mem::take(&mut self.sets);
        }
        // What was repeated had reached everybody before.
        self.from = self.from.or(cycle.outputs).or(cycle.sent.map(|sent| sent + 1));
        if cycle.is_short {
            self.sets += sets;
        } else if let Some(fewer) = &mut self.fewer {
            fewer.sets += sets;
        }
        0
    }

    /// Whether a slave that is not named yet may have missed a cycle, or may be in a lower state, and slaves that are lost hide it: some
    /// of these answer and others do not, and their states may be its state, too. So while some are lost, a cycle that has fewer answers
    /// than the one before says nothing of who is missing, until the states of all have been read since.
    fn may_lack_one_beside_the_lost(&mut self, cycle: &Cycle) -> bool {
        let [counted, expected] = cycle.working_counters;
        let before = std::mem::replace(&mut self.counted, counted);
        if counted >= expected {
            self.end_fewer();
        } else if counted < before {
            let sets = self.fewer.filter(|fewer| !fewer.is_explained).map_or(0, |fewer| fewer.sets);
            self.fewer = Some(Fewer { at: cycle.sent_at, is_explained: cycle.has_job, sets });
        }
        self.fewer.is_some() && cycle.has_lost
    }

    /// It is known who was missing, or nobody is any more. If nothing explains it, some slave may have missed what was sent meanwhile.
    fn end_fewer(&mut self) {
        if let Some(fewer) = self.fewer.take().filter(|fewer| !fewer.is_explained) {
            self.sets += fewer.sets;
        }
    }

    /// The states of all slaves were asked for at `read`, and have come: who was not named is in OP.
    pub(super) fn note_states(&mut self, read: Option<Ns>, sent: Option<u64>) {
        if read == self.read_at {
            return;
        }
        self.read_at = read;
        if self.fewer.is_some_and(|fewer| read >= Some(fewer.at)) {
            self.end_fewer();
        }
        let [known_from, _] = self.known_from;
        self.known_from = [after(sent), known_from];
    }

    /// A slave was seen to be missing: if a cycle had fewer answers, that is why.
    pub(super) const fn explain(&mut self) {
        if let Some(fewer) = &mut self.fewer {
            fewer.is_explained = true;
        }
    }

    /// A slave is named as lost: the id of the first outputs that did not reach it, as far as that is known. One that leaves OP and
    /// still counts is not seen if another one is lost (`is_hidden`) that is in the same state.
    pub(super) fn name(&mut self, is_hidden: bool) -> Option<u64> {
        self.sets = 0;
        let [_, unseen_from] = self.known_from;
        self.from.or(is_hidden.then_some(unseen_from))
    }
}
