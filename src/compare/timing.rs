//! What of the differences between two answers is but timing: the other run shows the same some cycles before or later.
//!
//! A board whose slaves are behind an ECM-XF carries a command out some cycles later, and while it does a program goes on or
//! waits for more cycles. So what the two boards had answered to a command is held against what they answered in the cycles
//! around it:
//!
//! - What one run has answered and the other one shows in at most so many cycles ([`super::Options::latency_cycles`]) before or
//!   behind its own answer is no difference, if it is so in both directions: then both show both, and nothing is hidden that
//!   never comes.
//! - Whether an axis that moves has reached the target of a cycle (bit 10), and where it is, go together otherwise in a run that has a
//!   cycle more or less. Each is held against that of the other run by itself.
//! - Where one run has cycles that the other has not, since its program waited or the board had nothing to send, an axis that
//!   moves is elsewhere for a while. Until it stands in both runs, or both have shown the same place for a while, each run has to
//!   show where it is in the other within so many cycles, or next to it. An axis that stands is where it is.
//! - The last answers of a run, and of slaves in a stretch of OP, have to be the same, but for the place of an axis that still
//!   moves in both runs, of which one has had more cycles.

use std::collections::VecDeque;

use super::difference::Deviation;
use super::gaps::apart;
use super::report::Answer;
use super::steps::Step;
use super::{Options, STANDS_REPORTS, Side, WINDOW_CYCLES, answers, unsure_cycles};
use crate::ethercat::cia402::Statusword;
use crate::sk::dump::MAX_SLAVES;

/// Answers in a row that are the same in both runs, after which an axis that moves is at the same place of its way. \[OURS]
const SAME_ANSWERS: u32 = 16;
/// Cycles more than those that one run has: a drive takes a cycle or two to follow, and a report may be one of the next. \[OURS]
const SLACK_CYCLES: usize = 2;
/// After so many answers that are the same some cycles before or later a run has no cycles more: its reports were taken for
/// those of other commands. \[OURS]
const UNMOVED_ANSWERS: usize = 3;
/// An axis may be on its way for so many cycles longer in one run: waits for a few SDOs in a row. \[OURS]
const WAY_CYCLES: usize = 128;
/// Pairs of steps before and behind one that are looked at at most. \[OURS]
const PAIRS_MAX: usize = 2 * WAY_CYCLES;

/// Equal steps of both runs.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    pub(super) a: Step,
    pub(super) b: Step,
    /// What differs; empty if nothing does. See [`answers::differences`].
    what: Vec<Deviation>,
}

impl Pair {
    pub(super) const fn new(a: Step, b: Step, what: Vec<Deviation>) -> Self {
        Self { a, b, what }
    }

    const fn step(&self, side: Side) -> &Step {
        match side {
            Side::A => &self.a,
            Side::B => &self.b,
        }
    }

    fn answers(&self) -> Option<[&Answer; 2]> {
        Some([self.a.answer.as_ref()?, self.b.answer.as_ref()?])
    }

    /// Both answers, if they are answers of OP.
    fn answers_in_op(&self) -> Option<[&Answer; 2]> {
        self.answers().filter(|answers| answers.iter().all(|answer| answer.is_op()))
    }
}

/// What follows the pairs that were given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Follows {
    /// More pairs, or it is not known yet.
    More,
    /// One of the runs only.
    OneRun,
    /// Nothing: both runs have ended.
    Nothing,
}

/// How far an axis is apart in the two runs.
#[derive(Clone, Copy, Debug, Default)]
struct Apart {
    /// By how many cycles run B was further than run A when both were at the same place.
    together: Option<i64>,
    /// The most cycles that one run had more since then.
    most: u64,
    /// How many answers in a row have been the same.
    same: u32,
}

/// The pairs around the one that is judged.
#[derive(Debug)]
pub(super) struct Timing {
    options: Options,
    pairs: VecDeque<Pair>,
    /// The place of the next pair to judge.
    next: usize,
    axes: [Apart; MAX_SLAVES],
    /// Pairs whose answers are the same but for their timing.
    pub(super) shifted: u64,
}

impl Timing {
    pub(super) fn new(options: &Options) -> Self {
        let axes = [Apart::default(); MAX_SLAVES];
        Self { options: *options, pairs: VecDeque::new(), next: 0, axes, shifted: 0 }
    }

    /// So many cycles may lie between what is the same.
    fn window(&self) -> usize {
        let most = self.options.latency_cycles.map_or(WINDOW_CYCLES, |cycles| cycles as usize);
        most.min(WINDOW_CYCLES)
    }

