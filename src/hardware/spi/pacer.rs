//! Decides when the next exchange is due and what it carries. The pacer only keeps state: it neither reads a clock nor
//! waits, and its caller passes the present time.
//!
//! On SPI every exchange carries a command frame. In OP each command frame takes an entry of the board's FIFO, from
//! which the board removes one entry per cycle. So the link makes one exchange per cycle, timed by this machine's
//! clock. That clock and the board's clock differ a little, so the FIFO level in the reports slowly rises or falls. If
//! the level is above the target, an exchange is skipped; if it is below, the next frames of the program are sent in
//! extra exchanges. Reports show the level of about one exchange before, so after each such correction some reports are
//! ignored.

use super::sent_frames::SentFrames;
use crate::ethercat::Ns;
use crate::sk::{
    CommandId, CycleTime, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SlotSize,
};

/// The target level without prefill: one entry, so that the FIFO is not empty when an exchange is a little late.
/// \[OURS]
const LEVEL_MIN: u16 = 1;
/// Exchanges are skipped if the level is at least this far above the target. A difference of one is no drift of the
/// clocks: it depends on whether an exchange is just before or just after the board takes an entry. \[OURS]
const LEVEL_SLACK: u16 = 2;
/// The maximum number of exchanges that are skipped in a row. The exchange after them is made in any case, because only
/// exchanges bring reports. \[OURS]
const SKIPPED_IN_A_ROW_MAX: u16 = 8;
/// After a skipped or an extra exchange, this many reports are ignored: their FIFO levels are from before that
/// exchange. \[OURS]
const IGNORED_REPORTS: u8 = 2;
/// While the FIFO level is this high, no frame of the program is sent: frames wait in the link. Two entries stay free
/// as a margin. \[OURS]
const LEVEL_MAX: u16 = FIFO_ENTRIES - 2;
/// The maximum of [`Pacer::reserve`], the entries that are kept in the FIFO for some time after this machine was late.
/// \[OURS]
const RESERVE_MAX: u16 = 32;
/// After this many regular exchanges without a late one the reserve shrinks by one entry. \[OURS]
const RESERVE_DECAY_EXCHANGES: u32 = 2000;
/// The maximum number of sent frames that the FIFO level in an answer does not include yet, because they are newer than
/// the answer. \[OURS]
const UNREPORTED_ENTRIES_MAX: u16 = 2;
/// The maximum age, in cycles, of the FIFO level and the other data in an answer. \[OURS]
const ANSWER_AGE_MAX_CYCLES: Ns = 2;
/// The maximum target for the FIFO level, even if a program sets a higher threshold. It is below the size of the FIFO,
/// so that the level can be above the target without a loss of frames. \[OURS]
const TARGET_LEVEL_MAX: u16 = FIFO_ENTRIES - 5;

/// What command frame an exchange sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeContent {
    /// The oldest frame of the program that has not been sent yet.
    Host,
    /// A frame of the link itself, with GET_STATUS in every slot.
    Status,
    /// SET_FIFO with the threshold for the prefill: the board executes nothing until that many entries have arrived.
    Prefill,
    /// SET_FIFO with the default threshold: the link is being closed during the prefill, and the board shall execute
    /// the entries in its FIFO without waiting for more.
    Release,
}

/// What the link's thread has to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacerPlan {
    /// Wait until that time, or until the program writes a frame.
    Wait(Ns),
    /// An exchange is due now.
    Exchange {
        /// What command frame the exchange sends.
        content: ExchangeContent,
        /// Whether the exchange is an extra one, besides the regular exchange that each cycle has.
        extra: bool,
    },
}

/// A summary of the program's frames that wait in the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WaitingFrames {
    /// The number of waiting frames.
    pub frames: usize,
    /// Whether the oldest waiting frame contains a motion command (CSP, CSV or CST).
    pub motion: bool,
    /// Whether the link is being closed: no more frames will follow, and the waiting ones are sent as fast as possible.
    pub last: bool,
}

