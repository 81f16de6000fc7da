//! Finds problems in the frames of a program: alarms, failed changes of state, gaps in a motion, and frames lost
//! because of a full FIFO or a wrong CRC.

use super::gaps::GapFinder;
use super::line::{Alarm, HeldBack, StateFailed};
use crate::ethercat::cia402::{DriveState, Statusword};
use crate::recording::Kinds;
use crate::sk::dump::MAX_SLAVES;
use crate::sk::{
    CommandId, DriveResponse, FIFO_ENTRIES, Frame, HspResponse, MasterCommand, MasterResponse, MasterState, SlaveKind,
    SlotSize, StateByte,
};

/// \[OURS] A drive holds its axis back if it shows an internal limit for this long while the axis is at rest, ns.
const HELD_MIN_NS: i64 = 150_000_000;
/// \[OURS] An axis counts as at rest while its position changes by at most this many counts.
const STANDING_COUNTS: u32 = 16;

/// An event that was found in a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameEvent {
    /// A drive has a new alarm.
    Alarm(Alarm),
    /// A drive holds its axis back, and it did not before.
    HeldBack(HeldBack),
    /// A change of the AL state has failed.
    StateFailed(StateFailed),
}

/// Counts from the frames of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// The number of command frames.
    pub commands: u64,
    /// The number of reports.
    pub reports: u64,
    /// The number of command frames lost because of a full FIFO, by the FIFO-full count in slot 0.
    pub full: u64,
    /// The number of command frames with a wrong CRC, by the error count in slot 0.
    pub crc: u64,
    /// The number of gaps in a motion: the FIFO ran empty while at least one axis was moving.
    pub gaps: u64,
    /// The state above the present one that the program has requested last, as long as the board has neither reached it nor
    /// reported a failure; `None` otherwise. The second value is how long the program has waited for it up to the newest
    /// report, ms (at least 1).
    pub unreached: Option<(MasterState, u64)>,
}

/// Watches the frames of a run, which have to be sorted by time. Does not allocate memory.
#[derive(Debug)]
pub struct FrameWatch {
    size: SlotSize,
    kinds: Kinds,
    /// Whether SET_AXIS has declared a slave of another kind than IO since the last reset of the board.
    declared: bool,
    state: StateByte,
    /// The time of the request for the state in [`FrameCounts::unreached`], ns on the clock of the frames.
    asked_ns: i64,
    /// Whether the program still waits for that state: since then it has not requested a state that the board already
    /// had.
    is_waiting: bool,
    /// The FIFO-full count and the CRC error count in the last report of OP. An increase means lost command frames.
    losses: Option<(u16, u8)>,
    /// The error code of each slave that has an alarm.
    alarms: [Option<u16>; MAX_SLAVES],
    /// For each slave whose drive shows an internal limit while the axis is at rest: since when, at which position, and
    /// whether that was reported.
    held: [Option<(i64, i32, bool)>; MAX_SLAVES],
    gaps: [GapFinder; MAX_SLAVES],
    /// The time of the newest command frame, ns.
    sent_ns: i64,
    /// The number of reports with an empty FIFO since the newest command frame. The first one only shows that the newest target
    /// was executed, which is normal for a program that sends one target per cycle. A second one is a gap in a motion.
    idle_reports: u32,
    counts: FrameCounts,
    damage_before: u64,
}

impl FrameWatch {
    /// Watches frames with slots of this size.
    pub fn new(size: SlotSize) -> Self {
        Self {
            size,
            kinds: Kinds::new(None),
            declared: false,
            state: StateByte::default(),
            asked_ns: 0,
            is_waiting: false,
            losses: None,
            alarms: [None; MAX_SLAVES],
            held: [None; MAX_SLAVES],
            gaps: std::array::from_fn(|_| GapFinder::default()),
            sent_ns: i64::MIN,
            idle_reports: 0,
            counts: FrameCounts::default(),
            damage_before: 0,
        }
    }

    /// The counts so far.
    pub const fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// To be called before each frame of a recording that may be damaged, with its
    /// [`damage_before`](crate::recording::Recorded::damage_before). The frames that the damage has destroyed then
    /// count neither as a gap in a motion nor as lost command frames.
    pub fn damage(&mut self, damage_before: u64) {
        if damage_before > self.damage_before {
            self.damage_before = damage_before;
            (self.losses, self.idle_reports) = (None, 0);
            self.held = [None; MAX_SLAVES];
            self.gaps.iter_mut().for_each(GapFinder::reset);
        }
    }

    /// Examines a command frame that was sent at `at_ns`, ns on the clock of the link or the recording.
    pub fn command(&mut self, at_ns: i64, frame: &Frame) {
        self.counts.commands += 1;
        self.sent_ns = at_ns;
        self.idle_reports = 0;
        self.kinds.command(frame, self.size);
        if self.state.state() != Some(MasterState::Op) {
            match MasterCommand::decode(&frame.slot(self.size, 0), self.size) {
                Ok(MasterCommand::SetAxis { kinds, .. }) => {
                    self.declared |= kinds.iter().any(|kind| !matches!(kind, SlaveKind::Io | SlaveKind::None));
                }
                Ok(MasterCommand::SoftReset) => {
                    self.declared = false;
                    self.counts.unreached = None;
                }
                Ok(MasterCommand::SetState(wanted)) => {
                    self.is_waiting = Some(wanted) > self.state.state();
                    if self.is_waiting {
                        self.counts.unreached = Some((wanted, 1));
                        self.asked_ns = at_ns;
                    }
                }
                _ => {}
            }
            return;
        }
        let mut is_gap = false;
        for (slave, gaps) in (1..=self.size.max_slaves()).zip(&mut self.gaps) {
            let slot = frame.slot(self.size, slave);
            match CommandId::from_code(slot.id) {
                CommandId::Csp => is_gap |= gaps.target(at_ns, slot.data1 as i32).is_some(),
                CommandId::GetStatus => {}
                _ => gaps.reset(),
            }
        }
        self.counts.gaps += u64::from(is_gap);
    }

