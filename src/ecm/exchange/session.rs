//! The state of a board between two calls: its reports, the commands that wait for the next frame, the frames in
//! flight. Each part has a file of its own. This file has the operations that concern several parts: taking a report,
//! composing a frame, and noting that it was written.

use std::sync::Arc;
use std::thread::ThreadId;
use std::time::Instant;

use super::answers::Answers;
use super::credit::Credit;
use super::cyclic_targets::CyclicTargets;
use super::marks::{Echo, Marks};
use super::outgoing::{Outgoing, Sent};
use super::posts::Posts;
use super::reports::Reports;
use super::second_channels::SecondChannels;
use super::stats::{News, NewsQueue, Stats};
use crate::ecm::EcmError;
use crate::ecm::config::Slave;
use crate::ecm::network::Network;
use crate::ecm::snapshot::Snapshot;
use crate::ecm::standstill::HeldBack;
use crate::ethercat::SlaveSet;
use crate::ethercat::cia402::Statusword;
use crate::ethercat::coe::ObjectAddress;
use crate::link::{ReadMeta, Stamp};
use crate::sk::{CrcPolicy, Frame, MasterResponse, RawSlot, SlotSize};

/// \[OURS] While slaves are lost, one in this many frames of a stream gets a mark although it has no command. Slaves repeat the
/// mark in their slots of a report; a slave that does not is lost.
const ASK_LOST: u64 = 32;

/// The axes that a call is homing.
#[derive(Clone, Copy, Debug, Default)]
pub struct HomingAxes {
    /// Slaves that are being homed, from before their objects are written until their mode is restored.
    pub active: SlaveSet,
    /// Slaves in `active` whose homing was aborted. Their homing has failed, whatever bits 10 and 12 of the statusword
    /// show: in CSP these bits do not mean "homing attained".
    pub aborted: SlaveSet,
    /// Slaves in `active` whose GO_HOME was queued or written.
    pub started: SlaveSet,
}

/// The open stream, whose steps write the frames.
#[derive(Clone, Copy, Debug)]
pub struct StreamPacer {
    /// The thread that made the last step of the stream.
    pub thread: ThreadId,
    /// When the last step was made.
    pub last_step: Instant,
}

pub struct Session {
    pub size: SlotSize,
    /// The configuration of the slaves.
    pub network: Arc<Network>,
    pub reports: Reports,
    pub outgoing: Outgoing,
    pub posts: Posts,
    pub answers: Answers,
    pub marks: Marks,
    pub credit: Credit,
    /// Slaves that are known to be lost: their slots do not repeat the marks of executed frames, while the slots of
    /// other slaves do.
    pub lost: SlaveSet,
    pub second_channels: SecondChannels,
    /// The targets that a stream repeats in every frame.
    pub targets: CyclicTargets,
    pub homing: HomingAxes,
    /// The thread and the last step of the open stream, whose steps write the frames; `None` without a stream.
    pub pacer: Option<StreamPacer>,
    /// How often the FIFO was cleared. After a clear the targets of an open stream no longer continue the positions of
    /// its axes.
    pub fifo_clears: u64,
    /// Objects of SDO transfers that have timed out and may still be answered.
    pub late_sdos: Vec<ObjectAddress>,
    /// Axes that a stop holds at their actual positions, because they did not follow their targets.
    pub held_back: Vec<HeldBack>,
    pub stats: Stats,
    pub news: NewsQueue,
    /// Whether the board was closed, so that every call returns an error.
    pub closed: bool,
}

impl Session {
    pub fn new(size: SlotSize, strict_crc: bool) -> Self {
        let crc_policy = if strict_crc { CrcPolicy::Strict } else { CrcPolicy::AbsentAllowed };
        Self {
            size,
            network: Arc::new(Network::NONE),
            reports: Reports::new(size, crc_policy),
            outgoing: Outgoing::new(),
            posts: Posts::new(),
            answers: Answers::new(),
            marks: Marks::new(),
            credit: Credit::new(),
            lost: SlaveSet::EMPTY,
            second_channels: SecondChannels::new(),
            targets: CyclicTargets::new(size),
            homing: HomingAxes::default(),
            pacer: None,
            fifo_clears: 0,
            late_sdos: Vec::new(),
            held_back: Vec::new(),
            stats: Stats::default(),
            news: NewsQueue::new(),
            closed: false,
        }
    }

    pub fn in_op(&self) -> bool {
        self.reports.in_op()
    }

    /// Returns an error outside OP; `what`: the call that needs OP.
    pub fn require_op(&self, what: &'static str) -> Result<(), EcmError> {
        if self.in_op() { Ok(()) } else { Err(EcmError::WrongState { what, needs: "OP", found: self.board().state }) }
    }

