//! An independent account of a schedule's frames: which frames are in the FIFO, the commands of each, and their
//! outcome.

use std::collections::VecDeque;

use ecmsk::engine::Counters;
use ecmsk::fieldbus::SlaveOut;
use ecmsk::sk::{CommandId, FIFO_ENTRIES, Frame, MASTER_CYCLIC, MasterResponse, SlaveCommand, SlotCommand, SlotSize};

use crate::machine::{MARKER, Machine};

/// A frame in the FIFO.
struct Entry {
    /// Index of its IO_RD.
    mark: u8,
    /// Slave and targets of its motion commands.
    targets: Vec<(usize, [i32; 2])>,
    /// Commands for slaves, the IO_RD among them.
    commands: u64,
}

/// The account.
#[derive(Default)]
pub struct Books {
    queue: VecDeque<Entry>,
    sent: u64,
    /// Motion commands executed so far, and motion commands found in a counter instead.
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
            let commands: Vec<_> = (MARKER + 1..=size.max_slaves())
                .filter_map(|slave| Some((slave, SlotCommand::decode(&frame.slot(size, slave), size).ok()?.command)))
                .filter(|(_, command)| *command != SlaveCommand::GetStatus)
                .collect();
            let targets = commands.iter().filter_map(|&(slave, command)| match command {
                SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion) => {
                    Some((slave, [motion.first.target, motion.second.target]))
                }
                SlaveCommand::Cst(torque) => Some((slave, [torque.into(), 0])),
                _ => None,
            });
            self.queue.push_back(Entry {
                mark: frame.slot(size, MARKER).index,
                targets: targets.collect(),
                commands: 1 + commands.len() as u64,
            });
        }
    }

    /// SW_RESET.
    pub fn forget(&mut self) {
        self.queue.clear();
    }

    /// A cycle has passed, with its report if there was one.
    pub fn cycle(&mut self, machine: &Machine, report: Option<&Frame>, before: &Counters, after: &Counters) {
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
            if machine.is_heard(MARKER) {
                let answer = report.slot(machine.size, MARKER);
                let expected = (CommandId::IoRead.code(), entry.mark);
                assert_eq!((answer.id, answer.index), expected, "in order, none left out");
            }
            self.motion(&entry, machine, report, before, after);
        }
        let answer = MasterResponse::decode(&report.slot(machine.size, 0));
        if answer.id == MASTER_CYCLIC {
            assert_eq!(usize::from(answer.fifo_free) + self.queue.len(), usize::from(FIFO_ENTRIES), "free and held");
        }
    }

    /// Checks that every motion command that was not rejected drives its axes, or is in a counter.
    fn motion(&mut self, entry: &Entry, machine: &Machine, report: &Frame, before: &Counters, after: &Counters) {
        let (mut accepted, mut followed, mut rejected) = (0, 0, 0);
        for &(slave, targets) in &entry.targets {
            let unit = machine.units.iter().find(|unit| unit.slave == slave).expect("a slave with axes");
            let id = CommandId::from_code(report.slot(machine.size, slave).id);
            // SK-4: the slot of a lost slave keeps its values, and so does not show a rejection.
            let lost = !machine.is_heard(slave);
            if lost {
                rejected = after.rejected_total() - before.rejected_total();
            }
            if !lost && !matches!(id, CommandId::Csp | CommandId::Csv | CommandId::Cst) {
                continue;
            }
            accepted += 1;
            let seen = unit.seen.lock().expect("no panic");
            let drives = |seen: &SlaveOut| (0..unit.axes).all(|axis| seen[axis].target == targets[axis]);
            followed += u64::from(!lost && seen.as_ref().is_some_and(drives));
        }
        let counted = not_executed(after) - not_executed(before);
        assert!(
            followed + counted + rejected >= accepted,
            "{accepted} motion commands: {followed} executed, {counted} counted, {rejected} rejected"
        );
        assert!(counted <= entry.commands, "{counted} counted of {}", entry.commands);
        self.followed += followed;
        self.discarded += counted;
    }
}

/// Commands that were taken out and not executed, except rejected ones.
fn not_executed(counters: &Counters) -> u64 {
    counters.discarded_before_enabled + counters.ignored_homing + counters.for_lost
}
