//! A summary of what went wrong in a run of a program, and how often: commands that the board did not execute, alarms
//! of drives, changes of state that failed, gaps in a motion, lost reports, and warnings of the library. Commands that
//! a program itself discards, for example with SET_FIFO 1, are left out.
//!
//! `ecmsk summary` makes it from the frames of a recording ([`FrameWatch`]). `ecmsk exec` shows it when its program has
//! ended: the library in the program's process writes events to a file that the tool reads ([`writer`], [`Line`]).
//!
//! Files:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`Summary`]: the counts, and their text |
//! | `watch.rs` | [`FrameWatch`]: finds alarms, failed changes of state and losses in frames |
//! | `flight.rs` | [`FlightEvents`]: finds what a flight recorder keeps |
//! | `gaps.rs` | [`GapFinder`]: finds gaps in the motion of one axis |
//! | `line.rs` | [`Line`]: a line of the file between library and tool |
//! | `writer.rs` | writes those lines, in the process of the program |
//! | `link.rs` | a link that wraps another one and watches its frames for `writer.rs` |

mod flight;
mod gaps;
mod line;
mod link;
mod watch;
pub mod writer;

use std::collections::BTreeMap;
use std::fmt;

pub use flight::FlightEvents;
pub use gaps::GapFinder;
pub use line::{Alarm, HeldBack, Line, StateFailed};
pub use watch::{FrameCounts, FrameEvent, FrameWatch};

use crate::engine::{Counters, Reason, Unexecuted};
use crate::link::LinkStats;
use crate::sk::MasterState;

/// \[OURS] The maximum number of different messages of the log that a summary keeps; further ones are left out.
const TEXTS_MAX: usize = 200;
/// The beginning of the names of the counts of rejected commands, in the file and in [`Summary::counts`]. The name of the
/// reason follows.
const REJECTED: &str = "rejected.";
// The names of counts that are no counters of the board: they come from the frames that the summary has watched, or from the
// library.
const FULL_SEEN: &str = "full_seen";
const CRC_SEEN: &str = "crc_seen";
const GAPS: &str = "gaps";
const UNREACHED: [(MasterState, &str); 2] =
    [(MasterState::SafeOp, "safeop_unreached_ms"), (MasterState::Op, "op_unreached_ms")];
const REPORTS_LOST: &str = "reports_lost";
const RECORD_DROPPED: &str = "record_dropped";

/// What went wrong in a run, and how often.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// The alarms by slave and error code: the first one, and how many times it began.
    alarms: BTreeMap<(u8, u16), (Alarm, u64)>,
    /// The axes that their drives held back, by slave: the first event, and the number of events.
    held_back: BTreeMap<u8, (HeldBack, u64)>,
    failed: BTreeMap<StateFailed, u64>,
    counts: BTreeMap<String, u64>,
    /// Messages of the log: the text of the first one of each kind, and the number of messages of the kind.
    messages: Vec<(String, u64)>,
    /// The number of lines that the library could not write to the file.
    dropped: u64,
}

impl Summary {
    /// Adds an event that was found in a frame of the run.
    pub fn add_event(&mut self, event: FrameEvent) {
        match event {
            FrameEvent::Alarm(alarm) => self.alarms.entry((alarm.slave, alarm.code)).or_insert((alarm, 0)).1 += 1,
            FrameEvent::HeldBack(held) => self.held_back.entry(held.slave).or_insert((held, 0)).1 += 1,
            FrameEvent::StateFailed(failed) => *self.failed.entry(failed).or_default() += 1,
        }
    }

    /// Sets the counts that were found in the frames of the run. A second call replaces the values of the first one.
    pub fn set_frame_counts(&mut self, counts: &FrameCounts) {
        of_frames(counts).into_iter().for_each(|(name, value)| self.set(name, value));
    }

