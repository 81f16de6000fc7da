//! Finds the time spans in which a condition is true.

use std::collections::VecDeque;

use super::condition::{Condition, Values};
use crate::motion::Execution;

/// \[OURS] For at most this long, ns, a report waits for later ones that show whether it is part of a gap. A longer
/// pause is intended by the program and is no gap.
const GAP_MAX_NS: i64 = 1_000_000_000;

/// A time span in which the condition is true, in nanoseconds of the recording's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The time of the first report at which the condition is true.
    pub from_ns: i64,
    /// The time of the first later report at which the condition is false, or of the last report of the recording.
    pub to_ns: i64,
    /// Whether a report shows that the condition is false again.
    pub ended: bool,
}

impl Span {
    /// How long the condition was true, in nanoseconds.
    pub const fn lasts_ns(&self) -> i64 {
        self.to_ns.saturating_sub(self.from_ns)
    }
}

/// Finds the time spans in which a condition is true, while reports are processed.
pub struct Spans {
    condition: Condition,
    has_gap: bool,
    has_target: bool,
    /// Reports that may be part of a gap, which only a later report shows: their times, and whether the condition is
    /// true without a gap and with one. Empty if the condition does not contain `gap`.
    waiting: VecDeque<(i64, [bool; 2])>,
    since_ns: Option<i64>,
    /// The beginning of the latest time span, until [`Self::begun`] returns it.
    begun_ns: Option<i64>,
    last_ns: i64,
    found: Vec<Span>,
}

impl Spans {
    /// Starts without reports.
    pub fn new(condition: Condition) -> Self {
        Self {
            has_gap: condition.has(&|condition| *condition == Condition::Gap),
            has_target: condition.has_target(),
            condition,
            waiting: VecDeque::new(),
            since_ns: None,
            begun_ns: None,
            last_ns: 0,
            found: Vec::new(),
        }
    }

    /// Processes the next report.
    pub fn report(&mut self, at_ns: i64, values: &impl Values, execution: Execution) {
        if execution.is_later && self.has_target {
            // It is not yet known which target was in force, so the result of the previous report is kept.
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

    /// The beginning of the latest time span, if it began since the last call. Forgets the time spans that are over.
    pub fn begun(&mut self) -> Option<i64> {
        self.found.clear();
        self.begun_ns.take()
    }

    /// Must be called after the last report. Returns the time spans.
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
            (None, true) => (self.since_ns, self.begun_ns) = (Some(at_ns), Some(at_ns)),
            (Some(from_ns), false) => {
                self.found.push(Span { from_ns, to_ns: at_ns, ended: true });
                self.since_ns = None;
            }
            (None, false) | (Some(_), true) => {}
        }
    }
}
