//! The run of the model, which gets the command frames of a recording at the recorded times.

use std::collections::VecDeque;

use super::ReplayStart;
use super::start::CYCLE_NS;
use crate::compare::{RecordedRun, TimedFrame};
use crate::engine::Board;
use crate::link::Dir;
use crate::sk::Frame;

/// The longest time, ns, for which the model of the replay runs before the first frame, so that its clock then shows
/// the same time as that of the recorded model did. If the recorded model ran for longer before its first frame, the
/// offset between the two clocks is chosen from the cycles alone. \[OURS]
const RUN_BEFORE_MAX_NS: i64 = 60_000_000_000;
/// How long after a cycle a recorded model may have made the report of that cycle. \[OURS]
const LATE_MAX_NS: u64 = 1_000_000_000;

/// The run of the model: the recorded command frames, each at its time, and the reports that the model makes. Times are
/// on the clock of the recording.
///
/// At each time at which the recorded host received a report, the host receives the newest report of the model, unless
/// it has received that report already. \[OURS]
///
/// A model over a chip makes a report some cycles after the cycle that it shows, and the report has the time of that
/// cycle. A recording is sorted by these times. So if a model was recorded, the host receives the report of the same
/// cycle, however late the model made it.
pub struct ModelRun {
    source: RecordedRun,
    frames: u64,
    writes: Writes,
    board: Board,
    /// The model's time minus the time on the clock of the recording, ns.
    offset_ns: i64,
    unread: Unread,
    reports: u64,
    begun: bool,
    start: ReplayStart,
}

impl ModelRun {
    /// The run of the model `board`. `again` is the same recording as `source`, opened a second time at the same frame:
    /// command frames are read ahead from it.
    pub(super) fn new(source: RecordedRun, again: RecordedRun, board: Board, start: &ReplayStart) -> Self {
        let mut model = Self {
            source,
            frames: 0,
            writes: Writes::new(again),
            board,
            offset_ns: 0,
            unread: Unread::default(),
            reports: 0,
            begun: false,
            start: *start,
        };
        model.offset_ns = time(model.board.next_cycle()).saturating_sub(start.tick_ns);
        model
    }

    /// Chooses the offset between the two clocks, at the first frame. If a model was recorded, the recording has the
    /// offset. Otherwise the offset makes the model's cycles end at the same times as those of the recorded board.
    fn begin(&mut self, first_ns: i64) {
        let now = time(self.board.now());
        if let Some(model_clock_ns) = self.start.model_clock_ns
            && (now..now.saturating_add(RUN_BEFORE_MAX_NS)).contains(&model_clock_ns.saturating_add(first_ns))
        {
            self.offset_ns = model_clock_ns;
            return;
        }
        let behind = now.saturating_sub(first_ns.saturating_add(self.offset_ns));
        if behind > 0 {
            let cycles = (behind.saturating_add(CYCLE_NS - 1)) / CYCLE_NS;
            self.offset_ns = self.offset_ns.saturating_add(cycles.saturating_mul(CYCLE_NS));
        }
    }

    fn play(&mut self, observed: TimedFrame) -> Option<TimedFrame> {
        if !std::mem::replace(&mut self.begun, true) {
            self.begin(observed.at_ns);
        }
        if observed.dir == Dir::Write {
            let due = self.model_time(observed.at_ns);
            while let Some(write) = self.writes.next_until(self.frames) {
                self.write(&write, due);
            }
            return Some(observed);
        }
        let at = self.model_time(observed.at_ns);
        let Self { board, unread, .. } = self;
        board.advance(at, &mut |frame, made| unread.push(frame, made, at));
        if self.start.model_clock_ns.is_some() {
            self.wait_for_report_of(at);
        }
        let frame = self.unread.pop(at)?;
        self.reports += 1;
        Some(TimedFrame { number: self.reports, frame, ..observed })
    }

