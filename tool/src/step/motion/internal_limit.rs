//! Detects that a drive keeps an axis away from its targets, by bit 11 of the statusword (internal limit active, CiA
//! 402). Reasons are a limit switch, a software limit, or too little torque.

use ecmsk::cia402::Statusword;
use ecmsk::ecm::Snapshot;

use crate::board::{Board, NEAR_COUNTS};

/// \[OURS] An axis counts as at rest if its position changes by at most this many counts, because encoders have noise.
const STANDING_COUNTS: u32 = 16;

/// Tracks from cycle to cycle whether an internal limit keeps an axis away from its target.
#[derive(Clone, Copy, Debug)]
pub struct Watched {
    pub slave: u8,
    /// Since when the axis is at rest under an internal limit, in seconds since the move began, and its position then;
    /// `None` if it is not.
    since: Option<(f64, i32)>,
}

impl Watched {
    pub const fn new(slave: u8) -> Self {
        Self { slave, since: None }
    }

    /// Examines the latest report, `seconds` after the move began. Returns for how many seconds an internal limit has
    /// kept the axis away from its target.
    pub fn held_for(&mut self, board: &Board, now: &Snapshot, target: i32, seconds: f64) -> f64 {
        let at = now.position(self.slave).unwrap_or_default();
        if !is_limited(board, now, self.slave) || target.wrapping_sub(at).unsigned_abs() <= NEAR_COUNTS {
            self.since = None;
            return 0.0;
        }
        let stands = |(_, place): &(f64, i32)| place.wrapping_sub(at).unsigned_abs() <= STANDING_COUNTS;
        let (since, place) = self.since.filter(stands).unwrap_or((seconds, at));
        self.since = Some((since, place));
        seconds - since
    }
}

/// Whether the statusword of an axis has bit 11, internal limit active.
pub fn is_limited(board: &Board, now: &Snapshot, slave: u8) -> bool {
    board.statusword(now, slave).0 & Statusword::INTERNAL_LIMIT != 0
}

/// What an internal limit is, for error texts.
pub const WHY: &str = "its drive holds it back (internal limit active, statusword bit 11)";
/// What the user can check after an internal limit, for error texts.
pub const NEXT: &str = "see its limit switches (0x60FD), its software limits (0x607D), its torque limit and its load";
