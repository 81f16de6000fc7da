//! What belonged to each set of outputs: commands, axes and homing as they were when the set was made. Answers come some
//! cycles later, and a SET_FIFO clear takes back what was pushed, so that the state behind a set is needed after it was
//! made.

use super::axis::AxisCheckpoint;
use super::homing::AxisHoming;
use super::test_mode::TestPhase;
use super::volatile::SlotHead;
use crate::fieldbus::{MAX_AXES, MAX_SLAVES, Ns, SlaveSet};

/// The state that one set of outputs was made from.
#[derive(Clone, Debug)]
pub(super) struct OutputsRecord {
    /// What the slaves' slots of the response show once the set was sent.
    pub(super) heads: [SlotHead; MAX_SLAVES],
    /// The axes: the first axis of every slave, then the second ones, since most slaves have only one.
    pub(super) axes: [[AxisCheckpoint; MAX_SLAVES]; MAX_AXES],
    /// Slaves with an axis whose homing, or what follows it, was under way.
    pub(super) homing_active: SlaveSet,
    /// The homing of the axes of those slaves. The entries of all other slaves are out of date.
    pub(super) homing: [[AxisHoming; MAX_AXES]; MAX_SLAVES],
    /// When this set was handed to the bus.
    pub(super) pushed_at: Ns,
    /// The phase of the output test.
    pub(super) test: TestPhase,
}

impl OutputsRecord {
    pub(super) fn new() -> Self {
        Self {
            heads: [SlotHead::default(); MAX_SLAVES],
            axes: [[AxisCheckpoint::default(); MAX_SLAVES]; MAX_AXES],
            homing_active: SlaveSet::EMPTY,
            homing: [[AxisHoming::default(); MAX_AXES]; MAX_SLAVES],
            pushed_at: 0,
            test: TestPhase::default(),
        }
    }
}

/// How many sets are remembered with the slaves that they have a command for, beyond those with a record: a bus may name lost slaves
/// late, as it may be busy with another one for a second, and a cycle takes 250 us. \[OURS]
pub(super) const COMMANDED_SETS: usize = 4096;

/// What is remembered of each of the newest sets of outputs: a ring that is indexed by the id of a set.
#[derive(Debug)]
pub(super) struct History<T>(Vec<T>);

impl<T: Clone> History<T> {
    /// Room for that many sets. Allocates once.
    pub(super) fn new(sets: usize, empty: T) -> Self {
        Self(vec![empty; sets])
    }

    /// How many sets it remembers.
    pub(super) const fn len(&self) -> u64 {
        self.0.len() as u64
    }

    /// What is remembered of the outputs with that id, which has to be one of the newest [`Self::len`] ids.
    pub(super) fn of(&self, id: u64) -> &T {
        &self.0[(id % self.len()) as usize]
    }

    /// The same, to be written when the outputs with that id are made.
    pub(super) fn of_mut(&mut self, id: u64) -> &mut T {
        let place = (id % self.len()) as usize;
        &mut self.0[place]
    }
}
