//! The newest sent frames, kept to show a program the same answers as on USB. The link adds entries of its own to the
//! board's FIFO. The program must not notice them, neither in the number of free entries nor in the answers of the
//! slots.

use crate::ethercat::Ns;
use crate::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, RawSlot, SlaveKind, SlotSize};

/// How many of the newest entries count as being in the FIFO even if its reported level is lower: the frame of this
/// exchange, and two frames that may be newer than the answer. \[OURS]
const UNREPORTED_ENTRIES: u16 = 3;
const MAX_SLOTS: usize = SlotSize::Bytes12.slots();
/// The number of frames that are kept: as many as the FIFO can hold, plus those that the reported level may not
/// include.
const ENTRIES_KEPT: usize = FIFO_ENTRIES as usize + UNREPORTED_ENTRIES as usize;

const GET_STATUS: u8 = CommandId::GetStatus.code();

/// A command of the program in one slot of a sent frame.
#[derive(Clone, Copy, Default)]
struct Command {
    id: u8,
    index: u8,
    /// The outputs in an IO_WR command: the low half of Data1.
    outputs: u16,
}

/// The record of a sent frame.
#[derive(Clone, Copy)]
enum Entry {
    /// A frame of the link itself, with GET_STATUS for every slave.
    Link,
    /// A frame of the program, with the commands in its slots.
    Host([Command; MAX_SLOTS]),
}

/// What a slot has answered to a command of the program.
#[derive(Clone, Copy)]
struct Answered {
    slot: RawSlot,
    /// The number of the frame whose command the slot has answered, as far as is known. It may be too low if a later
    /// frame has the same command.
    entry: u64,
}

/// The newest sent frames, and the answers of the slots to their commands. Frames are numbered from 0.
pub(super) struct SentFrames {
    size: SlotSize,
    /// The records of the newest frames: a ring buffer indexed by [`ring_index`].
    entries: [Entry; ENTRIES_KEPT],
    /// The time at which each frame was sent.
    times: [Ns; ENTRIES_KEPT],
    /// Number of frames sent so far, which is also the number of the next frame.
    pushed: u64,
    /// All frames with a smaller number have been executed or discarded.
    done_before: u64,
    /// The answer of each slot to the latest command of the program.
    answers: [Option<Answered>; MAX_SLOTS],
    /// The slots of slaves that have answered IO_RD or IO_WR, for [`Self::io_answer`]: bit N is slot N.
    io_slaves: u64,
    /// Whether the board's answers repeat the index of a command, as firmware 1.7 does.
    repeats_index: bool,
    /// The board's two counters of frames that it did not execute, as in the newest answer in OP: its error count and
    /// its full count. `None`: the board is not in OP.
    error_counts: Option<(u8, u16)>,
    /// Frames with a smaller number may be among those that the board did not execute, so no answer is derived from
    /// them.
    doubtful_before: u64,
    /// Number of the program's commands to slaves that no report has answered.
    unanswered: u64,
}

impl SentFrames {
    pub fn new(size: SlotSize) -> Self {
        Self {
            size,
            entries: [Entry::Link; ENTRIES_KEPT],
            times: [0; ENTRIES_KEPT],
            pushed: 0,
            done_before: 0,
            answers: [None; MAX_SLOTS],
            io_slaves: 0,
            repeats_index: true,
            error_counts: None,
            doubtful_before: 0,
            unanswered: 0,
        }
    }

    /// Adds a frame that is being sent; `host` says whether it is a frame of the program.
    pub fn push(&mut self, frame: &Frame, host: bool, now: Ns) {
        let entry = if host {
            let slots = frame.slots(self.size);
            let mut commands = [Command::default(); MAX_SLOTS];
            for (slot, command) in commands.iter_mut().enumerate().take(self.size.slots()) {
                let head = slots.head(slot);
                *command = Command { id: head.id, index: head.index, outputs: head.data1.get() as u16 };
            }
            Entry::Host(commands)
        } else {
            Entry::Link
        };
        self.entries[ring_index(self.pushed)] = entry;
        self.times[ring_index(self.pushed)] = now;
        self.pushed += 1;
    }

    /// Records that the FIFO no longer holds any of the frames sent so far: they were executed or discarded.
    pub fn forget(&mut self) {
        self.entries = [Entry::Link; ENTRIES_KEPT];
        self.done_before = self.pushed;
        self.answers[0] = None;
    }

