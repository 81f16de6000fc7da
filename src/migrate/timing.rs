//! The timing of the host: the pauses between its writes and between all frames in OP, and how full the board's FIFO
//! was.
//!
//! An ECM-XF has to bridge the stalls of the process that runs the engine. No frame shows these directly, but there are
//! two signs:
//!
//! - **Silence**: no frame in either direction, although the board makes a report every cycle. Both the reading and the
//!   writing thread were stalled then.
//! - **Late writes**: a pause between two bursts of writes that was longer than the program's usual one (the median),
//!   within a motion: an axis was moving before it, and at its end targets still waited or the axis had stopped before
//!   its target. If all axes are at rest or off, a pause is the program's intention.
//!
//! A silence or a late write counts for at most as many cycles as command frames waited in the FIFO when it began.
//! Without waiting frames there would be no outputs in a chip either, and the axes would stop as they do on the board.
//!
//! \[OURS] The longer of the two counts as the host's longest stall. It is an overestimate if the program pauses by
//! intention, and an underestimate if the kernel or a driver accepts frames for a stalled process.

use super::spread::Spread;
use super::{Place, Stretch};
use crate::sk::FIFO_ENTRIES;

/// Divisor of the cycle time: two writes that are less than half a cycle apart belong to the same burst. \[OURS]
const BURST_DIVISOR: i64 = 2;
/// The longest pause that may be a stall, in nanoseconds: a longer one is the program's intention.
/// [`GapFinder`](crate::summary::GapFinder) has the same limit. \[OURS]
const PAUSE_MAX_NS: i64 = 1_000_000_000;

/// A histogram of the FIFO levels in OP: for each number of waiting command frames, how many reports have shown it.
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

    /// The percentile of the FIFO levels, in command frames; `None` if there were no reports in OP. `per_cent` is 0 to
    /// 100.
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

/// How a stall of the host shows in the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeenBy {
    /// There was no frame in either direction.
    Silence,
    /// The program wrote later than usual, while its targets still waited or an axis had stopped before its target.
    LateWrite,
}

impl Stall {
    /// Whether [`Self::ns`] is shorter than the stall: the stall used up all waiting command frames, so the axes would stop
    /// on a board too.
    pub const fn is_limited(&self) -> bool {
        self.ns < self.whole_ns - self.usual_ns
    }
}

/// The longest stall of the host in OP while command frames waited, as far as the frames show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall {
    /// The time that outputs in a chip would have to bridge, in nanoseconds.
    pub ns: i64,
    /// The whole pause or silence, in nanoseconds.
    pub whole_ns: i64,
    /// The usual part of the pause, in nanoseconds: the program's pause between two bursts, or one cycle between two
    /// reports.
    pub usual_ns: i64,
    /// The number of command frames in the board's FIFO when the stall began. [`Stall::ns`] is at most that many
    /// cycles: after them the FIFO is empty, and the axes would stop on a board as well.
    pub sets: u16,
    /// How the stall shows in the frames.
    pub seen_by: SeenBy,
    /// The frame at the end of the stall.
    pub ended: Place,
}

/// For each number of command frames that waited in the board's FIFO when a pause or silence began: the length of the
/// longest one in nanoseconds, and the frame at its end.
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

    /// The longest stall, if the first `usual_ns` of each pause or silence are normal. A stall of up to half a cycle
    /// does not count; `None` if there is no longer one.
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

/// The timing of the host in OP.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HostTiming {
    /// The time in OP, in nanoseconds.
    pub op_ns: i64,
    /// How many command frames waited in the board's FIFO, as the reports in OP have shown it.
    pub levels: Levels,
    /// The pauses between bursts of writes, in nanoseconds. Pauses of more than a second are the program's intention
    /// and left out.
    pub pauses: Spread,
    /// The times without a frame in either direction while command frames waited, in nanoseconds.
    pub silences: Spread,
    /// The cycles with an empty FIFO during a motion, in which the board repeated its outputs.
    pub repeated_cycles: u64,
    /// The number of gaps: periods of such cycles without a target in between.
    pub gaps: u64,
    /// The longest gap in nanoseconds, and the frame with the target that ended it. `None`: there was no gap.
    pub longest_gap: Option<(i64, Place)>,
    /// The longest pause within a motion, in nanoseconds, and the frame at its end: targets still waited, or an axis
    /// had stopped before its target. `None`: there was no pause within a motion.
    pub longest_pause: Option<(i64, Place)>,
    late_writes: Longest,
    long_silences: Longest,
}

impl HostTiming {
    /// The longest stall; `None` if there is no sign of one.
    pub fn stall(&self, cycle_ns: i64) -> Option<Stall> {
        // One cycle between two reports is normal, so it does not count as a part of the stall.
        let silence = self.long_silences.stall(cycle_ns, cycle_ns, SeenBy::Silence);
        let usual_ns = self.pauses.percentile(50).unwrap_or(0);
        let late = self.late_writes.stall(usual_ns, cycle_ns, SeenBy::LateWrite);
        match (silence, late) {
            (Some(a), Some(b)) => Some(if a.ns >= b.ns { a } else { b }),
            (a, b) => a.or(b),
        }
    }
}

/// A command frame of OP, with the state of the axes when it was written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Write {
    /// The number of command frames in the FIFO at the newest report.
    pub(super) waiting: u16,
    /// The number of command frames in the FIFO, including this one and those written since the newest report.
    pub(super) sets: u16,
    /// Whether an axis was moving when the previous frame was written.
    pub(super) moved: bool,
    /// The time since which an axis waits before its target because the FIFO is empty. `None`: no axis does.
    pub(super) gap_since_ns: Option<i64>,
}

/// Measures the timing of the host from the frames of a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Clockwork {
    pub(super) timing: HostTiming,
    /// The time of the newest frame in OP, and of the newest command in OP. `None` before the first one since OP was
    /// entered.
    newest_ns: Option<i64>,
    newest_write_ns: Option<i64>,
    /// The number of command frames that waited in the FIFO after the newest frame, and after the newest command.
    sets: u16,
    sets_written: u16,
}

impl Clockwork {
    /// Forgets the newest frame and command, because OP was left: the time until the next OP is no pause.
    pub(super) fn left_op(&mut self) {
        (self.newest_ns, self.newest_write_ns, self.sets, self.sets_written) = (None, None, 0, 0);
    }

    /// Processes a frame in OP, after which `sets` command frames wait in the board's FIFO.
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

    /// Processes a report in OP with `waiting` command frames in the FIFO.
    pub(super) fn report(&mut self, place: Place, waiting: u16) {
        self.passed(place, waiting);
        self.timing.levels.add(waiting);
    }

    /// Processes a command frame in OP. Returns the pause before it, if the motion was not over. Otherwise returns
    /// `None`.
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
        if ns < cycle_ns / BURST_DIVISOR || ns > PAUSE_MAX_NS {
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
