//! Log lines about commands that the board rejected. The first rejections of each kind are logged one by one, later
//! ones are summed up. So a program that sends a wrong command in every cycle does not fill the log, and no rejection
//! is left out.

use log::Level;

use super::episodes::Episodes;
use crate::engine::{Counters, Event, EventKind, HomingEnd, Reason, Unexecuted};
use crate::fieldbus::Ns;
use crate::span::Seconds;

/// The most rejections of one kind that get a line each within [`WINDOW_NS`] \[OURS]. The others are summed up in one
/// line. SDO transfers that a slave has aborted count as one kind.
const LINES_PER_WINDOW_MAX: u32 = 5;
/// The window for [`LINES_PER_WINDOW_MAX`]: one second of the board's time \[OURS].
const WINDOW_NS: Ns = 1_000_000_000;

/// Limits the lines in the log for one kind of rejection.
#[derive(Clone, Copy, Default)]
struct Throttle {
    /// The beginning of the current window, in the board's time.
    since: Ns,
    /// The number of lines logged in this window.
    lines: u32,
    /// The number of rejections that are already in the log, either with their own line or in a sum.
    logged: u64,
}

impl Throttle {
    /// Whether one more rejection, at the time `at`, gets its own line.
    fn is_logged(&mut self, at: Ns) -> bool {
        if at.saturating_sub(self.since) >= WINDOW_NS || self.lines == 0 {
            (self.since, self.lines) = (at, 0);
        }
        let takes = self.lines < LINES_PER_WINDOW_MAX;
        self.lines += u32::from(takes);
        takes
    }
}

/// Which rejections were logged so far, by kind.
pub(crate) struct RejectionLog {
    kinds: [Throttle; Reason::KINDS],
    aborts: Throttle,
    episodes: Episodes,
}

impl RejectionLog {
    /// Begins at the present values of the board's counters: events that were counted before belong to earlier
    /// programs.
    pub(crate) fn new(counters: &Counters) -> Self {
        let kinds = counters.rejected.map(|logged| Throttle { logged, ..Throttle::default() });
        Self { kinds, aborts: Throttle::default(), episodes: Episodes::new(counters) }
    }

    /// Logs events. Rejections that got no line of their own are summed up once their window is over. `now` is the
    /// board's time.
    pub(crate) fn log(
        &mut self,
        events: impl IntoIterator<Item = Event>,
        counters: &Counters,
        now: Ns,
        log: &mut dyn FnMut(Level, String),
    ) {
        let mut logged = [false; Unexecuted::KINDS];
        for event in events {
            let is_told = match event.kind {
                EventKind::Rejected(rejection) => {
                    let kind = &mut self.kinds[rejection.reason.kind()];
                    let is_logged = kind.is_logged(event.at);
                    kind.logged += u64::from(is_logged);
                    is_logged
                }
                // The line of this event also contains the number of bytes, so it replaces the line for the beginning
                // of an episode.
                EventKind::Incomplete { .. } => self.is_first_of_episode(Unexecuted::Incomplete, &mut logged),
                // Only the first loss of an episode gets a line, because the bus may lose outputs in each cycle.
                EventKind::OutputsLost { .. } => self.is_first_of_episode(Unexecuted::OutputsLost, &mut logged),
                EventKind::SdoAborted { .. } => {
                    logged[Unexecuted::SdoAborted as usize] = true;
                    self.aborts.is_logged(event.at)
                }
                _ => true,
            };
            if is_told {
                log(level_of(&event), event.to_string());
            }
        }
        self.sum_up(&counters.rejected, |kind| now.saturating_sub(kind.since) >= WINDOW_NS, log);
        self.episodes.log(counters, now, |what| logged[what as usize], log);
    }

    /// Whether an event is the first of an episode. If so, it is noted as logged, so that the episode gets no second line.
    fn is_first_of_episode(&self, what: Unexecuted, logged: &mut [bool; Unexecuted::KINDS]) -> bool {
        !self.episodes.is_running(what) && !std::mem::replace(&mut logged[what as usize], true)
    }

