//! Divides a run into steps: a command, and the board's reports until the next command was executed.

use std::collections::VecDeque;

use super::{Counts, TimedFrame};
use crate::cia402::DriveState;
use crate::link::Dir;
use crate::recording::{Executed, Kinds, LastExecuted};
use crate::sk::dump::{MAX_SLAVES, ResponseDump, SlaveData, SlotMeaning};
use crate::sk::{
    CommandId, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SdoCommand, SdoResponse,
    SlaveKind, SlotSize,
};

/// The EtherCAT cycle until SET_DC changes it (SK-4).
const DEFAULT_CYCLE_NS: i64 = 1_000_000;
/// How many steps may wait for their answers: more than the FIFO has entries. The oldest is given up without one. \[OURS]
const OPEN_STEPS_MAX: usize = 1024;

/// A command frame that requests something, and the board's answer to it.
///
/// - A frame of nothing but GET_STATUS is no step, because it depends on timing how many of them a program sends while it
///   waits. With [`super::Options::ignore_repeats`] repeats of a frame are no steps either.
/// - A report belongs to the step whose command was the last one executed when the board made it. Outside OP that is the
///   last one sent; in OP it follows from the free entries of the FIFO ([`Executed`]). A report for which it is doubtful
///   belongs to no step.
/// - The answer is the last report of a step: what the program could know when its next command was executed. Faults of
///   drives in earlier reports of the step are kept too. \[OURS]
#[derive(Clone, Debug)]
pub struct Step {
    /// Its number among the run's steps, from 1.
    pub number: u64,
    /// The number of the command frame in the run.
    pub frame_number: u64,
    /// When the command was sent, in nanoseconds.
    pub at_ns: i64,
    /// The command frame.
    pub command: Frame,
    /// The slot size of the command frame.
    pub size: SlotSize,
    /// The last report that belongs to the step; `None` if there is none.
    pub answer: Option<Answer>,
    /// Faults of drives in the step's reports, each once: the slave, and its error code or 0 if it showed none.
    pub faults: Vec<(u8, u16)>,
    /// Whether commands were lost or refused for their CRC after this one was sent.
    pub lost: bool,
    /// How many reports belong to the step.
    pub reports: u64,
    /// The number of the command among the frames sent in OP; `None` if it was sent outside OP and executed on arrival.
    entry: Option<u64>,
}

/// A report, with the kinds of the slaves at its time.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The number of the report in the run.
    pub frame_number: u64,
    /// When the report was received, in nanoseconds.
    pub at_ns: i64,
    frame: Frame,
    size: SlotSize,
    kinds: [Option<SlaveKind>; MAX_SLAVES],
}

impl Answer {
    /// Slot 0, decoded.
    pub fn board(&self) -> MasterResponse {
        MasterResponse::decode(&self.frame.slot(self.size, 0))
    }

    /// The SDO slot, decoded.
    pub fn sdo(&self) -> SdoResponse {
        SdoResponse::decode(&self.frame.slot(self.size, self.size.sdo_slot()))
    }

    /// The slot of `slave`, from 1, decoded for the kind that SET_AXIS has declared, or else for the kind that its fields show.
    pub fn slave(&self, slave: u8) -> SlaveData {
        reading(&self.frame, self.size, &self.kinds, slave.into())
    }

    /// The command that the slot of `slave` answers.
    pub fn answers(&self, slave: u8) -> CommandId {
        CommandId::from_code(self.frame.slot(self.size, slave.into()).id)
    }

    /// The actual position of the first axis of `slave` in counts; `None` if it has no axis or the network is not in OP.
    pub fn position(&self, slave: u8) -> Option<i32> {
        match self.slave(slave) {
            SlaveData::Drive(drive) if self.is_op() => Some(drive.position),
            SlaveData::Hsp(hsp) if self.is_op() => Some(hsp.first.position),
            _ => None,
        }
    }

    /// Whether the network is in OP, so that the slaves' slots hold process data.
    pub fn is_op(&self) -> bool {
        self.board().state.state() == Some(MasterState::Op)
    }
}

fn reading(frame: &Frame, size: SlotSize, kinds: &[Option<SlaveKind>; MAX_SLAVES], slave: usize) -> SlaveData {
    let given = kinds.map(Option::unwrap_or_default);
    let dump = match kinds.get(slave.wrapping_sub(1)) {
        Some(Some(_)) => ResponseDump::new(frame, size).kinds(&given),
        _ => ResponseDump::new(frame, size),
    };
    match dump.line(slave).map(|line| line.meaning) {
        Some(SlotMeaning::SlaveResponse(reading)) => reading.data,
        _ => SlaveData::Nothing,
    }
}

