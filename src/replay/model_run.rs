//! The run of the model, to which the command frames of a recording are played.

use super::Start;
use super::start::CYCLE_NS;
use crate::compare::{RecordedRun, TimedFrame};
use crate::engine::Board;
use crate::link::Dir;
use crate::sk::Frame;

/// How long a recorded model may have run before its first frame. Its clock is taken over exactly up to this. \[OURS]
const RUN_BEFORE_MAX_NS: i64 = 60_000_000_000;

/// The run of the model: the recorded command frames, each at its time, and the model's reports to them. Times are those of
/// the recording.
///
/// Whenever the host has received a report in the recording, it receives the newest report of the model, unless it has
/// received that already. \[OURS]
pub struct ModelRun {
    source: RecordedRun,
    board: Board,
    /// The model's time minus the recording's time.
    offset_ns: i64,
    /// The model's newest report, if the host has not received it yet.
    newest: Option<Frame>,
    reports: u64,
    begun: bool,
    start: Start,
}

impl ModelRun {
    pub(super) fn new(source: RecordedRun, board: Board, start: &Start) -> Self {
        let mut model = Self { source, board, offset_ns: 0, newest: None, reports: 0, begun: false, start: *start };
        model.offset_ns = time(model.board.next_cycle()).saturating_sub(start.tick_ns);
        model
    }

    /// At the first frame, chooses the offset between the two clocks: the recorded one if a model was recorded, otherwise one
    /// by which the model's cycles end when the recorded board's cycles did.
    fn begin(&mut self, first_ns: i64) {
        let now = time(self.board.now());
        if let Some(began) = self.start.began
            && (now..now.saturating_add(RUN_BEFORE_MAX_NS)).contains(&began.saturating_add(first_ns))
        {
            self.offset_ns = began;
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
        let Self { board, newest, offset_ns, .. } = self;
        let mut keep = |frame: &Frame, _| *newest = Some(frame.clone());
        let at = observed.at_ns.saturating_add(*offset_ns).max(0).unsigned_abs();
        match observed.dir {
            Dir::Write => {
                board.host(&observed.frame, at, &mut keep);
                Some(observed)
            }
            Dir::Read => {
                board.advance(at, &mut keep);
                let frame = newest.take()?;
                self.reports += 1;
                Some(TimedFrame { number: self.reports, frame, ..observed })
            }
        }
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
            if let Some(played) = self.play(observed) {
                return Some(played);
            }
        }
    }
}
