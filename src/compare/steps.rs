//! A run as steps: a command, and what the board said to it until the program moved on.

use std::collections::VecDeque;

use super::Observed;
use crate::cia402::DriveState;
use crate::link::Dir;
use crate::recording::{Executed, Kinds, LastExecuted};
use crate::sk::dump::{MAX_SLAVES, ResponseDump, SlaveData, SlotMeaning};
use crate::sk::{
    CommandId, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SdoCommand, SdoResponse,
    SlaveKind, SlotSize,
};

/// EtherCAT cycle of a board that was told none (SK-4).
const DEFAULT_CYCLE_NS: i64 = 1_000_000;
/// Steps that may wait for their answers: more than the FIFO has entries. A run without any report has no answers. \[OURS]
const OPEN_STEPS: usize = 1024;

/// A command frame that asks for something, and what the board said to it.
///
/// - A frame of nothing but GET_STATUS is no step: how many of them a program sends while it waits is a matter of time.
///   Neither are, with [`super::Options::ignore_repeats`], the repeats of a frame.
/// - A report belongs to the step whose command was executed last when it was made: outside OP the one sent last, in OP by
///   the free entries of the FIFO ([`Executed`]). A report for which that is doubtful belongs to none.
/// - The answer is the last report of a step: what the program had before it when its next command was executed. That a
///   drive had a fault in between is kept too, though a later report does not show it. \[OURS]
#[derive(Clone, Debug)]
pub struct Step {
    /// Its number among the run's steps, from 1.
    pub number: u64,
    /// The frame's number in the run.
    pub frame_number: u64,
    /// When it was sent, nanoseconds.
    pub at_ns: i64,
    /// The command frame.
    pub command: Frame,
    /// Its slot size.
    pub size: SlotSize,
    /// The last report that belongs to it; `None` if there is none.
    pub answer: Option<Answer>,
    /// Faults that drives had in its reports: slave and error code (0: none was told), each once.
    pub faults: Vec<(u8, u16)>,
    /// Whether commands were lost or refused for their CRC after it was sent.
    pub lost: bool,
    /// Reports that belong to it.
    pub reports: u64,
    /// Its number among the frames sent in OP; `None` if it was executed on arrival.
    entry: Option<u64>,
}

/// A report, and what the slaves were then.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Its number in the run.
    pub frame_number: u64,
    /// When it was made, nanoseconds.
    pub at_ns: i64,
    frame: Frame,
    size: SlotSize,
    kinds: [Option<SlaveKind>; MAX_SLAVES],
}

impl Answer {
    /// Slot 0.
    pub fn board(&self) -> MasterResponse {
        MasterResponse::decode(&self.frame.slot(self.size, 0))
    }

    /// The SDO slot.
    pub fn sdo(&self) -> SdoResponse {
        SdoResponse::decode(&self.frame.slot(self.size, self.size.sdo_slot()))
    }

    /// What slave n, from 1, said; read by what SET_AXIS said it is, else by its fields.
    pub fn slave(&self, slave: u8) -> SlaveData {
        reading(&self.frame, self.size, &self.kinds, slave.into())
    }

    /// The id that the slot of slave n answers.
    pub fn answers(&self, slave: u8) -> CommandId {
        CommandId::from_code(self.frame.slot(self.size, slave.into()).id)
    }

    /// Actual position of slave n's first axis in counts, if it has one and the network is in OP.
    pub fn position(&self, slave: u8) -> Option<i32> {
        match self.slave(slave) {
            SlaveData::Drive(drive) if self.is_op() => Some(drive.position),
            SlaveData::Hsp(hsp) if self.is_op() => Some(hsp.first.position),
            _ => None,
        }
    }

    /// Whether slaves' slots are fresh.
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
    /// Slot `i` of the command, the CRC taken out.
    pub fn slot(&self, i: usize) -> RawSlot {
        let slot = self.command.slot(self.size, i);
        if i == 0 { RawSlot { parm: slot.parm & 0xFF, ..slot } } else { slot }
    }

    /// The first slot from there on that asks for something.
    pub(super) fn asking_slot(&self) -> usize {
        (0..self.size.slots()).find(|i| !self.slot(*i).is_zero()).unwrap_or_default()
    }

    /// The SDO transfer that it asks for.
    pub fn sdo(&self) -> Option<SdoCommand> {
        match SdoCommand::decode(&self.slot(self.size.sdo_slot()), self.size) {
            Ok(request @ (SdoCommand::Read { .. } | SdoCommand::Write { .. })) => Some(request),
            _ => None,
        }
    }
}

