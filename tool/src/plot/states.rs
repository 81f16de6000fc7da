//! What state a drive was in, as reports tell it: not enabled, homing, or with a fault; and gaps in its motion.
//!
//! That a drive is homing no field of a report says. It is, from the report that answers GO_HOME until bits 10 and 12 of
//! the statusword say that home is attained, bit 13 that it is not, or the drive leaves Operation enabled, or ABORT_HOME
//! is answered (SK-7). Bits that may still be those of an earlier homing count by the rule of the board: once bits 12 and
//! 13 were seen clear, or when they stay for [`SETTLE_NS`].

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::sk::{CommandId, DriveResponse};

use super::{Window, seconds, style};

/// So long a result must stand that was there from the first report on. As the board's. \[OURS]
const SETTLE_NS: i64 = 20_000_000;

/// A state that is shown; in Operation enabled and not homing nothing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// Neither in Operation enabled nor with a fault.
    NotEnabled,
    /// On the way home.
    Homing,
    /// Fault, or Fault reaction active.
    Fault,
    /// The FIFO was empty on the way.
    Gap,
}

/// A state from one moment to another, in seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// The state.
    pub state: State,
    /// Its beginning.
    pub from: f64,
    /// Its end.
    pub to: f64,
    /// What is to be said of it.
    pub note: Option<String>,
}

/// What a report changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing.
    None,
    /// The drive follows targets from here on. After homing its position has another zero.
    Follows,
    /// It follows no target from here on, and those before are void.
    FollowsNot,
}

/// The states of one drive under construction.
#[derive(Debug)]
pub struct States {
    window: Window,
    /// Of spans of a state that are less apart than this, one is made: no eye could tell them apart.
    apart_ns: i64,
    done: Vec<Piece>,
    now: Option<Piece>,
    homing: Homing,
}

#[derive(Clone, Debug)]
struct Piece {
    state: State,
    from_ns: i64,
    to_ns: i64,
    note: Option<String>,
}

impl States {
    /// Across `window`, drawn `columns` pixels wide.
    pub fn new(window: Window, columns: u32) -> Self {
        let apart_ns = (window.to_ns.saturating_sub(window.from_ns)) / i64::from(columns.max(1));
        Self { window, apart_ns, done: Vec::new(), now: None, homing: Homing::default() }
    }

    /// The host sends GO_HOME.
    pub const fn go_home(&mut self) {
        self.homing.asked = true;
    }

    /// The next report in OP. `aborted`: it answers ABORT_HOME, in whatever slot. `has_code`: the drive's kind has an
    /// error code in its slot.
    pub fn report(&mut self, at_ns: i64, drive: &DriveResponse, aborted: bool, has_code: bool) -> Change {
        let was_homing = self.homing.since_ns.is_some();
        let failed = self.homing.report(at_ns, drive, aborted);
        if failed && let Some(now) = self.now.as_mut().filter(|_| was_homing) {
            now.note = Some("homing error".to_owned());
        }
        let state = match drive.statusword.state() {
            Some(DriveState::Fault | DriveState::FaultReactionActive) => Some(State::Fault),
            _ if !drive.statusword.is_enabled() => Some(State::NotEnabled),
            _ => self.homing.since_ns.map(|_| State::Homing),
        };
        let begins = self.now.as_ref().map(|piece| piece.state) != state;
        if begins {
            self.close(at_ns);
            self.now = state.map(|state| Piece { state, from_ns: at_ns, to_ns: at_ns, note: None });
        }
        if let Some(now) = self.now.as_mut().filter(|now| now.state == State::Fault && now.note.is_none()) {
            now.note = match drive.error_code {
                _ if !has_code => Some("fault".to_owned()),
                // The code may come a cycle later than the state.
                0 => None,
                code => Some(format!("alarm 0x{code:04X}")),
            };
        }
        match (begins, state) {
            (false, _) => Change::None,
            (true, None) => Change::Follows,
            (true, Some(_)) => Change::FollowsNot,
        }
    }

