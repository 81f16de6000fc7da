//! Determines the states of a drive from its reports: not enabled, homing, or with a fault. It also determines gaps in
//! the motion, and whether the slave is lost.
//!
//! No report says which slave is lost. The report only shows state 0x18, and the slot of the lost slave keeps its last
//! values (SK-4.61). So a slave counts as lost from the first report with 0x18 on, as long as the state lasts and the
//! slot does not change. A connected slave whose axis is at rest looks the same until the axis moves.
//!
//! No field of a report says that a drive is homing. Homing begins with the report that answers GO_HOME. It ends when
//! bits 10 and 12 of the statusword report that home is attained, bit 13 reports an error, the drive leaves Operation
//! enabled, or ABORT_HOME is answered (SK-7). Bits 12 and 13 may still be set from an earlier homing. So, as in the
//! board, they count only after both were clear, or [`SETTLE_NS`] after homing began.

use ecmsk::cia402::{DriveState, ErrorCode, Statusword};
use ecmsk::sk::{CommandId, DriveResponse};

use super::{Window, seconds, style};

/// In this time after the beginning of homing, its result bits count only after both were clear. Bits that are set from
/// the first report on may be of an earlier homing. After this time the bits count in any case, as in the board.
/// \[OURS]
const SETTLE_NS: i64 = 20_000_000;

/// A state that the plot shows. Operation enabled without homing is the normal state and is not shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// Neither in Operation enabled nor with a fault.
    NotEnabled,
    /// The drive is homing.
    Homing,
    /// Fault, or Fault reaction active.
    Fault,
    /// The FIFO was empty while the axis was moving.
    Gap,
    /// The board is in state 0x18, and the slot of the slave does not change.
    Lost,
    /// The board is in state 0x18: OP with a lost slave.
    Failed,
}

/// A note that the plot writes at the beginning of a state, such as the alarm of a fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// The note in few words, such as an error code alone.
    pub brief: String,
    /// The note with its meaning, shown where there is room.
    pub full: String,
}

impl Note {
    fn new(text: impl Into<String>) -> Self {
        let brief = text.into();
        Self { full: brief.clone(), brief }
    }

    fn alarm(code: u16) -> Self {
        Self { brief: format!("alarm 0x{code:04X}"), full: format!("alarm {}", ErrorCode(code)) }
    }

    /// The same note, preceded by the name of the second recording.
    pub fn of(&self, name: &str) -> Self {
        Self { brief: format!("{}, {name}", self.brief), full: format!("{}, {name}", self.full) }
    }
}

/// The time span of a state.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// The state of the drive or of the board in this time span.
    pub state: State,
    /// The beginning in seconds of the recording's time.
    pub from: f64,
    /// The end in seconds of the recording's time.
    pub to: f64,
    /// The note on the state, such as the error code.
    pub note: Option<Note>,
}

/// How a report changes whether the drive follows targets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// The report changes nothing.
    None,
    /// From here on the drive follows targets. If it was homing until now, its position has a new zero.
    Follows,
    /// From here on the drive follows no target, and earlier targets are void.
    FollowsNot,
}

/// Collects the states of one drive while reports are read.
#[derive(Debug)]
pub struct States {
    window: Window,
    /// Two spans of the same state are merged if the time between them is less than this, which is the width of one
    /// pixel.
    apart_ns: i64,
    done: Vec<Piece>,
    now: Option<Piece>,
    homing: Homing,
    /// The time from which on the slave may be lost, in nanoseconds of the recording's time; `None` if it is connected.
    lost_since_ns: Option<i64>,
}

#[derive(Clone, Debug)]
struct Piece {
    state: State,
    from_ns: i64,
    to_ns: i64,
    note: Option<Note>,
}

impl States {
    /// Creates an empty list of states for the time range `window`, which is drawn `columns` pixels wide.
    pub fn new(window: Window, columns: u32) -> Self {
        let apart_ns = (window.to_ns.saturating_sub(window.from_ns)) / i64::from(columns.max(1));
        Self { window, apart_ns, done: Vec::new(), now: None, homing: Homing::default(), lost_since_ns: None }
    }