    /// Records that the newest frame has cleared the FIFO, so that no earlier frame is in it.
    pub fn forget_earlier(&mut self) {
        let newest = ring_index(self.pushed - 1);
        let (entry, time) = (self.entries[newest], self.times[newest]);
        self.pushed -= 1;
        self.forget();
        (self.entries[newest], self.times[newest]) = (entry, time);
        self.pushed += 1;
    }

    /// The latest time for which the newest answer certainly includes every frame sent until then. The answer may show
    /// a state of the board that is `old` ns older than the beginning of the newest exchange. It may also lack the
    /// frame of the exchange before that one. The earlier of these two limits counts.
    fn reported_until(&self, old: Ns) -> Ns {
        let began = |back: u64| self.pushed.checked_sub(back).map_or(0, |number| self.times[ring_index(number)]);
        began(1).saturating_sub(old).min(began(2).saturating_sub(1))
    }

    /// The maximum number of entries of the program in the FIFO, if the newest answer reports the FIFO level `level`.
    /// Newer frames than the answer count as being in the FIFO.
    pub fn host_entries_max(&self, level: u16) -> u16 {
        let newest = u64::from((level + 1).max(UNREPORTED_ENTRIES)).min(ENTRIES_KEPT as u64);
        let newest = self.pushed.saturating_sub(newest)..self.pushed;
        newest.filter(|number| matches!(self.entries[ring_index(*number)], Entry::Host(_))).count() as u16
    }

    /// The number of the oldest frame that may not have been executed yet: all earlier frames have been executed. The
    /// answer reports the FIFO level `level`; frames that were sent after `since` may be missing from this level.
    fn executed_before(&self, level: u16, since: Ns) -> u64 {
        let unknown =
            (self.oldest()..self.pushed).rev().take_while(|number| self.times[ring_index(*number)] > since).count();
        self.pushed.saturating_sub(u64::from(level) + unknown as u64)
    }

    /// The number of the oldest frame that is kept.
    fn oldest(&self) -> u64 {
        self.pushed.saturating_sub(ENTRIES_KEPT as u64)
    }

    /// Puts the answers to the program's latest commands (command id, index, and the data of IO_WR) into an answer to
    /// the link's own GET_STATUS commands. On USB a board gets no such commands, and keeps the answers to the program's
    /// latest commands in its reports.
    ///
    /// `level` is the FIFO level in this answer, `old` the largest age of the answer, and `op` whether the board was in
    /// OP. Returns whether the answer was changed.
    pub fn restore_answers(&mut self, answer: &mut Frame, level: u16, old: Ns, op: bool) -> bool {
        let board = MasterResponse::decode(&answer.slot(self.size, 0));
        let refused = (board.error, board.full_count);
        if board.state.is_failed() || (op && self.error_counts.is_some_and(|before| before != refused)) {
            self.doubtful_before = self.pushed;
        }
        self.error_counts = op.then_some(refused);
        // In OP slot 0 is left out: it always has the id of the cyclic response.
        let slots = usize::from(op)..=self.size.max_slaves();
        for slot in slots.clone() {
            let answered = answer.slot(self.size, slot);
            if answered.id != GET_STATUS {
                let entry = self.newest_with(slot, answered.id, level);
                self.answers[slot] = Some(Answered { slot: answered, entry });
                self.note_io_slave(slot, &answered, entry);
            } else if answered.index != 0 && self.host_asked_status(slot, answered.index) {
                // The GET_STATUS command has an index, which the link's own GET_STATUS commands do not have. So the
                // command is the program's, and its answer is shown unchanged.
                self.answers[slot] = None;
            }
        }
        let done_before = self.executed_before(level, self.reported_until(old)).max(self.done_before);
        for number in self.done_before.max(self.oldest())..done_before {
            if let Entry::Host(commands) = self.entries[ring_index(number)] {
                slots.clone().for_each(|slot| self.mark_executed(slot, commands[slot], number));
            }
        }
        self.done_before = done_before;
        let mut put = false;
        for slot in slots {
            let now = answer.slot(self.size, slot);
            if let (GET_STATUS, Some(answers)) = (now.id, self.answers[slot]) {
                answer.put(self.size, slot, &shown_slot(&now, &answers.slot, slot));
                put = true;
            }
        }
        put
    }

