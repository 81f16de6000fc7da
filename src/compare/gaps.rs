//! Counts the gaps of two runs: cycles in a motion that one run has and the other has not.

use super::steps::Step;
use super::{Side, unsure_cycles};
use crate::sk::dump::MAX_SLAVES;
use crate::sk::{CommandId, FIFO_ENTRIES};
use crate::summary::GapFinder;

/// After so many commands in a row with the same number of cycles more a gap is sure: a report may be taken for one of the
/// command before or behind its own. \[OURS]
const SURE_COMMANDS: u32 = 3;
/// The gaps of a run: cycles between two targets of an axis on its way that the other run does not have. In each of them the axis
/// was sent the first of the two once more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gaps {
    /// How many there are.
    pub count: u64,
    /// Their cycles together.
    pub cycles: u64,
    /// The cycles of the longest one.
    pub longest: u64,
}

/// By how many cycles run B is further than run A at the answers to a command; `None` outside OP, or without an answer.
pub(super) fn apart(a: &Step, b: &Step) -> Option<i64> {
    Some(b.answered_in?.saturating_sub(a.answered_in?))
}

/// What a pair of equal commands tells.
#[derive(Clone, Copy, Debug)]
struct Told {
    /// By how many cycles run B is further than run A.
    apart: i64,
    /// Whether the FIFO of run A and of run B was empty at its last report, so that a gap could begin.
    empty: [bool; 2],
    /// Whether both runs have answered the same.
    is_same: bool,
    /// More cycles than these are no mistake. A gap of no more counts only where the FIFO was empty.
    unsure_cycles: u64,
}

/// Finds the gaps, while pairs of equal commands go by.
#[derive(Debug)]
pub(super) struct GapCount {
    gaps: [Gaps; 2],
    /// Tell of each slave whether its axis is on its way.
    axes: [GapFinder; MAX_SLAVES],
    /// By how many cycles run B is further than run A, as far as it is sure.
    level: Option<i64>,
    /// The first command that has shown another level, and how many in a row have.
    other: Option<(Told, u32)>,
    /// What the command before has shown.
    before: Option<Told>,
}

impl Default for GapCount {
    fn default() -> Self {
        let axes = std::array::from_fn(|_| GapFinder::default());
        Self { gaps: Default::default(), axes, level: None, other: None, before: None }
    }
}

impl GapCount {
    /// The next two equal steps, and whether the answers to them are the same. Returns whether they go on with a motion.
    pub(super) fn pair(&mut self, a: &Step, b: &Step, is_same: bool) -> bool {
        let moves = self.moves(a);
        let is_empty =
            |step: &Step| step.answer.as_ref().is_some_and(|answer| answer.board().fifo_free >= FIFO_ENTRIES);
        let unsure_cycles = unsure_cycles(a.cycle_ns);
        let empty = [a, b].map(is_empty);
        let told = apart(a, b).map(|apart| Told { apart, empty, is_same, unsure_cycles });
        if let Some(before) = std::mem::replace(&mut self.before, told) {
            self.look(before, moves);
        }
        moves
    }

    /// The gaps of run A and run B.
    pub(super) fn end(mut self) -> [Gaps; 2] {
        self.settle();
        self.gaps
    }

    /// Whether an axis is on its way, so that it would stop if there was a pause before this command.
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

    /// What a command has told, and whether the one behind it goes on with the same motion.
    fn look(&mut self, told: Told, moves: bool) {
        let Some(level) = self.level.filter(|_| moves) else {
            // What was seen in a motion up to its end is a gap, if it is sure; a pause behind it is none.
            self.settle();
            self.level = Some(told.apart);
            return;
        };
        if told.apart == level {
            self.other = None;
            return;
        }
        self.other = match self.other {
            Some((first, count)) if first.apart == told.apart => {
                Some((Told { is_same: first.is_same && told.is_same, ..first }, count + 1))
            }
            _ => Some((told, 1)),
        };
        if self.other.is_some_and(|(_, count)| count >= SURE_COMMANDS) {
            self.settle();
        }
    }

    /// Takes another level, if it is sure: so many commands have shown it. It is a gap if one could begin, or the cycles are more
    /// than those by which a report may be taken for another one; and if the axis that stopped in one run alone is at another
    /// place.
    fn settle(&mut self) {
        let Some((told, count)) = self.other.take() else { return };
        let Some(level) = self.level.filter(|_| count >= SURE_COMMANDS) else { return };
        let side = if told.apart > level { Side::B } else { Side::A };
        let cycles = told.apart.abs_diff(level);
        let is_gap = !told.is_same && (told.empty[side.index()] || cycles > told.unsure_cycles);
        if is_gap {
            self.gaps[side.index()].add(cycles);
        }
        if is_gap || told.is_same {
            self.level = Some(told.apart);
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
