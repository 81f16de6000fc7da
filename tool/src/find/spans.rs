//! From when to when a condition holds.

use std::collections::VecDeque;

use super::condition::{Condition, Values};
use crate::motion::Execution;

/// \[OURS] A report waits no longer than this to be known as part of a gap, ns: a longer pause is intended by the program.
const GAP_MAX_NS: i64 = 1_000_000_000;

/// A time span in which the condition holds, in nanoseconds of the recording's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The first report in which it holds.
    pub from_ns: i64,
    /// The first report after that in which it does not, or the last report of all.
    pub to_ns: i64,
    /// Whether a report shows that it holds no more.
    pub ended: bool,
}

impl Span {
    /// How long the condition held, nanoseconds.
    pub const fn lasts_ns(&self) -> i64 {
        self.to_ns.saturating_sub(self.from_ns)
    }
}

/// Finds the time spans in which a condition holds, from report to report.
pub struct Spans<'c> {
    condition: &'c Condition,
    has_gap: bool,
    has_target: bool,
    /// Reports of which a later one shows whether they are part of a gap: the time, and whether the condition holds without a
    /// gap and with one. Empty if the condition has no gap.
    waiting: VecDeque<(i64, [bool; 2])>,
    since_ns: Option<i64>,
    last_ns: i64,
    found: Vec<Span>,
}

impl<'c> Spans<'c> {
    /// Starts without reports.
    pub fn new(condition: &'c Condition) -> Self {
        Self {
            condition,
            has_gap: condition.has(&|condition| *condition == Condition::Gap),
            has_target: condition.has_target(),
            waiting: VecDeque::new(),
            since_ns: None,
            last_ns: 0,
            found: Vec::new(),
        }
    }

    /// Adds the next report.
    pub fn report(&mut self, at_ns: i64, values: &impl Values, execution: Execution) {
        if execution.is_later && self.has_target {
            // It is not known which target was in force. What held at the report before goes on.
            return;
        }
        let holds = |gap| self.condition.holds(values, gap) == Some(true);
        if !self.has_gap {
            let holds = holds(false);
            return self.decide(at_ns, holds);
        }
        let holds = [false, true].map(holds);
        self.waiting.push_back((at_ns, holds));
        while let Some((then_ns, [without, within])) = self.waiting.front().copied() {
            let is_old = at_ns.saturating_sub(then_ns) > GAP_MAX_NS;
            if !(execution.goes_on || is_old) {
                break;
            }
            self.waiting.pop_front();
            let is_gap = execution.gap_since_ns.is_some_and(|since_ns| since_ns <= then_ns && then_ns < at_ns);
            self.decide(then_ns, if is_gap { within } else { without });
        }
    }

    /// Returns the time spans, after the last report.
    pub fn finish(mut self) -> Vec<Span> {
        for (at_ns, [without, _]) in std::mem::take(&mut self.waiting) {
            self.decide(at_ns, without);
        }
        if let Some(from_ns) = self.since_ns {
            self.found.push(Span { from_ns, to_ns: self.last_ns, ended: false });
        }
        self.found
    }

    fn decide(&mut self, at_ns: i64, holds: bool) {
        self.last_ns = at_ns;
        match (self.since_ns, holds) {
            (None, true) => self.since_ns = Some(at_ns),
            (Some(from_ns), false) => {
                self.found.push(Span { from_ns, to_ns: at_ns, ended: true });
                self.since_ns = None;
            }
            (None, false) | (Some(_), true) => {}
        }
    }
}
