//! Divides a run into steps: a command, and the reports until the next command was executed.

use std::collections::VecDeque;

use super::counts::RunCounts;
use super::cycles::Cycles;
use super::report::BoardReport;
use super::{TimedFrame, WINDOW_CYCLES};
use crate::ethercat::cia402::DriveState;
use crate::link::Dir;
use crate::recording::{Executed, Kinds, LastExecuted};
use crate::sk::dump::{MAX_SLAVES, SlaveData};
use crate::sk::{FifoAction, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SdoCommand, SlotSize};

/// The EtherCAT cycle time until SET_DC changes it (SK-4).
const DEFAULT_CYCLE_NS: i64 = 1_000_000;
/// The maximum number of steps that may still get an answer, more than the FIFO has entries. If there is one more, the
/// oldest step is completed with the answer that it has, or without one. \[OURS]
const OPEN_STEPS_MAX: usize = 1024;

/// The maximum number of ambiguous reports that are kept until a later report shows which commands they answer. \[OURS]
const AMBIGUOUS_MAX: usize = 32;

/// A command frame that requests something, and the board's answer to it.
///
/// - A frame in which all slots are GET_STATUS is no step: how many of them a program sends while it waits depends on
///   timing. With [`super::CompareOptions::ignore_repeats`] repeats of a frame are no steps either.
/// - A report belongs to the step whose command the board had executed last when it made the report. Outside OP that is
///   the last command sent; in OP it follows from the free entries of the FIFO ([`Executed`]). A report that was in
///   flight together with a command may remain ambiguous. It then belongs to no step, but its faults count for the
///   oldest open step.
/// - The answer is the last report of a step, the newest one that the program could have when its next command was
///   executed. Faults of drives in earlier reports of the step are kept too. \[OURS]
#[derive(Clone, Debug)]
pub struct Step {
    /// The number of the step in the run, from 1.
    pub number: u64,
    /// The number of the command frame in the run.
    pub frame_number: u64,
    /// The time at which the command was sent, in nanoseconds.
    pub at_ns: i64,
    /// The command frame.
    pub command: Frame,
    /// The slot size of the command frame.
    pub size: SlotSize,
    /// The last report that belongs to the step; `None` if there is none.
    pub answer: Option<BoardReport>,
    /// Faults of drives in the step's reports, each once: the slave, and the error code, or 0 if the report shows none.
    pub faults: Vec<(u8, u16)>,
    /// Whether the reports show that commands were lost, or refused because of their CRC, after this command was sent.
    pub lost: bool,
    /// The number of reports that belong to the step.
    pub reports: u64,
    /// How many cycles of the board passed from the sending of the command to the end of the cycle that executed it,
    /// counted by the reports; `None` outside OP.
    pub answered_after: Option<u64>,
    /// The EtherCAT cycle time when the command was sent, in nanoseconds.
    pub(super) cycle_ns: i64,
    /// The number of the cycle, counted in OP, in which the command was sent.
    sent_in: i64,
    /// The cycle of the report in which the answer arrived, counted from the first cycle in OP; `None` outside OP, or without an
    /// answer.
    pub answered_in: Option<i64>,
    /// The first and the last [`WINDOW_CYCLES`] reports of the step. Ambiguous reports, which may belong to a later step,
    /// are among them.
    pub(super) kept: VecDeque<BoardReport>,
    /// The number of the command among the frames sent in OP, which is compared with the last executed command that a
    /// report shows. `None` if the command was sent outside OP, where the board executes commands on arrival, or if the
    /// network has left OP since.
    entry: Option<u64>,
}

impl Step {
    /// Slot `i` of the command, without the CRC.
    pub fn slot(&self, i: usize) -> RawSlot {
        let slot = self.command.slot(self.size, i);
        if i == 0 { RawSlot { parm: slot.parm & 0xFF, ..slot } } else { slot }
    }

    /// The number of the first slot of the command that requests something; 0 if none does.
    pub(super) fn asking_slot(&self) -> usize {
        (0..self.size.slots()).find(|i| !self.slot(*i).is_zero()).unwrap_or_default()
    }

    /// Keeps a report that belongs, or may belong, to the step, and adds the faults in it to those of the step.
    fn note_report(&mut self, answer: &BoardReport, size: SlotSize) {
        if answer.is_op() {
            for slave in 1..=size.max_slaves() as u8 {
                if answer.frame.slot(size, slave.into()).is_zero() {
                    continue;
                }
                if let Some(code) = fault(&answer.slave(slave)) {
                    add_fault(&mut self.faults, slave, code);
                }
            }
        }
        self.kept.push_back(answer.clone());
        if self.kept.len() > 2 * WINDOW_CYCLES {
            self.kept.remove(WINDOW_CYCLES);
        }
    }

    /// The SDO transfer that the command requests; `None` if it requests none.
    pub fn sdo(&self) -> Option<SdoCommand> {
        match SdoCommand::decode(&self.slot(self.size.sdo_slot()), self.size) {
            Ok(request @ (SdoCommand::Read { .. } | SdoCommand::Write { .. })) => Some(request),
            _ => None,
        }
    }
}