    /// Takes the next pair.
    pub(super) fn push(&mut self, pair: Pair) {
        self.pairs.push_back(pair);
    }

    /// Judges the next pair, if what follows it is known: the pair, and what differs in it beyond timing.
    pub(super) fn judge(&mut self, follows: Follows) -> Option<(Pair, Vec<Deviation>)> {
        let ended = follows == Follows::Nothing;
        let is_known = follows != Follows::More || self.window() == 0 || self.is_followed();
        if self.next == self.pairs.len() || !is_known {
            return None;
        }
        let at = self.next;
        self.next += 1;
        self.follow(at);
        let pair = self.pairs.get(at)?.clone();
        let mut what = pair.what.clone();
        if !what.is_empty() && self.window() > 0 {
            what.retain(|deviation| !self.is_timing(at, deviation, ended));
            self.shifted += u64::from(what.is_empty());
        }
        // What an answer shows of a fault says more than that there was one.
        let shown: Vec<u8> = what.iter().filter(|what| !is_fault(what)).filter_map(Deviation::slave).collect();
        what.retain(|what| !is_fault(what) || what.slave().is_none_or(|slave| !shown.contains(&slave)));
        self.forget();
        Some((pair, what))
    }

    /// Whether the reports that follow the next pair are known.
    fn is_followed(&self) -> bool {
        let wanted = if self.axes.iter().any(|axis| axis.most > 0) { WAY_CYCLES } else { self.window() };
        let enough = |side| self.reports(self.next + 1, self.pairs.len(), side) > wanted;
        self.pairs.len() - self.next > PAIRS_MAX || (enough(Side::A) && enough(Side::B))
    }

    fn reports(&self, from: usize, to: usize, side: Side) -> usize {
        self.pairs.range(from.min(to)..to).map(|pair| pair.step(side).kept.len()).sum()
    }

    /// Forgets what is too long ago.
    fn forget(&mut self) {
        let enough = |this: &Self, side| this.reports(1, this.next, side) > 2 * WAY_CYCLES;
        while self.next > PAIRS_MAX || (enough(self, Side::A) && enough(self, Side::B)) {
            self.pairs.pop_front();
            self.next -= 1;
        }
    }

    /// Whether no answer to a later command can be compared before both runs end, or `in_op` before OP is left.
    fn is_last(&self, at: usize, ended: bool, in_op: bool) -> bool {
        let mut later = self.pairs.range(at + 1..).filter_map(Pair::answers);
        match later.next() {
            Some(answers) => in_op && answers.iter().any(|answer| !answer.is_op()),
            None => ended,
        }
    }

    /// Whether a slave shows the same some cycles before or later at a pair and those behind it.
    fn is_unmoved(&self, at: usize, slave: u8) -> bool {
        let same = |one: &Answer, other: &Answer| self.shows_same(slave, one, other);
        let mut pairs = (at..self.pairs.len()).take(UNMOVED_ANSWERS);
        pairs.all(|at| self.pairs.get(at).is_none_or(|pair| pair.answers_in_op().is_none()) || self.both_show(at, same))
    }

    /// Whether two reports of OP show the same of a slave.
    fn shows_same(&self, slave: u8, one: &Answer, other: &Answer) -> bool {
        one.is_op() && other.is_op() && answers::is_same(slave, one, other, &self.options)
    }

    /// Keeps by how many cycles the runs are apart for each axis.
    fn follow(&mut self, at: usize) {
        let mut axes = self.axes;
        self.follow_axes(at, &mut axes);
        self.axes = axes;
    }

    fn follow_axes(&self, at: usize, axes: &mut [Apart; MAX_SLAVES]) {
        let Some(pair) = self.pairs.get(at) else { return };
        let Some([a, b]) = pair.answers_in_op() else {
            if pair.answers().is_some() {
                *axes = [Apart::default(); MAX_SLAVES];
            }
            return;
        };
        let Some(apart) = apart(&pair.a, &pair.b) else { return };
        for (slave, axis) in (1..=pair.a.size.max_slaves() as u8).zip(axes) {
            let more = apart.abs_diff(*axis.together.get_or_insert(apart));
            if more > axis.most
                && more <= unsure_cycles(pair.a.cycle_ns)
                && axis.most == 0
                && self.is_unmoved(at, slave)
            {
                axis.together = Some(apart);
                continue;
            }
            axis.most = axis.most.max(more);
            if axis.most == 0 {
                continue;
            }
            let is_same = answers::is_same(slave, a, b, &self.options);
            axis.same = if is_same { axis.same + 1 } else { 0 };
            let stands = [a, b].iter().all(|answer| answer.still(slave) >= STANDS_REPORTS);
            if is_same && (stands || axis.same >= SAME_ANSWERS) {
                *axis = Apart { together: Some(apart), ..Apart::default() };
            }
        }
    }

