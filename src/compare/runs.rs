//! Compares two runs step by step.

use std::collections::VecDeque;
use std::fmt::{self, Display, Formatter};

use super::answers::{self, SdoComparison};
use super::counts::{RunCounts, seconds};
use super::difference::{Deviation, Difference, words};
use super::gaps::{GapCount, Gaps};
use super::latency::{Latency, LatencyFinder, LatencyStretch};
use super::steps::{Step, Steps};
use super::timing::{NextSteps, PairWindow, StepPair};
use super::{CompareOptions, Side, TimedFrame};
use crate::sk::SlotSize;
use crate::sk::dump::CommandDump;

/// The maximum number of equal commands before the first difference that are kept as its context. \[OURS]
const CONTEXT_MAX: usize = 3;

/// A command before the first difference, equal in both runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Context {
    /// The number of the command, from 1.
    pub command: u64,
    /// The time at which the command was sent in run A and in run B, in nanoseconds.
    pub at_ns: [i64; 2],
    /// The first slot of the command that requests something, as [`crate::sk::dump`] writes it.
    pub text: String,
}

/// The result of comparing two runs. Its `Display` is a report of a few lines.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// The numbers of frames of run A and run B.
    pub counts: [RunCounts; 2],
    /// The number of compared answers: those to commands that are equal in both runs and answered in both.
    pub answers: u64,
    /// The number of equal commands whose answers differ.
    pub differing_answers: u64,
    /// The number of equal commands whose answers differ in timing only: the other run shows the same answer some
    /// cycles earlier or later, or an axis is moving while one run has additional cycles.
    pub shifted_answers: u64,
    /// The delay of the answers in run B against those in run A, in cycles.
    pub latency: Latency,
    /// The gaps of run A and run B.
    pub gaps: [Gaps; 2],
    /// The first difference; `None` if the runs are equal.
    pub first: Option<Difference>,
    /// The run that ends first although all its commands are equal to those of the other run; `None` if neither run does.
    /// Its end counts as a difference.
    pub ends_early: Option<Side>,
    /// The last commands before the first difference, at most three.
    pub context: Vec<Context>,
}

impl Comparison {
    /// Whether there is no difference.
    pub const fn is_equal(&self) -> bool {
        self.first.is_none()
    }
}

/// Compares two runs, each given as its frames sorted by time.
///
/// After a differing command the runs cannot be aligned any more, so the later frames are only counted. After a
/// difference between answers the comparison continues.
pub fn compare(
    a: impl IntoIterator<Item = TimedFrame>,
    b: impl IntoIterator<Item = TimedFrame>,
    size: SlotSize,
    options: &CompareOptions,
) -> Comparison {
    let steps = Steps::new(a.into_iter(), size, options.ignore_repeats);
    compare_steps(steps, Steps::new(b.into_iter(), size, options.ignore_repeats), options)
}

/// Compares two runs that are given as steps; otherwise like [`compare`].
pub fn compare_steps<A, B>(mut a: Steps<A>, mut b: Steps<B>, options: &CompareOptions) -> Comparison
where
    A: Iterator<Item = TimedFrame>,
    B: Iterator<Item = TimedFrame>,
{
    let mut state = ComparisonState::new(options);
    loop {
        match (a.next(), b.next()) {
            (None, None) => break,
            _ if state.alignment_ended => {}
            (Some(a), Some(b)) => state.pair(a, b),
            (a, b) => state.ended(a.as_ref(), b.as_ref()),
        }
    }
    state.finish([a.counts, b.counts])
}

/// The state of a comparison, with the result so far.
struct ComparisonState {
    options: CompareOptions,
    /// Whether a pair of differing commands has been read. It may still wait in the window of pairs.
    differ: bool,
    /// Whether the alignment by commands has ended: [`Self::judge`] has reached a pair of differing commands, or one run
    /// has ended. Later pairs are not compared.
    alignment_ended: bool,
    transfer: SdoComparison,
    timing: PairWindow,
    latency: LatencyFinder,
    gaps: GapCount,
    /// The first command of the last [`LatencyStretch`] that was reported because its latency is longer than allowed.
    late_from: Option<u64>,
    recent: VecDeque<(Step, Step)>,
    result: Comparison,
}