/// An iterator over the steps of a run, in order. Only steps that may still get answers are in memory.
pub struct Steps<I> {
    frames: I,
    size: SlotSize,
    ignore_repeats: bool,
    kinds: Kinds,
    executed: Executed,
    cycle_ns: i64,
    in_op: bool,
    losses: Option<(u16, u8)>,
    cycles: Cycles,
    /// Ambiguous reports, whose last executed command is not known yet, each with the number of its cycle.
    ambiguous: Vec<(BoardReport, i64)>,
    /// The newest unambiguous report: the number of the command that it shows as executed last, among the commands sent in
    /// OP, and the cycle of the report.
    last_certain: Option<(Option<u64>, i64)>,
    /// For each slave: the positions of both axes, and for how many reports they have not changed.
    unchanged_reports: [([Option<i32>; 2], u16); MAX_SLAVES],
    open: VecDeque<Step>,
    done: VecDeque<Step>,
    ended: bool,
    /// The numbers of frames of the run so far.
    pub(super) counts: RunCounts,
}

impl<I: Iterator<Item = TimedFrame>> Steps<I> {
    /// The steps of a run, given as its frames sorted by time.
    pub fn new(frames: I, size: SlotSize, ignore_repeats: bool) -> Self {
        Self {
            frames,
            size,
            ignore_repeats,
            kinds: Kinds::new(None),
            executed: Executed::new(DEFAULT_CYCLE_NS),
            cycle_ns: DEFAULT_CYCLE_NS,
            in_op: false,
            losses: None,
            cycles: Cycles::default(),
            ambiguous: Vec::new(),
            last_certain: None,
            unchanged_reports: [([None; 2], 0); MAX_SLAVES],
            open: VecDeque::new(),
            done: VecDeque::new(),
            ended: false,
            counts: RunCounts::default(),
        }
    }

    fn command(&mut self, observed: TimedFrame) {
        let TimedFrame { number: frame_number, at_ns, frame: command, .. } = observed;
        self.kinds.command(&command, self.size);
        let master = MasterCommand::decode(&command.slot(self.size, 0), self.size);
        match master {
            Ok(MasterCommand::SetDc { cycle, .. }) if !self.in_op => self.cycle_ns = i64::from(cycle.us()) * 1000,
            Ok(MasterCommand::SoftReset) => self.cycle_ns = DEFAULT_CYCLE_NS,
            _ => {}
        }
        let entry = self.in_op.then(|| self.executed.command(master == Ok(MasterCommand::SetFifo(FifoAction::Clear))));
        let size = self.size;
        let step = Step {
            number: self.counts.commands + 1,
            frame_number,
            at_ns,
            command,
            size,
            answer: None,
            faults: Vec::new(),
            lost: false,
            reports: 0,
            answered_after: None,
            cycle_ns: self.cycle_ns,
            sent_in: self.cycles.passed(),
            answered_in: None,
            kept: VecDeque::new(),
            entry,
        };
        if (0..size.slots()).all(|i| step.slot(i).is_zero()) {
            self.counts.polls += 1;
            return;
        }
        if self.ignore_repeats
            && let Some(last) = self.open.back()
            && (0..size.slots()).all(|i| step.slot(i) == last.slot(i))
        {
            self.counts.repeats += 1;
            return;
        }
        self.counts.commands += 1;
        self.open.push_back(step);
        if self.open.len() > OPEN_STEPS_MAX {
            self.done.extend(self.open.pop_front());
        }
    }

    fn report(&mut self, observed: TimedFrame) {
        let TimedFrame { number, at_ns, frame, .. } = observed;
        self.counts.reports += 1;
        self.kinds.response(&frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let losses = (board.full_count, board.error);
        let was_op = std::mem::replace(&mut self.in_op, board.state.state() == Some(MasterState::Op));
        // Only reports of OP have the count of frames that found the FIFO full. A change of this count or of the error
        // byte means that commands were lost.
        if self.in_op && self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.open.back_mut().into_iter().for_each(|newest| newest.lost = true);
        }
        if !self.in_op {
            if was_op {
                self.executed.reset(self.cycle_ns);
                self.open.iter_mut().for_each(|step| step.entry = None);
            }
            self.give_up_ambiguous();
            let answer = self.answer(number, at_ns, frame);
            return self.add_report(self.open.len().wrapping_sub(1), answer, 0);
        }
        if !was_op {
            self.executed.reset(self.cycle_ns);
            (self.cycles, self.last_certain) = (Cycles::default(), None);
        }
        self.cycles.report(at_ns, self.cycle_ns);
        let last = match self.executed.report(at_ns, &board) {
            LastExecuted::Command(last) => Some(last),
            LastExecuted::Nothing => None,
            LastExecuted::Ambiguous => {
                let answer = self.answer(number, at_ns, frame);
                self.ambiguous.push((answer, self.cycles.passed()));
                if self.ambiguous.len() > AMBIGUOUS_MAX {
                    self.give_up_ambiguous();
                }
                return;
            }
            LastExecuted::Unknown => return self.give_up_ambiguous(),
        };
        let cycle = self.cycles.passed();
        self.resolve_ambiguous(last, cycle);
        let answer = self.answer(number, at_ns, frame);
        self.add_report_after(last, answer, cycle);
        self.last_certain = Some((last, cycle));
    }

