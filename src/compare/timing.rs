//! Decides which differences between two answers are timing alone: the other run shows the same value some cycles
//! earlier or later.
//!
//! A board over an ECM-XF executes a command some cycles later, and the program continues meanwhile or waits for more
//! cycles. So the answers of the two boards to a command are also compared with the answers in the cycles around it:
//!
//! - A value of one run is no difference if the other run shows it at most [`super::CompareOptions::latency_cycles`] before or
//!   after its own answer. This must hold in both directions, so that a value which one run never shows remains a
//!   difference.
//! - If a run has one cycle more or less, its report may pair the target reached bit (bit 10) of a moving axis with
//!   another position. Bit and position are therefore compared separately.
//! - If one run has additional cycles, because its program waited or the board had nothing to send, a moving axis is at
//!   another position for a while. Until it is at rest in both runs, or both have shown the same position for a while,
//!   the position of each run has to occur in the other run within that number of cycles, or close to it. An axis at
//!   rest has to be at the same position.
//! - The last answers of a run, and the last answers before slaves leave OP, have to be the same, except for an axis
//!   that still moves in both runs. Its target reached bit (bit 10) may differ. If one of the runs had additional
//!   cycles, its position and all bits of its statusword that do not belong to the CiA 402 state may differ too.

use std::collections::VecDeque;

use super::difference::Deviation;
use super::gaps::cycle_offset;
use super::report::BoardReport;
use super::steps::Step;
use super::{AT_REST_REPORTS, CompareOptions, Side, WINDOW_CYCLES, answers, unsure_cycles};
use crate::ethercat::cia402::Statusword;
use crate::sk::dump::MAX_SLAVES;

/// After this many consecutive answers that are the same in both runs, additional cycles before them do not count any
/// more as the reason why a moving axis is at another position. \[OURS]
const SAME_ANSWERS: u32 = 16;
/// How many cycles are searched for the same value in addition to the cycles by which the runs differ: a drive follows
/// after one or two cycles, and a report may belong to the next cycle. \[OURS]
const SLACK_CYCLES: usize = 2;
/// How many consecutive answers have to be the same some cycles earlier or later to show that neither run had additional
/// cycles, and that reports were only assigned to the wrong commands. \[OURS]
const UNMOVED_ANSWERS: usize = 3;
/// The maximum number of cycles that are searched for the other run's position of a moving axis, if one run had
/// additional cycles: enough for a program that waits for a few SDOs in succession. \[OURS]
const WAY_CYCLES: usize = 128;
/// The maximum number of pairs of steps whose reports are searched before and after a pair. \[OURS]
const PAIRS_MAX: usize = 2 * WAY_CYCLES;

/// Two equal steps, one of each run.
#[derive(Clone, Debug)]
pub(super) struct StepPair {
    pub(super) a: Step,
    pub(super) b: Step,
    /// The differences between their answers, by [`answers::differences`].
    what: Vec<Deviation>,
}

impl StepPair {
    pub(super) const fn new(a: Step, b: Step, what: Vec<Deviation>) -> Self {
        Self { a, b, what }
    }

    const fn step(&self, side: Side) -> &Step {
        match side {
            Side::A => &self.a,
            Side::B => &self.b,
        }
    }

    fn answers(&self) -> Option<[&BoardReport; 2]> {
        Some([self.a.answer.as_ref()?, self.b.answer.as_ref()?])
    }

    /// Both answers, if both were given in OP.
    fn answers_in_op(&self) -> Option<[&BoardReport; 2]> {
        self.answers().filter(|answers| answers.iter().all(|answer| answer.is_op()))
    }
}

/// Whether more steps follow the pairs that were pushed so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NextSteps {
    /// Further pairs follow, or may follow: the runs are not read to their ends yet.
    More,
    /// Steps of one run only, because the other one has ended.
    OneRun,
    /// Nothing: both runs have ended.
    Nothing,
}

/// For one axis: how the number of additional cycles of the runs has changed since both runs showed the axis at the same
/// position.
#[derive(Clone, Copy, Debug, Default)]
struct CycleOffset {
    /// The cycle count of run B minus that of run A at the first answer in OP; `None` before it. It is updated at an
    /// answer that shows the axis the same in both runs, either at rest or for the 16th time in a row. It is also
    /// updated if reports were only assigned to the wrong commands.
    offset_when_equal: Option<i64>,
    /// The largest change of that difference since it was last updated, in cycles.
    largest_change: u64,
    /// The number of consecutive answers that showed the same for this axis in both runs.
    same: u32,
}