    /// Whether the drive is on the way home.
    pub const fn is_homing(&self) -> bool {
        self.homing.since_ns.is_some()
    }

    /// The FIFO was empty on the way.
    pub fn gap(&mut self, from_ns: i64, to_ns: i64) {
        let milliseconds = (to_ns.saturating_sub(from_ns)) as f64 / 1e6;
        let note = Some(format!("gap {} ms", style::number(milliseconds, style::digits(milliseconds).min(3))));
        self.put(Piece { state: State::Gap, from_ns, to_ns, note });
    }

    /// Nothing is known from here to the next report.
    pub fn interrupt(&mut self, at_ns: i64) {
        self.close(at_ns);
        // Back in OP a slot may still answer the GO_HOME of before.
        self.homing = Homing { answered: self.homing.answered, ..Homing::default() };
    }

    /// The spans, as far as they are in the window.
    pub fn finish(mut self) -> Vec<Span> {
        self.close(self.window.to_ns);
        let mut spans: Vec<Span> = self.done.into_iter().map(Piece::into_span).collect();
        spans.sort_by(|a, b| a.from.total_cmp(&b.from));
        spans
    }

    fn close(&mut self, at_ns: i64) {
        if let Some(piece) = self.now.take() {
            self.put(Piece { to_ns: at_ns, ..piece });
        }
    }

    /// Keeps what of it is in the window.
    fn put(&mut self, mut piece: Piece) {
        let Window { from_ns, to_ns } = self.window;
        if piece.from_ns > to_ns || piece.to_ns < from_ns {
            return;
        }
        (piece.from_ns, piece.to_ns) = (piece.from_ns.max(from_ns), piece.to_ns.min(to_ns));
        let before = self.done.iter_mut().rev().find(|before| before.state == piece.state);
        match before {
            Some(before) if piece.from_ns.saturating_sub(before.to_ns) < self.apart_ns => {
                before.to_ns = piece.to_ns;
                if piece.state == State::Gap {
                    before.note = Some("gaps".to_owned());
                }
            }
            _ => self.done.push(piece),
        }
    }
}

impl Piece {
    fn into_span(self) -> Span {
        Span { state: self.state, from: seconds(self.from_ns), to: seconds(self.to_ns), note: self.note }
    }
}

/// Whether a drive is homing.
#[derive(Debug, Default)]
struct Homing {
    /// GO_HOME was sent, and no homing has begun since.
    asked: bool,
    /// The last report answered GO_HOME.
    answered: bool,
    since_ns: Option<i64>,
    clear_seen: bool,
}

impl Homing {
    /// Whether the search ends with this report by an error.
    fn report(&mut self, at_ns: i64, drive: &DriveResponse, aborted: bool) -> bool {
        let answers = CommandId::from_code(drive.head.id) == CommandId::GoHome;
        let answered = std::mem::replace(&mut self.answered, answers);
        let Some(since_ns) = self.since_ns else {
            if answers && (self.asked || !answered) && drive.statusword.is_enabled() {
                *self = Self { asked: false, answered: true, since_ns: Some(at_ns), clear_seen: false };
                self.see(drive.statusword);
            }
            return false;
        };
        self.see(drive.statusword);
        let Statusword(word) = drive.statusword;
        let error = word & Statusword::BIT13 != 0;
        let attained = word & Statusword::BIT12 != 0 && word & Statusword::TARGET_REACHED != 0;
        let counts = self.clear_seen || at_ns.saturating_sub(since_ns) >= SETTLE_NS;
        let ended = aborted || !drive.statusword.is_enabled() || (counts && (error || attained));
        if ended {
            *self = Self { answered: answers, ..Self::default() };
        }
        ended && counts && error
    }

    fn see(&mut self, Statusword(word): Statusword) {
        self.clear_seen |= word & (Statusword::BIT12 | Statusword::BIT13) == 0;
    }
}