    /// Logs the rejections that have not been logged yet, when the link is closed.
    pub(crate) fn end(&mut self, counters: &Counters, now: Ns, log: &mut dyn FnMut(Level, String)) {
        self.sum_up(&counters.rejected, |_| true, log);
        self.episodes.end(counters, now, log);
    }

    fn sum_up(
        &mut self,
        rejected: &[u64; Reason::KINDS],
        is_over: impl Fn(&Throttle) -> bool,
        log: &mut dyn FnMut(Level, String),
    ) {
        for ((kind, rejected), name) in self.kinds.iter_mut().zip(rejected).zip(Reason::NAMES) {
            let more = rejected.saturating_sub(kind.logged);
            if more > 0 && is_over(kind) {
                kind.logged += more;
                let since = Seconds(kind.since);
                log(Level::Warn, format!("{more} more rejected as {name} since {since}; look at the first ones"));
            }
        }
    }
}

/// The log level of an event. A successful homing is logged as information, because `ecmsk exec` lists warnings as
/// problems.
const fn level_of(event: &Event) -> Level {
    if matches!(event.kind, EventKind::HomingEnded { end: HomingEnd::Attained, .. }) {
        Level::Info
    } else {
        Level::Warn
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Rejection;
    use crate::sk::CommandId;

    const MS: Ns = 1_000_000;

    fn rejected(at: Ns, reason: Reason) -> Event {
        Event { at, kind: EventKind::Rejected(Rejection { slot: 1, id: CommandId::Csp, reason }) }
    }

    fn counted(kinds: &[(Reason, u64)]) -> Counters {
        let mut counters = Counters::default();
        kinds.iter().for_each(|(reason, count)| counters.rejected[reason.kind()] = *count);
        counters
    }

    /// SK-4.39 Of many rejections of one kind, the first five of a second are logged, followed by the number of the
    /// others.
    #[test]
    fn after_five_rejections_of_a_kind_in_a_second_further_ones_are_summed_up() {
        let mut log = RejectionLog::new(&counted(&[(Reason::WrongMode, 7)]));
        let mut said = Vec::new();
        // One rejection in each millisecond, and one of another kind after 250 ms.
        for n in 0..500 {
            let mut events = vec![rejected(n * MS, Reason::WrongMode)];
            let mut counters = counted(&[(Reason::WrongMode, 8 + n), (Reason::NoSlave, u64::from(n >= 250))]);
            if n == 250 {
                events.push(rejected(n * MS, Reason::NoSlave));
            }
            counters.rejected[Reason::SdoBusy.kind()] = 0;
            log.log(events, &counters, n * MS, &mut |_, line| said.push(line));
        }
        assert_eq!(said.len(), 6, "{said:?}");
        assert!(said[5].contains("no slave at that place"), "{said:?}");
        let counters = counted(&[(Reason::WrongMode, 507), (Reason::NoSlave, 1)]);
        log.log([], &counters, 999 * MS, &mut |_, line| said.push(line));
        assert_eq!(said.len(), 6, "{said:?}");
        log.log([], &counters, 1000 * MS, &mut |_, line| said.push(line));
        assert_eq!(said[6..], ["495 more rejected as wrong_mode since 0.000 s; look at the first ones"]);
        log.end(&counters, 2000 * MS, &mut |_, line| said.push(line));
        assert_eq!(said.len(), 7, "{said:?}");
    }

    /// SK-4.39 In each second the first rejections are logged one by one. Rejections that were not logged by the end
    /// are logged then.
    #[test]
    fn five_rejections_of_a_kind_are_logged_in_each_second() {
        let mut log = RejectionLog::new(&counted(&[]));
        let mut said = Vec::new();
        for n in 0..20 {
            let counters = counted(&[(Reason::NoSlave, n + 1)]);
            log.log([rejected(n * 100 * MS, Reason::NoSlave)], &counters, n * 100 * MS, &mut |_, line| said.push(line));
        }
        assert_eq!(said.iter().filter(|line| line.contains("CSP in slot 1")).count(), 10, "{said:?}");
        log.end(&counted(&[(Reason::NoSlave, 20)]), 2000 * MS, &mut |_, line| said.push(line));
        let more: u64 = said
            .iter()
            .filter(|line| line.contains("more rejected as no_slave"))
            .map(|line| line.split(' ').next().and_then(|n| n.parse::<u64>().ok()).expect("a number"))
            .sum();
        assert_eq!(more, 10, "{said:?}");
    }
    /// SK-4.79 An SDO that a slave has aborted is logged with its object and the next step, the first five of a second;
    /// the total count is logged at the end. SK-4.78 Of incomplete frames only the first is logged, with its number of
    /// bytes.
    #[test]
    fn aborted_sdos_and_incomplete_frames_are_logged_with_their_details() {
        let object = crate::ethercat::coe::ObjectAddress::new(0x2101, 0);
        let mut log = RejectionLog::new(&Counters::default());
        let mut said = Vec::new();
        for n in 0..50 {
            let code = crate::ethercat::coe::AbortCode::NO_OBJECT;
            let aborted = Event { at: n * MS, kind: EventKind::SdoAborted { slave: 2, object, write: true, code } };
            let dropped = Event { at: n * MS, kind: EventKind::Incomplete { bytes: 100 } };
            let counters = Counters { sdo_aborted: n + 1, incomplete: n + 1, ..Counters::default() };
            log.log([aborted, dropped], &counters, n * MS, &mut |_, line| said.push(line));
        }
        assert_eq!(said.len(), 6, "{said:?}");
        let aborts = said.iter().filter(|line| line.contains("SDO_WR of slave 2, 0x2101:0")).count();
        assert_eq!((aborts, said.iter().filter(|line| line.contains("only 100 bytes")).count()), (5, 1), "{said:?}");
        log.end(&Counters { sdo_aborted: 50, incomplete: 50, ..Counters::default() }, 60 * MS, &mut |_, line| {
            said.push(line);
        });
        assert_eq!(said.len(), 8, "{said:?}");
        assert!(said[6].contains("50 command frame(s) did not arrive completely"), "{said:?}");
        assert!(said[7].contains("50 SDO transfer(s)"), "{said:?}");
    }

    /// A successful homing is logged as information, and every other end of a homing as a warning.
    #[test]
    fn only_a_homing_that_failed_is_a_warning() {
        let mut log = RejectionLog::new(&Counters::default());
        for (end, level) in [
            (HomingEnd::Attained, Level::Info),
            (HomingEnd::Error, Level::Warn),
            (HomingEnd::Aborted, Level::Warn),
            (HomingEnd::Lost, Level::Warn),
        ] {
            let mut said = Vec::new();
            let event = Event { at: MS, kind: EventKind::HomingEnded { slave: 1, axis: 0, end } };
            log.log([event], &Counters::default(), MS, &mut |level, line| said.push((level, line)));
            let [(told, text)] = &said[..] else { panic!("{said:?}") };
            assert_eq!((*told, text.starts_with("homing of slave 1, axis 1")), (level, true), "{text}");
        }
    }

    /// SK-4.78 If a bus loses outputs in many cycles, the first loss and the total count are logged.
    #[test]
    fn lost_outputs_are_logged_once_and_counted() {
        let mut log = RejectionLog::new(&Counters::default());
        let mut said = Vec::new();
        for n in 0..50 {
            let counters = Counters { outputs_lost: n + 1, ..Counters::default() };
            log.log(
                [Event { at: n * MS, kind: EventKind::OutputsLost { sets: 1, has_chip: true } }],
                &counters,
                n * MS,
                &mut |_, line| said.push(line),
            );
        }
        assert!(said.len() == 1 && said[0].contains("the outputs of 1 cycles"), "{said:?}");
        log.end(&Counters { outputs_lost: 50, ..Counters::default() }, 60 * MS, &mut |_, line| said.push(line));
        assert!(said.len() == 2 && said[1].contains("50 set(s) of outputs"), "{said:?}");
    }
}