/// A window of pairs around the pair that is judged next.
#[derive(Debug)]
pub(super) struct PairWindow {
    options: CompareOptions,
    pairs: VecDeque<StepPair>,
    /// The index of the next pair to judge.
    next: usize,
    axes: [CycleOffset; MAX_SLAVES],
    /// The number of pairs whose answers differ in timing alone.
    pub(super) shifted: u64,
}

impl PairWindow {
    pub(super) fn new(options: &CompareOptions) -> Self {
        let axes = [CycleOffset::default(); MAX_SLAVES];
        Self { options: *options, pairs: VecDeque::new(), next: 0, axes, shifted: 0 }
    }

    /// The maximum number of cycles between two answers that count as the same.
    fn window(&self) -> usize {
        let most = self.options.latency_cycles.map_or(WINDOW_CYCLES, |cycles| cycles as usize);
        most.min(WINDOW_CYCLES)
    }

    /// Appends the next pair.
    pub(super) fn push(&mut self, pair: StepPair) {
        self.pairs.push_back(pair);
    }

    /// Returns the next pair, with its non-timing differences, once enough of the following pairs are known.
    pub(super) fn judge(&mut self, next_steps: NextSteps) -> Option<(StepPair, Vec<Deviation>)> {
        let ended = next_steps == NextSteps::Nothing;
        let is_known = next_steps != NextSteps::More || self.window() == 0 || self.is_followed();
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
        // If other values of a slave's answer differ, they say more than its fault does, so the fault is left out.
        let shown: Vec<u8> = what.iter().filter(|what| !is_fault(what)).filter_map(Deviation::slave).collect();
        what.retain(|what| !is_fault(what) || what.slave().is_none_or(|slave| !shown.contains(&slave)));
        self.forget();
        Some((pair, what))
    }

    /// Whether enough reports after the next pair are known to judge it: more than [`Self::window`] of each run, or
    /// more than [`WAY_CYCLES`] if a run had additional cycles. [`PAIRS_MAX`] pairs are enough in any case.
    fn is_followed(&self) -> bool {
        let wanted = if self.axes.iter().any(|axis| axis.largest_change > 0) { WAY_CYCLES } else { self.window() };
        let enough = |side| self.reports(self.next + 1, self.pairs.len(), side) > wanted;
        self.pairs.len() - self.next > PAIRS_MAX || (enough(Side::A) && enough(Side::B))
    }

    fn reports(&self, from: usize, to: usize, side: Side) -> usize {
        self.pairs.range(from.min(to)..to).map(|pair| pair.step(side).kept.len()).sum()
    }

    /// Drops the oldest pairs as long as the remaining pairs before the next one suffice for a search: they have more
    /// than 2 * [`WAY_CYCLES`] reports of each run, or are at least [`PAIRS_MAX`] pairs.
    fn forget(&mut self) {
        let enough = |this: &Self, side| this.reports(1, this.next, side) > 2 * WAY_CYCLES;
        while self.next > PAIRS_MAX || (enough(self, Side::A) && enough(self, Side::B)) {
            self.pairs.pop_front();
            self.next -= 1;
        }
    }

    /// Whether no later pair of answers can be compared: because both runs end (`ended`), or, with `in_op`, because the
    /// slaves leave OP.
    fn is_last(&self, at: usize, ended: bool, in_op: bool) -> bool {
        let mut later = self.pairs.range(at + 1..).filter_map(StepPair::answers);
        match later.next() {
            Some(answers) => in_op && answers.iter().any(|answer| !answer.is_op()),
            None => ended,
        }
    }

    /// Whether both runs show the same for a slave, some cycles earlier or later, at the pair `at` and at the pairs
    /// right after it.
    fn matches_shifted(&self, at: usize, slave: u8) -> bool {
        let same = |one: &BoardReport, other: &BoardReport| self.shows_same(slave, one, other);
        let mut pairs = (at..self.pairs.len()).take(UNMOVED_ANSWERS);
        pairs.all(|at| self.pairs.get(at).is_none_or(|pair| pair.answers_in_op().is_none()) || self.both_show(at, same))
    }

    /// Whether two reports of OP show the same for a slave.
    fn shows_same(&self, slave: u8, one: &BoardReport, other: &BoardReport) -> bool {
        one.is_op() && other.is_op() && answers::is_same(slave, one, other, &self.options)
    }