    /// Examines a report that the board sent at `at_ns`, ns on the same clock as in [`Self::command`]. Calls `on_event` for
    /// each event in it.
    pub fn report(&mut self, at_ns: i64, frame: &Frame, on_event: &mut dyn FnMut(FrameEvent)) {
        self.counts.reports += 1;
        self.kinds.response(frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let before = std::mem::replace(&mut self.state, board.state);
        if board.state.is_failed() && before != board.state {
            on_event(FrameEvent::StateFailed(StateFailed { state: board.state.0, declared: self.declared }));
        }
        if let Some((wanted, ms)) = &mut self.counts.unreached {
            if board.state.is_failed() || board.state.state() >= Some(*wanted) {
                self.counts.unreached = None;
            } else if self.is_waiting {
                *ms = (at_ns.saturating_sub(self.asked_ns).max(0) as u64 / 1_000_000).max(1);
            }
        }
        if !matches!(board.state.state(), Some(MasterState::SafeOp | MasterState::Op)) {
            // Below SafeOP reports have no FIFO counts, and the slaves' slots have no process data.
            self.losses = None;
            self.held = [None; MAX_SLAVES];
            self.gaps.iter_mut().for_each(GapFinder::reset);
            return;
        }
        if board.state.state() == Some(MasterState::Op) {
            let (full, crc) =
                self.losses.replace((board.full_count, board.error)).unwrap_or((board.full_count, board.error));
            self.counts.full += u64::from(board.full_count.wrapping_sub(full));
            self.counts.crc += u64::from(board.error.wrapping_sub(crc));
            if board.fifo_free >= FIFO_ENTRIES && at_ns > self.sent_ns {
                self.idle_reports = self.idle_reports.saturating_add(1);
                // The first report with an empty FIFO only shows that the newest target was executed, which is normal
                // for a program that sends one target per cycle.
                if self.idle_reports > 1 {
                    self.gaps.iter_mut().for_each(|gaps| gaps.idle(at_ns));
                }
            }
        }
        for slave in 1..=self.size.max_slaves() {
            let kind = self.kinds.of(slave);
            if matches!(kind, Some(SlaveKind::Io | SlaveKind::None)) {
                continue;
            }
            let slot = frame.slot(self.size, slave);
            // If the frames begin after SET_AXIS, the kind of the slave is unknown. A slot that answers a command for axes is
            // treated as that of a drive, any other slot is skipped.
            if kind.is_none() && !CommandId::from_code(slot.id).is_for_axes() {
                continue;
            }
            let drive = DriveResponse::decode(&slot);
            let code = if kind == Some(SlaveKind::Hsp) { 0 } else { drive.error_code };
            self.alarm(at_ns, slave, is_fault(drive.statusword).then_some(code), on_event);
            let is_hsp = kind == Some(SlaveKind::Hsp);
            let position = if is_hsp { HspResponse::decode(&slot, self.size).first.position } else { drive.position };
            // An internal limit is expected during homing, which may end at a stop, and in CST, where an axis may push
            // on purpose.
            let is_held = drive.statusword.is_enabled()
                && drive.statusword.0 & Statusword::INTERNAL_LIMIT != 0
                && !matches!(CommandId::from_code(slot.id), CommandId::GoHome | CommandId::Cst);
            self.held_back(at_ns, slave, is_held.then_some(position), on_event);
        }
    }

    /// Updates since when a slave's axis is held back. `at` is the position of the axis if its drive shows an internal
    /// limit; otherwise `None`.
    fn held_back(&mut self, at_ns: i64, slave: usize, at: Option<i32>, on_event: &mut dyn FnMut(FrameEvent)) {
        let held = &mut self.held[slave - 1];
        let Some(position) = at else {
            *held = None;
            return;
        };
        let stands = |(_, from, _): &(i64, i32, bool)| from.wrapping_sub(position).unsigned_abs() <= STANDING_COUNTS;
        let (since_ns, from, is_reported) = held.filter(stands).unwrap_or((at_ns, position, false));
        let is_event = !is_reported && at_ns.saturating_sub(since_ns) >= HELD_MIN_NS;
        *held = Some((since_ns, from, is_reported || is_event));
        if is_event {
            on_event(FrameEvent::HeldBack(HeldBack { slave: slave as u8, position, at_ns: Some(at_ns) }));
        }
    }

    fn alarm(&mut self, at_ns: i64, slave: usize, now: Option<u16>, on_event: &mut dyn FnMut(FrameEvent)) {
        let before = std::mem::replace(&mut self.alarms[slave - 1], now);
        // A drive may report the fault one cycle before its error code. This gives two events.
        if let Some(code) = now
            && before.is_none_or(|before| before != code && code != 0)
        {
            on_event(FrameEvent::Alarm(Alarm { slave: slave as u8, code, at_ns: Some(at_ns) }));
        }
    }
}

fn is_fault(statusword: Statusword) -> bool {
    matches!(statusword.state(), Some(DriveState::Fault | DriveState::FaultReactionActive))
}
