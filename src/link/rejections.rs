//! What the log says of rejected commands: a program that sends a wrong one every cycle does not drown all else.

use crate::engine::{Event, Reason};
use crate::fieldbus::Ns;

/// Rejections of one kind that are told one by one within [`WINDOW_NS`] of board time \[OURS]; the others are summed up.
const TOLD_EACH: u32 = 5;
/// One second of the board's time \[OURS].
const WINDOW_NS: Ns = 1_000_000_000;

#[derive(Clone, Copy, Default)]
struct Kind {
    /// When the window began.
    since: Ns,
    /// Lines in this window.
    lines: u32,
    /// Of the board's counter, what was told, each or summed up.
    told: u64,
}

/// What was told so far.
pub(super) struct RejectionLog {
    kinds: [Kind; Reason::KINDS],
}

impl RejectionLog {
    /// From a board on that has rejected so many before.
    pub(super) fn new(rejected: &[u64; Reason::KINDS]) -> Self {
        Self { kinds: rejected.map(|told| Kind { told, ..Kind::default() }) }
    }

    /// Tells events; `rejected` are the board's counters, `now` its time.
    pub(super) fn tell(
        &mut self,
        events: impl IntoIterator<Item = Event>,
        rejected: &[u64; Reason::KINDS],
        now: Ns,
        say: &mut dyn FnMut(String),
    ) {
        for event in events {
            let Event::Rejected(rejection) = event else {
                say(event.to_string());
                continue;
            };
            let kind = &mut self.kinds[rejection.reason.kind()];
            if rejection.at.saturating_sub(kind.since) >= WINDOW_NS || kind.lines == 0 {
                (kind.since, kind.lines) = (rejection.at, 0);
            }
            if kind.lines < TOLD_EACH {
                kind.lines += 1;
                kind.told += 1;
                say(rejection.to_string());
            }
        }
        self.sum_up(rejected, |kind| now.saturating_sub(kind.since) >= WINDOW_NS, say);
    }

    /// Tells how many were left out, at the end.
    pub(super) fn end(&mut self, rejected: &[u64; Reason::KINDS], say: &mut dyn FnMut(String)) {
        self.sum_up(rejected, |_| true, say);
    }

    fn sum_up(
        &mut self,
        rejected: &[u64; Reason::KINDS],
        is_over: impl Fn(&Kind) -> bool,
        say: &mut dyn FnMut(String),
    ) {
        for ((kind, rejected), name) in self.kinds.iter_mut().zip(rejected).zip(Reason::NAMES) {
            let more = rejected.saturating_sub(kind.told);
            if more > 0 && is_over(kind) {
                kind.told += more;
                say(format!("{more} more rejected as {name} since {} us; look at the first ones", kind.since / 1000));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Rejection;
    use crate::sk::CommandId;

    const MS: Ns = 1_000_000;

    fn rejected(at: Ns, reason: Reason) -> Event {
        Event::Rejected(Rejection { at, slot: 1, id: CommandId::Csp, reason })
    }

    fn counted(kinds: &[(Reason, u64)]) -> [u64; Reason::KINDS] {
        let mut counters = [0; Reason::KINDS];
        kinds.iter().for_each(|(reason, count)| counters[reason.kind()] = *count);
        counters
    }

    /// SK-4.39 Of many rejections of a kind the first five of a second are told, then how many more there were.
    #[test]
    fn many_of_a_kind_are_summed_up() {
        let mut log = RejectionLog::new(&counted(&[(Reason::WrongMode, 7)]));
        let mut said = Vec::new();
        // One a millisecond, and one of another kind in the middle.
        for n in 0..500 {
            let mut events = vec![rejected(n * MS, Reason::WrongMode)];
            let mut counters = counted(&[(Reason::WrongMode, 8 + n), (Reason::NoSlave, u64::from(n >= 250))]);
            if n == 250 {
                events.push(rejected(n * MS, Reason::NoSlave));
            }
            counters[Reason::SdoBusy.kind()] = 0;
            log.tell(events, &counters, n * MS, &mut |line| said.push(line));
        }
        assert_eq!(said.len(), 6, "{said:?}");
        assert!(said[5].contains("no slave at that place"), "{said:?}");
        let counters = counted(&[(Reason::WrongMode, 507), (Reason::NoSlave, 1)]);
        log.tell([], &counters, 999 * MS, &mut |line| said.push(line));
        assert_eq!(said.len(), 6, "{said:?}");
        log.tell([], &counters, 1000 * MS, &mut |line| said.push(line));
        assert_eq!(said[6..], ["495 more rejected as wrong_mode since 0 us; look at the first ones"]);
        log.end(&counters, &mut |line| said.push(line));
        assert_eq!(said.len(), 7, "{said:?}");
    }

    /// SK-4.39 A second later the first ones are told again; what nobody was told by then is told at the end.
    #[test]
    fn every_second_begins_anew() {
        let mut log = RejectionLog::new(&counted(&[]));
        let mut said = Vec::new();
        for n in 0..20 {
            let counters = counted(&[(Reason::NoSlave, n + 1)]);
            log.tell([rejected(n * 100 * MS, Reason::NoSlave)], &counters, n * 100 * MS, &mut |line| said.push(line));
        }
        assert_eq!(said.iter().filter(|line| line.contains("CSP in slot 1")).count(), 10, "{said:?}");
        log.end(&counted(&[(Reason::NoSlave, 20)]), &mut |line| said.push(line));
        let more: u64 = said
            .iter()
            .filter(|line| line.contains("more rejected as no_slave"))
            .map(|line| line.split(' ').next().and_then(|n| n.parse::<u64>().ok()).expect("a number"))
            .sum();
        assert_eq!(more, 10, "{said:?}");
    }
}