    /// Returns an error for a slave that shows an alarm.
    pub fn refuse_alarm(&self, slave: u8) -> Result<(), EcmError> {
        let second = self.second_channels.statusword(slave).unwrap_or_default();
        if (self.statusword(slave).0 | second.0) & Statusword::FAULT == 0 {
            return Ok(());
        }
        Err(self.network.alarm(slave, &self.slot(slave.into())))
    }

    /// Slot 0 of the newest report.
    pub const fn board(&self) -> &MasterResponse {
        &self.reports.board
    }

    /// Slot number `slot` of the newest report.
    pub fn slot(&self, slot: usize) -> RawSlot {
        self.reports.newest.slot(self.size, slot)
    }

    pub fn statusword(&self, slave: u8) -> Statusword {
        Statusword(self.reports.newest.slots(self.size).head(slave.into()).parm.get())
    }

    /// Whether all axes of a slave are enabled. A second channel of unknown state counts as enabled.
    pub fn is_on(&self, slave: u8) -> bool {
        self.statusword(slave).is_enabled() && !self.second_channels.off().contains(slave)
    }

    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            meta: self.reports.meta.unwrap_or_default(),
            board: self.reports.board,
            frame: Frame::clone(&self.reports.newest),
            size: self.size,
            network: Arc::clone(&self.network),
        }
    }
}

/// Processing of a report that was read.
impl Session {
    /// Takes the report in [`Reports::incoming`]. Returns whether it is usable.
    pub fn take_report(&mut self, meta: ReadMeta) -> bool {
        if !self.reports.accept(meta, &mut self.stats, &mut self.news) {
            return false;
        }
        self.read_board();
        self.read_slaves(meta.at);
        self.second_channels.read(self.size, &self.reports.newest);
        self.drop_targets_of_disabled();
        true
    }

    /// Reads slot 0 of the newest report: the state, and the FIFO's free count and full count.
    fn read_board(&mut self) {
        let was_in_op = self.in_op();
        let before = self.reports.read_board(&mut self.stats, &mut self.news);
        let Some((cycles, measured_cycle_ns)) = self.reports.cycles() else { return };
        if !self.in_op() {
            self.credit.reset();
            self.targets.forget_outputs();
            self.homing.active = SlaveSet::EMPTY;
            return;
        }
        let board = self.reports.board;
        // The FIFO-full count wraps around, so it may also have become smaller: any change means lost commands.
        if was_in_op && before.full_count != board.full_count {
            self.stats.losses += 1;
            self.news.push(News::CommandsLost { from: before.full_count, to: board.full_count });
        }
        // SK-5 [OURS]: a frame counts as arrived one cycle after it was written. Before that, a report's free count may
        // not include it.
        let margin_ns = self.network.cycle_ns.unwrap_or(measured_cycle_ns);
        self.credit.report(self.reports.at(), board.fifo_free, cycles, margin_ns);
        self.stats.underruns = self.credit.underruns();
    }

    /// Reads the slots of slaves for answers in claimed slots, marks of executed frames, and lost slaves.
    fn read_slaves(&mut self, at: Stamp) {
        let slots = self.reports.newest.slots(self.size);
        self.answers.read(at, slots);
        let board = self.reports.board;
        let failed = board.state.is_failed();
        if !failed {
            self.lost = SlaveSet::EMPTY;
        }
        if !self.in_op() || !failed && self.marks.awaited == 0 {
            return;
        }
        let mut last_is_new = false;
        for slave in 1..=self.size.max_slaves() {
            let index = slots.head(slave).index;
            last_is_new |= self.marks.read(index, board.result) && index == self.outgoing.last.mark;
        }
        if failed && last_is_new {
            let is_silent = |slave: u8| slots.head(slave.into()).index != self.outgoing.last.mark;
            let used = self.network.slaves().filter(|(_, config)| **config != Slave::Unused);
            let silent: SlaveSet = used.map(|(slave, _)| slave).filter(|slave| is_silent(*slave)).collect();
            // The slot of a rejected command returns no mark, although the slave is not lost. So a slave with a command
            // in this frame stays in `lost`, or out of it, as before.
            let commanded = self.outgoing.last_commanded.slaves();
            self.lost = silent.difference(commanded).union(self.lost.intersection(commanded));
        }
    }

    /// Removes the targets of axes that were switched off: an axis that is enabled again must not jump to an old
    /// target. If one axis of a slave with two axes is off, the targets of both are removed.
    fn drop_targets_of_disabled(&mut self) {
        let slots = self.reports.newest.slots(self.size);
        let is_off = |slave: usize| u64::from(!Statusword(slots.head(slave).parm.get()).is_enabled());
        let off = (0..self.network.count).fold(0, |off, n| off | is_off(n + 1) << n);
        self.targets.withdraw(SlaveSet::from_bits(off).union(self.second_channels.off()));
    }
}