    /// Adds the lines that one process has written to the file. Call it once for each process, because the counts of the
    /// processes are added up.
    pub fn add_lines<'a>(&mut self, lines: impl IntoIterator<Item = &'a Line>) {
        // The file may have several lines for a count. Only the newest value of each board counts, and the values of
        // all boards are added up.
        let mut newest: BTreeMap<(u32, &str), u64> = BTreeMap::new();
        let mut places = BTreeMap::new();
        let mut dropped = 0;
        for line in lines {
            match line {
                Line::Message { id, text } if self.messages.len() < TEXTS_MAX => {
                    places.insert(*id, self.messages.len());
                    self.messages.push((text.clone(), 1));
                }
                Line::Message { .. } => {}
                Line::Repeated { id, times } => {
                    if let Some((_, count)) = places.get(id).and_then(|place| self.messages.get_mut(*place)) {
                        *count = *times;
                    }
                }
                Line::Alarm(alarm) => self.add_event(FrameEvent::Alarm(*alarm)),
                Line::HeldBack(held) => self.add_event(FrameEvent::HeldBack(*held)),
                Line::StateFailed(failed) => self.add_event(FrameEvent::StateFailed(*failed)),
                Line::Count { board, name, value } => {
                    newest.insert((*board, name), *value);
                }
                Line::Dropped(lines) => dropped = *lines,
            }
        }
        self.dropped = self.dropped.saturating_add(dropped);
        for ((_, name), value) in newest {
            let sum = self.count(name).saturating_add(value);
            self.set(name, sum);
        }
    }

    fn set(&mut self, name: &str, value: u64) {
        self.counts.insert(name.to_owned(), value);
    }

    fn count(&self, name: &str) -> u64 {
        self.counts.get(name).copied().unwrap_or_default()
    }

    /// Whether the summary has nothing to report.
    pub fn is_empty(&self) -> bool {
        self.lines(false).is_empty()
    }

    /// The number of frames that the recording of the run lacks because it could not be written fast enough.
    pub fn record_dropped(&self) -> u64 {
        self.count(RECORD_DROPPED)
    }

    /// The counts that are not 0, with their names. Rejected commands are counted by their reason, under the name
    /// `rejected.REASON`.
    pub fn counts(&self) -> impl Iterator<Item = (&str, u64)> {
        self.counts.iter().filter(|(_, value)| **value > 0).map(|(name, value)| (name.as_str(), *value))
    }

    /// The alarms as they first began, with the number of times each began.
    pub fn alarms(&self) -> impl Iterator<Item = (Alarm, u64)> {
        self.alarms.values().copied()
    }

    /// The axes that their drives held back: the first event of each, and the number of events.
    pub fn held_back(&self) -> impl Iterator<Item = (HeldBack, u64)> {
        self.held_back.values().copied()
    }

    /// The changes of state that failed, with the number of times each failed.
    pub fn states_failed(&self) -> impl Iterator<Item = (StateFailed, u64)> {
        self.failed.iter().map(|(failed, times)| (*failed, *times))
    }

    /// The messages of the log: the first one of each kind, and the number of messages of the kind. Messages that
    /// differ only in their numbers are of the same kind.
    pub fn messages(&self) -> impl Iterator<Item = (&str, u64)> {
        self.messages.iter().map(|(text, times)| (text.as_str(), *times))
    }

    /// The summary as text, one line for each problem, beginning with commands that were not executed. With `told`, an event or
    /// message that came only once is left out, because the user has seen it already while the program ran.
    pub fn lines(&self, told: bool) -> Vec<String> {
        let mut lines = Vec::new();
        let rejected: Vec<(&str, u64)> = Reason::NAMES
            .iter()
            .map(|name| (*name, self.count(&format!("{REJECTED}{name}"))))
            .filter(|(_, count)| *count > 0)
            .collect();
        if !rejected.is_empty() {
            let total: u64 = rejected.iter().map(|(_, count)| count).sum();
            let each = rejected.iter().map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ");
            lines.push(format!("{total} command(s) were rejected and not executed: {each}"));
        }
        for what in Unexecuted::ALL.into_iter().filter(|what| !what.is_asked_for()) {
            // A modelled board has exact counters of these frames. A real board has no counters, so the FIFO-full count and the
            // error count in slot 0 of its reports are used.
            let seen = match what {
                Unexecuted::Full => self.count(FULL_SEEN),
                Unexecuted::Crc => self.count(CRC_SEEN),
                _ => 0,
            };
            match self.count(what.name()).max(seen) {
                0 => {}
                count => lines.push(format!("{count} {}; {}", what.meaning(), what.advice())),
            }
        }
        for (name, what) in [
            (GAPS, "gap(s) in a motion: the FIFO ran empty on the way of an axis; send targets ahead (prefill)"),
            (REPORTS_LOST, "report(s) were lost, since the program had not read them; read one in each cycle"),
            (RECORD_DROPPED, "frame(s) are missing in the recording; record to a disk that is fast and has room"),
        ] {
            match self.count(name) {
                0 => {}
                count => lines.push(format!("{count} {what}")),
            }
        }
        for (state, name) in UNREACHED {
            match self.count(name) {
                0 => {}
                ms => lines.push(format!(
                    "the program gave up {ms} ms after it had asked for {state}, while the board was on its way there; a network may take \
                     seconds: wait until byte 2 of slot 0 is {state}, or shows a failure"
                )),
            }
        }
        let failed = self.failed.iter().map(|(failed, count)| (failed.to_string(), *count));
        let alarms = self.alarms().map(|(alarm, count)| (alarm.to_string(), count));
        let held_back = self.held_back().map(|(held, count)| (held.to_string(), count));
        let messages = self.messages.iter().filter(|(text, _)| !is_counted(text)).cloned();
        let others = failed.chain(alarms).chain(held_back).chain(messages).filter(|(_, count)| !told || *count > 1);
        lines.extend(others.map(|(text, count)| format!("{text}{}", times(count))));
        if self.dropped > 0 {
            lines.push(format!("{} more word(s) of the library are not known: they came too fast", self.dropped));
        }
        lines
    }
}

