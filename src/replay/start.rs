//! Where a replay begins in a recording, and at which moment of a cycle.

use super::ReplayError;
use crate::compare::{Observed, Source};
use crate::link::Dir;
use crate::sk::{MasterResponse, MasterState, SlotSize};

/// The board's cycle before OP (SK-4).
pub(super) const CYCLE_NS: i64 = 1_000_000;
/// Reports that are looked at for their place in the cycle. \[OURS]
const LOOK_AT: usize = 500;

/// Where a replay begins. The model was just switched on: so the recording has to begin with a board that is in Init or
/// PreOP, or what comes before it is there is left out. \[OURS]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    /// Frames before it.
    pub skipped: u64,
    /// A moment at which a cycle of the board ended, nanoseconds of the recording: reports come then.
    ///
    /// A report is late by what USB and the host take, and never early: it is the earliest place in the cycle that a
    /// report before OP had. \[OURS]
    pub tick_ns: i64,
    /// When the recording's first frame passed on the clock of the model that was recorded, if it was one.
    pub began: Option<i64>,
}

impl Start {
    pub(super) fn find(source: &mut Source, name: &str, size: SlotSize) -> Result<Self, ReplayError> {
        let board = source.board();
        let (mut skipped, mut commands, mut seen) = (0, 0, 0_usize);
        let mut first = None;
        let mut tick: Option<Tick> = None;
        for Observed { at_ns, dir, frame, .. } in source.by_ref() {
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
                // All that came before is left out, the commands before this report too.
                None if is_first => skipped += commands + 1,
                None => skipped += 1,
                Some(tick) if state.state() == Some(MasterState::Op) || seen > LOOK_AT => {
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

/// The place of reports in their cycle.
struct Tick {
    first_ns: i64,
    /// How much earlier than the first one another came, at most.
    early_ns: i64,
}

impl Tick {
    fn report(&mut self, at_ns: i64) {
        let apart = at_ns.saturating_sub(self.first_ns).rem_euclid(CYCLE_NS);
        let apart = if apart > CYCLE_NS / 2 { apart - CYCLE_NS } else { apart };
        self.early_ns = self.early_ns.min(apart);
    }

    const fn start(&self, skipped: u64) -> Start {
        Start { skipped, tick_ns: self.first_ns + self.early_ns, began: None }
    }
}
