//! The frames of a schedule on a bus that takes outputs ahead: the commands of each, when it was sent, and its outcome.

use std::collections::VecDeque;

use ecmsk::engine::Counters;
use ecmsk::fieldbus::{SlaveOut, SlaveSet};
use ecmsk::sk::{FIFO_ENTRIES, FifoAction, Frame, MasterCommand, SlaveCommand, SlotCommand, SlotSize};

use super::log::{Event, SLAVES};
use super::trace::{Trace, mark};
use super::{Around, is_motion_of};
use crate::machine::{MARKER, Machine, Unit};

/// Commands of an entry that has not been sent.
#[derive(Clone, Copy, Default)]
struct Open {
    id: u64,
    /// Slaves whose command surely counts as one for a lost slave if the slave does not get it.
    sure: SlaveSet,
    /// Slaves whose command may count as one.
    may: SlaveSet,
}

/// The ledger.
#[derive(Default)]
pub struct Ledger {
    /// Commands of each frame, by its mark.
    entries: Vec<Vec<(usize, SlaveCommand)>>,
    /// Marks of the frames that were queued and may not have been passed to the bus.
    waiting: VecDeque<u16>,
    /// Outputs that were passed to the bus since then, while no mark could show their commands.
    unmarked: usize,
    /// Frames that were queued.
    queued: u64,
    /// Entries that were sent, including those executed unseen while the marker was lost.
    sent: u64,
    newest_mark: u16,
    open: Vec<Open>,
    /// Whether the marker is lost, or was since the last rest: then marks do not show what is executed.
    is_blurred: bool,
    /// Commands sent to slaves that did not get them, and that the bus has not named yet: cycle, slave.
    unnamed: Vec<(usize, u8)>,
    without_outputs: Vec<usize>,
    /// Commands that their slaves have got and whose answer has not come: cycle, slaves.
    got: Vec<(usize, SlaveSet)>,
    /// Commands that must be counted as for lost slaves by now, and that may be.
    lost_at_least: u64,
    lost_at_most: u64,
    /// Motion commands of this cycle of the board whose targets are not in the outputs.
    ignored: u64,
    /// Motion commands that their slaves have got.
    pub followed: u64,
}

impl Ledger {
    /// The mark of the next frame.
    pub fn next_mark(&mut self) -> u16 {
        self.entries.push(Vec::new());
        self.entries.len() as u16
    }

    pub fn entry(&self, mark: u16) -> &[(usize, SlaveCommand)] {
        &self.entries[usize::from(mark) - 1]
    }

    /// The commands of the newest outputs: those of their entry. While the marker is lost, it is unknown whether they
    /// have one, so these are the possible commands: entries go in order, at most one with each set of outputs, so that
    /// the n-th set without a mark carries one of the first n waiting entries, or none.
    pub fn carried(&mut self, trace: &Trace, around: &Around) -> Vec<(usize, SlaveCommand)> {
        if let Some(mark) = trace.newest_outputs().0.mark {
            self.waiting.retain(|waits| *waits > mark);
            self.unmarked = 0;
            return self.entry(mark).to_vec();
        }
        if !around.lost().contains(MARKER as u8) {
            return Vec::new();
        }
        self.unmarked += 1;
        self.waiting.iter().take(self.unmarked).flat_map(|mark| self.entry(*mark)).copied().collect()
    }

    /// Clears the waiting frames.
    fn forget_waiting(&mut self) {
        self.waiting.clear();
        self.unmarked = 0;
    }

    /// A frame has arrived in OP: it is queued unless it is counted as full.
    pub fn arrived(&mut self, frame: &Frame, size: SlotSize, before: &Counters, after: &Counters) {
        if MasterCommand::decode(&frame.slot(size, 0), size) == Ok(MasterCommand::SetFifo(FifoAction::Clear)) {
            self.forget_waiting();
        }
        if after.full > before.full {
            return;
        }
        self.queued += 1;
        self.waiting.push_back(self.entries.len() as u16);
        let commands = (1..=size.max_slaves().min(SLAVES))
            .filter_map(|slave| Some((slave, SlotCommand::decode(&frame.slot(size, slave), size).ok()?.command)));
        *self.entries.last_mut().expect("it has a mark") =
            commands.filter(|(_, command)| *command != SlaveCommand::GetStatus).collect();
    }