    /// The most cycles that one run had more while an axis was on its way, up to a pair and those right behind it.
    fn most_apart(&self, at: usize, slave: u8) -> u64 {
        let Some(axis) = self.axes.get(usize::from(slave).wrapping_sub(1)) else { return 0 };
        let Some(together) = axis.together else { return 0 };
        let near = self.pairs.range(at..).take(1 + SLACK_CYCLES).filter_map(|pair| apart(&pair.a, &pair.b));
        near.map(|apart| apart.abs_diff(together)).max().unwrap_or_default().max(axis.most)
    }

    fn is_timing(&self, at: usize, what: &Deviation, ended: bool) -> bool {
        match *what {
            Deviation::Fault { slave, side, error_code } => self.has_fault(at, side.other(), slave, error_code),
            Deviation::State { .. } if !self.is_last(at, ended, false) => {
                self.both_show(at, |one, other| one.board().state == other.board().state)
            }
            Deviation::Result { .. } if !self.is_last(at, ended, false) => self.both_show(at, |one, other| {
                let [one, other] = [one.board(), other.board()];
                (one.state, one.result) == (other.state, other.result)
            }),
            Deviation::Statusword { slave, .. }
            | Deviation::ErrorCode { slave, .. }
            | Deviation::Position { slave, .. }
            | Deviation::Inputs { slave, .. }
            | Deviation::Kind { slave }
                if !self.is_last(at, ended, true) || self.moves_at_end(at, slave, what) =>
            {
                self.both_show(at, |one, other| self.shows_same(slave, one, other))
                    || self.is_of_the_moment(at, slave, what)
                    || self.is_on_its_way(at, slave, what)
            }
            Deviation::Statusword { slave, .. } => self.is_of_the_moment(at, slave, what),
            _ => false,
        }
    }

    /// Whether a difference between last answers is one of an axis that moves in both runs, in the same state.
    fn moves_at_end(&self, at: usize, slave: u8, what: &Deviation) -> bool {
        let Some(answers) = self.pairs.get(at).and_then(Pair::answers_in_op) else { return false };
        let is_state = match what {
            Deviation::Statusword { words: [a, b], .. } => {
                (a.0 ^ b.0) & Statusword::STATE_BITS & self.options.statusword_mask != 0
            }
            Deviation::Position { .. } => false,
            _ => true,
        };
        !is_state && self.most_apart(at, slave) > 0 && answers.iter().all(|answer| answer.still(slave) < STANDS_REPORTS)
    }

    /// Whether a difference is one of an axis on its way, of which one run has more cycles than the other.
    fn is_on_its_way(&self, at: usize, slave: u8, what: &Deviation) -> bool {
        let most = self.most_apart(at, slave);
        if most == 0 {
            return false;
        }
        if let Deviation::Position { axis, counts, .. } = what {
            let cycles = usize::try_from(most).unwrap_or(usize::MAX).saturating_add(SLACK_CYCLES).min(WAY_CYCLES);
            let is_near = |side: Side| {
                let position = counts[side.other().index()];
                let moved = |cycles| self.moved(at, side, slave, *axis, cycles);
                let ((least, most), soon) = (moved(cycles)?, moved(SLACK_CYCLES)?);
                let slack = soon.1.abs_diff(soon.0).saturating_add(self.options.tolerance_counts);
                Some(position.clamp(least, most).abs_diff(position) <= slack)
            };
            return is_near(Side::A) == Some(true) && is_near(Side::B) == Some(true);
        }
        let same = self.same_in(slave, what);
        self.shows(at, Side::A, &same) || self.shows(at, Side::B, &same)
    }

    /// Whether two reports of OP show the same of a slave in that which differs elsewhere.
    fn same_in(&self, slave: u8, what: &Deviation) -> impl Fn(&Answer, &Answer) -> bool {
        let is_about_it = |found: &Deviation| std::mem::discriminant(found) == std::mem::discriminant(what);
        move |one, other| {
            let mut found = Vec::new();
            answers::slave_differences(slave, one, other, &self.options, &mut found);
            one.is_op() && other.is_op() && !found.iter().any(is_about_it)
        }
    }

