//! The frames of a schedule, kept from outside: which of them the FIFO holds, what each of them carries, and what became
//! of it.

use std::collections::VecDeque;

use ecmsk::engine::Counters;
use ecmsk::sk::{CommandId, FIFO_ENTRIES, Frame, MASTER_CYCLIC, MasterResponse, SlaveCommand, SlotCommand, SlotSize};

use crate::machine::{Axis, MARKER};

/// A frame in the FIFO.
struct Entry {
    /// Index of its IO_RD.
    mark: u8,
    /// Slave and target of its motion commands.
    targets: Vec<(usize, i32)>,
}

/// The books.
#[derive(Default)]
pub struct Books {
    queue: VecDeque<Entry>,
    sent: u64,
    /// Motion commands executed so far, and those found in a counter instead.
    pub followed: u64,
    pub discarded: u64,
}

impl Books {
    /// The mark that the next frame carries.
    pub fn next_mark(&mut self) -> u8 {
        self.sent += 1;
        self.sent as u8
    }

    /// A frame has arrived in OP: it is queued unless it is counted as full.
    pub fn arrived(&mut self, frame: &Frame, size: SlotSize, before: &Counters, after: &Counters) {
        let cleared = after.cleared - before.cleared;
        if cleared > 0 {
            assert_eq!(cleared, self.queue.len() as u64, "SET_FIFO 1 clears all entries, or none");
            self.queue.clear();
        }
        let full = after.full - before.full;
        assert_eq!(
            full,
            u64::from(self.queue.len() == usize::from(FIFO_ENTRIES)),
            "full if there are 160, and only then"
        );
        if full == 0 {
            let commands = (MARKER + 1..=size.max_slaves())
                .filter_map(|slave| Some((slave, SlotCommand::decode(&frame.slot(size, slave), size).ok()?.command)));
            let targets = commands.filter_map(|(slave, command)| match command {
                SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion) => Some((slave, motion.first.target)),
                SlaveCommand::Cst(torque) => Some((slave, torque.into())),
                _ => None,
            });
            self.queue.push_back(Entry { mark: frame.slot(size, MARKER).index, targets: targets.collect() });
        }
    }

    /// SW_RESET.
    pub fn forget(&mut self) {
        self.queue.clear();
    }

    /// A cycle has passed, with its report if there was one.
    pub fn cycle(
        &mut self,
        report: Option<&Frame>,
        size: SlotSize,
        axes: &[Axis],
        before: &Counters,
        after: &Counters,
    ) {
        let cleared = after.cleared - before.cleared;
        if cleared > 0 {
            assert_eq!(cleared, self.queue.len() as u64, "leaving OP clears all entries");
            self.queue.clear();
        }
        let executed = after.executed - before.executed;
        assert!(executed <= 1, "{executed} entries in a cycle");
        let Some(report) = report else {
            assert_eq!(executed, 0, "no entry is taken out while the bus is silent");
            return;
        };
        if executed == 1 {
            let entry = self.queue.pop_front().expect("an entry that was queued");
            let answer = report.slot(size, MARKER);
            assert_eq!((answer.id, answer.index), (CommandId::IoRead.code(), entry.mark), "in order, none left out");
            self.motion(&entry, report, size, axes, before, after);
        }
        let answer = MasterResponse::decode(&report.slot(size, 0));
        if answer.id == MASTER_CYCLIC {
            assert_eq!(usize::from(answer.fifo_free) + self.queue.len(), usize::from(FIFO_ENTRIES), "free and held");
        }
    }

    /// Every motion command that was not rejected drives its axis, or stands in a counter.
    fn motion(
        &mut self,
        entry: &Entry,
        report: &Frame,
        size: SlotSize,
        axes: &[Axis],
        before: &Counters,
        after: &Counters,
    ) {
        let (mut accepted, mut followed) = (0, 0);
        for &(slave, target) in &entry.targets {
            let id = CommandId::from_code(report.slot(size, slave).id);
            if !matches!(id, CommandId::Csp | CommandId::Csv | CommandId::Cst) {
                continue;
            }
            accepted += 1;
            let axis = axes.iter().find(|axis| axis.slave == slave).expect("a drive");
            let seen = axis.seen.lock().expect("no panic");
            followed += u64::from(seen.is_some_and(|[first, _]| first.target == target));
        }
        let counted = not_executed(after) - not_executed(before);
        assert!(followed + counted >= accepted, "{accepted} motion commands: {followed} executed, {counted} counted");
        assert!(counted <= entry.targets.len() as u64, "{counted} counted of {}", entry.targets.len());
        self.followed += followed;
        self.discarded += counted;
    }
}

/// Motion commands that were taken out and not executed.
fn not_executed(counters: &Counters) -> u64 {
    counters.discarded_before_enabled + counters.ignored_homing
}
