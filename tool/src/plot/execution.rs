//! When the board executed what: a command waits in the FIFO, and one is taken out in each cycle (SK-5).

use std::collections::VecDeque;

use ecmsk::recording::{Executed, LastExecuted};
use ecmsk::sk::{FIFO_ENTRIES, MasterResponse, SlaveCommand};

use super::chosen::MAX_SLAVES;

/// What a command asks of each axis and IO slave of the plot.
pub type Orders = [Option<SlaveCommand>; MAX_SLAVES];

/// Commands that are kept at most: those that may wait, and some more for reports that do not tell what was executed.
const KEPT: usize = 4 * FIFO_ENTRIES as usize;

/// A command that was executed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// When: the time of the report of that cycle, nanoseconds.
    pub at_ns: i64,
    /// What it asked for.
    pub orders: Orders,
}

/// What a report tells of the commands.
#[derive(Debug, PartialEq)]
pub enum Told {
    /// All that was executed since the report before that told it; nothing if `idle_since_ns` says that cycles found the FIFO
    /// empty: the first of them. Such cycles are before the entries.
    Executed {
        /// The entries, in the order of their execution.
        entries: Vec<Entry>,
        /// The first cycle that found the FIFO empty, nanoseconds.
        idle_since_ns: Option<i64>,
    },
    /// Nothing; a later report will tell (see [`LastExecuted::Doubtful`]).
    Later,
    /// Nothing, and commands before it were lost or cleared.
    Unknown,
}

/// The commands sent in OP, as far as they may still wait.
#[derive(Debug)]
pub struct Execution {
    cycle_ns: i64,
    executed: Executed,
    /// Those that are not known to be executed, with the time when they were sent; the oldest first.
    sent: VecDeque<(i64, Orders)>,
    /// The report before that told what was executed: when it was made, and whether commands waited.
    before: Option<(i64, bool)>,
}

impl Execution {
    /// Of a board with that cycle, in nanoseconds.
    pub fn new(cycle_ns: i64) -> Self {
        Self { cycle_ns: cycle_ns.max(1), executed: Executed::new(cycle_ns), sent: VecDeque::new(), before: None }
    }

    /// A command is sent in OP. `clears`: whether it clears the FIFO.
    pub fn command(&mut self, at_ns: i64, orders: Orders, clears: bool) {
        if self.sent.len() == KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back((at_ns, orders));
        self.executed.command(clears);
    }

    /// A report of OP goes by.
    pub fn report(&mut self, at_ns: i64, board: &MasterResponse) -> Told {
        let waits = board.fifo_free < FIFO_ENTRIES;
        let last = match self.executed.report(at_ns, board) {
            LastExecuted::Command(last) => last,
            LastExecuted::Nothing => {
                self.before = Some((at_ns, waits));
                return Told::Executed { entries: Vec::new(), idle_since_ns: None };
            }
            LastExecuted::Doubtful => return Told::Later,
            LastExecuted::Unknown => {
                self.before = None;
                return Told::Unknown;
            }
        };
        let oldest = self.executed.count() - self.sent.len() as u64;
        let (mut entries, mut earliest_ns) = (Vec::new(), self.before.map_or(i64::MIN, |(then_ns, _)| then_ns));
        for number in oldest..=last {
            let Some((sent_ns, orders)) = self.sent.pop_front() else { break };
            if number < self.executed.known_from() {
                continue;
            }
            let cycles_ago = i64::try_from(last - number).unwrap_or(i64::MAX);
            let at_ns = at_ns.saturating_sub(cycles_ago.saturating_mul(self.cycle_ns)).max(sent_ns).max(earliest_ns);
            earliest_ns = at_ns;
            entries.push(Entry { at_ns, orders });
        }
        let before = self.before.replace((at_ns, waits));
        let idle_since_ns = before.filter(|(_, waited)| !waited).and_then(|(then_ns, _)| {
            let cycles = (at_ns.saturating_sub(then_ns) + self.cycle_ns / 2) / self.cycle_ns;
            // Times of reports on a real wire are a part of a cycle wrong, so that one cycle too many tells nothing.
            let idle = (entries.is_empty() && !waits) || entries.len() as i64 + 1 < cycles;
            idle.then_some(then_ns.saturating_add(self.cycle_ns).min(at_ns))
        });
        Told::Executed { entries, idle_since_ns }
    }

    /// OP was left: the FIFO is empty.
    pub fn reset(&mut self) {
        self.executed.reset(self.cycle_ns);
        self.sent.clear();
        self.before = None;
    }
}