/// Writes one line for each problem.
impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.lines(false).iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

/// Whether a message of the log only gives what the summary has itself: a number of earlier messages, a final count
/// such as "12 in all", or the state that was not reached yet when the program closed the board. Such messages are left
/// out of the summary.
pub fn is_sum(text: &str) -> bool {
    text.contains(" more rejected as ") || text.ends_with(" in all") || text.contains(" was still under way when ")
}

/// Whether the summary counts what a message of the log reports, so that the message is left out of the texts: a
/// rejected command, or the beginning ("since ...") of a period in which commands were not executed.
fn is_counted(text: &str) -> bool {
    is_sum(text) || text.contains(" rejected at ") || text.starts_with("since ")
}

fn times(count: u64) -> String {
    if count > 1 { format!(" ({count} times)") } else { String::new() }
}

fn of_frames(counts: &FrameCounts) -> [(&'static str, u64); 5] {
    let unreached = UNREACHED
        .map(|(state, name)| (name, counts.unreached.filter(|(wanted, _)| *wanted == state).map_or(0, |(_, ms)| ms)));
    [(FULL_SEEN, counts.full), (CRC_SEEN, counts.crc), (GAPS, counts.gaps), unreached[0], unreached[1]]
}

/// The counters of a link, minus their values when the link was opened.
fn of_link(stats: &LinkStats, before: &Counters) -> Vec<(String, u64)> {
    let mut counts =
        vec![(REPORTS_LOST.to_owned(), stats.reports_dropped), (RECORD_DROPPED.to_owned(), stats.record_dropped)];
    if let Some(board) = &stats.board {
        let rejected = Reason::NAMES.iter().zip(board.rejected.iter().zip(before.rejected));
        counts.extend(rejected.map(|(name, (now, then))| (format!("{REJECTED}{name}"), now.saturating_sub(then))));
        let count = |what: Unexecuted| what.of(board).saturating_sub(what.of(before));
        counts.extend(Unexecuted::ALL.into_iter().map(|what| (what.name().to_owned(), count(what))));
    }
    counts
}
