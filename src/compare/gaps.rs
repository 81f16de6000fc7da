//! Counts the gaps of two runs: cycles in a motion that only one of the runs has.

use super::steps::Step;
use super::{Side, unsure_cycles};
use crate::sk::dump::MAX_SLAVES;
use crate::sk::{CommandId, FIFO_ENTRIES};
use crate::summary::GapFinder;

/// How many consecutive commands have to show the same number of additional cycles before these count. Fewer commands
/// prove nothing: a report may have been assigned to the command before or after its own. \[OURS]
const SURE_COMMANDS: u32 = 3;
/// The gaps of a run: additional cycles between two targets of a moving axis that the other run does not have. In each of
/// these cycles the board repeated the first of the two targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gaps {
    /// The number of gaps.
    pub count: u64,
    /// The additional cycles of all gaps together.
    pub cycles: u64,
    /// The additional cycles of the longest gap.
    pub longest: u64,
}

/// The cycle count of run B minus that of run A at the answers to a command; `None` outside OP, or if an answer is
/// missing.
pub(super) fn cycle_offset(a: &Step, b: &Step) -> Option<i64> {
    Some(b.answered_in?.saturating_sub(a.answered_in?))
}

/// What the answers to one pair of equal commands show.
#[derive(Clone, Copy, Debug)]
struct Observation {
    /// The cycle count of run B minus that of run A.
    cycle_offset: i64,
    /// Whether the FIFO of run A and of run B was empty at the answer, so that a gap could begin.
    empty: [bool; 2],
    /// Whether the answers of both runs are equal.
    is_same: bool,
    /// The largest number of additional cycles that may come from a report assigned to a wrong command. A gap of so few
    /// cycles counts only if the FIFO was empty.
    unsure_cycles: u64,
}

/// Counts the gaps while the pairs of equal commands are read.
#[derive(Debug)]
pub(super) struct GapCount {
    gaps: [Gaps; 2],
    /// For each slave the newest targets of its axis, which show whether the axis is moving.
    axes: [GapFinder; MAX_SLAVES],
    /// The [`Observation::cycle_offset`] in force: that at the beginning of the motion, or a later one that
    /// [`SURE_COMMANDS`] commands have shown.
    cycle_offset: Option<i64>,
    /// The first observation whose cycle offset is not the one in force, and how many consecutive commands have shown
    /// that offset.
    candidate: Option<(Observation, u32)>,
    /// The observation at the previous command.
    before: Option<Observation>,
}

impl Default for GapCount {
    fn default() -> Self {
        let axes = std::array::from_fn(|_| GapFinder::default());
        Self { gaps: Default::default(), axes, cycle_offset: None, candidate: None, before: None }
    }
}

impl GapCount {
    /// Processes the next two equal steps, one of each run. `is_same` says whether their answers are equal. Returns whether
    /// the steps continue a motion.
    pub(super) fn pair(&mut self, a: &Step, b: &Step, is_same: bool) -> bool {
        let moves = self.moves(a);
        let is_empty =
            |step: &Step| step.answer.as_ref().is_some_and(|answer| answer.board().fifo_free >= FIFO_ENTRIES);
        let unsure_cycles = unsure_cycles(a.cycle_ns);
        let empty = [a, b].map(is_empty);
        let observation =
            cycle_offset(a, b).map(|cycle_offset| Observation { cycle_offset, empty, is_same, unsure_cycles });
        if let Some(before) = std::mem::replace(&mut self.before, observation) {
            self.evaluate(before, moves);
        }
        moves
    }

    /// The gaps of run A and of run B.
    pub(super) fn end(mut self) -> [Gaps; 2] {
        self.accept_change();
        self.gaps
    }

    /// Whether the command continues the motion of an axis, so that additional cycles before it would stop the axis.
    fn moves(&mut self, step: &Step) -> bool {
        let mut moves = false;
        for (slave, axis) in (1..=step.size.max_slaves()).zip(&mut self.axes) {
            let slot = step.command.slot(step.size, slave);
            if CommandId::from_code(slot.id) == CommandId::Csp {
                axis.idle(0);
                moves |= axis.target(0, slot.data1.cast_signed()).is_some();
            }
        }
        moves
    }

    /// Evaluates an observation. `moves` says whether the command after it continues the same motion.
    fn evaluate(&mut self, observation: Observation, moves: bool) {
        let Some(offset) = self.cycle_offset.filter(|_| moves) else {
            // The motion ends. A change that enough commands have shown before is still a gap. Additional cycles
            // between two motions are no gap, so the present offset is taken over.
            self.accept_change();
            self.cycle_offset = Some(observation.cycle_offset);
            return;
        };
        if observation.cycle_offset == offset {
            self.candidate = None;
            return;
        }
        self.candidate = match self.candidate {
            Some((first, count)) if first.cycle_offset == observation.cycle_offset => {
                Some((Observation { is_same: first.is_same && observation.is_same, ..first }, count + 1))
            }
            _ => Some((observation, 1)),
        };
        if self.candidate.is_some_and(|(_, count)| count >= SURE_COMMANDS) {
            self.accept_change();
        }
    }

    /// Decides on a new value of the cycle offset, if enough commands have shown it. The change counts as a gap if the
    /// answers differ, so that the axis is at another position in one run. In addition, the FIFO has to be empty, or
    /// the change larger than [`Observation::unsure_cycles`]. The new value is taken over with a gap, and if the
    /// answers are equal.
    fn accept_change(&mut self) {
        let Some((observation, count)) = self.candidate.take() else { return };
        let Some(offset) = self.cycle_offset.filter(|_| count >= SURE_COMMANDS) else { return };
        let side = if observation.cycle_offset > offset { Side::B } else { Side::A };
        let cycles = observation.cycle_offset.abs_diff(offset);
        let is_gap = !observation.is_same && (observation.empty[side.index()] || cycles > observation.unsure_cycles);
        if is_gap {
            self.gaps[side.index()].add(cycles);
        }
        if is_gap || observation.is_same {
            self.cycle_offset = Some(observation.cycle_offset);
        }
    }
}

impl Gaps {
    fn add(&mut self, cycles: u64) {
        self.count += 1;
        self.cycles = self.cycles.saturating_add(cycles);
        self.longest = self.longest.max(cycles);
    }
}
