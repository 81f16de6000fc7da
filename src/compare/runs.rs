//! Two runs side by side.

use std::collections::VecDeque;
use std::fmt::{self, Display, Formatter};

use super::answers::{self, Transfer};
use super::difference::{Difference, What, seconds, words};
use super::steps::{Step, Steps};
use super::{Observed, Options, Side};
use crate::sk::SlotSize;
use crate::sk::dump::CommandDump;

/// Equal commands before the first difference that are kept. \[OURS]
const CONTEXT: usize = 3;

/// How much of a run there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Command frames that ask for something.
    pub commands: u64,
    /// Frames of nothing but GET_STATUS.
    pub polls: u64,
    /// Repeats that were not counted ([`Options::ignore_repeats`]).
    pub repeats: u64,
    /// Reports.
    pub reports: u64,
    /// When the last frame passed, nanoseconds.
    pub last_ns: i64,
}

/// A command before the first difference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Context {
    /// Its number, from 1.
    pub command: u64,
    /// When it was sent in A and B, nanoseconds.
    pub at_ns: [i64; 2],
    /// What it asks for: the first slot that does.
    pub text: String,
}

/// What comparing two runs has found. Its `Display` tells all in a few lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Comparison {
    /// Of A and B.
    pub counts: [Counts; 2],
    /// Commands, equal in both, with an answer in both: so many answers were compared.
    pub answers: u64,
    /// Commands that are equal but for their answers.
    pub differing_answers: u64,
    /// The first difference.
    pub first: Option<Difference>,
    /// The run that has fewer commands, and all it has are in the other one too.
    pub ends_early: Option<Side>,
    /// The commands before the first difference, the last three.
    pub context: Vec<Context>,
}

impl Comparison {
    /// Whether there is no difference.
    pub const fn is_equal(&self) -> bool {
        self.first.is_none()
    }
}

/// Compares two runs, each its frames in the order of their times.
///
/// After a command that differs nothing can be aligned any more: the rest is counted. After a difference in answers it goes
/// on.
pub fn compare(
    a: impl IntoIterator<Item = Observed>,
    b: impl IntoIterator<Item = Observed>,
    size: SlotSize,
    options: &Options,
) -> Comparison {
    let steps = Steps::new(a.into_iter(), size, options.ignore_repeats);
    compare_steps(steps, Steps::new(b.into_iter(), size, options.ignore_repeats), options)
}

/// As [`compare`], of steps.
pub fn compare_steps<A, B>(mut a: Steps<A>, mut b: Steps<B>, options: &Options) -> Comparison
where
    A: Iterator<Item = Observed>,
    B: Iterator<Item = Observed>,
{
    let mut found = Found::default();
    let mut commands = [0, 0];
    loop {
        let pair = (a.next(), b.next());
        commands[0] += u64::from(pair.0.is_some());
        commands[1] += u64::from(pair.1.is_some());
        match pair {
            (None, None) => break,
            (Some(a), Some(b)) if found.aligned => found.pair(a, b, options),
            (a, b) if found.aligned => found.ended(a.as_ref(), b.as_ref()),
            _ => {}
        }
    }
    found.finish([counts(&a, commands[0]), counts(&b, commands[1])])
}

fn counts<I>(steps: &Steps<I>, commands: u64) -> Counts {
    let Steps { polls, repeats, reports, last_ns, .. } = *steps;
    Counts { commands, polls, repeats, reports, last_ns }
}

/// What was found so far.
struct Found {
    /// Commands were equal up to here.
    aligned: bool,
    transfer: Transfer,
    recent: VecDeque<(Step, Step)>,
    answers: u64,
    differing_answers: u64,
    first: Option<Difference>,
    ends_early: Option<Side>,
    context: Vec<Context>,
}

impl Default for Found {
    fn default() -> Self {
        Self {
            aligned: true,
            transfer: Transfer::default(),
            recent: VecDeque::new(),
            answers: 0,
            differing_answers: 0,
            first: None,
            ends_early: None,
            context: Vec::new(),
        }
    }
}

impl Found {
    fn pair(&mut self, a: Step, b: Step, options: &Options) {
        if let Some(slot) = (0..a.size.slots()).find(|i| a.slot(*i) != b.slot(*i)) {
            let line = |step: &Step| CommandDump::new(&step.command, step.size).line(slot);
            if let (Some(line_a), Some(line_b)) = (line(&a), line(&b)) {
                self.tell(Some(&a), Some(&b), vec![What::Command { lines: Box::new([line_a, line_b]) }]);
            }
            self.aligned = false;
            return;
        }
        self.answers += u64::from(a.answer.is_some() && b.answer.is_some());
        let mut what = answers::differences(&a, &b, options);
        what.extend(self.transfer.steps(&a, &b));
        if !what.is_empty() {
            self.differing_answers += 1;
            self.tell(Some(&a), Some(&b), what);
        }
        if self.first.is_none() {
            if self.recent.len() == CONTEXT {
                self.recent.pop_front();
            }
            self.recent.push_back((a, b));
        }
    }

    fn ended(&mut self, a: Option<&Step>, b: Option<&Step>) {
        let side = if a.is_none() { Side::A } else { Side::B };
        self.ends_early = Some(side);
        self.tell(a, b, vec![What::Ends { side }]);
        self.aligned = false;
    }

    fn tell(&mut self, a: Option<&Step>, b: Option<&Step>, what: Vec<What>) {
        if self.first.is_some() {
            return;
        }
        self.first = Some(Difference::new(a, b, what));
        let context = self.recent.drain(..).map(|(a, b)| Context {
            command: a.number,
            at_ns: [a.at_ns, b.at_ns],
            text: words(&a, a.asking_slot()),
        });
        self.context = context.collect();
    }

    fn finish(mut self, counts: [Counts; 2]) -> Comparison {
        if self.aligned
            && let Some(what) = self.transfer.end()
        {
            let last = self.recent.back().cloned();
            let (a, b) = last.unzip();
            self.differing_answers += 1;
            self.tell(a.as_ref(), b.as_ref(), vec![what]);
        }
        let Self { answers, differing_answers, first, ends_early, context, .. } = self;
        Comparison { counts, answers, differing_answers, first, ends_early, context }
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
        let more = self
            .differing_answers
            .saturating_sub(u64::from(!matches!(first.what.first(), Some(What::Command { .. } | What::Ends { .. }))));
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
