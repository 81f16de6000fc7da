//! What one exchange with the board knows: the newest report, the commands that wait for the next frame, the counts.

use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::ThreadId;
use std::time::Instant;

use super::credit::Credit;
use super::marks::{Echo, Marks};
use super::second::Second;

use super::config::Slave;
use super::core::Sent;
use super::snapshot::{Plan, Snapshot};
use super::targets::{Targets, bits};
use crate::cia402::Statusword;
use crate::coe::ObjectAddress;
use crate::link::{ReadMeta, Stamp};
use crate::sk::{
    CrcPolicy, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SlotSize, StateByte,
};

/// News kept until somebody takes them; the oldest go first. \[OURS]
const NEWS_KEPT: usize = 64;
/// \[OURS] While slaves are lost every so many frames ask which they are.
const ASK_LOST: u64 = 32;
const SLOTS: usize = SlotSize::Bytes12.slots();

/// Something that a program may want to log, and that fails nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// Byte 1 of slot 0 changed: the CRC error count of firmware 1.7 (SK-2.7).
    ErrorByte {
        /// Before.
        from: u8,
        /// Now.
        to: u8,
    },
    /// The FIFO-full count went up: commands were lost. The numbers are the board's own (SK-5.10).
    CommandsLost {
        /// Before.
        from: u16,
        /// Now.
        to: u16,
    },
    /// Reports that nobody read, or that were lost on the way.
    ReportsLost {
        /// How many.
        count: u64,
    },
    /// A report was thrown away, its CRC is wrong.
    BadCrc,
    /// The state shows a failure, as when slaves are lost in OP (SK-4.61): the others go on, what the lost ones show is
    /// old, and the wire does not say which they are. [`Ecm::set_state`](super::Ecm::set_state) brings back those that
    /// are there again.
    SlavesFailed {
        /// What it shows.
        state: StateByte,
    },
}

/// Counts since the board was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Command frames written.
    pub written: u64,
    /// Reports that could be used.
    pub reports: u64,
    /// Reports thrown away for a wrong CRC.
    pub bad_crc: u64,
    /// Reports lost before they were read.
    pub reports_lost: u64,
    /// Reports that came again or too late, thrown away.
    pub stale: u64,
    /// Times byte 1 of slot 0 was seen changed.
    pub error_byte_changes: u64,
    /// Times the FIFO-full count was seen increased. How many commands each time the wire does not say for sure, and no
    /// division finds out (SK-5.10).
    pub losses: u64,
    /// Cycles of streams that found the FIFO empty.
    pub underruns: u64,
    /// Times the state began to show a failure (0x10).
    pub slaves_failed: u64,
}

/// Who paces frames by a stream.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pacer {
    pub(super) thread: ThreadId,
    pub(super) last_step: Instant,
}

pub(super) struct Session {
    pub(super) size: SlotSize,
    policy: CrcPolicy,
    pub(super) incoming: Box<Frame>,
    pub(super) report: Box<Frame>,
    pub(super) previous: Box<Frame>,
    pub(super) outgoing: Frame,
    pub(super) meta: Option<ReadMeta>,
    pub(super) previous_at: Stamp,
    last_sequence: u64,
    pub(super) board: MasterResponse,
    pub(super) plan: Arc<Plan>,
    pub(super) credit: Credit,
    /// Commands for the next frame; a bit of `posted` for each slot that has one.
    commands: [RawSlot; SLOTS],
    posted: u64,
    /// Slots whose command is waited for by one that must be sure of its own answer, a bit each.
    claimed: u64,
    /// The last answer in a claimed slot that names the command there, and the time of its report; those in which that has
    /// stood since it was claimed have a bit in `stands`: it may be an old one.
    answers: [(Stamp, RawSlot); SLOTS],
    stands: u64,
    pub(super) marks: Marks,
    /// Frames written so far, when the last one was, its number in the FIFO, its mark, and the slots that had a command.
    pub(super) flushes: u64,
    pub(super) flushed_at: Stamp,
    pub(super) flushed_number: i64,
    pub(super) flushed_mark: u8,
    composed_mark: u8,
    flushed_posts: u64,
    /// Slaves that are lost, as far as it is known, a bit each.
    pub(super) lost: u64,
    /// Objects of SDO transfers whose answers did not come in time.
    pub(super) late: Vec<ObjectAddress>,
    /// What is known of second channels, and the transfer that asks.
    pub(super) second: Second,
    /// Times the FIFO was cleared: a stream that was open then has lost its way.
    pub(super) clears: u64,
    /// What a stream keeps sending.
    pub(super) targets: Targets,
    /// Slaves whose targets hold no longer since the stream looked last, a bit each.
    pub(super) dropped: u64,
    /// Slaves that are homing, a bit each.
    pub(super) homing: u64,
    /// Those of them that were told to end: back in CSP bits 10 and 12 look like a home.
    pub(super) aborted: u64,
    /// Those that have been told to begin.
    pub(super) going: u64,
    pub(super) pacer: Option<Pacer>,
    pub(super) stats: Stats,
    news: VecDeque<News>,
    /// When a usable report came last, on the caller's clock.
    pub(super) heard: std::time::Duration,
    pub(super) closed: bool,
}

