//! Finds where a replay begins in a recording, and when the cycles of the recorded board end.

use super::ReplayError;
use crate::compare::{RecordedRun, TimedFrame};
use crate::link::Dir;
use crate::sk::{MasterResponse, MasterState, SlotSize};

/// The board's cycle time before OP (SK-4).
pub(super) const CYCLE_NS: i64 = 1_000_000;
/// The maximum number of reports that are used to find the times at which the board's cycles end. \[OURS]
const REPORTS_FOR_TICK: usize = 500;

/// Where a replay begins. The model starts like a board that was just powered on, so the replay begins at the first
/// report in Init or PreOP, and skips the frames before it. If this is the first report of the recording, the command
/// frames before it are replayed, too. \[OURS]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplayStart {
    /// The number of frames before the start.
    pub skipped: u64,
    /// The end of a cycle of the recorded board, in nanoseconds on the clock of the recording. At the end of a cycle
    /// the board sends a report.
    ///
    /// USB and the host can only delay reports, so the report before OP that came earliest in its cycle defines this
    /// time. \[OURS]
    pub tick_ns: i64,
    /// The time of the recording's first frame on the recorded model's clock, in nanoseconds; `None` if no model was
    /// recorded.
    pub model_clock_ns: Option<i64>,
}

impl ReplayStart {
    pub(super) fn find(source: &mut RecordedRun, name: &str, size: SlotSize) -> Result<Self, ReplayError> {
        let board = source.board();
        let (mut skipped, mut commands, mut seen) = (0, 0, 0_usize);
        let mut first = None;
        let mut tick: Option<Tick> = None;
        for TimedFrame { at_ns, dir, frame, .. } in source.by_ref() {
            if dir == Dir::Write {
                commands += 1;
                skipped += u64::from(first.is_some() && tick.is_none());
                continue;
            }
            let state = MasterResponse::decode(&frame.slot(size, 0)).state;
            let is_first = first.is_none();
            first.get_or_insert(state);
            let below = matches!(state.state(), Some(MasterState::Init | MasterState::PreOp));
            match &mut tick {
                None if below => tick = Some(Tick { first_ns: at_ns, early_ns: 0 }),
                // This report is not the start: it is skipped, and so are the commands before it.
                None if is_first => skipped += commands + 1,
                None => skipped += 1,
                Some(tick) if state.state() == Some(MasterState::Op) || seen > REPORTS_FOR_TICK => {
                    return Ok(tick.start(skipped));
                }
                Some(tick) => tick.report(at_ns),
            }
            seen += 1;
        }
        source.check()?;
        match (tick, first) {
            (Some(tick), _) => Ok(tick.start(skipped)),
            (None, Some(state)) => Err(ReplayError::NoStart { name: name.to_owned(), state }),
            (None, None) => Err(ReplayError::NoReport { name: name.to_owned(), board, commands }),
        }
    }
}

/// Finds the ends of the board's cycles from the times of its reports.
struct Tick {
    first_ns: i64,
    /// The phase of the report that came earliest in its cycle, relative to the first report, ns; 0 or negative.
    early_ns: i64,
}

impl Tick {
    fn report(&mut self, at_ns: i64) {
        let apart = at_ns.saturating_sub(self.first_ns).rem_euclid(CYCLE_NS);
        let apart = if apart > CYCLE_NS / 2 { apart - CYCLE_NS } else { apart };
        self.early_ns = self.early_ns.min(apart);
    }

    const fn start(&self, skipped: u64) -> ReplayStart {
        ReplayStart { skipped, tick_ns: self.first_ns + self.early_ns, model_clock_ns: None }
    }
}
