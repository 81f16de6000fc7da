//! What was sent, newest last, and what a program is shown of it: the link's own entries of the board's FIFO are none that
//! a program knows of, neither in the free count nor in what a slot answers.

use super::pacer::Ns;
use crate::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, RawSlot, SlotSize};

/// Entries that count as in the FIFO however low its level is: the frame of this exchange, and those that its answer may
/// be older than. \[OURS]
const NOT_IN_THE_ANSWER: u16 = 3;
const MAX_SLOTS: usize = SlotSize::Bytes12.slots();
const KEPT: usize = FIFO_ENTRIES as usize + NOT_IN_THE_ANSWER as usize;

const GET_STATUS: u8 = CommandId::GetStatus.code();

/// A command of the host.
#[derive(Clone, Copy, Default)]
struct Command {
    id: u8,
    index: u8,
    outputs: u16,
}

/// A frame that was sent.
#[derive(Clone, Copy)]
enum Entry {
    /// The link's own: GET_STATUS for every slave.
    Own,
    /// The host's, with the commands of its slots.
    Host([Command; MAX_SLOTS]),
}

/// What a slot has answered to a command of the host.
#[derive(Clone, Copy)]
struct Said {
    slot: RawSlot,
    /// The number of the frame with that command, or of one before it.
    entry: u64,
}

/// The frames sent.
pub(super) struct Sent {
    size: SlotSize,
    entries: [Entry; KEPT],
    /// When each was sent.
    times: [Ns; KEPT],
    /// How many there were.
    pushed: u64,
    /// All before this number have surely been executed, or dropped.
    settled: u64,
    said: [Option<Said>; MAX_SLOTS],
    /// The slaves that have answered IO_RD or IO_WR: bit N is slave N.
    io: u64,
    /// Whether answers repeat the index of a command.
    echoes: bool,
    /// What the board says of frames that it did not execute: its error count and its full count.
    refused: Option<(u8, u16)>,
    /// Frames before this number may be among those.
    doubtful: u64,
    unseen: u64,
}

impl Sent {
    pub fn new(size: SlotSize) -> Self {
        Self {
            size,
            entries: [Entry::Own; KEPT],
            times: [0; KEPT],
            pushed: 0,
            settled: 0,
            said: [None; MAX_SLOTS],
            io: 0,
            echoes: true,
            refused: None,
            doubtful: 0,
            unseen: 0,
        }
    }

