//! The commands that wait, run or are done: a queue of immediate ones and one of the others, of fixed size.

use super::error::HostError;
use super::flight::Part;
use crate::ethercat::Ns;
use crate::xf::code::AnswerForm;
use crate::xf::request::{Arguments, Encode, PdoOperation, Request, UnknownCommand};
use crate::xf::response::Returned;
use crate::xf::{AnswerHeader, CommandCode, Malformed};

/// How many immediate commands wait or are not taken yet.
pub const IMMEDIATE_SLOTS: usize = 4;
/// How many non-immediate commands wait or are not taken yet. One of them runs at a time.
pub const NON_IMMEDIATE_SLOTS: usize = 4;
/// Bytes of data that a command may have, and that are kept of an answer. The longest are RAW_ECAT_FUNC_REQ and
/// FOE_FUNC_REQ with 276.
pub const SLOT_BYTES: usize = 288;

/// A command that was submitted, by which its result is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Ticket {
    pub(super) slot: usize,
    pub(super) sequence: u64,
}

/// A command as it is sent, and where the second one of a pair is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    pub(super) code: CommandCode,
    pub(super) arguments: Arguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SlotState {
    Free,
    /// Until this part is sent.
    Waiting(Part),
    /// Its packet is on its way.
    Sent(Part),
    /// It runs since then.
    Running(Ns),
    Done(Result<(), HostError>),
}

#[derive(Clone, Debug)]
pub(super) struct Slot {
    pub(super) state: SlotState,
    /// Nobody will take the result.
    abandoned: bool,
    pub(super) sequence: u64,
    pub(super) code: CommandCode,
    pub(super) arguments: Arguments,
    /// What reads the result.
    pub(super) read: Option<Read>,
    /// When it was submitted, or when it ended and its result was to be read.
    pub(super) submitted: Ns,
    pub(super) busy_ns: Ns,
    /// When it has ended with error bit 3, after so long.
    pub(super) failed_after: Ns,
    pub(super) returned: Returned,
    /// First the data of the command, then those of the answer.
    pub(super) bytes: [u8; SLOT_BYTES],
    /// Bytes of the answer's data segment that are there.
    pub(super) held: usize,
}

impl Slot {
    pub(super) const FREE: Self = Self {
        state: SlotState::Free,
        abandoned: false,
        sequence: 0,
        code: CommandCode::InfoUpdate,
        arguments: Arguments::NONE,
        read: None,
        submitted: 0,
        busy_ns: 0,
        failed_after: 0,
        returned: Returned::NONE,
        bytes: [0; SLOT_BYTES],
        held: 0,
    };

    /// Drops the command if it was not sent yet, and else its result.
    pub(super) fn abandon(&mut self) {
        match self.state {
            SlotState::Waiting(Part::Request) => self.state = SlotState::Free,
            _ => self.abandoned = true,
        }
    }

    fn is_free(&self) -> bool {
        matches!(self.state, SlotState::Free) || self.abandoned && matches!(self.state, SlotState::Done(_))
    }

    /// The command whose answer is the result.
    pub(super) fn answering(&self) -> CommandCode {
        self.read.map_or(self.code, |read| read.code)
    }

    /// What is sent for this part.
    pub(super) fn request(&self, part: Part) -> Request<'_> {
        let (code, arguments, data) = match (part, self.read) {
            (Part::Read, Some(read)) => (read.code, read.arguments, &[][..]),
            (Part::AbortCode, _) => (CommandCode::SdoAbortCodeGet, Arguments::NONE, &[][..]),
            _ => (self.code, self.arguments, &self.bytes[..usize::from(self.arguments.len).min(SLOT_BYTES)]),
        };
        Request::Unknown(UnknownCommand { code, arguments, data })
    }

    /// Keeps an answer and its data segment.
    pub(super) fn keep(&mut self, header: &AnswerHeader, data: &[u8]) {
        self.held = data.len().min(SLOT_BYTES);
        self.bytes[..self.held].copy_from_slice(&data[..self.held]);
        self.returned = Returned { ret: header.ret, len: header.len };
    }
}

/// Both queues.
#[derive(Clone, Debug)]
pub(super) struct Slots {
    pub(super) all: [Slot; IMMEDIATE_SLOTS + NON_IMMEDIATE_SLOTS],
    sequence: u64,
    /// False: all are free or done, so that a cycle of process data alone need not look at each of them.
    maybe_pending: bool,
}

impl Slots {
    pub(super) const fn new() -> Self {
        Self { all: [Slot::FREE; IMMEDIATE_SLOTS + NON_IMMEDIATE_SLOTS], sequence: 0, maybe_pending: false }
    }

    /// Puts a command, and what reads its result, into its queue.
    pub(super) fn submit(
        &mut self,
        now: Ns,
        busy_ns: Ns,
        request: &impl Encode,
        read: Option<Read>,
    ) -> Result<Ticket, HostError> {
        let mut data = [0; SLOT_BYTES];
        let (code, arguments) = request.command(&mut data)?;
        use CommandCode::{CrcTypeSet, PdoData, PdoDataFifo, SpiReconfig};
        if matches!(code, CrcTypeSet | PdoData | PdoDataFifo | SpiReconfig) {
            return Err(HostError::OfDriver { code });
        }
        if usize::from(arguments.len) > SLOT_BYTES {
            return Err(HostError::TooLong { code, found: arguments.len.into(), most: SLOT_BYTES });
        }
        let lane =
            if code.is_immediate(arguments.parameter) { 0..IMMEDIATE_SLOTS } else { IMMEDIATE_SLOTS..self.all.len() };
        let slots = lane.len();
        let free = lane.into_iter().find(|slot| self.all[*slot].is_free());
        let slot = free.ok_or(HostError::QueueFull { code, slots })?;
        self.sequence += 1;
        self.maybe_pending = true;
        self.all[slot] = Slot {
            state: SlotState::Waiting(Part::Request),
            sequence: self.sequence,
            code,
            arguments,
            read,
            submitted: now,
            busy_ns,
            bytes: data,
            ..Slot::FREE
        };
        Ok(Ticket { slot, sequence: self.sequence })
    }