impl Session {
    pub(super) fn new(size: SlotSize, strict: bool) -> Self {
        Self {
            size,
            policy: if strict { CrcPolicy::Strict } else { CrcPolicy::AbsentAllowed },
            incoming: Box::default(),
            report: Box::default(),
            previous: Box::default(),
            outgoing: Frame::new(),
            meta: None,
            previous_at: Stamp(0),
            last_sequence: 0,
            board: MasterResponse::default(),
            plan: Arc::new(Plan::NONE),
            credit: Credit::new(),
            commands: [RawSlot::ZERO; SLOTS],
            posted: 0,
            claimed: 0,
            answers: [(Stamp(0), RawSlot::ZERO); SLOTS],
            stands: 0,
            marks: Marks::new(),
            flushes: 0,
            flushed_at: Stamp(0),
            flushed_number: 0,
            flushed_mark: 0,
            composed_mark: 0,
            flushed_posts: 0,
            lost: 0,
            late: Vec::new(),
            second: Second::new(),
            clears: 0,
            targets: Targets::new(size),
            dropped: 0,
            homing: 0,
            aborted: 0,
            going: 0,
            pacer: None,
            stats: Stats::default(),
            news: VecDeque::with_capacity(NEWS_KEPT),
            heard: std::time::Duration::ZERO,
            closed: false,
        }
    }

    pub(super) fn in_op(&self) -> bool {
        self.board.state.state() == Some(MasterState::Op)
    }

    pub(super) fn news(&mut self) -> Vec<News> {
        self.news.drain(..).collect()
    }

    fn tell(&mut self, news: News) {
        if self.news.len() == NEWS_KEPT {
            self.news.pop_front();
        }
        self.news.push_back(news);
    }

    /// Takes the report in `incoming`; says whether it is one that can be used.
    pub(super) fn take(&mut self, meta: ReadMeta) -> bool {
        if self.incoming.check_crc(self.size, self.policy).is_err() {
            self.stats.bad_crc += 1;
            self.tell(News::BadCrc);
            self.last_sequence = self.last_sequence.max(meta.sequence);
            return false;
        }
        let before = self.meta;
        if let Some(before) = before {
            if meta.sequence <= before.sequence {
                self.stats.stale += 1;
                return false;
            }
            let lost = meta.sequence.saturating_sub(self.last_sequence + 1);
            if lost > 0 {
                self.stats.reports_lost += lost;
                self.tell(News::ReportsLost { count: lost });
            }
        }
        self.last_sequence = self.last_sequence.max(meta.sequence);
        std::mem::swap(&mut self.report, &mut self.previous);
        std::mem::swap(&mut self.incoming, &mut self.report);
        self.meta = Some(meta);
        self.previous_at = before.map_or(meta.at, |before| before.at);
        self.stats.reports += 1;
        self.read_board(before, meta);
        self.read_marks(meta.at);
        self.second.read(self.size, &self.report);
        self.drop_dead_targets();
        true
    }

    fn read_board(&mut self, before: Option<ReadMeta>, meta: ReadMeta) {
        let was = (self.board, self.in_op());
        self.board = MasterResponse::decode(&self.report.slot(self.size, 0));
        let Some(before) = before else { return };
        if was.0.error != self.board.error {
            self.stats.error_byte_changes += 1;
            self.tell(News::ErrorByte { from: was.0.error, to: self.board.error });
        }
        if self.board.state.is_failed() && !was.0.state.is_failed() {
            self.stats.slaves_failed += 1;
            self.tell(News::SlavesFailed { state: self.board.state });
        }
        if !self.in_op() {
            self.credit.reset();
            self.targets.forget_outputs();
            self.homing = 0;
            return;
        }
        // It wraps: whatever is different is more.
        if was.1 && was.0.full_count != self.board.full_count {
            self.stats.losses += 1;
            self.tell(News::CommandsLost { from: was.0.full_count, to: self.board.full_count });
        }
        let cycles = meta.sequence - before.sequence;
        let measured = meta.at.0.saturating_sub(before.at.0) / cycles.max(1);
        // SK-5 [OURS]: a frame counts as arrived one cycle after it was written.
        let margin = self.plan.cycle_ns.unwrap_or(measured);
        self.credit.report(meta.at, self.board.fifo_free, cycles, margin);
        self.stats.underruns = self.credit.underruns();
    }