    /// A cycle of the board begins.
    pub fn begin(&mut self, around: &Around) {
        self.ignored = 0;
        self.is_blurred |= around.lost().contains(MARKER as u8);
        if !around.in_op {
            self.forget_waiting();
        }
    }

    /// Outputs were passed to the bus.
    pub fn pushed(&mut self, trace: &Trace, units: &[Unit], around: &Around, falling: SlaveSet) {
        let (pushed, _) = trace.newest_outputs();
        let Some(mark) = pushed.mark else { return };
        let mut open = Open { id: pushed.id, ..Open::default() };
        for &(slave, command) in &self.entries[usize::from(mark) - 1] {
            let n = slave as u8;
            let unit = units.iter().find(|unit| unit.slave == slave);
            let is_motion = unit.is_some_and(|unit| is_motion_of(unit, command));
            let follows = unit.is_some_and(|unit| is_commanded(unit, command, &pushed.outputs));
            self.ignored += u64::from(is_motion && !follows);
            use SlaveCommand::{AlarmClear, ServoOff, ServoOn};
            let may_follow = !is_motion || follows && Around::may_follow(trace, unit);
            if around.lost().contains(n) {
                // Skipped, or not.
                self.lost_at_most += 1;
            } else if may_follow {
                open.may.insert(n);
            }
            let is_sure = match command {
                ServoOff | AlarmClear => unit.is_some(),
                ServoOn => unit.is_some() && !around.homing.contains(n),
                _ if slave == MARKER => true,
                _ => follows && !falling.contains(n) && around.follows(trace, unit, &pushed.outputs),
            };
            if around.lost_before.contains(n) && around.lost_after.contains(n) {
                let in_mode = unit.is_some_and(|unit| trace.mode(slave, 0) == unit.mode.code());
                let is_counted = matches!(command, ServoOn | ServoOff | AlarmClear) || is_motion && in_mode;
                self.lost_at_least += u64::from(is_counted && unit.is_some());
            } else if !around.lost_before.contains(n) && is_sure {
                open.sure.insert(n);
            }
        }
        self.open.push(open);
    }

    /// Processes an event.
    pub fn apply(&mut self, trace: &Trace, units: &[Unit], event: &Event, sent: Option<u64>) {
        match event {
            Event::Passed(cycle) => {
                let Some(pushed) = sent.and_then(|id| trace.outputs(id)) else { return };
                let Some(mark) = pushed.mark else { return };
                let n = trace.passed() - 1;
                assert!(mark > self.newest_mark, "entry {mark} is sent after {}", self.newest_mark);
                self.newest_mark = mark;
                self.sent += 1;
                let unreached = cycle.lost.union(cycle.without_outputs);
                let got = self.entries[usize::from(mark) - 1].iter().filter(|(slave, command)| {
                    let unit = units.iter().find(|unit| unit.slave == *slave);
                    !unreached.contains(*slave as u8)
                        && unit.is_some_and(|unit| is_commanded(unit, *command, &pushed.outputs))
                });
                self.followed += got.count() as u64;
                let place = self.open.iter().position(|open| open.id == pushed.id).expect("it was open");
                let open = self.open.swap_remove(place);
                self.lost_at_most += u64::from(open.may.intersection(unreached).len());
                self.got.push((n, open.may.difference(unreached)));
                self.unnamed.extend(open.sure.intersection(cycle.lost).iter().map(|slave| (n, slave)));
                self.without_outputs
                    .extend(open.sure.intersection(cycle.without_outputs).difference(cycle.lost).iter().map(|_| n));
            }
            Event::Answered { lost, .. } => {
                let answered = trace.answered.expect("it was answered");
                let still = trace.cycle(answered).lost;
                let named = |(n, slave): &(usize, u8)| *n <= answered && lost.contains(*slave);
                self.lost_at_least += self.unnamed.iter().filter(|sent| named(sent)).count() as u64;
                // A slave that has come back before the bus has named it was never lost for the board.
                self.unnamed.retain(|sent| !named(sent) && (sent.0 >= answered || still.contains(sent.1)));
                // For a slave that is not in OP an answer shows only its own cycle.
                self.lost_at_least += self.without_outputs.iter().filter(|n| **n == answered).count() as u64;
                self.without_outputs.retain(|n| *n > answered);
                // If the answer of a cycle is lost and in the next one a slave is not in OP, the board cannot know whether it
                // still was.
                let doubtful = self.got.extract_if(.., |(n, _)| *n <= answered).filter(|(n, _)| *n < answered);
                let left = trace.cycle(answered).without_outputs;
                self.lost_at_most += doubtful.map(|(_, got)| u64::from(got.intersection(left).len())).sum::<u64>();
            }
            Event::Cleared { newest_sent } => self.open.retain(|open| Some(open.id) <= *newest_sent),
            Event::Pushed { .. } | Event::Mode { .. } | Event::Op => {}
        }
    }