    /// Finds the steps of the ambiguous reports that precede an unambiguous one, whose last executed command is `last`.
    /// This is possible if the board executed one command in each cycle since the unambiguous report before them: then
    /// the cycle of a report determines its command. Otherwise the search is given up.
    fn resolve_ambiguous(&mut self, last: Option<u64>, cycle: i64) {
        let number = |last: Option<u64>| last.map_or(-1, |last| i64::try_from(last).unwrap_or(i64::MAX));
        let Some((before, cycle_before)) = self.last_certain else { return self.give_up_ambiguous() };
        let before = number(before);
        if number(last).saturating_sub(before) != cycle.saturating_sub(cycle_before) {
            return self.give_up_ambiguous();
        }
        for (answer, cycle) in std::mem::take(&mut self.ambiguous) {
            let last = before.saturating_add(cycle.saturating_sub(cycle_before));
            self.add_report_after(u64::try_from(last).ok(), answer, cycle);
        }
    }

    /// Gives up the search for the steps of the ambiguous reports. They answer the command of the oldest open step or of
    /// a later one, so the oldest step keeps them and their faults, but none of them becomes its answer.
    fn give_up_ambiguous(&mut self) {
        let size = self.size;
        for (answer, _) in std::mem::take(&mut self.ambiguous) {
            self.open.iter_mut().take(1).for_each(|step| step.note_report(&answer, size));
        }
    }

    /// Adds a report of OP to the step whose command was executed last; `last` is its number among the commands sent in
    /// OP. Steps that were executed on arrival have the entry `None`, which is less than any number.
    fn add_report_after(&mut self, last: Option<u64>, answer: BoardReport, cycle: i64) {
        if let Some(i) = self.open.iter().rposition(|step| step.entry <= last) {
            self.add_report(i, answer, cycle);
        }
    }

    /// Makes a [`BoardReport`] of a report: adds the kinds of the slaves, and for how long their positions have not
    /// changed.
    fn answer(&mut self, frame_number: u64, at_ns: i64, frame: Frame) -> BoardReport {
        let kinds = std::array::from_fn(|n| self.kinds.of(n + 1));
        let mut answer =
            BoardReport { frame_number, at_ns, frame, size: self.size, kinds, unchanged_reports: [0; MAX_SLAVES] };
        for (n, (shown, count)) in self.unchanged_reports.iter_mut().enumerate().take(self.size.max_slaves()) {
            let positions = answer.positions(n as u8 + 1);
            *count = if std::mem::replace(shown, positions) == positions { count.saturating_add(1) } else { 0 };
            answer.unchanged_reports[n] = *count;
        }
        answer
    }

    /// Adds a report to the open step `i`. The steps before it get no more reports and are done.
    fn add_report(&mut self, i: usize, answer: BoardReport, cycle: i64) {
        for step in self.open.iter_mut().take(i.saturating_add(1)).filter(|step| step.entry.is_some()) {
            let after = cycle.saturating_sub(step.sent_in).max(0).unsigned_abs();
            step.answered_after.get_or_insert(after);
        }
        let Some(step) = self.open.get_mut(i) else { return };
        step.note_report(&answer, self.size);
        step.answered_in = step.entry.map(|_| cycle);
        step.answer = Some(answer);
        step.reports += 1;
        self.done.extend(self.open.drain(..i));
    }
}

/// The error code of a drive in a fault, 0 if the slot shows none; `None` without a fault.
fn fault(data: &SlaveData) -> Option<u16> {
    let (statusword, code) = match data {
        SlaveData::Drive(drive) => (drive.statusword, drive.error_code),
        SlaveData::Hsp(hsp) => (hsp.statusword, 0),
        _ => return None,
    };
    let faulty = matches!(statusword.state(), Some(DriveState::Fault | DriveState::FaultReactionActive));
    (faulty || code != 0).then_some(code)
}

/// Adds a fault. A drive may show its error code a cycle later than the fault state, so a fault with code 0 and one
/// with a code are the same fault.
fn add_fault(faults: &mut Vec<(u8, u16)>, slave: u8, code: u16) {
    if faults.contains(&(slave, code)) || (code == 0 && faults.iter().any(|(other, _)| *other == slave)) {
        return;
    }
    faults.retain(|fault| *fault != (slave, 0));
    faults.push((slave, code));
}

impl<I: Iterator<Item = TimedFrame>> Iterator for Steps<I> {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        while self.done.is_empty() && !self.ended {
            let Some(observed) = self.frames.next() else {
                self.ended = true;
                self.give_up_ambiguous();
                self.done.append(&mut self.open);
                break;
            };
            self.counts.last_ns = observed.at_ns;
            match observed.dir {
                Dir::Write => self.command(observed),
                Dir::Read => self.report(observed),
            }
        }
        self.done.pop_front()
    }
}