    /// The immediate command, or the other one, that waits the longest.
    pub(super) fn first_waiting(&self, immediate: bool) -> Option<usize> {
        if !self.maybe_pending {
            return None;
        }
        let lane = if immediate { 0..IMMEDIATE_SLOTS } else { IMMEDIATE_SLOTS..self.all.len() };
        lane.filter(|slot| matches!(self.all[*slot].state, SlotState::Waiting(Part::Request)))
            .min_by_key(|slot| self.all[*slot].sequence)
    }

    /// A read that belongs to a command which has ended.
    pub(super) fn waiting_read(&self) -> Option<(usize, Part)> {
        if !self.maybe_pending {
            return None;
        }
        self.all.iter().enumerate().find_map(|(slot, this)| match this.state {
            SlotState::Waiting(part @ (Part::Read | Part::AbortCode)) => Some((slot, part)),
            _ => None,
        })
    }

    /// The non-immediate command that runs or whose result is still to be read, so that no other may begin.
    pub(super) fn running(&self) -> Option<usize> {
        use Part::{AbortCode, Read, Request};
        if !self.maybe_pending {
            return None;
        }
        self.all[IMMEDIATE_SLOTS..]
            .iter()
            .position(|slot| {
                matches!(
                    slot.state,
                    SlotState::Running(_)
                        | SlotState::Sent(Request | Read | AbortCode)
                        | SlotState::Waiting(Read | AbortCode)
                )
            })
            .map(|place| IMMEDIATE_SLOTS + place)
    }

    /// Ends all that are not done.
    pub(super) fn fail_all(&mut self, error: HostError) {
        for slot in &mut self.all {
            if !matches!(slot.state, SlotState::Free | SlotState::Done(_)) {
                slot.state = SlotState::Done(Err(error));
            }
        }
    }

    /// Ends what waits in a queue for too long, and what runs for too long.
    pub(super) fn expire(&mut self, now: Ns, queue_ns: Ns) {
        if !self.maybe_pending {
            return;
        }
        self.maybe_pending = false;
        for slot in &mut self.all {
            let code = slot.code;
            let waited_ns = now.saturating_sub(slot.submitted);
            match slot.state {
                SlotState::Waiting(Part::Request) if waited_ns >= queue_ns => {
                    slot.state = SlotState::Done(Err(HostError::NotSent { code, waited_ns }));
                }
                // The command ran, but its result cannot be read.
                SlotState::Waiting(Part::Read | Part::AbortCode) if waited_ns >= queue_ns => {
                    slot.state = SlotState::Done(Err(HostError::AnswerLost { code: slot.code }));
                }
                SlotState::Running(since) if now.saturating_sub(since) >= slot.busy_ns => {
                    let waited_ns = now.saturating_sub(since);
                    slot.state = SlotState::Done(Err(HostError::StillBusy { code, waited_ns }));
                }
                _ => {}
            }
            self.maybe_pending |= !matches!(slot.state, SlotState::Free | SlotState::Done(_));
        }
    }

    /// When the next command has waited or run for too long.
    pub(super) fn next_deadline(&self, queue_ns: Ns) -> Option<Ns> {
        self.all
            .iter()
            .filter_map(|slot| match slot.state {
                SlotState::Waiting(_) => Some(slot.submitted.saturating_add(queue_ns)),
                SlotState::Running(since) => Some(since.saturating_add(slot.busy_ns)),
                _ => None,
            })
            .min()
    }
}

/// Whether a command only reads, so that it may run again if its answer was lost. `[OURS]` All whose answer has a
/// result but those that also do something: 5 takes TxPDOs out of the FIFO, 24 clears, 6, 81 and 144 read with some
/// arguments alone.
pub(super) fn only_reads(code: CommandCode, arguments: &Arguments) -> bool {
    let writes = match code {
        CommandCode::PdoDataFifo | CommandCode::CrcErrorCountClear => true,
        CommandCode::PdoData => {
            let operation = PdoOperation(arguments.info[0]);
            !operation.contains(PdoOperation::VALID) || operation.contains(PdoOperation::WRITE)
        }
        CommandCode::Mdio => arguments.parameter != 1,
        CommandCode::MailboxStatus => arguments.parameter == 1,
        _ => false,
    };
    has_result(code, arguments) && !writes && code.is_immediate(arguments.parameter)
}

/// Whether the answer to a command has a result.
pub(super) fn has_result(code: CommandCode, arguments: &Arguments) -> bool {
    let form = match code.command().map(|row| row.answer) {
        Some(AnswerForm::ByFunction) => code.function(arguments.parameter).map(|function| function.answer),
        form => form,
    };
    form.is_some_and(|form| form != AnswerForm::Nothing)
}

/// The read of a pair, if it is one.
pub(super) fn read_of(read: &impl Encode) -> Result<Read, HostError> {
    let (code, arguments) = read.command(&mut [0; SLOT_BYTES])?;
    if arguments.len > 0 || !only_reads(code, &arguments) {
        return Err(HostError::NoRead { code });
    }
    Ok(Read { code, arguments })
}

/// What a result is decoded from, if the segment was kept whole.
pub(super) fn whole(slot: &Slot) -> Result<(), Malformed> {
    Malformed::at_most("valid data length", slot.returned.len.into(), slot.held).map(drop)
}