impl ComparisonState {
    fn new(options: &CompareOptions) -> Self {
        Self {
            options: *options,
            differ: false,
            alignment_ended: false,
            transfer: SdoComparison::default(),
            timing: PairWindow::new(options),
            latency: LatencyFinder::default(),
            gaps: GapCount::default(),
            late_from: None,
            recent: VecDeque::new(),
            result: Comparison::default(),
        }
    }

    fn pair(&mut self, a: Step, b: Step) {
        let slot = (0..a.size.slots()).find(|i| a.slot(*i) != b.slot(*i));
        if slot.is_some() || self.differ {
            // The runs are not aligned after a differing command. Later pairs are read only because their reports may
            // show that a difference before that command is timing alone.
            let line = |step: &Step| CommandDump::new(&step.command, step.size).line(slot?);
            let lines = line(&a).zip(line(&b)).filter(|_| !std::mem::replace(&mut self.differ, true));
            let what = lines.map(|(a, b)| Deviation::Command { lines: Box::new([a, b]) });
            self.timing.push(StepPair::new(a, b, what.into_iter().collect()));
            self.judge(NextSteps::More);
            return;
        }
        self.result.answers += u64::from(a.answer.is_some() && b.answer.is_some());
        let mut what = answers::differences(&a, &b, &self.options);
        // In a motion commands wait in the FIFO, as many as the program sends ahead. Their delay is not the latency of
        // the board.
        let moves = self.gaps.pair(&a, &b, what.is_empty());
        if !moves {
            self.latency.pair(&a, &b);
        }
        what.extend(self.transfer.steps(&a, &b));
        what.extend(self.late());
        self.timing.push(StepPair::new(a, b, what));
        self.judge(NextSteps::More);
    }

    /// Returns a latency that is longer than allowed as a difference. Each [`LatencyStretch`] is reported once, at its
    /// beginning.
    fn late(&mut self) -> Option<Deviation> {
        let now = self.latency.late(self.options.latency_cycles?.into())?;
        let is_new = self.late_from.replace(now.from_command) != Some(now.from_command);
        is_new.then_some(late(now))
    }

    /// Returns a latency that is longer than allowed as a difference, once both runs have ended. Here a few commands with
    /// that latency suffice.
    fn late_at_end(&mut self) -> Option<Deviation> {
        let allowed = self.options.latency_cycles.filter(|_| self.late_from.is_none())?;
        self.latency.late_at_end(allowed.into()).map(late)
    }

    /// Sets the result of each pair for which enough later pairs are known ([`PairWindow::judge`]), up to the first
    /// command that differs.
    fn judge(&mut self, next_steps: NextSteps) {
        while !self.alignment_ended
            && let Some((StepPair { a, b, .. }, what)) = self.timing.judge(next_steps)
        {
            self.alignment_ended = matches!(what.first(), Some(Deviation::Command { .. }));
            if !what.is_empty() {
                self.result.differing_answers += u64::from(!self.alignment_ended);
                self.set_first(Some(&a), Some(&b), what);
            }
            if self.result.first.is_none() {
                if self.recent.len() == CONTEXT_MAX {
                    self.recent.pop_front();
                }
                self.recent.push_back((a, b));
            }
        }
    }

    fn ended(&mut self, a: Option<&Step>, b: Option<&Step>) {
        self.judge(NextSteps::OneRun);
        if self.differ {
            return;
        }
        let side = if a.is_none() { Side::A } else { Side::B };
        self.result.ends_early = Some(side);
        self.set_first(a, b, vec![Deviation::Ends { side }]);
        self.alignment_ended = true;
    }

    /// Keeps the first difference, with the commands before it as context.
    fn set_first(&mut self, a: Option<&Step>, b: Option<&Step>, what: Vec<Deviation>) {
        if self.result.first.is_some() {
            return;
        }
        self.result.first = Some(Difference::new(a, b, what));
        let context = self.recent.drain(..).map(|(a, b)| Context {
            command: a.number,
            at_ns: [a.at_ns, b.at_ns],
            text: words(&a, a.asking_slot()),
        });
        self.result.context = context.collect();
    }

