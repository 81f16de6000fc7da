//! The frames that were sent last, kept to show a program what it would see on USB. The program does not know the
//! entries that the link itself adds to the board's FIFO, so it sees them neither in the number of free entries nor in
//! the answers of the slots.

use crate::ethercat::Ns;
use crate::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, RawSlot, SlaveKind, SlotSize};

/// How many of the newest entries count as being in the FIFO however low its reported level is: the frame of this
/// exchange, and those that are newer than the answer. \[OURS]
const UNREPORTED_ENTRIES: u16 = 3;
const MAX_SLOTS: usize = SlotSize::Bytes12.slots();
/// How many frames are kept: all that may be in the FIFO.
const ENTRIES_KEPT: usize = FIFO_ENTRIES as usize + UNREPORTED_ENTRIES as usize;

const GET_STATUS: u8 = CommandId::GetStatus.code();

/// A command in one slot of a frame of the program.
#[derive(Clone, Copy, Default)]
struct Command {
    id: u8,
    index: u8,
    /// The outputs of IO_WR: the low half of data1.
    outputs: u16,
}

/// A frame that was sent.
#[derive(Clone, Copy)]
enum Entry {
    /// A frame of the link itself: GET_STATUS for every slave.
    Link,
    /// A frame of the program, with the commands of its slots.
    Host([Command; MAX_SLOTS]),
}

/// What a slot has answered to a command of the program.
#[derive(Clone, Copy)]
struct Answered {
    slot: RawSlot,
    /// The number of the frame with that command, or of an earlier one.
    entry: u64,
}

/// The frames that were sent last, and what the slots have answered to them. Frames are numbered from 0.
pub(super) struct SentFrames {
    size: SlotSize,
    /// The frames, as a ring buffer indexed by [`ring_index`].
    entries: [Entry; ENTRIES_KEPT],
    /// When each of them was sent.
    times: [Ns; ENTRIES_KEPT],
    /// How many frames were sent: the number of the next one.
    pushed: u64,
    /// All frames with a smaller number have been executed or discarded.
    done_before: u64,
    /// What each slot has answered to the latest command of the program.
    answers: [Option<Answered>; MAX_SLOTS],
    /// The slaves that have answered IO_RD or IO_WR; bit N is slave N.
    io_slaves: u64,
    /// Whether answers repeat the index of the command.
    repeats_index: bool,
    /// The board's counts of frames that it did not execute: its error count and its full count.
    error_counts: Option<(u8, u16)>,
    /// Frames with a smaller number may be among those that the board did not execute.
    doubtful_before: u64,
    /// How many commands of the program no answer has shown.
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

    /// Adds a frame that is being sent; `host` tells whether it is one of the program.
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

    /// None of the frames sent so far is in the FIFO any more, whether it was executed or not.
    pub fn forget(&mut self) {
        self.entries = [Entry::Link; ENTRIES_KEPT];
        self.done_before = self.pushed;
        self.answers[0] = None;
    }

    /// The newest frame has cleared the FIFO, so of all frames sent it alone may be in the FIFO.
    pub fn forget_earlier(&mut self) {
        let newest = ring_index(self.pushed - 1);
        let (entry, time) = (self.entries[newest], self.times[newest]);
        self.pushed -= 1;
        self.forget();
        (self.entries[newest], self.times[newest]) = (entry, time);
        self.pushed += 1;
    }

    /// The latest time of sending for which an answer surely knows the frame. The answer shows a cycle at most `old`
    /// ago, or the end of the previous exchange.
    fn reported_until(&self, old: Ns) -> Ns {
        let began = |back: u64| self.pushed.checked_sub(back).map_or(0, |number| self.times[ring_index(number)]);
        began(1).saturating_sub(old).min(began(2).saturating_sub(1))
    }

    /// The largest possible number of the program's entries in the FIFO, if the newest answer reports that level.
    pub fn host_entries_max(&self, level: u16) -> u16 {
        let newest = u64::from((level + 1).max(UNREPORTED_ENTRIES)).min(ENTRIES_KEPT as u64);
        let newest = self.pushed.saturating_sub(newest)..self.pushed;
        newest.filter(|number| matches!(self.entries[ring_index(*number)], Entry::Host(_))).count() as u16
    }

    /// All frames with a smaller number than this are executed in an answer that reports that level and may not know
    /// frames sent after `since`.
    fn executed_before(&self, level: u16, since: Ns) -> u64 {
        let unknown =
            (self.oldest()..self.pushed).rev().take_while(|number| self.times[ring_index(*number)] > since).count();
        self.pushed.saturating_sub(u64::from(level) + unknown as u64)
    }

    /// The smallest number of a frame that is kept.
    fn oldest(&self) -> u64 {
        self.pushed.saturating_sub(ENTRIES_KEPT as u64)
    }