/// The settings of a link that its pacer needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacerOptions {
    /// The board's slot size.
    pub slot: SlotSize,
    /// The cycle time in OP, until the program sets another one by SET_DC.
    pub cycle: CycleTime,
    /// How many command frames to keep in the board's FIFO ahead of their execution.
    pub prefill: u16,
    /// The shortest time between the starts of two exchanges, in nanoseconds; 0 if BUSY shows when the board is ready.
    pub period_ns: Ns,
    /// The time that the transfer of one frame takes, in nanoseconds.
    pub wires_ns: Ns,
}

/// How far the FIFO has been filled with the prefill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PrefillState {
    /// The threshold has not been set since OP was reached or the FIFO was cleared.
    Unset,
    /// The threshold is set and the board waits for more entries; this many have been sent since.
    Waiting(u16),
    /// No prefill is needed any more: the FIFO was filled up to the threshold, or the program sets thresholds itself.
    Done,
}

/// Counters of a pacer since it was created.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacerCounts {
    /// Number of all exchanges.
    pub exchanges: u64,
    /// Number of exchanges with a frame of the program.
    pub host: u64,
    /// Number of exchanges in addition to one per cycle.
    pub extra: u64,
    /// Number of cycles in which the exchange was skipped because the FIFO level was too high. This happens because the
    /// clocks of this machine and of the board differ.
    pub skipped: u64,
    /// Number of cycles in which the exchange was skipped because the program had no frame and entries of the prefill
    /// were still in the FIFO.
    pub skipped_with_prefill: u64,
    /// Number of the program's commands to slaves that no report has answered: the board rejected them, or executed
    /// them between two answers.
    pub unanswered: u64,
}

/// The pacer of one link.
pub struct Pacer {
    options: PacerOptions,
    /// The cycle time of OP.
    cycle: CycleTime,
    state: Option<MasterState>,
    /// When the next regular exchange, one per cycle, is due.
    tick: Ns,
    /// Before this time no exchange may begin, neither a regular nor an extra one, because the board needs a minimum
    /// time ([`PacerOptions::period_ns`]) between the starts of two exchanges.
    not_before: Ns,
    /// The target for the FIFO level. As in the reports, the level is the number of entries after the board has taken
    /// one out in a cycle.
    target_level: u16,
    /// The estimated present level of the board's FIFO.
    level: u16,
    /// The FIFO level in the newest answer.
    reported: u16,
    /// Whether there has been an extra exchange since the last regular one.
    had_extra: bool,
    /// The largest number of cycles by which this machine was late. It shrinks by one after each
    /// [`RESERVE_DECAY_EXCHANGES`] exchanges in time. While frames of the program wait, the link keeps at least
    /// `reserve` plus [`LEVEL_MIN`] entries in the FIFO.
    reserve: u16,
    /// Number of regular exchanges since this machine was last late, or since the reserve last shrank.
    on_time: u32,
    /// How many of the next regular exchanges are skipped, because the FIFO level is too high.
    to_skip: u16,
    /// How many extra exchanges may be made, because the FIFO level is too low.
    extra: u16,
    /// How many of the next reports are ignored, because their FIFO level is from before the newest correction.
    ignored_reports: u8,
    prefill: PrefillState,
    sent: SentFrames,
    counts: PacerCounts,
}

impl Pacer {
    /// A pacer whose first exchange is due at once.
    pub fn new(options: PacerOptions) -> Self {
        Self {
            options,
            cycle: options.cycle,
            state: None,
            tick: 0,
            not_before: 0,
            target_level: options.prefill.max(LEVEL_MIN),
            level: 0,
            reported: 0,
            had_extra: false,
            reserve: 0,
            on_time: 0,
            to_skip: 0,
            extra: 0,
            ignored_reports: IGNORED_REPORTS,
            prefill: PrefillState::Unset,
            sent: SentFrames::new(options.slot),
            counts: PacerCounts::default(),
        }
    }

