//! When the host was late: the pauses between its writes and between all frames in OP, and how full the board's FIFO was.
//!
//! What an ECM-XF needs to know is how long the process that runs the engine may stand still. No frame says that, but two
//! things that do hint at it:
//!
//! - **Silence**: nothing passed in either direction, although the board makes a report every cycle. Then nobody took
//!   frames, neither the thread that reads nor the one that writes.
//! - **Late writes**: a pause between two bursts of writes that was longer than the program's usual one (the median), before
//!   which an axis had got targets that move it, and at the end of which targets still waited or an axis stood on its way: the
//!   motion was not over. Where all axes stand, or are off, a pause is the program's own.
//!
//! Of either no more counts than the sets that waited in the FIFO when it began: where none are, none can lie in a chip, and
//! the axes stop there as they do on the board.
//!
//! \[OURS] The longer of both counts as the host's longest stall. It is more than the engine will see where a program
//! pauses by itself, and less where the kernel or a driver takes frames for a process that stands still.

use super::spread::Spread;
use super::{Place, Stretch};
use crate::sk::FIFO_ENTRIES;

/// Writes that follow each other within this part of a cycle are one burst. \[OURS]
const BURST_FRACTION: i64 = 2;
/// A pause longer than this is the program's intention, in nanoseconds: that of
/// [`GapFinder`](crate::summary::GapFinder). \[OURS]
const PAUSE_MAX_NS: i64 = 1_000_000_000;

/// The levels of the board's FIFO in OP: so many reports have shown so many sets that waited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels([u64; FIFO_ENTRIES as usize + 1]);

impl Default for Levels {
    fn default() -> Self {
        Self([0; FIFO_ENTRIES as usize + 1])
    }
}

impl Levels {
    fn add(&mut self, waiting: u16) {
        self.0[usize::from(waiting.min(FIFO_ENTRIES))] += 1;
    }

    /// The level that so many per cent of the reports do not exceed, in sets; `None`: there were no reports in OP.
    pub fn percentile(&self, per_cent: u64) -> Option<u16> {
        let total: u64 = self.0.iter().sum();
        let wanted = total.saturating_mul(per_cent.min(100)).div_ceil(100).max(1);
        let mut passed = 0;
        let level = self.0.iter().position(|count| {
            passed += count;
            passed >= wanted
        });
        level.and_then(|level| u16::try_from(level).ok())
    }
}

/// What a stall was seen by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeenBy {
    /// Nothing passed in either direction.
    Silence,
    /// The program wrote later than it used to, and its targets still waited, or an axis had stopped.
    LateWrite,
}

impl Stall {
    /// Whether it lasted for longer than counts: as many cycles as sets waited have passed, and the axes stop then on a board, too.
    pub const fn is_limited(&self) -> bool {
        self.ns < self.whole_ns - self.usual_ns
    }
}

/// The longest time for which the host stood still in OP while sets waited, as far as its frames show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall {
    /// How long, in nanoseconds: of the whole time what counts.
    pub ns: i64,
    /// The whole pause or silence, in nanoseconds.
    pub whole_ns: i64,
    /// What of it is usual, in nanoseconds: the pause between two bursts of this program, or the cycle of a report.
    pub usual_ns: i64,
    /// The sets that waited in the board's FIFO when it began. Of the time beyond the usual no more cycles count.
    pub sets: u16,
    /// By what it was seen.
    pub seen_by: SeenBy,
    /// The frame that ended it.
    pub ended: Place,
}

/// Of each number of sets that waited at the beginning the longest time, in nanoseconds, and where it ended.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Longest([Option<(i64, Place)>; FIFO_ENTRIES as usize + 1]);

impl Default for Longest {
    fn default() -> Self {
        Self([None; FIFO_ENTRIES as usize + 1])
    }
}

impl Longest {
    fn add(&mut self, sets: u16, ns: i64, ended: Place) {
        let longest = &mut self.0[usize::from(sets.min(FIFO_ENTRIES))];
        if longest.is_none_or(|(longest, _)| ns > longest) {
            *longest = Some((ns, ended));
        }
    }

    /// The longest stall, where `usual_ns` of each time are none. Half a cycle is none either.
    fn stall(&self, usual_ns: i64, cycle_ns: i64, seen_by: SeenBy) -> Option<Stall> {
        let stalls = (0_u16..).zip(&self.0).filter_map(|(sets, longest)| {
            let (ns, ended) = (*longest)?;
            let whole_ns = ns;
            let ns = (whole_ns - usual_ns).min(cycle_ns.saturating_mul(sets.into()));
            (ns > cycle_ns / 2).then_some(Stall { ns, whole_ns, usual_ns, sets, seen_by, ended })
        });
        stalls.max_by_key(|stall| stall.ns)
    }
}

