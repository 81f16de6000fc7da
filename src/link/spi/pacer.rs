//! When the next exchange is due and what it carries. Plain state and pure steps; time is an argument.
//!
//! On SPI every exchange is a command frame, and in OP every command frame takes an entry of the board's FIFO, out of
//! which one goes each cycle. So one exchange goes with each cycle, on this machine's clock, and what the two clocks
//! differ by shows in the FIFO's level as reports tell it: a level above what is wanted passes an exchange over, a level
//! below makes the next frames of the host go out sooner. Reports are a little old (SPI's answer is that of the exchange
//! before), so after each such step some are not believed.

use super::sent::Sent;
use crate::sk::{
    CommandId, CycleTime, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SlotSize,
};

/// Nanoseconds since the link was opened.
pub type Ns = u64;

/// The level that is wanted where no prefill asks for more: one entry, so that an exchange that comes a little late finds
/// the FIFO not empty. \[OURS]
const LEVEL: u16 = 1;
/// A level this far above the wanted one passes exchanges over: one more or less is the phase between the clocks. \[OURS]
const SLACK: u16 = 2;
/// Exchanges passed over in a row at most, so that reports go on. \[OURS]
const PASSED_OVER: u16 = 8;
/// Regular reports that are not believed after a step. \[OURS]
const SETTLE: u8 = 2;
/// From this level on frames of the host wait in the link. \[OURS]
const FULL: u16 = FIFO_ENTRIES - 2;
/// The most entries that are kept because this machine is late at times. \[OURS]
const RESERVE: u16 = 32;
/// Regular exchanges without a late one after which one entry less is kept. \[OURS]
const CALM: u32 = 2000;
/// Entries that the newest answer may not know of. \[OURS]
const NOT_REPORTED: u16 = 2;
/// Cycles that an answer is old at most. \[OURS]
const OLD: Ns = 2;
/// The highest level that is wanted, whatever threshold a program sets. \[OURS]
const HIGHEST: u16 = FIFO_ENTRIES - 5;

/// What an exchange carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carry {
    /// The oldest frame of the host that the link holds.
    Host,
    /// GET_STATUS in every slot.
    Status,
    /// SET_FIFO with the threshold of the prefill.
    Prefill,
    /// SET_FIFO with the default threshold: what is in the FIFO goes although there is less than the prefill.
    Release,
}

/// What to do now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// Nothing before that time, unless the host writes.
    Wait(Ns),
    /// An exchange.
    Exchange {
        /// What it carries.
        carry: Carry,
        /// Whether it is one more than the cycle's own.
        extra: bool,
    },
}

/// The frames of the host that wait in the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Held {
    /// How many.
    pub frames: usize,
    /// Whether the oldest moves something (CSP, CSV, CST).
    pub motion: bool,
    /// Whether the link is being closed: no more will come, and these go out as fast as they may.
    pub last: bool,
}

/// What a pacer goes by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacerOptions {
    /// Slot size.
    pub slot: SlotSize,
    /// The cycle in OP before a SET_DC passes.
    pub cycle: CycleTime,
    /// Entries kept in the FIFO.
    pub prefill: u16,
    /// Time between the begin of an exchange and the next one's; 0 where BUSY says it.
    pub period_ns: Ns,
    /// How long a frame is on the wires.
    pub wires_ns: Ns,
}

/// Whether the prefill's threshold was set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arm {
    /// Not yet, since OP was reached or the FIFO was cleared.
    Not,
    /// So many entries were sent since, and the FIFO waits for more.
    Waiting(u16),
    /// It has fired, or a program sets thresholds of its own.
    Done,
}

/// Counts of a pacer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacerCounts {
    /// Exchanges.
    pub exchanges: u64,
    /// Of these, with a frame of the host.
    pub host: u64,
    /// Of these, beyond one a cycle.
    pub extra: u64,
    /// Cycles passed over because the FIFO's level was too high: the clocks differ.
    pub passed_over: u64,
    /// Cycles passed over because the host had no frame and the prefill lasts.
    pub spared: u64,
    /// Commands of the host for slaves that no answer has shown: rejected ones, and such as were executed between two answers.
    pub unseen: u64,
}