    /// Decides what to do at the time `now`, with `held` frames of the program waiting.
    pub fn plan(&mut self, now: Ns, held: WaitingFrames) -> PacerPlan {
        self.handle_lateness(now, held);
        // After a SET_DC command the cycle may be shorter, so that the next exchange is due earlier.
        self.tick = self.tick.min(now + self.period());
        let may_be_extra = held.frames > 0 && self.has_room() && (held.last || (self.op() && self.extra > 0));
        if may_be_extra {
            while held.last && self.tick <= now {
                self.pass_tick();
            }
            return self.plan_exchange(now, self.not_before, self.content(held), true);
        }
        while self.tick <= now && self.skips_tick(held) {
            self.pass_tick();
        }
        self.plan_exchange(now, self.tick.max(self.not_before), self.content(held), false)
    }

    const fn plan_exchange(&self, now: Ns, due: Ns, content: ExchangeContent, extra: bool) -> PacerPlan {
        if now < due { PacerPlan::Wait(due) } else { PacerPlan::Exchange { content, extra } }
    }

    fn content(&self, held: WaitingFrames) -> ExchangeContent {
        let arms = self.options.prefill > 0 && self.prefill == PrefillState::Unset && self.op();
        match held.frames {
            0 if held.last && matches!(self.prefill, PrefillState::Waiting(_)) => ExchangeContent::Release,
            1.. if arms && held.motion => ExchangeContent::Prefill,
            1.. if self.has_room() => ExchangeContent::Host,
            _ => ExchangeContent::Status,
        }
    }

    /// Whether the board still waits for prefill entries. If the link is closed now, none will come, and the link has
    /// to send an [`ExchangeContent::Release`] first.
    pub fn owes_release(&self) -> bool {
        matches!(self.prefill, PrefillState::Waiting(_)) && self.op()
    }

    /// Whether the FIFO has room for a frame, even if its level in the newest answer does not include the newest
    /// frames.
    const fn has_room(&self) -> bool {
        self.level < LEVEL_MAX && self.reported < LEVEL_MAX - UNREPORTED_ENTRIES_MAX
    }

    /// Restarts the timing if this machine was late by more than a cycle. Missed cycles are not made up for: the next
    /// exchange is due now. If frames of the program were waiting, the lateness has let the FIFO run low, so for a
    /// while more entries are kept in it.
    fn handle_lateness(&mut self, now: Ns, held: WaitingFrames) {
        if now <= self.tick + self.period() {
            return;
        }
        let late = ((now - self.tick) / self.period()).min(RESERVE_MAX.into()) as u16;
        self.tick = now;
        self.level = self.level.saturating_sub(late);
        if self.op() && held.frames > 0 && !matches!(self.prefill, PrefillState::Waiting(_)) {
            self.reserve = self.reserve.max(late);
            self.on_time = 0;
            self.extra = self.extra.max(self.level_for(held.frames).saturating_sub(self.level));
        }
    }

    /// The target for the FIFO level. The reserve counts only while frames of the program are waiting, because only
    /// these frames can fill it.
    fn level_for(&self, held: usize) -> u16 {
        if held > 0 && self.reserve > 0 { self.target_level.max(self.reserve + LEVEL_MIN) } else { self.target_level }
    }

    /// Whether to skip the regular exchange that is due, because the FIFO level is too high or the prefill is not used
    /// up.
    fn skips_tick(&mut self, held: WaitingFrames) -> bool {
        if self.to_skip > 0 {
            self.to_skip -= 1;
            self.counts.skipped += 1;
            return true;
        }
        // While the link is being closed, no regular exchange is needed: the remaining frames are sent as soon as there
        // is room.
        if held.last && held.frames > 0 {
            return true;
        }
        // During the prefill, the frame of an extra exchange replaces the regular exchange of its cycle: a GET_STATUS
        // frame would be an entry without targets.
        if self.had_extra && held.frames == 0 && matches!(self.prefill, PrefillState::Waiting(_)) {
            return true;
        }
        let lasts = self.op() && self.options.prefill > 0 && self.prefill == PrefillState::Done && self.level >= 2;
        if lasts && held.frames == 0 && !held.last {
            self.counts.skipped_with_prefill += 1;
            self.ignored_reports = IGNORED_REPORTS;
            return true;
        }
        false
    }

