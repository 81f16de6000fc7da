//! Compares two runs step by step.

use std::collections::VecDeque;
use std::fmt::{self, Display, Formatter};

use super::answers::{self, Transfer};
use super::difference::{Deviation, Difference, seconds, words};
use super::steps::{Step, Steps};
use super::{Options, Side, TimedFrame};
use crate::sk::SlotSize;
use crate::sk::dump::CommandDump;

/// How many equal commands before the first difference are kept as its context. \[OURS]
const CONTEXT_MAX: usize = 3;

/// The length of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Command frames that request something.
    pub commands: u64,
    /// Command frames of nothing but GET_STATUS.
    pub polls: u64,
    /// Repeated command frames that were left out ([`Options::ignore_repeats`]).
    pub repeats: u64,
    /// Reports of the board.
    pub reports: u64,
    /// The time of the last frame, in nanoseconds.
    pub last_ns: i64,
}

/// A command before the first difference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Context {
    /// The number of the command, from 1.
    pub command: u64,
    /// When it was sent in run A and in run B, in nanoseconds.
    pub at_ns: [i64; 2],
    /// The first slot of it that requests something, as [`crate::sk::dump`] writes it.
    pub text: String,
}

/// The result of comparing two runs. Its `Display` is a report of a few lines.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// The lengths of run A and run B.
    pub counts: [Counts; 2],
    /// How many answers were compared: commands that are equal in both runs and have an answer in both.
    pub answers: u64,
    /// At how many equal commands the answers differ.
    pub differing_answers: u64,
    /// The first difference; `None` if the runs are equal.
    pub first: Option<Difference>,
    /// The run that ends first although all its commands are equal; `None` if both have the same commands.
    pub ends_early: Option<Side>,
    /// The last three commands before the first difference.
    pub context: Vec<Context>,
}

impl Comparison {
    /// Whether there is no difference.
    pub const fn is_equal(&self) -> bool {
        self.first.is_none()
    }
}

/// Compares two runs, each given as its frames in the order of their times.
///
/// After a command that differs the runs cannot be aligned any more, and what follows is only counted. After a difference
/// between answers the comparison goes on.
pub fn compare(
    a: impl IntoIterator<Item = TimedFrame>,
    b: impl IntoIterator<Item = TimedFrame>,
    size: SlotSize,
    options: &Options,
) -> Comparison {
    let steps = Steps::new(a.into_iter(), size, options.ignore_repeats);
    compare_steps(steps, Steps::new(b.into_iter(), size, options.ignore_repeats), options)
}

/// Compares two runs that are given as steps; otherwise like [`compare`].
pub fn compare_steps<A, B>(mut a: Steps<A>, mut b: Steps<B>, options: &Options) -> Comparison
where
    A: Iterator<Item = TimedFrame>,
    B: Iterator<Item = TimedFrame>,
{
    let mut found = Found::default();
    loop {
        match (a.next(), b.next()) {
            (None, None) => break,
            _ if found.apart => {}
            (Some(a), Some(b)) => found.pair(a, b, options),
            (a, b) => found.ended(a.as_ref(), b.as_ref()),
        }
    }
    found.finish([a.counts, b.counts])
}

/// The result so far.
#[derive(Default)]
struct Found {
    /// The commands differ, or one run has ended.
    apart: bool,
    transfer: Transfer,
    recent: VecDeque<(Step, Step)>,
    result: Comparison,
}

impl Found {
    fn pair(&mut self, a: Step, b: Step, options: &Options) {
        if let Some(slot) = (0..a.size.slots()).find(|i| a.slot(*i) != b.slot(*i)) {
            let line = |step: &Step| CommandDump::new(&step.command, step.size).line(slot);
            if let (Some(line_a), Some(line_b)) = (line(&a), line(&b)) {
                self.set_first(Some(&a), Some(&b), vec![Deviation::Command { lines: Box::new([line_a, line_b]) }]);
            }
            self.apart = true;
            return;
        }
        self.result.answers += u64::from(a.answer.is_some() && b.answer.is_some());
        let mut what = answers::differences(&a, &b, options);
        what.extend(self.transfer.steps(&a, &b));
        if !what.is_empty() {
            self.result.differing_answers += 1;
            self.set_first(Some(&a), Some(&b), what);
        }
        if self.result.first.is_none() {
            if self.recent.len() == CONTEXT_MAX {
                self.recent.pop_front();
            }
            self.recent.push_back((a, b));
        }
    }

    fn ended(&mut self, a: Option<&Step>, b: Option<&Step>) {
        let side = if a.is_none() { Side::A } else { Side::B };
        self.result.ends_early = Some(side);
        self.set_first(a, b, vec![Deviation::Ends { side }]);
        self.apart = true;
    }

    /// Keeps the difference with its context if it is the first.
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

    fn finish(mut self, counts: [Counts; 2]) -> Comparison {
        if !self.apart
            && let Some(what) = self.transfer.end()
        {
            let last = self.recent.back().cloned();
            let (a, b) = last.unzip();
            self.result.differing_answers += 1;
            self.set_first(a.as_ref(), b.as_ref(), vec![what]);
        }
        Comparison { counts, ..self.result }
    }
}

impl Display for Comparison {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (side, counts) in [Side::A, Side::B].into_iter().zip(&self.counts) {
            writeln!(f, "{side}: {counts}")?;
        }
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
        if more > 0 {
            write!(f, "\nanswers to {more} later commands differ too")?;
        }
        if let Some(side) = self.ends_early {
            let [a, b] = self.counts.map(|counts| counts.commands);
            write!(f, "\n{side} ends early: {} of {} commands", a.min(b), a.max(b))?;
        }
        Ok(())
    }
}

impl Display for Counts {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { commands, polls, repeats, reports, last_ns } = *self;
        write!(f, "{commands} commands, {polls} polls, ")?;
        if repeats > 0 {
            write!(f, "{repeats} repeats, ")?;
        }
        write!(f, "{reports} reports, {}", seconds(last_ns))
    }
}
