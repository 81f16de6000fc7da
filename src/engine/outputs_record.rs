//! The history of sets of outputs: commands, axes and homing as they were when each set was made. Answers come some
//! cycles later, and SET_FIFO 1 takes back sets that were pushed, so the state at a set is needed after the set was
//! made.

use super::axis::AxisCheckpoint;
use super::homing::AxisHoming;
use super::test_mode::TestPhase;
use super::volatile::SlotHead;
use crate::fieldbus::{MAX_AXES, MAX_SLAVES, Ns, SlaveSet};

/// The state of the board from which one set of outputs was made.
#[derive(Clone, Debug)]
pub(super) struct OutputsRecord {
    /// The commands (id, index, output image) that the slaves' slots in reports show once this set is known to be sent.
    pub(super) heads: [SlotHead; MAX_SLAVES],
    /// The checkpoints of the first axes of all slaves, then those of the second axes, since most slaves have only one
    /// axis.
    pub(super) axes: [[AxisCheckpoint; MAX_SLAVES]; MAX_AXES],
    /// Slaves with an axis that was homing or had not finished the steps after it.
    pub(super) homing_active: SlaveSet,
    /// The homing of the axes of the slaves in `homing_active`. The elements of all other slaves are out of date.
    pub(super) homing: [[AxisHoming; MAX_AXES]; MAX_SLAVES],
    /// When the set was passed to the bus, board time.
    pub(super) pushed_at: Ns,
    /// The progress of the output test (test mode) when the set was made.
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

/// How many sets of outputs more than `records` the history `commanded_by` keeps. A bus may name lost slaves late: it
/// may be busy with another slave for a second, which is 4000 cycles of 250 us. \[OURS]
pub(super) const COMMANDED_SETS: usize = 4096;

/// A ring buffer with a value for each of the newest sets of outputs, indexed by the id of the set.
#[derive(Debug)]
pub(super) struct History<T>(Vec<T>);

impl<T: Clone> History<T> {
    /// Allocates room for the values of `sets` sets of outputs.
    pub(super) fn new(sets: usize, empty: T) -> Self {
        Self(vec![empty; sets])
    }

    /// The number of sets that the history keeps.
    pub(super) const fn len(&self) -> u64 {
        self.0.len() as u64
    }

    /// The value for the outputs with that id, which must be one of the newest [`Self::len`] ids.
    pub(super) fn of(&self, id: u64) -> &T {
        &self.0[(id % self.len()) as usize]
    }

    /// The value for the outputs with this id, for writing it when the outputs are made.
    pub(super) fn of_mut(&mut self, id: u64) -> &mut T {
        let place = (id % self.len()) as usize;
        &mut self.0[place]
    }
}