    /// Returns the number of the newest frame with the command `id` in this slot that the board may have executed
    /// before it made this answer. If there is none, returns the number of the last frame before `done_before`: all
    /// frames up to it have been executed or discarded.
    fn newest_with(&self, slot: usize, id: u8, level: u16) -> u64 {
        let end = self.pushed.saturating_sub(u64::from(level) + 1);
        let has = |number: &u64| matches!(self.entries[ring_index(*number)], Entry::Host(commands) if commands[slot].id == id);
        (self.done_before..end).rev().find(has).unwrap_or(self.done_before.saturating_sub(1))
    }

    /// Marks a slave that answers IO_RD or IO_WR as an IO slave. Its answer also shows whether the board repeats the
    /// index, which firmware 1.5 does not.
    fn note_io_slave(&mut self, slot: usize, answered: &RawSlot, entry: u64) {
        if !is_io(answered.id) {
            return;
        }
        self.io_slaves |= 1 << slot;
        if let Entry::Host(commands) = self.entries[ring_index(entry)]
            && (commands[slot].id, commands[slot].index != 0) == (answered.id, true)
        {
            self.repeats_index = answered.index != 0;
        }
    }

    /// Whether a frame of the program that may not have been executed yet has a GET_STATUS with this index in this
    /// slot. Its answer belongs to the program and stays unchanged.
    fn host_asked_status(&self, slot: usize, index: u8) -> bool {
        let asks = |number: u64| {
            matches!(self.entries[ring_index(number)], Entry::Host(commands)
                if (commands[slot].id, commands[slot].index) == (GET_STATUS, index))
        };
        (self.done_before.max(self.oldest())..self.pushed).any(asks)
    }

    /// Records that the program's command in that slot has been executed. If the slot has no answer to it, the answer
    /// to an earlier command is not shown any more.
    fn mark_executed(&mut self, slot: usize, command: Command, number: u64) {
        let fits = match self.answers[slot] {
            Some(answers) => answers.entry >= number || (answers.slot.id == command.id && !is_io(command.id)),
            None => command.id == GET_STATUS,
        };
        if fits {
            return;
        }
        // No answer has shown the command: it was executed between two answers, or rejected. For an IO slave the answer
        // follows from the command alone ([`Self::io_answer`]).
        self.answers[slot] = self.io_answer(slot, command, number).map(|slot| Answered { slot, entry: number });
        if slot > 0 && command.id != GET_STATUS && self.answers[slot].is_none() {
            self.unanswered += 1;
        }
    }

    /// The answer to an IO_RD or IO_WR that no report has shown. It is known only for a slave that has answered such a
    /// command before, so that it accepts further ones (SK-4): it answers IO_WR with the outputs that were written.
    /// \[OURS]
    fn io_answer(&self, slot: usize, command: Command, number: u64) -> Option<RawSlot> {
        let known = self.io_slaves >> slot & 1 == 1 && is_io(command.id) && number >= self.doubtful_before;
        let index = if self.repeats_index { command.index } else { 0 };
        known.then_some(RawSlot { id: command.id, index, data1: command.outputs.into(), ..RawSlot::ZERO })
    }

    /// Forgets the kinds of slaves that answers have shown, because SET_AXIS declares them anew.
    pub const fn forget_kinds(&mut self) {
        self.io_slaves = 0;
    }

    /// Number of the program's commands to slaves that no report has answered: the board rejected them, or executed
    /// them between two answers.
    pub const fn unanswered(&self) -> u64 {
        self.unanswered
    }
}

/// The index of a frame's record in the ring buffer.
const fn ring_index(number: u64) -> usize {
    (number % ENTRIES_KEPT as u64) as usize
}

/// The slot to show in a report: `now`, an answer to GET_STATUS, with the command id, index and outputs from `answers`,
/// the answer to an earlier command.
fn shown_slot(now: &RawSlot, answers: &RawSlot, slot: usize) -> RawSlot {
    let mut shown = RawSlot { id: answers.id, ..*now };
    // Byte 1, the index, is not replaced in two cases. In slot 0 it counts errors. With firmware 1.5 it holds a drive's
    // mode of operation, whatever the command was.
    if slot > 0 && now.index == 0 {
        shown.index = answers.index;
    }
    // IO_WR answers with the outputs, which stay as written; any other command answers with the inputs.
    if answers.id == CommandId::IoWrite.code() {
        shown.data1 = answers.data1;
    }
    shown
}

fn is_io(id: u8) -> bool {
    CommandId::from_code(id).only_kind() == Some(SlaveKind::Io)
}