/// Queries about a written frame: whether the board has executed it, its result, and its answers.
impl Session {
    /// Whether reports prove that the board has executed a frame. False means that it has not, or that this is not known
    /// yet.
    pub fn executed(&self, sent: Sent) -> bool {
        match self.marks.echo {
            Echo::Yes | Echo::Unknown => self.marks.has_returned(sent.mark),
            Echo::No => self.credit.has_executed(sent.number),
        }
    }

    /// As [`Session::executed`], but while it is unknown whether the board repeats marks, the count of FIFO entries
    /// suffices. That count is wrong if a frame was lost on the way, so this is only for uses in which a wrong "executed"
    /// does little harm.
    pub fn probably_executed(&self, sent: Sent) -> bool {
        self.executed(sent) || self.marks.echo == Echo::Unknown && self.credit.has_executed(sent.number)
    }

    /// The board's result (Data1 of slot 0) in the cycle that executed a frame of OP; `None` until it is executed.
    pub fn result(&self, sent: Sent) -> Option<u32> {
        let marked = self.marks.echo != Echo::No;
        self.executed(sent).then(|| if marked { self.marks.result(sent.mark) } else { self.reports.board.result })
    }

    /// Claims slots for a call that needs the answers to its own commands, until [`Answers::release`]. Returns false if
    /// another call has claimed one of them.
    pub fn claim(&mut self, commands: &[(usize, RawSlot)]) -> bool {
        self.answers.claim(commands, &self.reports.newest, self.size)
    }

    /// The answer to the command of frame `sent` in a claimed slot; `None` until a report has it.
    pub fn answer(&self, sent: Sent, slot: usize, id: u8) -> Option<RawSlot> {
        let (at, answer) = self.answers.newest(slot);
        let is_its_own = match self.marks.echo {
            Echo::Yes | Echo::Unknown => answer.index == sent.mark,
            Echo::No => !self.answers.may_be_old(slot) || self.executed(sent),
        };
        (is_its_own && answer.id == id && at > sent.at).then_some(answer)
    }
}

/// Composing the next frame, and noting that it was written.
impl Session {
    /// Whether the board has room for a frame.
    pub fn may_write(&self) -> bool {
        !self.in_op() || self.credit.credit() > 0
    }

    /// Composes the next frame: each slot gets the queued command, or else the target that a stream repeats, or
    /// nothing. The CRC is filled last (SK-1.22).
    pub fn compose(&mut self) {
        let size = self.size;
        // After the board has cleared its FIFO, a target in the same frame would be the only entry, and the axis would
        // jump to it.
        if self.in_op() && !self.posts.clear_fifo() {
            self.outgoing.frame.clone_from(self.targets.next());
        } else {
            self.outgoing.frame.bytes_mut().fill(0);
        }
        self.posts.write_to(&mut self.outgoing.frame, size);
        self.put_mark();
        self.outgoing.frame.fill_crc(size);
    }

    /// Gives the next frame a mark in OP, if it has a command other than an SDO transfer, or if the answers to the mark
    /// are to show which slaves are lost.
    fn put_mark(&mut self) {
        let outgoing = &mut self.outgoing;
        outgoing.mark = 0;
        let has_command = !self.posts.slots().without(self.size.sdo_slot()).is_empty();
        let asks_for_lost = self.reports.board.state.is_failed() && outgoing.written.is_multiple_of(ASK_LOST);
        if !self.reports.in_op() || !has_command && !asks_for_lost {
            return;
        }
        outgoing.mark = self.marks.next();
        for slave in 1..=self.size.max_slaves() {
            let slot = outgoing.frame.slot(self.size, slave);
            outgoing.frame.put(self.size, slave, &RawSlot { index: outgoing.mark, ..slot });
        }
    }

    /// Records that the next frame was written at `at`: empties the queue of commands, and counts the frame.
    pub fn wrote(&mut self, at: Stamp) {
        if self.posts.clear_fifo() {
            self.fifo_clears += 1;
            self.targets.clear();
        }
        let outgoing = &mut self.outgoing;
        if outgoing.mark != 0 {
            (outgoing.last.mark, outgoing.last_commanded) = (outgoing.mark, self.posts.slots());
        }
        self.posts.clear();
        outgoing.written += 1;
        outgoing.last.at = at;
        self.stats.written += 1;
        outgoing.last.number = if self.reports.in_op() { self.credit.wrote(at) } else { 0 };
    }

    /// Records that no stream is open any more: calls write their own frames again, and underruns are not counted.
    pub fn end_stream(&mut self) {
        self.pacer = None;
        self.credit.count_underruns(false);
        self.targets.clear();
    }
}