    /// Which of its own entries the board has executed, and which slaves are lost.
    fn read_marks(&mut self, at: Stamp) {
        let slots = self.report.slots(self.size);
        for slot in bits(self.claimed) {
            if slots.head(slot).id == self.answers[slot].1.id {
                self.answers[slot] = (at, slots.get(slot));
            } else {
                self.stands &= !(1 << slot);
            }
        }
        let failed = self.board.state.is_failed();
        if !failed {
            self.lost = 0;
        }
        if !self.in_op() || !failed && self.marks.awaited == 0 {
            return;
        }
        let mut last_is_new = false;
        for slave in 1..=self.size.max_slaves() {
            let index = slots.head(slave).index;
            last_is_new |= self.marks.see(index, self.board.result) && index == self.flushed_mark;
        }
        if failed && last_is_new {
            let is_silent = |slave: u8| slots.head(slave.into()).index != self.flushed_mark;
            let used = self.plan.slaves().filter(|(_, config)| **config != Slave::Unused);
            let silent = used.filter(|(slave, _)| is_silent(*slave)).fold(0, |lost, (slave, _)| lost | 1 << slave);
            // One that had a command may have rejected it.
            self.lost = silent & !self.flushed_posts | self.lost & self.flushed_posts;
        }
    }

    /// An axis that went off has no target any more: switched on again, it must not jump to an old one. Of a slave of two
    /// axes both lose theirs.
    fn drop_dead_targets(&mut self) {
        let slots = self.report.slots(self.size);
        let is_off = |slave: usize| u64::from(!Statusword(slots.head(slave).parm.get()).is_enabled());
        let off = (1..=self.plan.count).fold(self.second.off(), |off, slave| off | is_off(slave) << slave);
        self.drop_targets(off);
    }

    /// Whether all axes of a slave are on, as far as it is known.
    pub(super) fn is_on(&self, slave: u8) -> bool {
        self.statusword(slave).is_enabled() && self.second.off() & 1 << slave == 0
    }

    /// Whether the frame was executed for sure.
    pub(super) fn executed(&self, sent: Sent) -> bool {
        match self.marks.echo {
            Echo::Yes | Echo::Unknown => self.marks.saw(sent.mark),
            Echo::No => self.credit.ran(sent.number),
        }
    }

    /// As [`Session::executed`], where it matters little and the board is not known yet.
    pub(super) fn probably_executed(&self, sent: Sent) -> bool {
        self.executed(sent) || self.marks.echo == Echo::Unknown && self.credit.ran(sent.number)
    }

    /// The board's own result of that frame, in OP.
    pub(super) fn result(&self, sent: Sent) -> Option<u32> {
        let marked = self.marks.echo != Echo::No;
        self.executed(sent).then(|| if marked { self.marks.result(sent.mark) } else { self.board.result })
    }

    /// The answer in a claimed slot to that frame's command there, once it has come.
    pub(super) fn answer(&self, sent: Sent, slot: usize, id: u8) -> Option<RawSlot> {
        let (at, answer) = self.answers[slot];
        let own = match self.marks.echo {
            Echo::Yes | Echo::Unknown => answer.index == sent.mark,
            Echo::No => self.stands & 1 << slot == 0 || self.executed(sent),
        };
        (own && answer.id == id && at > sent.at).then_some(answer)
    }

    /// Takes the targets of slaves away, a bit each, and those that a stream has for its next step.
    pub(super) fn drop_targets(&mut self, slaves: u64) {
        self.targets.forget(slaves);
        self.dropped |= slaves;
    }

    /// Nobody streams any more.
    pub(super) fn end_stream(&mut self) {
        self.pacer = None;
        self.credit.watch(false);
        self.targets.clear();
    }

    pub(super) fn statusword(&self, slave: u8) -> Statusword {
        Statusword(self.report.slots(self.size).head(slave.into()).parm.get())
    }