    /// Updates for each axis by how many cycles the runs are apart, from the answers of the pair `at`.
    fn follow(&mut self, at: usize) {
        let mut axes = self.axes;
        self.follow_axes(at, &mut axes);
        self.axes = axes;
    }

    fn follow_axes(&self, at: usize, axes: &mut [CycleOffset; MAX_SLAVES]) {
        let Some(pair) = self.pairs.get(at) else { return };
        let Some([a, b]) = pair.answers_in_op() else {
            if pair.answers().is_some() {
                *axes = [CycleOffset::default(); MAX_SLAVES];
            }
            return;
        };
        let Some(offset) = cycle_offset(&pair.a, &pair.b) else { return };
        for (slave, axis) in (1..=pair.a.size.max_slaves() as u8).zip(axes) {
            let more = offset.abs_diff(*axis.offset_when_equal.get_or_insert(offset));
            if more > axis.largest_change
                && more <= unsure_cycles(pair.a.cycle_ns)
                && axis.largest_change == 0
                && self.matches_shifted(at, slave)
            {
                axis.offset_when_equal = Some(offset);
                continue;
            }
            axis.largest_change = axis.largest_change.max(more);
            if axis.largest_change == 0 {
                continue;
            }
            let is_same = answers::is_same(slave, a, b, &self.options);
            axis.same = if is_same { axis.same + 1 } else { 0 };
            let stands = [a, b].iter().all(|answer| answer.unchanged_reports(slave) >= AT_REST_REPORTS);
            if is_same && (stands || axis.same >= SAME_ANSWERS) {
                *axis = CycleOffset { offset_when_equal: Some(offset), ..CycleOffset::default() };
            }
        }
    }

