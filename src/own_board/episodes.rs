//! Log lines about commands that the board did not execute although it did not reject them, for example because its
//! FIFO was full. An episode is a period in which such commands occur. The log gets a line when an episode begins, and
//! a line with the number of commands when it has ended.

use log::Level;

use crate::engine::{Counters, Unexecuted};
use crate::fieldbus::Ns;
use crate::span::Seconds;

/// An episode has ended once its counter has not changed for this long, in nanoseconds of the board's time \[OURS].
const QUIET_NS: Ns = 1_000_000_000;

/// A period in which commands were not executed for one reason, such as a full FIFO.
#[derive(Clone, Copy)]
struct Episode {
    /// When the first command of the episode was noticed, in the board's time.
    from: Ns,
    /// When the latest command of the episode was noticed, in the board's time.
    to: Ns,
    /// The value of the board's counter before the episode.
    before: u64,
}

/// One of the board's counters of commands that were not executed, with its present episode.
#[derive(Clone, Copy)]
struct Tracker {
    /// The value of the counter when it was last read.
    seen: u64,
    episode: Option<Episode>,
}

/// The episodes of all kinds of commands that were not executed, one tracker for each kind.
pub(crate) struct Episodes {
    kinds: [Tracker; Unexecuted::KINDS],
}

impl Episodes {
    /// Begins at the present values of the board's counters: events that were counted before belong to earlier
    /// programs.
    pub(crate) fn new(counters: &Counters) -> Self {
        Self { kinds: Unexecuted::ALL.map(|what| Tracker { seen: what.of(counters), episode: None }) }
    }

    /// Whether an episode of this kind is in progress.
    pub(crate) fn is_running(&self, what: Unexecuted) -> bool {
        let kinds = self.kinds.iter().zip(Unexecuted::ALL);
        kinds.filter(|(_, of)| *of == what).any(|(kind, _)| kind.episode.is_some())
    }

    /// Logs the episodes that have begun or ended. The line for a beginning is left out if `is_logged` returns true,
    /// because the log already has a line for that command. `now` is the board's time.
    pub(crate) fn log(
        &mut self,
        counters: &Counters,
        now: Ns,
        is_logged: impl Fn(Unexecuted) -> bool,
        log: &mut dyn FnMut(Level, String),
    ) {
        for (kind, what) in self.kinds.iter_mut().zip(Unexecuted::ALL) {
            let count = what.of(counters);
            let before = std::mem::replace(&mut kind.seen, count);
            match &mut kind.episode {
                Some(episode) if count > before => episode.to = now,
                Some(episode) if now.saturating_sub(episode.to) >= QUIET_NS => {
                    log(level(what), ended(what, episode, count));
                    kind.episode = None;
                }
                Some(_) => {}
                None if count > before => {
                    kind.episode = Some(Episode { from: now, to: now, before });
                    if !is_logged(what) {
                        log(level(what), begun(what, count - before, now));
                    }
                }
                None => {}
            }
        }
    }

    /// Logs the number of commands of each episode in progress, because the link is being closed.
    pub(crate) fn end(&mut self, counters: &Counters, now: Ns, log: &mut dyn FnMut(Level, String)) {
        self.log(counters, now, |_| false, log);
        for (kind, what) in self.kinds.iter_mut().zip(Unexecuted::ALL) {
            if let Some(episode) = kind.episode.take() {
                log(level(what), ended(what, &episode, kind.seen));
            }
        }
    }
}

/// The log level of a line: commands that the program itself discarded are no reason for a warning.
const fn level(what: Unexecuted) -> Level {
    if what.is_asked_for() { Level::Info } else { Level::Warn }
}

fn begun(what: Unexecuted, count: u64, at: Ns) -> String {
    format!("since {}: {count} {}; {}", Seconds(at), what.meaning(), what.advice())
}