    pub(super) fn slot(&self, slot: usize) -> RawSlot {
        self.report.slot(self.size, slot)
    }

    pub(super) fn snapshot(&self) -> Snapshot {
        Snapshot {
            meta: self.meta.unwrap_or_default(),
            board: self.board,
            frame: Frame::clone(&self.report),
            size: self.size,
            plan: Arc::clone(&self.plan),
        }
    }

    /// Takes slots for one that must be sure of its own answer; they are free again with [`Session::release`].
    pub(super) fn claim(&mut self, commands: &[(usize, RawSlot)]) -> bool {
        let wanted = mask(commands);
        let free = self.claimed & wanted == 0;
        if free {
            self.claimed |= wanted;
            self.stands |= wanted;
            for (slot, command) in commands {
                self.answers[*slot] = (Stamp(0), RawSlot { id: command.id, ..RawSlot::ZERO });
                if self.report.slot(self.size, *slot).id != command.id {
                    self.stands &= !(1 << slot);
                }
            }
        }
        free
    }

    pub(super) fn release(&mut self, commands: &[(usize, RawSlot)]) {
        self.claimed &= !mask(commands);
    }

    /// Puts commands into the next frame, all or none: a slot that is taken takes no second one.
    pub(super) fn post(&mut self, commands: &[(usize, RawSlot)]) -> bool {
        let wanted = mask(commands);
        if self.posted & wanted != 0 {
            return false;
        }
        for (slot, command) in commands {
            self.commands[*slot] = *command;
        }
        self.posted |= wanted;
        true
    }

    /// Takes back what was posted and not written.
    pub(super) fn withdraw(&mut self, commands: &[(usize, RawSlot)]) {
        self.posted &= !mask(commands);
    }

    pub(super) const fn has_posts(&self) -> bool {
        self.posted != 0
    }

    /// The slots that have a command, a bit each.
    pub(super) const fn posts(&self) -> u64 {
        self.posted
    }

    /// Puts those of the last frame but that of the board itself into the next one, too.
    pub(super) const fn post_again(&mut self, slots: u64) {
        self.posted |= slots & !1;
    }

    /// Whether the board takes a frame now.
    pub(super) fn may_write(&self) -> bool {
        !self.in_op() || self.credit.credit() > 0
    }

    /// Builds the next frame: posted commands first, else what a stream keeps sending, else nothing. CRC last (SK-1.22).
    pub(super) fn compose(&mut self) {
        let size = self.size;
        // A target in the frame of a clear would be the newest one, and the way to it is what is dropped: a jump.
        if self.in_op() && !self.clears_now() {
            self.outgoing.clone_from(self.targets.next());
        } else {
            self.outgoing.bytes_mut().fill(0);
        }
        for slot in bits(self.posted) {
            self.outgoing.put(size, slot, &self.commands[slot]);
        }
        self.mark();
        self.outgoing.fill_crc(size);
    }

    /// Gives the frame a mark, if somebody may want to know it again.
    fn mark(&mut self) {
        self.composed_mark = 0;
        let has_command = self.posted & !(1 << self.size.sdo_slot()) != 0;
        let asks = self.board.state.is_failed() && self.flushes.is_multiple_of(ASK_LOST);
        if !self.in_op() || !has_command && !asks {
            return;
        }
        let mark = self.marks.give();
        self.composed_mark = mark;
        for slave in 1..=self.size.max_slaves() {
            let slot = self.outgoing.slot(self.size, slave);
            self.outgoing.put(self.size, slave, &RawSlot { index: mark, ..slot });
        }
    }

    /// Whether the next frame clears the FIFO.
    fn clears_now(&self) -> bool {
        self.posted & 1 != 0 && self.commands[0] == MasterCommand::SetFifo(FifoAction::Clear).encode()
    }

    /// The frame was written.
    pub(super) fn wrote(&mut self, at: Stamp) {
        if self.clears_now() {
            self.clears += 1;
            self.targets.clear();
        }
        if self.composed_mark != 0 {
            (self.flushed_mark, self.flushed_posts) = (self.composed_mark, self.posted);
        }
        self.posted = 0;
        self.flushes += 1;
        self.flushed_at = at;
        self.stats.written += 1;
        self.flushed_number = if self.in_op() { self.credit.sent(at) } else { 0 };
    }
}

fn mask(commands: &[(usize, RawSlot)]) -> u64 {
    commands.iter().fold(0, |mask, (slot, _)| mask | 1 << slot)
}