    /// Advances to the next cycle, whether its exchange was made or skipped. Meanwhile the board takes an entry out of
    /// its FIFO, unless it waits for the prefill.
    fn pass_tick(&mut self) {
        self.tick += self.period();
        self.had_extra = false;
        if !matches!(self.prefill, PrefillState::Waiting(_)) {
            self.level = self.level.saturating_sub(1);
        }
    }

    /// Records the beginning of an exchange with the command frame `frame`.
    pub fn begins(&mut self, frame: &Frame, content: ExchangeContent, extra: bool, now: Ns) {
        self.counts.exchanges += 1;
        self.counts.host += u64::from(content == ExchangeContent::Host);
        self.counts.extra += u64::from(extra);
        if extra {
            self.extra = self.extra.saturating_sub(1);
            self.ignored_reports = IGNORED_REPORTS;
            self.had_extra = true;
        } else {
            // The next exchange is due one period after this one was due, whenever this one began, so that small delays
            // do not add up.
            self.pass_tick();
            self.on_time += 1;
            if self.on_time >= RESERVE_DECAY_EXCHANGES {
                (self.on_time, self.reserve) = (0, self.reserve.saturating_sub(1));
            }
        }
        self.not_before = now + self.options.period_ns;
        self.sent.push(frame, content == ExchangeContent::Host, now);
        match content {
            ExchangeContent::Host => self.note_command(frame),
            ExchangeContent::Prefill => {
                self.prefill = PrefillState::Waiting(0);
                self.extra = self.target_level;
            }
            ExchangeContent::Release => self.prefill = PrefillState::Done,
            ExchangeContent::Status => {}
        }
        if self.op() {
            self.level = (self.level + 1).min(FIFO_ENTRIES);
        }
        if let PrefillState::Waiting(sent) = &mut self.prefill {
            *sent += 1;
            if *sent >= self.options.prefill {
                self.prefill = PrefillState::Done;
                self.ignored_reports = IGNORED_REPORTS;
            }
        }
    }

    /// Records that the exchange has ended. Its transfer began at least one transfer time ago. The minimum time until
    /// the next exchange counts from the beginning of the transfer.
    pub fn ended(&mut self, now: Ns) {
        let began = now.saturating_sub(self.options.wires_ns);
        if self.options.period_ns > 0 {
            self.not_before = self.not_before.max(began + self.options.period_ns);
        }
    }

    /// Evaluates the commands of the program's frame that concern the pacer: those that change the cycle, the FIFO or
    /// the declared kinds of slaves.
    fn note_command(&mut self, frame: &Frame) {
        match MasterCommand::decode(&frame.slot(self.options.slot, 0), self.options.slot) {
            Ok(MasterCommand::SetAxis { .. }) if !self.above_preop() => self.sent.forget_kinds(),
            Ok(MasterCommand::SetDc { cycle, .. }) if !self.above_preop() => self.cycle = cycle,
            Ok(MasterCommand::SetFifo(FifoAction::Clear)) if self.op() => {
                self.restart_fifo();
                self.sent.forget_earlier();
            }
            // If the program sets a threshold, the board starts when fewer than `free` entries of the FIFO are free.
            // The number of used entries at that moment becomes the target.
            Ok(MasterCommand::SetFifo(FifoAction::Threshold(free))) if self.op() => {
                let free = free.min(FIFO_ENTRIES.into()) as u16;
                self.prefill = PrefillState::Done;
                self.target_level =
                    (FIFO_ENTRIES + 1 - free).clamp(LEVEL_MIN, TARGET_LEVEL_MAX).max(self.options.prefill);
                (self.to_skip, self.extra, self.ignored_reports) =
                    (0, self.target_level.saturating_sub(self.level), IGNORED_REPORTS);
            }
            _ => {}
        }
    }