    fn finish(mut self, counts: [RunCounts; 2]) -> Comparison {
        self.judge(NextSteps::Nothing);
        let late = self.late_at_end();
        let at_end = if self.alignment_ended { None } else { self.transfer.end() };
        let what: Vec<_> = at_end.into_iter().chain(late).collect();
        if !what.is_empty() {
            let last = self.recent.back().cloned();
            let (a, b) = last.unzip();
            self.result.differing_answers += 1;
            self.set_first(a.as_ref(), b.as_ref(), what);
        }
        let (latency, gaps, shifted) = (self.latency.end(), self.gaps.end(), self.timing.shifted);
        Comparison { counts, latency, gaps, shifted_answers: shifted, ..self.result }
    }
}

impl Comparison {
    /// Writes how the timing of the two runs differs: a line for the latency, for the gaps of each run, and for answers
    /// that come earlier or later. Writes nothing if the timing does not differ.
    fn timing(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Latency { commands, usual, least, most, ref stretches } = self.latency;
        // Single commands that differ by one or two cycles are not shown: the cycle of a report is not known more
        // exactly.
        if usual != 0 || stretches.iter().any(|stretch| stretch.cycles != 0) {
            write!(f, "latency: {}", Later(usual))?;
            if least != most {
                write!(f, ", of {commands} commands that did not wait; from {least} to {most}")?;
            }
            for LatencyStretch { from_command, cycles } in stretches.iter().skip(1).take(SHOWN_STRETCHES) {
                write!(f, "; {} from command {from_command} on", Later(*cycles))?;
            }
            match stretches.len().saturating_sub(1 + SHOWN_STRETCHES) {
                0 => {}
                more => write!(f, "; {more} changes more")?,
            }
            writeln!(f)?;
        }
        for (side, Gaps { count, cycles, longest }) in [Side::A, Side::B].into_iter().zip(&self.gaps) {
            if *count > 0 {
                let gaps = if *count == 1 { "gap" } else { "gaps" };
                writeln!(f, "{side}: {count} {gaps} of {cycles} cycles together, the longest {longest}")?;
            }
        }
        if self.shifted_answers > 0 {
            writeln!(f, "the same some cycles before or later: {} answers", self.shifted_answers)?;
        }
        Ok(())
    }
}

fn late(now: LatencyStretch) -> Deviation {
    let LatencyStretch { from_command, cycles } = now;
    let side = if cycles > 0 { Side::B } else { Side::A };
    Deviation::Late { side, cycles: cycles.unsigned_abs(), from_command }
}

/// The maximum number of changes of the latency that the text lists. \[OURS]
const SHOWN_STRETCHES: usize = 4;

/// Text of a latency: how many cycles run B answers later.
struct Later(i64);

impl Display for Later {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (side, cycles) = (if self.0 < 0 { Side::A } else { Side::B }, self.0.unsigned_abs());
        match cycles {
            0 => f.write_str("both answer in the same cycle"),
            1 => write!(f, "{side} answers 1 cycle later"),
            _ => write!(f, "{side} answers {cycles} cycles later"),
        }
    }
}

impl Display for Comparison {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (side, counts) in [Side::A, Side::B].into_iter().zip(&self.counts) {
            writeln!(f, "{side}: {counts}")?;
        }
        self.timing(f)?;
        let Some(first) = &self.first else {
            return write!(f, "equal: {} commands and {} answers", self.counts[0].commands, self.answers);
        };
        writeln!(f, "first difference:")?;
        for Context { command, at_ns: [a, b], text } in &self.context {
            writeln!(f, "  command {command} ({text}) at {} in A, {} in B: equal", seconds(*a), seconds(*b))?;
        }
        write!(f, "  {first}")?;
        let more = self.differing_answers.saturating_sub(u64::from(!matches!(
            first.what.first(),
            Some(Deviation::Command { .. } | Deviation::Ends { .. })
        )));
        match more {
            0 => {}
            1 => write!(f, "\nthe answer to a later command differs too")?,
            _ => write!(f, "\nanswers to {more} later commands differ too")?,
        }
        if let Some(side) = self.ends_early {
            let [a, b] = self.counts.map(|counts| counts.commands);
            write!(f, "\n{side} ends early: {} of {} commands", a.min(b), a.max(b))?;
        }
        Ok(())
    }
}
