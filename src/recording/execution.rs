//! Determines from reports when the board executed each command. Commands wait in the FIFO, from which the board takes one in
//! each cycle (SK-5).

use std::collections::VecDeque;

use super::executed::{Executed, LastExecuted};
use crate::sk::{FIFO_ENTRIES, MasterResponse, SlaveCommand};

/// The commands in one frame, each with the number that the caller gives to its slave. Slots without a valid command are
/// left out.
pub type Orders = Vec<(usize, SlaveCommand)>;

/// The most command frames that are kept until a report shows their execution: as many as the FIFO holds, and more because some
/// reports do not show what was executed.
const COMMANDS_KEPT: usize = 4 * FIFO_ENTRIES as usize;

/// A command frame that was executed.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// When the board executed the frame, ns: the time of that cycle's report, or the time calculated from a later
    /// report.
    pub at_ns: i64,
    /// The commands of the frame.
    pub orders: Orders,
}

/// What a report shows about the execution of commands.
#[derive(Debug, PartialEq)]
pub enum ExecutionReport {
    /// All command frames that are known to be executed since the last report with this result. If `idle_since_ns` is
    /// set, the FIFO was empty before the first of them.
    Executed {
        /// The command frames, in the order of their execution.
        entries: Vec<Entry>,
        /// The time of the first cycle that found the FIFO empty, in nanoseconds; `None` if no cycle did.
        idle_since_ns: Option<i64>,
    },
    /// It is not yet known which commands were executed; a later report will show it (see [`LastExecuted::Ambiguous`]).
    Later,
    /// It cannot be known which commands were executed, because earlier ones were lost or the FIFO was cleared. This
    /// ends with the report that shows the execution of a command sent later.
    Unknown,
}

/// The commands sent in OP that may still wait in the FIFO.
#[derive(Debug)]
pub struct Execution {
    cycle_ns: i64,
    executed: Executed,
    /// The commands that perhaps still wait for their execution, with the times at which they were sent, oldest first.
    sent: VecDeque<(i64, Orders)>,
    /// The time of the last report that showed what was executed, and whether commands waited in the FIFO then. `None`:
    /// there was none yet, or commands were lost since then.
    before: Option<(i64, bool)>,
}

impl Execution {
    /// Starts without commands. `cycle_ns` is the board's cycle time in nanoseconds.
    pub fn new(cycle_ns: i64) -> Self {
        Self { cycle_ns: cycle_ns.max(1), executed: Executed::new(cycle_ns), sent: VecDeque::new(), before: None }
    }

    /// Adds a command frame that was sent in OP. `clears`: whether it clears the FIFO.
    pub fn command(&mut self, at_ns: i64, orders: Orders, clears: bool) {
        if self.sent.len() == COMMANDS_KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back((at_ns, orders));
        self.executed.command(clears);
    }

    /// Adds a report in OP. Returns which commands the board has executed, as far as the report shows it.
    pub fn report(&mut self, at_ns: i64, board: &MasterResponse) -> ExecutionReport {
        let waits = board.fifo_free < FIFO_ENTRIES;
        let last = match self.executed.report(at_ns, board) {
            LastExecuted::Command(last) => last,
            LastExecuted::Nothing => {
                self.before = Some((at_ns, waits));
                return ExecutionReport::Executed { entries: Vec::new(), idle_since_ns: None };
            }
            LastExecuted::Ambiguous => return ExecutionReport::Later,
            LastExecuted::Unknown => {
                self.before = None;
                return ExecutionReport::Unknown;
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
            let cycles = at_ns.saturating_sub(then_ns).saturating_add(self.cycle_ns / 2) / self.cycle_ns;
            // The FIFO was empty if more cycles have passed than commands were executed. One cycle more proves nothing,
            // because on a real link the times of reports vary by up to a cycle.
            let idle = (entries.is_empty() && !waits) || entries.len() as i64 + 1 < cycles;
            idle.then_some(then_ns.saturating_add(self.cycle_ns).min(at_ns))
        });
        ExecutionReport::Executed { entries, idle_since_ns }
    }

    /// Notes that frames are missing before the next one, such as damaged ones.
    pub fn lost(&mut self) {
        self.executed.lost();
        self.sent.clear();
        self.before = None;
    }

    /// Starts anew when OP is left, since the FIFO is empty then.
    pub fn reset(&mut self) {
        self.executed.reset(self.cycle_ns);
        self.sent.clear();
        self.before = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sk::{MasterState, StateByte};

    /// A damaged file may have any times.
    #[test]
    fn odd_times_are_no_panic() {
        let state = StateByte::reached(MasterState::Op);
        let board = MasterResponse { state, fifo_free: FIFO_ENTRIES, ..MasterResponse::default() };
        let mut execution = Execution::new(1_000_000);
        for at_ns in [i64::MIN, i64::MAX, i64::MIN, i64::MAX] {
            execution.command(at_ns, Orders::new(), false);
            execution.report(at_ns, &board);
        }
    }
}