    /// Sends a command frame to the model. `due` is the model's time of the recorded frame that is being replayed: of
    /// the reports made up to then, the host receives only the newest.
    fn write(&mut self, observed: &TimedFrame, due: u64) {
        let at = self.model_time(observed.at_ns);
        let Self { board, unread, .. } = self;
        board.host(&observed.frame, at, &mut |frame, made| unread.push(frame, made, due));
    }

    /// Runs the model until it has made the report of the cycle at the model's time `at`. Meanwhile the model gets the
    /// command frames that the host wrote in that time.
    fn wait_for_report_of(&mut self, at: u64) {
        let end = at.saturating_add(LATE_MAX_NS);
        while self.unread.newest().is_none_or(|made| made < at) && self.board.next_cycle() <= end {
            // A command frame that the host wrote before the next cycle goes to the model first.
            let before_ns = time(self.board.next_cycle()).saturating_sub(self.offset_ns);
            if let Some(write) = self.writes.next_if(|write| write.at_ns < before_ns) {
                self.write(&write, at);
            } else {
                let Self { board, unread, .. } = self;
                board.cycle(&mut |frame, made| unread.push(frame, made, at));
            }
        }
    }

    /// Converts a time of the recording to the model's time.
    fn model_time(&self, ns: i64) -> u64 {
        ns.saturating_add(self.offset_ns).max(0).unsigned_abs()
    }
}

/// The model's reports that the host has not received yet, with the times of their cycles.
#[derive(Default)]
struct Unread(VecDeque<(Frame, u64)>);

impl Unread {
    /// Adds a report. Of the reports made up to `due` only the newest is kept.
    fn push(&mut self, frame: &Frame, made: u64, due: u64) {
        if made <= due {
            self.0.clear();
        }
        self.0.push_back((frame.clone(), made));
    }

    fn newest(&self) -> Option<u64> {
        self.0.back().map(|(_, made)| *made)
    }

    /// Removes the reports made up to `at`, and returns the newest of them.
    fn pop(&mut self, at: u64) -> Option<Frame> {
        let due = self.0.partition_point(|(_, made)| *made <= at);
        self.0.drain(..due).next_back().map(|(frame, _)| frame)
    }
}

/// The command frames of a recording, read by a second reader that may be ahead of the first: the model may need a
/// command frame before a report that is earlier in the recording.
struct Writes {
    source: RecordedRun,
    /// The number of frames of the recording that were read.
    frames: u64,
    /// The next command frame, with its number among all frames, from 1.
    next: Option<(u64, TimedFrame)>,
}

impl Writes {
    const fn new(source: RecordedRun) -> Self {
        Self { source, frames: 0, next: None }
    }

    fn look(&mut self) -> Option<&(u64, TimedFrame)> {
        while self.next.is_none() {
            let observed = self.source.next()?;
            self.frames += 1;
            self.next = (observed.dir == Dir::Write).then_some((self.frames, observed));
        }
        self.next.as_ref()
    }

    /// Takes the next command frame, if it is among the first `frames` frames.
    fn next_until(&mut self, frames: u64) -> Option<TimedFrame> {
        self.look().filter(|(number, _)| *number <= frames)?;
        self.next.take().map(|(_, write)| write)
    }

    /// Takes the next command frame, if `wanted` is true for it.
    fn next_if(&mut self, wanted: impl FnOnce(&TimedFrame) -> bool) -> Option<TimedFrame> {
        self.look().filter(|(_, write)| wanted(write))?;
        self.next.take().map(|(_, write)| write)
    }
}

fn time(ns: u64) -> i64 {
    i64::try_from(ns).unwrap_or(i64::MAX)
}

impl Iterator for ModelRun {
    type Item = TimedFrame;

    fn next(&mut self) -> Option<TimedFrame> {
        loop {
            let observed = self.source.next()?;
            self.frames += 1;
            if let Some(played) = self.play(observed) {
                return Some(played);
            }
        }
    }
}