/// The steps of a run, in order. Keeps those alone that may still get answers.
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
    steps: u64,
    /// Frames of nothing but GET_STATUS, repeats that do not count, reports.
    pub(super) polls: u64,
    pub(super) repeats: u64,
    pub(super) reports: u64,
    /// When the last frame passed.
    pub(super) last_ns: i64,
}

impl<I: Iterator<Item = Observed>> Steps<I> {
    /// Of frames in the order of their times.
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
            steps: 0,
            polls: 0,
            repeats: 0,
            reports: 0,
            last_ns: 0,
        }
    }

    fn command(&mut self, observed: Observed) {
        let Observed { number: frame_number, at_ns, frame: command, .. } = observed;
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
            number: self.steps + 1,
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
            self.polls += 1;
            return;
        }
        if self.ignore_repeats
            && let Some(last) = self.open.back()
            && (0..size.slots()).all(|i| step.slot(i) == last.slot(i))
        {
            self.repeats += 1;
            return;
        }
        self.steps += 1;
        self.open.push_back(step);
        if self.open.len() > OPEN_STEPS {
            self.done.extend(self.open.pop_front());
        }
    }

    fn report(&mut self, observed: Observed) {
        let Observed { number, at_ns, frame, .. } = observed;
        self.reports += 1;
        self.kinds.response(&frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let losses = (board.full_count, board.error);
        let was_op = std::mem::replace(&mut self.in_op, board.state.state() == Some(MasterState::Op));
        // Outside OP the full count is not told.
        if self.in_op && self.losses.replace(losses).is_some_and(|before| before != losses) {
            self.open.back_mut().into_iter().for_each(|newest| newest.lost = true);
        }
        if !self.in_op {
            if was_op {
                self.executed.reset(self.cycle_ns);
                self.open.iter_mut().for_each(|step| step.entry = None);
            }
            return self.belongs(self.open.len().wrapping_sub(1), number, at_ns, frame);
        }
        if !was_op {
            self.executed.reset(self.cycle_ns);
        }
        let last = match self.executed.report(at_ns, &board) {
            LastExecuted::Command(last) => Some(last),
            LastExecuted::Nothing => None,
            LastExecuted::Doubtful | LastExecuted::Unknown => return,
        };
        // `None` is before any entry: a step that was executed on arrival.
        if let Some(i) = self.open.iter().rposition(|step| step.entry <= last) {
            self.belongs(i, number, at_ns, frame);
        }
    }

    /// The report is one of open step `i`, and so the steps before it get no more.
    fn belongs(&mut self, i: usize, frame_number: u64, at_ns: i64, frame: Frame) {
        let kinds = std::array::from_fn(|n| self.kinds.of(n + 1));
        let Some(step) = self.open.get_mut(i) else { return };
        let answer = Answer { frame_number, at_ns, frame, size: self.size, kinds };
        if answer.is_op() {
            for slave in 1..=self.size.max_slaves() as u8 {
                if answer.frame.slot(self.size, slave.into()).is_zero() {
                    continue;
                }
                if let Some(code) = fault(&answer.slave(slave)) {
                    note(&mut step.faults, slave, code);
                }
            }
        }
        step.answer = Some(answer);
        step.reports += 1;
        self.done.extend(self.open.drain(..i));
    }
}

/// The error code of a drive that has a fault, 0 if it tells none.
fn fault(data: &SlaveData) -> Option<u16> {
    let (statusword, code) = match data {
        SlaveData::Drive(drive) => (drive.statusword, drive.error_code),
        SlaveData::Hsp(hsp) => (hsp.statusword, 0),
        _ => return None,
    };
    let faulty = matches!(statusword.state(), Some(DriveState::Fault | DriveState::FaultReactionActive));
    (faulty || code != 0).then_some(code)
}

/// Adds a fault. The code may come a cycle later than the state: a fault without one is that with it.
fn note(faults: &mut Vec<(u8, u16)>, slave: u8, code: u16) {
    if faults.contains(&(slave, code)) || (code == 0 && faults.iter().any(|(other, _)| *other == slave)) {
        return;
    }
    faults.retain(|fault| *fault != (slave, 0));
    faults.push((slave, code));
}

impl<I: Iterator<Item = Observed>> Iterator for Steps<I> {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        while self.done.is_empty() && !self.ended {
            let Some(observed) = self.frames.next() else {
                self.ended = true;
                self.done.append(&mut self.open);
                break;
            };
            self.last_ns = observed.at_ns;
            match observed.dir {
                Dir::Write => self.command(observed),
                Dir::Read => self.report(observed),
            }
        }
        self.done.pop_front()
    }
}