    /// Whether a difference depends on nothing but the moment in which an axis was seen that moves in both runs: whether it has
    /// reached the target of that cycle (bit 10), and which of the places on its way it was at. In a cycle more or less these two go
    /// together otherwise, so that each run has to show near its own answer the one of the other by itself, and not both at once.
    fn is_of_the_moment(&self, at: usize, slave: u8, what: &Deviation) -> bool {
        let Some(answers) = self.pairs.get(at).and_then(Pair::answers_in_op) else { return false };
        let is_one = match what {
            Deviation::Statusword { words: [a, b], .. } => {
                (a.0 ^ b.0) & self.options.statusword_mask == Statusword::TARGET_REACHED
            }
            Deviation::Position { .. } => true,
            _ => false,
        };
        is_one
            && answers.iter().all(|answer| answer.still(slave) < STANDS_REPORTS)
            && self.both_show(at, self.same_in(slave, what))
    }

    /// Whether a run shows that fault of a slave near a pair.
    fn has_fault(&self, at: usize, side: Side, slave: u8, error_code: u16) -> bool {
        let is_it = |step: &Step| {
            let mut faults = step.faults.iter().filter(|(of, _)| *of == slave);
            faults.any(|(_, code)| *code == error_code || error_code == 0)
        };
        let mut reports = 0;
        let is_near = |pair: &&Pair| {
            let near = reports <= self.window();
            reports += pair.step(side).kept.len();
            near
        };
        if self.pairs.range(at..).take_while(is_near).any(|pair| is_it(pair.step(side))) {
            return true;
        }
        let mut reports = 0;
        let mut before = self.pairs.range(..at).rev().take_while(|pair| {
            let near = reports <= self.window();
            reports += pair.step(side).kept.len();
            near
        });
        before.any(|pair| is_it(pair.step(side)))
    }

    /// The least and the greatest position of an axis in counts, in an answer and so many cycles before and behind it, or behind
    /// the other run's.
    fn moved(&self, at: usize, side: Side, slave: u8, axis: u8, cycles: usize) -> Option<(i32, i32)> {
        let place = usize::from(axis.saturating_sub(1));
        let reports = self.near(at, side, cycles).chain(self.soon(at, side, cycles));
        let positions = reports.filter_map(|answer| answer.positions(slave).get(place).copied()?);
        positions.fold(None, |range: Option<(i32, i32)>, position| {
            let (least, most) = range.unwrap_or((position, position));
            Some((least.min(position), most.max(position)))
        })
    }

    /// Whether each of the runs shows near its own answer what the other one has answered.
    fn both_show(&self, at: usize, same: impl Fn(&Answer, &Answer) -> bool) -> bool {
        self.shows(at, Side::A, &same) && self.shows(at, Side::B, &same)
    }

    /// Whether that run shows near its own answer what the other one has answered.
    fn shows(&self, at: usize, side: Side, same: &impl Fn(&Answer, &Answer) -> bool) -> bool {
        let Some(pair) = self.pairs.get(at) else { return false };
        let Some(wanted) = &pair.step(side.other()).answer else { return false };
        let same = |report: &Answer| if side == Side::B { same(wanted, report) } else { same(report, wanted) };
        self.near(at, side, self.window()).chain(self.soon(at, side, self.window())).any(same)
    }

    /// The first reports of a run to a command, up to so many cycles behind those that the other run has until its answer. Where
    /// that has waited for long there are none.
    fn soon(&self, at: usize, side: Side, cycles: usize) -> impl Iterator<Item = &Answer> {
        let reports = self.pairs.get(at).map(|pair| (&pair.step(side).kept, pair.step(side.other()).kept.len()));
        let reports = reports.filter(|(_, waited)| *waited <= self.window());
        reports.into_iter().flat_map(move |(kept, waited)| kept.iter().take(waited + cycles))
    }

    /// The answer of a run and the reports of so many cycles before and behind it.
    fn near(&self, at: usize, side: Side, cycles: usize) -> impl Iterator<Item = &Answer> {
        let before = self.pairs.range(..=at).rev().flat_map(move |pair| pair.step(side).kept.iter().rev());
        let behind = self.pairs.range(at + 1..).flat_map(move |pair| pair.step(side).kept.iter());
        before.take(cycles + 1).chain(behind.take(cycles))
    }
}

const fn is_fault(what: &Deviation) -> bool {
    matches!(what, Deviation::Fault { .. })
}