impl Step {
    /// Slot `i` of the command, without the CRC.
    pub fn slot(&self, i: usize) -> RawSlot {
        let slot = self.command.slot(self.size, i);
        if i == 0 { RawSlot { parm: slot.parm & 0xFF, ..slot } } else { slot }
    }

    /// The number of the first slot of the command that requests something.
    pub(super) fn asking_slot(&self) -> usize {
        (0..self.size.slots()).find(|i| !self.slot(*i).is_zero()).unwrap_or_default()
    }

    /// The SDO transfer that the command requests; `None` if it requests none.
    pub fn sdo(&self) -> Option<SdoCommand> {
        match SdoCommand::decode(&self.slot(self.size.sdo_slot()), self.size) {
            Ok(request @ (SdoCommand::Read { .. } | SdoCommand::Write { .. })) => Some(request),
            _ => None,
        }
    }
}

/// The steps of a run in order, as an iterator. It holds only the steps that may still get answers.
pub struct Steps<I> {
    frames: I,
    size: SlotSize,
    ignore_repeats: bool,
    kinds: Kinds,
    executed: Executed,
    cycle_ns: i64,
    in_op: bool,
    losses: Option<(u16, u8)>,
    open: VecDeque<Step>,
    done: VecDeque<Step>,
    ended: bool,
    /// The length of the run so far.
    pub(super) counts: Counts,
}

impl<I: Iterator<Item = TimedFrame>> Steps<I> {
    /// The steps of a run, which is given as its frames in the order of their times.
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
            open: VecDeque::new(),
            done: VecDeque::new(),
            ended: false,
            counts: Counts::default(),
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
        // Outside OP a response does not show the full count.
        if self.in_op && self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.open.back_mut().into_iter().for_each(|newest| newest.lost = true);
        }
        if !self.in_op {
            if was_op {
                self.executed.reset(self.cycle_ns);
                self.open.iter_mut().for_each(|step| step.entry = None);
            }
            return self.add_report(self.open.len().wrapping_sub(1), number, at_ns, frame);
        }
        if !was_op {
            self.executed.reset(self.cycle_ns);
        }
        let last = match self.executed.report(at_ns, &board) {
            LastExecuted::Command(last) => Some(last),
            LastExecuted::Nothing => None,
            LastExecuted::Doubtful | LastExecuted::Unknown => return,
        };
        // A step that was executed on arrival has the entry `None`, which is less than any.
        if let Some(i) = self.open.iter().rposition(|step| step.entry <= last) {
            self.add_report(i, number, at_ns, frame);
        }
    }

    /// Adds a report to the open step `i`. The steps before it get no further reports and are done.
    fn add_report(&mut self, i: usize, frame_number: u64, at_ns: i64, frame: Frame) {
        let kinds = std::array::from_fn(|n| self.kinds.of(n + 1));
        let Some(step) = self.open.get_mut(i) else { return };
        let answer = Answer { frame_number, at_ns, frame, size: self.size, kinds };
        if answer.is_op() {
            for slave in 1..=self.size.max_slaves() as u8 {
                if answer.frame.slot(self.size, slave.into()).is_zero() {
                    continue;
                }
                if let Some(code) = fault(&answer.slave(slave)) {
                    add_fault(&mut step.faults, slave, code);
                }
            }
        }
        step.answer = Some(answer);
        step.reports += 1;
        self.done.extend(self.open.drain(..i));
    }
}

/// The error code of a drive that has a fault, 0 if it shows none; `None` without a fault.
fn fault(data: &SlaveData) -> Option<u16> {
    let (statusword, code) = match data {
        SlaveData::Drive(drive) => (drive.statusword, drive.error_code),
        SlaveData::Hsp(hsp) => (hsp.statusword, 0),
        _ => return None,
    };
    let faulty = matches!(statusword.state(), Some(DriveState::Fault | DriveState::FaultReactionActive));
    (faulty || code != 0).then_some(code)
}

/// Adds a fault. A drive may show its error code a cycle later than the state, so a fault with code 0 and one with a code are
/// the same fault.
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
