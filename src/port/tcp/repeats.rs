//! Lines about connections that repeat: the first ones are told, the others counted. Whoever knocks ten thousand times a minute
//! is one fact, and not ten thousand lines.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use crate::span::Span;

/// Lines of one kind that are told each by itself. \[OURS]
const TOLD_FIRST: u32 = 20;
/// How long further ones are counted before their number is told; a kind that does not come for as long begins anew. \[OURS]
const PERIOD: Duration = Duration::from_secs(10);
/// Kinds that are counted apart, at most: what others choose may be different every time. \[OURS]
const KINDS_MAX: usize = 64;
/// The kind of all kinds beyond these.
const OTHERS: &str = "other connections";

/// Lines, by their kinds.
#[derive(Default)]
pub(super) struct Repeats {
    kinds: HashMap<String, Counted>,
}

struct Counted {
    since: Instant,
    told: u32,
    /// Those of this period that were not told.
    more: u64,
}

impl Repeats {
    /// Whether a line of that kind is told now; else it is counted.
    pub(super) fn is_told(&mut self, kind: &str, now: Instant) -> bool {
        let kind = if self.kinds.contains_key(kind) || self.kinds.len() < KINDS_MAX { kind } else { OTHERS };
        let counted = self.kinds.entry(kind.to_owned()).or_insert(Counted { since: now, told: 0, more: 0 });
        if counted.told < TOLD_FIRST {
            counted.told += 1;
            return true;
        }
        counted.more += 1;
        false
    }

    /// When there is something to tell again.
    pub(super) fn next_due(&self) -> Option<Instant> {
        self.kinds.values().map(|counted| counted.since + PERIOD).min()
    }

    /// What was counted in periods that are over by `now`.
    pub(super) fn due(&mut self, now: Instant) -> Vec<String> {
        let mut lines = Vec::new();
        self.kinds.retain(|kind, counted| {
            if counted.since + PERIOD > now {
                return true;
            }
            let more = std::mem::take(&mut counted.more);
            if more == 0 {
                return false;
            }
            lines.push(format!("{kind} ({more} more times within {})", Span(now - counted.since)));
            counted.since = now;
            true
        });
        lines
    }

    /// What was counted and not told yet: nothing more comes.
    pub(super) fn end(&mut self) -> Vec<String> {
        let counted = self.kinds.drain().filter(|(_, counted)| counted.more > 0);
        counted.map(|(kind, counted)| format!("{kind} ({} more times)", counted.more)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// TCP-13 What repeats is told some times and then counted, each kind by itself; a minute of it is a handful of lines.
    #[test]
    fn what_repeats_is_counted() {
        let (begin, mut repeats) = (Instant::now(), Repeats::default());
        let mut lines = Vec::new();
        let (mut told, mut counted) = (0, 0);
        for ms in 0..60_000_u32 {
            let now = begin + Duration::from_millis(ms.into());
            told += u32::from(repeats.is_told("10.0.0.1: no hello", now));
            lines.extend(repeats.due(now));
        }
        lines.extend(repeats.end());
        for line in &lines {
            let more = line.strip_prefix("10.0.0.1: no hello (").and_then(|line| line.split(' ').next());
            counted += more.expect(line).parse::<u32>().unwrap();
        }
        assert_eq!(told + counted, 60_000, "none is missing");
        assert!(told + lines.len() as u32 <= TOLD_FIRST + 7, "{told} {lines:?}");
    }

    /// TCP-13 Kinds that are different every time are counted together, and what has not come for a while is told again.
    #[test]
    fn kinds_are_bounded_and_forgotten() {
        let (begin, mut repeats) = (Instant::now(), Repeats::default());
        let told = (0..10_000).filter(|n| repeats.is_told(&format!("kind {n}"), begin)).count();
        assert_eq!(told, KINDS_MAX + TOLD_FIRST as usize);
        assert!(repeats.next_due() == Some(begin + PERIOD) && repeats.due(begin).is_empty());
        let lines = repeats.due(begin + PERIOD);
        assert_eq!(lines, [format!("{OTHERS} ({} more times within 10s)", 10_000 - told)]);
        assert!(repeats.due(begin + 2 * PERIOD).is_empty());
        assert!(repeats.next_due().is_none() && repeats.is_told("kind 1", begin + 3 * PERIOD));
    }
}