fn ended(what: Unexecuted, episode: &Episode, count: u64) -> String {
    let (from, to) = (Seconds(episode.from), Seconds(episode.to));
    format!("from {from} to {to}: {} {} in all", count - episode.before, what.meaning())
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    struct Log {
        episodes: Episodes,
        lines: Vec<(Level, String)>,
    }

    impl Log {
        fn of(counters: &Counters) -> Self {
            Self { episodes: Episodes::new(counters), lines: Vec::new() }
        }

        fn look(&mut self, counters: &Counters, at: Ns) {
            self.episodes.log(counters, at, |_| false, &mut |level, line| self.lines.push((level, line)));
        }

        fn end(&mut self, counters: &Counters, at: Ns) {
            self.episodes.end(counters, at, &mut |level, line| self.lines.push((level, line)));
        }
    }

    /// SK-4.78 A FIFO that is full for a while gets one line with advice when it begins, and one with the count after a
    /// second without losses. Losses before the link was opened are not counted.
    #[test]
    fn a_full_fifo_is_logged_when_it_begins_and_when_it_ends() {
        let mut log = Log::of(&Counters { full: 1000, ..Counters::default() });
        for n in 0..400 {
            log.look(&Counters { full: 1000 + n, ..Counters::default() }, n * MS);
        }
        assert_eq!(log.lines.len(), 1, "{:?}", log.lines);
        let (level, line) = &log.lines[0];
        assert_eq!(*level, Level::Warn);
        let begins = "since 0.001 s: 1 command frame(s) found the FIFO full and were lost; ";
        assert!(line.starts_with(begins), "{line}");
        let last = Counters { full: 1399, ..Counters::default() };
        log.look(&last, 1398 * MS);
        assert_eq!(log.lines.len(), 1, "it has not ended: {:?}", log.lines);
        log.look(&last, 1399 * MS);
        let ends = "from 0.001 s to 0.399 s: 399 command frame(s) found the FIFO full and were lost in all";
        assert_eq!(log.lines[1..], [(Level::Warn, ends.to_owned())]);
        log.end(&last, 5000 * MS);
        assert_eq!(log.lines.len(), 2, "told twice: {:?}", log.lines);
        log.look(&Counters { full: 1400, ..Counters::default() }, 6000 * MS);
        assert!(log.lines[2].1.starts_with("since 6.000 s: 1 "), "{:?}", log.lines);
    }

    /// SK-4.78 Every counter of commands that were not executed gets its lines. If the link is closed during an
    /// episode, the count is logged. Commands that the program itself cleared are logged at a lower level.
    #[test]
    fn every_counter_of_unexecuted_commands_is_logged_when_it_begins_and_ends() {
        let lost = Counters {
            ignored_homing: 1,
            discarded_before_enabled: 2,
            for_lost: 3,
            cleared: 4,
            full: 5,
            crc: 6,
            incomplete: 7,
            while_booting: 8,
            sdo_aborted: 9,
            outputs_lost: 10,
            cycles_left_out: 11,
            ring_broken: 12,
            inputs_held: 13,
            inputs_stale: 14,
            ..Counters::default()
        };
        let mut log = Log::of(&Counters::default());
        log.end(&lost, MS);
        assert_eq!(log.lines.len(), 2 * Unexecuted::KINDS, "{:?}", log.lines);
        let (begun, ended) = log.lines.split_at(Unexecuted::KINDS);
        for ((what, begun), ended) in Unexecuted::ALL.into_iter().zip(begun).zip(ended) {
            let count = what.of(&lost);
            assert!(count > 0 && begun.1.contains(&format!(" {count} {}", what.meaning())), "{begun:?}");
            assert!(begun.1.ends_with(what.advice()), "{begun:?}");
            assert!(ended.1.contains(&format!(" {count} {} in all", what.meaning())), "{ended:?}");
            let level = if what == Unexecuted::Cleared { Level::Info } else { Level::Warn };
            assert_eq!((begun.0, ended.0), (level, level), "{what:?}");
        }
    }
}