    /// A frame goes out.
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
            Entry::Own
        };
        self.entries[place(self.pushed)] = entry;
        self.times[place(self.pushed)] = now;
        self.pushed += 1;
    }

    /// What was sent so far is in the FIFO no more, whether it was executed or not.
    pub fn forget(&mut self) {
        self.entries = [Entry::Own; KEPT];
        self.settled = self.pushed;
        self.said[0] = None;
    }

    /// The newest frame has cleared the FIFO: of all that were sent it alone is there.
    pub fn forget_earlier(&mut self) {
        let newest = place(self.pushed - 1);
        let (entry, time) = (self.entries[newest], self.times[newest]);
        self.pushed -= 1;
        self.forget();
        (self.entries[newest], self.times[newest]) = (entry, time);
        self.pushed += 1;
    }

    /// What an answer may not know of was sent after this: it is of a cycle so long ago at most, or of the end of the
    /// exchange before.
    fn known_until(&self, old: Ns) -> Ns {
        let began = |back: u64| self.pushed.checked_sub(back).map_or(0, |number| self.times[place(number)]);
        began(1).saturating_sub(old).min(began(2).saturating_sub(1))
    }

    /// How many entries of the host there are at most, if the newest answer says that level.
    pub fn of_the_host(&self, level: u16) -> u16 {
        let newest = u64::from((level + 1).max(NOT_IN_THE_ANSWER)).min(KEPT as u64);
        let newest = self.pushed.saturating_sub(newest)..self.pushed;
        newest.filter(|number| matches!(self.entries[place(*number)], Entry::Host(_))).count() as u16
    }

    /// All before this number are executed in an answer that says that level and may not know what was sent since then.
    fn executed(&self, level: u16, since: Ns) -> u64 {
        let unknown =
            (self.oldest()..self.pushed).rev().take_while(|number| self.times[place(*number)] > since).count();
        self.pushed.saturating_sub(u64::from(level) + unknown as u64)
    }

    fn oldest(&self) -> u64 {
        self.pushed.saturating_sub(KEPT as u64)
    }

    /// Puts into an answer what its slots said to the host's last commands, where they now answer a GET_STATUS of the
    /// link's own: the id and the index, and what IO_WR answers. On USB nobody asks in between, and they stay.
    ///
    /// `level` is the FIFO's in this answer, `old` the age of it at most; `op`, whether it is of OP. Whether anything was
    /// put.
    pub fn show(&mut self, answer: &mut Frame, level: u16, old: Ns, op: bool) -> bool {
        let board = MasterResponse::decode(&answer.slot(self.size, 0));
        let refused = (board.error, board.full_count);
        if board.state.is_failed() || (op && self.refused.is_some_and(|before| before != refused)) {
            self.doubtful = self.pushed;
        }
        self.refused = op.then_some(refused);
        // In OP slot 0 has an id of its own.
        let slots = usize::from(op)..=self.size.max_slaves();
        for slot in slots.clone() {
            let answered = answer.slot(self.size, slot);
            if answered.id != GET_STATUS {
                let entry = self.newest_with(slot, answered.id, level);
                self.said[slot] = Some(Said { slot: answered, entry });
                self.learn(slot, &answered, entry);
            } else if answered.index != 0 && self.asked_itself(slot, answered.index) {
                // The host's own GET_STATUS, with an index of its own.
                self.said[slot] = None;
            }
        }
        let settled = self.executed(level, self.known_until(old)).max(self.settled);
        for number in self.settled.max(self.oldest())..settled {
            if let Entry::Host(commands) = self.entries[place(number)] {
                slots.clone().for_each(|slot| self.settle(slot, commands[slot], number));
            }
        }
        self.settled = settled;
        let mut put = false;
        for slot in slots {
            let now = answer.slot(self.size, slot);
            if let (GET_STATUS, Some(said)) = (now.id, self.said[slot]) {
                answer.put(self.size, slot, &repeated(&now, &said.slot, slot));
                put = true;
            }
        }
        put
    }

    /// The newest entry with that command which this answer may know of; if there is none, it was one before.
    fn newest_with(&self, slot: usize, id: u8, level: u16) -> u64 {
        let end = self.pushed.saturating_sub(u64::from(level) + 1);
        let has =
            |number: &u64| matches!(self.entries[place(*number)], Entry::Host(commands) if commands[slot].id == id);
        (self.settled..end).rev().find(has).unwrap_or(self.settled.saturating_sub(1))
    }

    /// The board takes IO_RD and IO_WR there, and repeats the index or, in firmware 1.5, does not.
    fn learn(&mut self, slot: usize, answered: &RawSlot, entry: u64) {
        if !is_io(answered.id) {
            return;
        }
        self.io |= 1 << slot;
        if let Entry::Host(commands) = self.entries[place(entry)]
            && (commands[slot].id, commands[slot].index != 0) == (answered.id, true)
        {
            self.echoes = answered.index != 0;
        }
    }

    /// Whether an entry of the host that is not settled asks that slot for its state with that index.
    fn asked_itself(&self, slot: usize, index: u8) -> bool {
        let asks = |number: u64| {
            matches!(self.entries[place(number)], Entry::Host(commands)
                if (commands[slot].id, commands[slot].index) == (GET_STATUS, index))
        };
        (self.settled.max(self.oldest())..self.pushed).any(asks)
    }

    /// A slot of an entry of the host has been executed: what was said to an earlier one is no answer any more.
    fn settle(&mut self, slot: usize, command: Command, number: u64) {
        let fits = match self.said[slot] {
            Some(said) => said.entry >= number || (said.slot.id == command.id && !is_io(command.id)),
            None => command.id == GET_STATUS,
        };
        if fits {
            return;
        }
        // Executed between two answers, or rejected. What an IO slave answers is known all the same.
        self.said[slot] = self.answer_of_io(slot, command, number).map(|slot| Said { slot, entry: number });
        if slot > 0 && command.id != GET_STATUS && self.said[slot].is_none() {
            self.unseen += 1;
        }
    }

    /// Where the board has answered IO_RD or IO_WR it takes the next ones too (SK-4), and answers outputs as they were
    /// written. \[OURS]
    fn answer_of_io(&self, slot: usize, command: Command, number: u64) -> Option<RawSlot> {
        let known = self.io >> slot & 1 == 1 && is_io(command.id) && number >= self.doubtful;
        let index = if self.echoes { command.index } else { 0 };
        known.then_some(RawSlot { id: command.id, index, data1: command.outputs.into(), ..RawSlot::ZERO })
    }

    /// The kinds of slaves are told anew: what is known of them counts no more.
    pub const fn forget_kinds(&mut self) {
        self.io = 0;
    }

    /// Commands of the host for slaves that no answer has shown: rejected ones, and such as were executed between two answers.
    pub const fn unseen(&self) -> u64 {
        self.unseen
    }
}

const fn place(number: u64) -> usize {
    (number % KEPT as u64) as usize
}

/// What a slot answers now, as the answer to an earlier command.
fn repeated(now: &RawSlot, said: &RawSlot, slot: usize) -> RawSlot {
    let mut shown = RawSlot { id: said.id, ..*now };
    // Byte 1 of slot 0 counts errors; a drive's mode (firmware 1.5) is there whatever the command was.
    if slot > 0 && now.index == 0 {
        shown.index = said.index;
    }
    // Outputs hold, and inputs are shown to anything else.
    if said.id == CommandId::IoWrite.code() {
        shown.data1 = said.data1;
    }
    shown
}

fn is_io(id: u8) -> bool {
    [CommandId::IoRead, CommandId::IoWrite].map(CommandId::code).contains(&id)
}