    /// The largest change, in cycles, of the difference between the runs' cycle counts since both runs showed the axis
    /// at the same position. The pair `at` and the pairs right after it are included. The change is the number of
    /// additional cycles of either run.
    fn largest_offset_change(&self, at: usize, slave: u8) -> u64 {
        let Some(axis) = self.axes.get(usize::from(slave).wrapping_sub(1)) else { return 0 };
        let Some(offset_when_equal) = axis.offset_when_equal else { return 0 };
        let near = self.pairs.range(at..).take(1 + SLACK_CYCLES).filter_map(|pair| cycle_offset(&pair.a, &pair.b));
        near.map(|offset| offset.abs_diff(offset_when_equal)).max().unwrap_or_default().max(axis.largest_change)
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
                    || self.is_sampling_moment(at, slave, what)
                    || self.is_on_its_way(at, slave, what)
            }
            Deviation::Statusword { slave, .. } => self.is_sampling_moment(at, slave, what),
            _ => false,
        }
    }

    /// Whether additional cycles of a run explain a difference between the last answers of a step. They do for an axis that
    /// moves in both runs, if the difference is in its position, or in bits of its statusword outside the CiA 402 state.
    fn moves_at_end(&self, at: usize, slave: u8, what: &Deviation) -> bool {
        let Some(answers) = self.pairs.get(at).and_then(StepPair::answers_in_op) else { return false };
        let is_state = match what {
            Deviation::Statusword { words: [a, b], .. } => {
                (a.0 ^ b.0) & Statusword::STATE_BITS & self.options.statusword_mask != 0
            }
            Deviation::Position { .. } => false,
            _ => true,
        };
        !is_state
            && self.largest_offset_change(at, slave) > 0
            && answers.iter().all(|answer| answer.unchanged_reports(slave) < AT_REST_REPORTS)
    }

    /// Whether a difference comes from additional cycles of one run. A position has to be, within a small tolerance,
    /// among the positions that the other run shows within that number of cycles. Any other value has to occur in a
    /// report close to the answer in at least one run.
    fn is_on_its_way(&self, at: usize, slave: u8, what: &Deviation) -> bool {
        let most = self.largest_offset_change(at, slave);
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

    /// Returns a function that compares two reports in OP for a slave, in the kind of value that `what` is about, such as
    /// the position.
    fn same_in(&self, slave: u8, what: &Deviation) -> impl Fn(&BoardReport, &BoardReport) -> bool {
        let is_about_it = |found: &Deviation| std::mem::discriminant(found) == std::mem::discriminant(what);
        move |one, other| {
            let mut found = Vec::new();
            answers::slave_differences(slave, one, other, &self.options, &mut found);
            one.is_op() && other.is_op() && !found.iter().any(is_about_it)
        }
    }

    /// Whether a difference depends only on the moment of a report: in target reached (bit 10), or in the position of
    /// an axis that moves in both runs. A report one cycle earlier or later may combine bit and position differently.
    /// So each run has to show the other run's bit close to its own answer, and the other run's position too, but the
    /// two may be in different reports.
    fn is_sampling_moment(&self, at: usize, slave: u8, what: &Deviation) -> bool {
        let Some(answers) = self.pairs.get(at).and_then(StepPair::answers_in_op) else { return false };
        let is_one = match what {
            Deviation::Statusword { words: [a, b], .. } => {
                (a.0 ^ b.0) & self.options.statusword_mask == Statusword::TARGET_REACHED
            }
            Deviation::Position { .. } => true,
            _ => false,
        };
        is_one
            && answers.iter().all(|answer| answer.unchanged_reports(slave) < AT_REST_REPORTS)
            && self.both_show(at, self.same_in(slave, what))
    }

    /// Whether a run shows this fault of a slave in a report close to the pair `at`.
    fn has_fault(&self, at: usize, side: Side, slave: u8, error_code: u16) -> bool {
        let is_it = |step: &Step| {
            let mut faults = step.faults.iter().filter(|(of, _)| *of == slave);
            faults.any(|(_, code)| *code == error_code || error_code == 0)
        };
        let mut reports = 0;
        let is_near = |pair: &&StepPair| {
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

    /// The smallest and the largest position of an axis, in counts, in the reports within `cycles` of the answer and in
    /// the first reports of the step ([`Self::first_reports`]).
    fn moved(&self, at: usize, side: Side, slave: u8, axis: u8, cycles: usize) -> Option<(i32, i32)> {
        let place = usize::from(axis.saturating_sub(1));
        let reports = self.reports_around(at, side, cycles).chain(self.first_reports(at, side, cycles));
        let positions = reports.filter_map(|answer| answer.positions(slave).get(place).copied()?);
        positions.fold(None, |range: Option<(i32, i32)>, position| {
            let (least, most) = range.unwrap_or((position, position));
            Some((least.min(position), most.max(position)))
        })
    }

    /// Whether each run shows the other run's answer within [`Self::window`] cycles of its own answer, or among the first
    /// reports of the step.
    fn both_show(&self, at: usize, same: impl Fn(&BoardReport, &BoardReport) -> bool) -> bool {
        self.shows(at, Side::A, &same) && self.shows(at, Side::B, &same)
    }

    /// Whether the run `side` shows the other run's answer within [`Self::window`] cycles of its own answer, or among the
    /// first reports of the step.
    fn shows(&self, at: usize, side: Side, same: &impl Fn(&BoardReport, &BoardReport) -> bool) -> bool {
        let Some(pair) = self.pairs.get(at) else { return false };
        let Some(wanted) = &pair.step(side.other()).answer else { return false };
        let same = |report: &BoardReport| if side == Side::B { same(wanted, report) } else { same(report, wanted) };
        self.reports_around(at, side, self.window()).chain(self.first_reports(at, side, self.window())).any(same)
    }

    /// The first reports of the run `side` in its step of the pair `at`: as many as the other run has in its step, and
    /// `cycles` more. There are none if the other run has more reports than [`Self::window`] in the step.
    fn first_reports(&self, at: usize, side: Side, cycles: usize) -> impl Iterator<Item = &BoardReport> {
        let reports = self.pairs.get(at).map(|pair| (&pair.step(side).kept, pair.step(side.other()).kept.len()));
        let reports = reports.filter(|(_, waited)| *waited <= self.window());
        reports.into_iter().flat_map(move |(kept, waited)| kept.iter().take(waited + cycles))
    }

    /// The answer of the run `side`, and its reports of `cycles` cycles before and after it.
    fn reports_around(&self, at: usize, side: Side, cycles: usize) -> impl Iterator<Item = &BoardReport> {
        let before = self.pairs.range(..=at).rev().flat_map(move |pair| pair.step(side).kept.iter().rev());
        let behind = self.pairs.range(at + 1..).flat_map(move |pair| pair.step(side).kept.iter());
        before.take(cycles + 1).chain(behind.take(cycles))
    }
}

const fn is_fault(what: &Deviation) -> bool {
    matches!(what, Deviation::Fault { .. })
}