    /// Evaluates a valid answer of the board, while `held` frames of the program are waiting.
    pub fn answered(&mut self, answer: &MasterResponse, extra: bool, held: usize) {
        let was_op = self.op();
        self.state = answer.state.state();
        if self.op() != was_op {
            self.restart_fifo();
            self.sent.forget();
        }
        let level = FIFO_ENTRIES.saturating_sub(answer.fifo_free);
        self.reported = if self.op() { level } else { 0 };
        if !self.op() || extra {
            return;
        }
        if self.ignored_reports > 0 {
            self.ignored_reports -= 1;
            return;
        }
        // The FIFO level in the answer is from before the frame of this exchange, which adds one entry.
        self.level = (level + 1).min(FIFO_ENTRIES);
        if matches!(self.prefill, PrefillState::Waiting(_)) {
            return;
        }
        let wanted = self.level_for(held);
        if level >= wanted + LEVEL_SLACK {
            self.to_skip = (level + 1 - wanted - LEVEL_SLACK).min(SKIPPED_IN_A_ROW_MAX);
            (self.extra, self.ignored_reports) = (0, IGNORED_REPORTS);
        } else {
            self.extra = wanted.saturating_sub(level);
        }
    }

    /// Resets the estimated FIFO level to empty: OP was reached or left, or the FIFO was cleared.
    fn restart_fifo(&mut self) {
        self.target_level = self.options.prefill.max(LEVEL_MIN);
        (self.level, self.reported, self.to_skip, self.extra, self.ignored_reports) = (0, 0, 0, 0, IGNORED_REPORTS);
        self.prefill = PrefillState::Unset;
    }

    /// Turns a valid answer into the report for the program. The report shows the number of FIFO entries that the
    /// program may still write, and in each slot the answer to the program's own command, even if the board has
    /// answered a frame of the link since. Returns whether the report differs from the answer, so that its CRC has to
    /// be computed again.
    pub fn to_report(&mut self, answer: &mut Frame, held: usize) -> bool {
        let size = self.options.slot;
        let mut board = answer.slot(size, 0);
        let free = MasterResponse::decode(&board).fifo_free;
        let level = if self.op() { FIFO_ENTRIES.saturating_sub(free) } else { 0 };
        let old = ANSWER_AGE_MAX_CYCLES * self.period() + self.options.wires_ns;
        let put = self.sent.restore_answers(answer, level, old, self.op());
        self.counts.unanswered = self.sent.unanswered();
        if !self.op() {
            return put;
        }
        let ahead = usize::from(self.sent.host_entries_max(level)) + held;
        let shown = FIFO_ENTRIES.saturating_sub(ahead.min(FIFO_ENTRIES.into()) as u16);
        board.data2 = u32::from(shown) | u32::from(board.data2_high()) << 16;
        answer.put(size, 0, &board);
        put || shown != free
    }

    /// Whether the board was in OP in the latest answer.
    pub fn op(&self) -> bool {
        self.state == Some(MasterState::Op)
    }

    fn above_preop(&self) -> bool {
        matches!(self.state, Some(MasterState::SafeOp | MasterState::Op))
    }

    /// The cycle time of OP, also while the board is below OP.
    pub const fn cycle(&self) -> CycleTime {
        self.cycle
    }

    /// The time between two regular exchanges, in nanoseconds.
    fn period(&self) -> Ns {
        if self.op() { self.cycle.ns() } else { CycleTime::DEFAULT.ns() }
    }

    /// The counters so far.
    pub const fn counts(&self) -> PacerCounts {
        self.counts
    }

    /// Builds the link's own frame for an exchange without a frame of the program. Its CRC is valid, whether or not the
    /// board checks it.
    pub fn own_frame(&self, content: ExchangeContent, frame: &mut Frame) {
        let size = self.options.slot;
        frame.set_prefix(&[]);
        let free = match content {
            ExchangeContent::Prefill => FIFO_ENTRIES + 1 - self.options.prefill,
            ExchangeContent::Release => FIFO_ENTRIES,
            ExchangeContent::Host | ExchangeContent::Status => 0,
        };
        if free > 0 {
            frame.put_master(size, &MasterCommand::SetFifo(FifoAction::Threshold(free.into())));
        }
        frame.fill_crc(size);
    }
}

/// Whether a frame contains a motion command.
pub fn has_motion(frame: &Frame, size: SlotSize) -> bool {
    let slots = frame.slots(size);
    (1..=size.max_slaves()).any(|slave| CommandId::from_code(slots.head(slave).id).is_motion())
}