    /// Replaces the answers to the link's own GET_STATUS commands by those to the program's latest commands: the
    /// command id, the index, and what IO_WR answers. On USB nobody sends commands in between, and these answers stay.
    ///
    /// `level` is the FIFO's level in this answer, `old` the largest age of the answer, and `op` whether it was made in
    /// OP. Returns whether the answer was changed.
    pub fn restore_answers(&mut self, answer: &mut Frame, level: u16, old: Ns, op: bool) -> bool {
        let board = MasterResponse::decode(&answer.slot(self.size, 0));
        let refused = (board.error, board.full_count);
        if board.state.is_failed() || (op && self.error_counts.is_some_and(|before| before != refused)) {
            self.doubtful_before = self.pushed;
        }
        self.error_counts = op.then_some(refused);
        // In OP slot 0 always answers with the same id.
        let slots = usize::from(op)..=self.size.max_slaves();
        for slot in slots.clone() {
            let answered = answer.slot(self.size, slot);
            if answered.id != GET_STATUS {
                let entry = self.newest_with(slot, answered.id, level);
                self.answers[slot] = Some(Answered { slot: answered, entry });
                self.note_io_slave(slot, &answered, entry);
            } else if answered.index != 0 && self.host_asked_status(slot, answered.index) {
                // The program itself has sent GET_STATUS, with an index.
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

    /// The number of the newest frame with that command that this answer may know; if there is none, of the last one
    /// before those.
    fn newest_with(&self, slot: usize, id: u8, level: u16) -> u64 {
        let end = self.pushed.saturating_sub(u64::from(level) + 1);
        let has = |number: &u64| matches!(self.entries[ring_index(*number)], Entry::Host(commands) if commands[slot].id == id);
        (self.done_before..end).rev().find(has).unwrap_or(self.done_before.saturating_sub(1))
    }

    /// A slave that answers IO_RD or IO_WR is an IO slave. Its answer also shows whether the board repeats the index,
    /// which firmware 1.5 does not.
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

    /// Whether a frame of the program that may not be executed yet has GET_STATUS with that index in that slot.
    fn host_asked_status(&self, slot: usize, index: u8) -> bool {
        let asks = |number: u64| {
            matches!(self.entries[ring_index(number)], Entry::Host(commands)
                if (commands[slot].id, commands[slot].index) == (GET_STATUS, index))
        };
        (self.done_before.max(self.oldest())..self.pushed).any(asks)
    }

    /// The command of the program in that slot has been executed, so an answer to an earlier command no longer applies.
    fn mark_executed(&mut self, slot: usize, command: Command, number: u64) {
        let fits = match self.answers[slot] {
            Some(answers) => answers.entry >= number || (answers.slot.id == command.id && !is_io(command.id)),
            None => command.id == GET_STATUS,
        };
        if fits {
            return;
        }
        // The command was executed between two answers, or rejected. The answer of an IO slave can be derived from it.
        self.answers[slot] = self.io_answer(slot, command, number).map(|slot| Answered { slot, entry: number });
        if slot > 0 && command.id != GET_STATUS && self.answers[slot].is_none() {
            self.unanswered += 1;
        }
    }

    /// The answer to IO_RD and IO_WR. A slave that has answered such a command accepts further ones (SK-4), and answers
    /// with the outputs that were written. \[OURS]
    fn io_answer(&self, slot: usize, command: Command, number: u64) -> Option<RawSlot> {
        let known = self.io_slaves >> slot & 1 == 1 && is_io(command.id) && number >= self.doubtful_before;
        let index = if self.repeats_index { command.index } else { 0 };
        known.then_some(RawSlot { id: command.id, index, data1: command.outputs.into(), ..RawSlot::ZERO })
    }

    /// SET_AXIS defines the kinds of the slaves anew, so what the answers have shown no longer applies.
    pub const fn forget_kinds(&mut self) {
        self.io_slaves = 0;
    }

    /// How many commands of the program for slaves no answer has shown, because they were rejected or were executed
    /// between two answers.
    pub const fn unanswered(&self) -> u64 {
        self.unanswered
    }
}

/// The index of a frame in the ring buffer.
const fn ring_index(number: u64) -> usize {
    (number % ENTRIES_KEPT as u64) as usize
}

/// The answer of a slot to GET_STATUS, changed to look like the answer to an earlier command.
fn shown_slot(now: &RawSlot, answers: &RawSlot, slot: usize) -> RawSlot {
    let mut shown = RawSlot { id: answers.id, ..*now };
    // Byte 1 of slot 0 counts errors; in firmware 1.5 it holds a drive's mode after any command.
    if slot > 0 && now.index == 0 {
        shown.index = answers.index;
    }
    // IO_WR answers the outputs, which stay as they were written; any other command answers the inputs.
    if answers.id == CommandId::IoWrite.code() {
        shown.data1 = answers.data1;
    }
    shown
}

fn is_io(id: u8) -> bool {
    CommandId::from_code(id).only_kind() == Some(SlaveKind::Io)
}