    /// Must be called when the host sends GO_HOME.
    pub const fn go_home(&mut self) {
        self.homing.ask();
    }

    /// Adds the next report in OP. `aborted`: one of its slots answers ABORT_HOME. `has_code`: a slave of this kind has an
    /// error code in its slot.
    pub fn report(&mut self, at_ns: i64, drive: &DriveResponse, aborted: bool, has_code: bool) -> Change {
        let was_homing = self.homing.is_under_way();
        let failed = self.homing.report(at_ns, drive, aborted);
        if failed && let Some(now) = self.now.as_mut().filter(|_| was_homing) {
            now.note = Some(Note::new("homing error"));
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
                _ if !has_code => Some(Note::new("fault")),
                // The error code may come one cycle later than the state, so while it is 0 the note is left to a later
                // report.
                0 => None,
                code => Some(Note::alarm(code)),
            };
        }
        match (begins, state) {
            (false, _) => Change::None,
            (true, None) => Change::Follows,
            (true, Some(_)) => Change::FollowsNot,
        }
    }

    /// The slave may be lost from `at_ns` on, so the states in its reports are not used.
    pub fn may_be_lost(&mut self, at_ns: i64) {
        self.close(at_ns);
        self.homing.interrupt();
        self.lost_since_ns = Some(at_ns);
    }

    /// Ends the suspicion that the slave is lost. `was_lost`: `Some(true)` if the slave was certainly lost until now,
    /// `Some(false)` if possibly, `None` if it was never lost.
    pub fn is_there(&mut self, at_ns: i64, was_lost: Option<bool>) {
        if let Some((from_ns, is_certain)) = self.lost_since_ns.take().zip(was_lost) {
            let note = if is_certain { "lost" } else { "lost?" };
            self.put(Piece { state: State::Lost, from_ns, to_ns: at_ns, note: Some(Note::new(note)) });
        }
    }

    /// Adds the time span of state 0x18.
    pub fn failed(&mut self, from_ns: i64, to_ns: i64) {
        self.put(Piece { state: State::Failed, from_ns, to_ns, note: Some(Note::new("0x18")) });
    }

    /// Whether the drive is homing.
    pub const fn is_homing(&self) -> bool {
        self.homing.is_under_way()
    }

    /// Adds a gap: a time in which the FIFO was empty while the axis was moving.
    pub fn gap(&mut self, from_ns: i64, to_ns: i64) {
        let milliseconds = (to_ns.saturating_sub(from_ns)) as f64 / 1e6;
        let note =
            Some(Note::new(format!("gap {} ms", style::number(milliseconds, style::digits(milliseconds).min(3)))));
        self.put(Piece { state: State::Gap, from_ns, to_ns, note });
    }

    /// Ends the present state, because the state is unknown until the next report in OP.
    pub fn interrupt(&mut self, at_ns: i64) {
        self.close(at_ns);
        self.homing.interrupt();
    }

    /// Returns the spans within the window, sorted by their beginning.
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

    /// Adds the part of the span that is in the window.
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
                    before.note = Some(Note::new("gaps"));
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

/// Tracks whether a drive is homing.
#[derive(Debug, Default)]
pub struct Homing {
    /// Whether the host has sent GO_HOME and no homing has begun since.
    asked: bool,
    /// Whether the last report answered GO_HOME.
    answered: bool,
    since_ns: Option<i64>,
    clear_seen: bool,
}

impl Homing {
    /// Must be called when the host sends GO_HOME.
    pub const fn ask(&mut self) {
        self.asked = true;
    }

    /// Whether the drive is homing.
    pub const fn is_under_way(&self) -> bool {
        self.since_ns.is_some()
    }

    /// Ends the homing, because its end cannot be observed until the next report in OP. After that, the slot may still
    /// answer the earlier GO_HOME; this answer does not count as a new homing.
    pub fn interrupt(&mut self) {
        *self = Self { answered: self.answered, ..Self::default() };
    }

    /// Adds a report. Returns true if it ends the homing with an error.
    pub fn report(&mut self, at_ns: i64, drive: &DriveResponse, aborted: bool) -> bool {
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
