//! Limits repeated lines in the log: the first lines of a kind are logged and further ones are counted, so that ten
//! thousand connection attempts per minute do not become ten thousand lines.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use crate::link::LinkError;
use crate::span::Span;

/// How many lines of the same kind are logged one by one in a period. \[OURS]
const LINES_MAX: u32 = 20;
/// How long further lines are counted before their number is logged. A kind without lines for this long starts anew.
/// \[OURS]
const COUNTING_PERIOD: Duration = Duration::from_secs(10);
/// The largest number of kinds, because clients can cause new ones as often as they like. \[OURS]
const KINDS_MAX: usize = 64;
/// The kind under which the lines of all further kinds are counted, beyond [`KINDS_MAX`].
const OTHERS: &str = "other connections";

/// Counts log lines by their kind, and suppresses them if there are too many.
#[derive(Default)]
pub(super) struct LogLimit {
    kinds: HashMap<String, Counted>,
}

struct Counted {
    since: Instant,
    logged: u32,
    /// How many lines of this kind were suppressed in the present period.
    suppressed: u64,
}

impl LogLimit {
    /// Whether a line of this kind may be logged now; otherwise the line is only counted.
    pub(super) fn may_log(&mut self, kind: &str, now: Instant) -> bool {
        let kind = if self.kinds.contains_key(kind) || self.kinds.len() < KINDS_MAX { kind } else { OTHERS };
        let counted = self.kinds.entry(kind.to_owned()).or_insert(Counted { since: now, logged: 0, suppressed: 0 });
        if counted.logged < LINES_MAX {
            counted.logged += 1;
            return true;
        }
        counted.suppressed += 1;
        false
    }

    /// The end of the counting period that ends first, when [`Self::due`] has to be called; `None`: no period is
    /// running.
    pub(super) fn next_due(&self) -> Option<Instant> {
        self.kinds.values().map(|counted| counted.since + COUNTING_PERIOD).min()
    }

    /// Log lines with the numbers of suppressed lines, for the counting periods that have ended.
    pub(super) fn due(&mut self, now: Instant) -> Vec<String> {
        let mut lines = Vec::new();
        self.kinds.retain(|kind, counted| {
            if counted.since + COUNTING_PERIOD > now {
                return true;
            }
            let more = std::mem::take(&mut counted.suppressed);
            if more == 0 {
                return false;
            }
            lines.push(format!("{kind} ({more} more times within {})", Span(now - counted.since)));
            counted.since = now;
            true
        });
        lines
    }

    /// Log lines with all numbers of suppressed lines that have not been logged yet. Called at the end of the server.
    pub(super) fn end(&mut self) -> Vec<String> {
        let counted = self.kinds.drain().filter(|(_, counted)| counted.suppressed > 0);
        counted.map(|(kind, counted)| format!("{kind} ({} more times)", counted.suppressed)).collect()
    }
}

/// Limits the log lines about a host's frames that the link of the board refuses.
#[derive(Default)]
pub(super) struct RefusedFrames(LogLimit);

impl RefusedFrames {
    /// The log lines for a frame that the link has refused with this error.
    pub(super) fn lines(&mut self, error: &LinkError) -> Vec<String> {
        const KIND: &str = "a frame of the host was refused";
        let now = Instant::now();
        let mut lines = self.0.due(now);
        if self.0.may_log(KIND, now) {
            lines.push(format!("{KIND}: {error}"));
        }
        lines
    }

    /// The log lines at the end of the host's session or of the server.
    pub(super) fn end(&mut self) -> Vec<String> {
        self.0.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// TCP-13 Repeated lines are logged some times and then counted, each kind separately; a minute of them gives a
    /// handful of lines.
    #[test]
    fn what_repeats_is_counted() {
        let (begin, mut limit) = (Instant::now(), LogLimit::default());
        let mut lines = Vec::new();
        let (mut told, mut counted) = (0, 0);
        for ms in 0..60_000_u32 {
            let now = begin + Duration::from_millis(ms.into());
            told += u32::from(limit.may_log("10.0.0.1: no hello", now));
            lines.extend(limit.due(now));
        }
        lines.extend(limit.end());
        for line in &lines {
            let more = line.strip_prefix("10.0.0.1: no hello (").and_then(|line| line.split(' ').next());
            counted += more.expect(line).parse::<u32>().unwrap();
        }
        assert_eq!(told + counted, 60_000, "none is missing");
        assert!(told + lines.len() as u32 <= LINES_MAX + 7, "{told} {lines:?}");
    }

    /// TCP-13 Kinds that are always new are counted together, and a kind that was absent for a while is logged again.
    #[test]
    fn kinds_are_bounded_and_forgotten() {
        let (begin, mut limit) = (Instant::now(), LogLimit::default());
        let told = (0..10_000).filter(|n| limit.may_log(&format!("kind {n}"), begin)).count();
        assert_eq!(told, KINDS_MAX + LINES_MAX as usize);
        assert!(limit.next_due() == Some(begin + COUNTING_PERIOD) && limit.due(begin).is_empty());
        let lines = limit.due(begin + COUNTING_PERIOD);
        assert_eq!(lines, [format!("{OTHERS} ({} more times within 10s)", 10_000 - told)]);
        assert!(limit.due(begin + 2 * COUNTING_PERIOD).is_empty());
        assert!(limit.next_due().is_none() && limit.may_log("kind 1", begin + 3 * COUNTING_PERIOD));
    }
}
