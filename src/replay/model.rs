//! The model, with the host's half of a recording played to it.

use super::Start;
use super::start::CYCLE_NS;
use crate::compare::{Observed, Source};
use crate::engine::Board;
use crate::link::Dir;
use crate::sk::Frame;

/// How far a recorded model may have run before its first frame for its time to be taken over as it is. \[OURS]
const LONGEST_WAIT_NS: i64 = 60_000_000_000;

/// What passes between the host and the model: the host's frames, each at its time, and the model's reports. Times are
/// those of the recording.
///
/// Whenever the host got a report of the board, it gets the newest of the model: it looks at both at the same moments. One
/// that it has seen already it does not get again. \[OURS]
pub struct Model {
    source: Source,
    board: Board,
    /// The model's time less that of the recording.
    offset_ns: i64,
    /// Its newest report that the host has not seen.
    newest: Option<Frame>,
    reports: u64,
    begun: bool,
    start: Start,
}

impl Model {
    pub(super) fn new(source: Source, board: Board, start: &Start) -> Self {
        let mut model = Self { source, board, offset_ns: 0, newest: None, reports: 0, begun: false, start: *start };
        model.offset_ns = time(model.board.next_cycle()).saturating_sub(start.tick_ns);
        model
    }

    /// The first frame: the two times are put beside each other. A model that was recorded has its own; else cycles end at
    /// the same moments in both.
    fn begin(&mut self, first_ns: i64) {
        let now = time(self.board.now());
        if let Some(began) = self.start.began
            && (now..now.saturating_add(LONGEST_WAIT_NS)).contains(&began.saturating_add(first_ns))
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

    fn play(&mut self, observed: Observed) -> Option<Observed> {
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
                Some(Observed { number: self.reports, frame, ..observed })
            }
        }
    }
}

fn time(ns: u64) -> i64 {
    i64::try_from(ns).unwrap_or(i64::MAX)
}

impl Iterator for Model {
    type Item = Observed;

    fn next(&mut self) -> Option<Observed> {
        loop {
            let observed = self.source.next()?;
            if let Some(seen) = self.play(observed) {
                return Some(seen);
            }
        }
    }
}