/// How the host kept its time in OP.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HostTiming {
    /// Time in OP in nanoseconds.
    pub op_ns: i64,
    /// How many sets waited in the board's FIFO.
    pub levels: Levels,
    /// The pauses between bursts of writes, in nanoseconds; those of more than a second are the program's intention and left
    /// out.
    pub pauses: Spread,
    /// The times without any frame while sets waited, in nanoseconds.
    pub silences: Spread,
    /// The cycles in which the FIFO was empty while an axis was on its way, so that the board repeated its outputs.
    pub repeated_cycles: u64,
    /// How often that was.
    pub gaps: u64,
    /// The longest of these gaps in nanoseconds, and where it ended.
    pub longest_gap: Option<(i64, Place)>,
    /// The longest pause that ended while targets still waited or an axis had stopped on its way, in nanoseconds, and where
    /// it ended.
    pub longest_pause: Option<(i64, Place)>,
    late_writes: Longest,
    long_silences: Longest,
}

impl HostTiming {
    /// The longest stall; `None`: no sign of any.
    pub fn stall(&self, cycle_ns: i64) -> Option<Stall> {
        // A report comes every cycle.
        let silence = self.long_silences.stall(cycle_ns, cycle_ns, SeenBy::Silence);
        let usual_ns = self.pauses.percentile(50).unwrap_or(0);
        let late = self.late_writes.stall(usual_ns, cycle_ns, SeenBy::LateWrite);
        match (silence, late) {
            (Some(a), Some(b)) => Some(if a.ns >= b.ns { a } else { b }),
            (a, b) => a.or(b),
        }
    }
}

/// A command frame of OP, and how it was with the axes when it was written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Write {
    /// The sets in the FIFO, as the newest report tells.
    pub(super) waiting: u16,
    /// The same with what was written since, this frame included.
    pub(super) sets: u16,
    /// Whether an axis moved when the frame before was written.
    pub(super) moved: bool,
    /// Since when an axis stands on its way, because the FIFO was empty.
    pub(super) gap_since_ns: Option<i64>,
}

/// Follows the host's time through the frames of a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Clockwork {
    pub(super) timing: HostTiming,
    /// The newest frame in OP, and the newest command in OP.
    newest_ns: Option<i64>,
    newest_write_ns: Option<i64>,
    /// The sets that waited behind the newest frame, and behind the newest command.
    sets: u16,
    sets_written: u16,
}

impl Clockwork {
    /// OP was left, or is entered anew.
    pub(super) fn left_op(&mut self) {
        (self.newest_ns, self.newest_write_ns, self.sets, self.sets_written) = (None, None, 0, 0);
    }

    /// A frame of OP, behind which so many sets wait.
    fn passed(&mut self, place: Place, sets: u16) {
        let had_sets = std::mem::replace(&mut self.sets, sets);
        if let Some(before) = self.newest_ns.replace(place.at_ns) {
            let ns = place.at_ns.saturating_sub(before).max(0);
            self.timing.op_ns = self.timing.op_ns.saturating_add(ns);
            if ns <= PAUSE_MAX_NS && had_sets > 0 {
                self.timing.silences.add(ns, place);
                self.timing.long_silences.add(had_sets, ns, place);
            }
        }
    }

    /// A report of OP with so many sets waiting.
    pub(super) fn report(&mut self, place: Place, waiting: u16) {
        self.passed(place, waiting);
        self.timing.levels.add(waiting);
    }

    /// A command frame of OP. Gives the pause before it, if the program had more to say.
    pub(super) fn command(&mut self, place: Place, write: Write, cycle_ns: i64) -> Option<Stretch> {
        let Write { waiting, sets, moved, gap_since_ns } = write;
        self.passed(place, sets);
        let had_sets = std::mem::replace(&mut self.sets_written, sets);
        let since_ns = self.newest_write_ns.replace(place.at_ns)?;
        let timing = &mut self.timing;
        if let Some(since) = gap_since_ns {
            let ns = place.at_ns.saturating_sub(since).max(0);
            timing.gaps += 1;
            timing.repeated_cycles += 1 + (ns / cycle_ns.max(1)).unsigned_abs();
            if timing.longest_gap.is_none_or(|(longest, _)| ns > longest) {
                timing.longest_gap = Some((ns, place));
            }
        }
        let ns = place.at_ns.saturating_sub(since_ns);
        if ns < cycle_ns / BURST_FRACTION || ns > PAUSE_MAX_NS {
            return None;
        }
        timing.pauses.add(ns, place);
        if gap_since_ns.is_none() && (waiting == 0 || !moved) {
            return None;
        }
        timing.late_writes.add(had_sets, ns, place);
        if timing.longest_pause.is_none_or(|(longest, _)| ns > longest) {
            timing.longest_pause = Some((ns, place));
        }
        Some(Stretch { from_ns: since_ns, to_ns: place.at_ns })
    }
}