    /// A cycle of the board has passed.
    pub fn check(&mut self, trace: &Trace, machine: &Machine, before: &Counters, after: &Counters) {
        let held = u64::from(FIFO_ENTRIES - machine.board.engine().fifo_free());
        assert_eq!(self.queued, after.executed + after.cleared + held, "queued: executed, cleared or held ({held})");
        while self.waiting.len() as u64 > held {
            self.waiting.pop_front();
            self.unmarked = self.unmarked.saturating_sub(1);
        }
        let counted = not_executed(after) - not_executed(before);
        assert!(self.ignored <= counted, "{} motion commands are not in the outputs, {counted} counted", self.ignored);
        if self.is_blurred {
            return self.end_blur(trace, machine, held, after);
        }
        assert!(after.executed <= self.sent, "{} entries count as executed, {} were sent", after.executed, self.sent);
        let (least, most) = (self.lost_at_least, self.lost_at_most);
        let lost = after.for_lost;
        assert!(lost >= least, "{least} commands have not reached lost slaves, {lost} counted");
        assert!(lost <= most, "{lost} commands counted as for lost slaves, {most} were at most");
        if held == 0 {
            assert_eq!(after.executed, self.sent, "those count as executed that were sent");
        }
    }

    /// Begins the ledger anew once the marker answers and all is at rest.
    fn end_blur(&mut self, trace: &Trace, machine: &Machine, held: u64, counters: &Counters) {
        let engine = machine.board.engine();
        let whole = engine.lost().is_empty() && trace.newest().lost.is_empty() && machine.in_op();
        if held == 0 && whole && trace.is_at_rest() && self.unnamed.is_empty() {
            self.sent = counters.executed;
            (self.lost_at_least, self.lost_at_most) = (counters.for_lost, counters.for_lost);
            self.is_blurred = false;
        }
    }

    /// Checks at rest that every frame was executed, cleared or counted as full.
    pub fn close(&self, machine: &Machine) {
        assert_eq!(machine.board.engine().fifo_free(), FIFO_ENTRIES, "something is left in the FIFO");
    }
}

/// Whether the outputs are those of a motion command.
pub fn is_commanded(unit: &Unit, command: SlaveCommand, outputs: &[SlaveOut; SLAVES]) -> bool {
    let Some(targets) = super::targets(unit, command) else { return false };
    (0..unit.axes).all(|axis| outputs[unit.slave - 1][axis].target == targets[axis])
}

/// The mark of the newest entry that a cycle has carried or repeated.
pub fn shown_mark(trace: &Trace, n: usize) -> u16 {
    trace.cycle(n).outputs.as_ref().map_or(0, |(_, outputs)| mark(outputs))
}

/// Commands that were taken out of the FIFO and not executed.
fn not_executed(counters: &Counters) -> u64 {
    counters.discarded_before_enabled + counters.ignored_homing + counters.for_lost + counters.rejected_total()
}