/// The pacer of one link.
pub struct Pacer {
    options: PacerOptions,
    /// The cycle in OP.
    cycle: CycleTime,
    state: Option<MasterState>,
    /// When the next regular exchange is due.
    tick: Ns,
    /// When one may begin at the soonest.
    not_before: Ns,
    /// The level that is wanted, after an entry was taken out.
    wanted: u16,
    /// The FIFO's level now, as far as it is known.
    level: u16,
    /// The FIFO's level in the newest answer.
    reported: u16,
    /// Whether there was an exchange beyond the cycle's own since that one.
    had_extra: bool,
    /// The most cycles that this machine was late by, not long ago.
    reserve: u16,
    /// Regular exchanges since it was.
    calm: u32,
    /// Exchanges to pass over.
    over: u16,
    /// Exchanges that may be made beyond one a cycle.
    extra: u16,
    settle: u8,
    arm: Arm,
    sent: Sent,
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
            wanted: options.prefill.max(LEVEL),
            level: 0,
            reported: 0,
            had_extra: false,
            reserve: 0,
            calm: 0,
            over: 0,
            extra: 0,
            settle: SETTLE,
            arm: Arm::Not,
            sent: Sent::new(options.slot),
            counts: PacerCounts::default(),
        }
    }

    /// What is due at `now`.
    pub fn plan(&mut self, now: Ns, held: Held) -> Plan {
        self.fall_behind(now, held);
        // The cycle may have become shorter.
        self.tick = self.tick.min(now + self.period());
        let may_be_extra = held.frames > 0 && self.has_room() && (held.last || (self.op() && self.extra > 0));
        if may_be_extra {
            while held.last && self.tick <= now {
                self.pass_tick();
            }
            return self.begin(now, self.not_before, self.carry(held), true);
        }
        while self.tick <= now && self.passes_over(held) {
            self.pass_tick();
        }
        self.begin(now, self.tick.max(self.not_before), self.carry(held), false)
    }

    const fn begin(&self, now: Ns, due: Ns, carry: Carry, extra: bool) -> Plan {
        if now < due { Plan::Wait(due) } else { Plan::Exchange { carry, extra } }
    }

    fn carry(&self, held: Held) -> Carry {
        let arms = self.options.prefill > 0 && self.arm == Arm::Not && self.op();
        match held.frames {
            0 if held.last && matches!(self.arm, Arm::Waiting(_)) => Carry::Release,
            1.. if arms && held.motion => Carry::Prefill,
            1.. if self.has_room() => Carry::Host,
            _ => Carry::Status,
        }
    }

    /// Whether the prefill waits for entries that will not come once the link is closed.
    pub fn owes_release(&self) -> bool {
        matches!(self.arm, Arm::Waiting(_)) && self.op()
    }

    /// Whether the FIFO surely takes a frame, however old the newest answer is.
    const fn has_room(&self) -> bool {
        self.level < FULL && self.reported < FULL - NOT_REPORTED
    }

    /// A machine that was late does not make up for cycles, the next one is due now. But frames that were held meanwhile
    /// should have been in the FIFO: from now on, for a while, as many are.
    fn fall_behind(&mut self, now: Ns, held: Held) {
        if now <= self.tick + self.period() {
            return;
        }
        let late = ((now - self.tick) / self.period()).min(RESERVE.into()) as u16;
        self.tick = now;
        self.level = self.level.saturating_sub(late);
        if self.op() && held.frames > 0 && !matches!(self.arm, Arm::Waiting(_)) {
            self.reserve = self.reserve.max(late);
            self.calm = 0;
            self.extra = self.extra.max(self.wanted(held.frames).saturating_sub(self.level));
        }
    }

    /// The level that is wanted: more only of frames that the host has ahead anyway.
    fn wanted(&self, held: usize) -> u16 {
        if held > 0 && self.reserve > 0 { self.wanted.max(self.reserve + LEVEL) } else { self.wanted }
    }

    fn passes_over(&mut self, held: Held) -> bool {
        if self.over > 0 {
            self.over -= 1;
            self.counts.passed_over += 1;
            return true;
        }
        // What is left of a program's frames goes out when there is room.
        if held.last && held.frames > 0 {
            return true;
        }
        // While the prefill is awaited a frame that went out before its time is the cycle's.
        if self.had_extra && held.frames == 0 && matches!(self.arm, Arm::Waiting(_)) {
            return true;
        }
        let lasts = self.op() && self.options.prefill > 0 && self.arm == Arm::Done && self.level >= 2;
        if lasts && held.frames == 0 && !held.last {
            self.counts.spared += 1;
            self.settle = SETTLE;
            return true;
        }
        false
    }

    fn pass_tick(&mut self) {
        self.tick += self.period();
        self.had_extra = false;
        if !matches!(self.arm, Arm::Waiting(_)) {
            self.level = self.level.saturating_sub(1);
        }
    }

    /// An exchange with that frame begins.
    pub fn begins(&mut self, frame: &Frame, carry: Carry, extra: bool, now: Ns) {
        self.counts.exchanges += 1;
        self.counts.host += u64::from(carry == Carry::Host);
        self.counts.extra += u64::from(extra);
        if extra {
            self.extra = self.extra.saturating_sub(1);
            self.settle = SETTLE;
            self.had_extra = true;
        } else {
            // A little late is not later for all that follow.
            self.pass_tick();
            self.calm += 1;
            if self.calm >= CALM {
                (self.calm, self.reserve) = (0, self.reserve.saturating_sub(1));
            }
        }
        self.not_before = now + self.options.period_ns;
        self.sent.push(frame, carry == Carry::Host, now);
        match carry {
            Carry::Host => self.look(frame),
            Carry::Prefill => {
                self.arm = Arm::Waiting(0);
                self.extra = self.wanted;
            }
            Carry::Release => self.arm = Arm::Done,
            Carry::Status => {}
        }
        if self.op() {
            self.level = (self.level + 1).min(FIFO_ENTRIES);
        }
        if let Arm::Waiting(sent) = &mut self.arm {
            *sent += 1;
            if *sent >= self.options.prefill {
                self.arm = Arm::Done;
                self.settle = SETTLE;
            }
        }
    }

    /// It has ended: on the wires it began no later than a frame takes before.
    pub fn ended(&mut self, now: Ns) {
        let began = now.saturating_sub(self.options.wires_ns);
        if self.options.period_ns > 0 {
            self.not_before = self.not_before.max(began + self.options.period_ns);
        }
    }

    /// What a frame of the host changes for the pacer.
    fn look(&mut self, frame: &Frame) {
        match MasterCommand::decode(&frame.slot(self.options.slot, 0), self.options.slot) {
            Ok(MasterCommand::SetAxis { .. }) if !self.above_preop() => self.sent.forget_kinds(),
            Ok(MasterCommand::SetDc { cycle, .. }) if !self.above_preop() => self.cycle = cycle,
            Ok(MasterCommand::SetFifo(FifoAction::Clear)) if self.op() => {
                self.flow_anew();
                self.sent.forget_earlier();
            }
            // A program that fills the FIFO before it starts gets the level that it asks for.
            Ok(MasterCommand::SetFifo(FifoAction::Threshold(free))) if self.op() => {
                let free = free.min(FIFO_ENTRIES.into()) as u16;
                self.arm = Arm::Done;
                self.wanted = (FIFO_ENTRIES + 1 - free).clamp(LEVEL, HIGHEST).max(self.options.prefill);
                (self.over, self.extra, self.settle) = (0, self.wanted.saturating_sub(self.level), SETTLE);
            }
            _ => {}
        }
    }

    /// A good answer came back; `held` frames of the host wait.
    pub fn answered(&mut self, answer: &MasterResponse, extra: bool, held: usize) {
        let was_op = self.op();
        self.state = answer.state.state();
        if self.op() != was_op {
            self.flow_anew();
            self.sent.forget();
        }
        let level = FIFO_ENTRIES.saturating_sub(answer.fifo_free);
        self.reported = if self.op() { level } else { 0 };
        if !self.op() || extra {
            return;
        }
        if self.settle > 0 {
            self.settle -= 1;
            return;
        }
        // The frame of this exchange is not in it.
        self.level = (level + 1).min(FIFO_ENTRIES);
        if matches!(self.arm, Arm::Waiting(_)) {
            return;
        }
        let wanted = self.wanted(held);
        if level >= wanted + SLACK {
            self.over = (level + 1 - wanted - SLACK).min(PASSED_OVER);
            (self.extra, self.settle) = (0, SETTLE);
        } else {
            self.extra = wanted.saturating_sub(level);
        }
    }

    fn flow_anew(&mut self) {
        self.wanted = self.options.prefill.max(LEVEL);
        (self.level, self.reported, self.over, self.extra, self.settle) = (0, 0, 0, 0, SETTLE);
        self.arm = Arm::Not;
    }

    /// Makes of a good answer the report that a program is shown: as free entries those that it may still write, and in
    /// the slots what they answered to its own commands. Whether that differs from the answer; then the CRC has to be
    /// filled.
    pub fn show(&mut self, answer: &mut Frame, held: usize) -> bool {
        let size = self.options.slot;
        let mut board = answer.slot(size, 0);
        let free = MasterResponse::decode(&board).fifo_free;
        let level = if self.op() { FIFO_ENTRIES.saturating_sub(free) } else { 0 };
        let old = OLD * self.period() + self.options.wires_ns;
        let put = self.sent.show(answer, level, old, self.op());
        self.counts.unseen = self.sent.unseen();
        if !self.op() {
            return put;
        }
        let ahead = usize::from(self.sent.of_the_host(level)) + held;
        let shown = FIFO_ENTRIES.saturating_sub(ahead.min(FIFO_ENTRIES.into()) as u16);
        board.data2 = u32::from(shown) | u32::from(board.data2_high()) << 16;
        answer.put(size, 0, &board);
        put || shown != free
    }

    /// Whether the last answer was of OP.
    pub fn op(&self) -> bool {
        self.state == Some(MasterState::Op)
    }

    fn above_preop(&self) -> bool {
        matches!(self.state, Some(MasterState::SafeOp | MasterState::Op))
    }

    /// The cycle that OP has, or will have.
    pub const fn cycle(&self) -> CycleTime {
        self.cycle
    }

    /// Nanoseconds between two regular exchanges.
    fn period(&self) -> Ns {
        if self.op() { self.cycle.ns() } else { CycleTime::DEFAULT.ns() }
    }

    /// What was exchanged so far.
    pub const fn counts(&self) -> PacerCounts {
        self.counts
    }

    /// The frame for what an exchange carries, when it is not one of the host. Its CRC is right, whether the board checks
    /// it or not.
    pub fn own_frame(&self, carry: Carry, frame: &mut Frame) {
        let size = self.options.slot;
        frame.set_prefix(&[]);
        let free = match carry {
            Carry::Prefill => FIFO_ENTRIES + 1 - self.options.prefill,
            Carry::Release => FIFO_ENTRIES,
            Carry::Host | Carry::Status => 0,
        };
        if free > 0 {
            frame.put_master(size, &MasterCommand::SetFifo(FifoAction::Threshold(free.into())));
        }
        frame.fill_crc(size);
    }
}

/// Whether a frame moves something.
pub fn has_motion(frame: &Frame, size: SlotSize) -> bool {
    let motion = [CommandId::Csp, CommandId::Csv, CommandId::Cst].map(CommandId::code);
    let slots = frame.slots(size);
    (1..=size.max_slaves()).any(|slave| motion.contains(&slots.head(slave).id))
}
