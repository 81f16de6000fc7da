//! The slots of commands that are queued, running or done. There is a queue of immediate and one of non-immediate
//! commands, both of fixed size.

use super::error::HostError;
use super::flight::CommandPart;
use crate::ethercat::Ns;
use crate::xf::command_table::{AnswerForm, CommandEffect};
use crate::xf::request::{Arguments, Encode, PdoOperation, Request, UnknownCommand};
use crate::xf::response::Returned;
use crate::xf::{AnswerHeader, CommandCode, Malformed};

/// Size of the queue of immediate commands, including those whose result was not taken yet.
pub const IMMEDIATE_SLOTS: usize = 4;
/// Size of the queue of non-immediate commands, including those whose result was not taken yet. One of them runs at a
/// time.
pub const NON_IMMEDIATE_SLOTS: usize = 4;
/// Maximum size of a command's data, and of the kept data of an answer, in bytes. The longest commands are
/// RAW_ECAT_FUNC_REQ and FOE_FUNC_REQ with 276.
pub const SLOT_BYTES: usize = 288;

/// Identifies a submitted command; with it the program takes the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Ticket {
    pub(super) slot: usize,
    pub(super) sequence: u64,
}

/// The second command of a pair, which reads the result of the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    pub(super) code: CommandCode,
    pub(super) arguments: Arguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SlotState {
    Free,
    /// The command, or the read of its result, is waiting to be sent.
    Waiting(CommandPart),
    /// The packet with the command, or with the read of its result, is in flight.
    Sent(CommandPart),
    /// The command has been running since this time.
    Running(Ns),
    Done(Result<(), HostError>),
}

#[derive(Clone, Debug)]
pub(super) struct CommandSlot {
    pub(super) state: SlotState,
    /// Whether the command was dropped, so that its result is not needed.
    abandoned: bool,
    pub(super) sequence: u64,
    pub(super) code: CommandCode,
    pub(super) arguments: Arguments,
    /// The second command of a pair, which reads the result; `None` for a single command.
    pub(super) read: Option<Read>,
    /// The time at which the command was submitted, or at which it ended and its result had to be read.
    pub(super) submitted: Ns,
    pub(super) busy_ns: Ns,
    /// How long the command ran before it ended with error bit 3.
    pub(super) failed_after: Ns,
    pub(super) returned: Returned,
    /// The data of the command; later the data of its answer.
    pub(super) bytes: [u8; SLOT_BYTES],
    /// How many bytes of the answer's data segment are kept in `bytes`.
    pub(super) held: usize,
}

impl CommandSlot {
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

    /// Drops the command if it was not sent yet, and otherwise its result.
    pub(super) fn abandon(&mut self) {
        match self.state {
            SlotState::Waiting(CommandPart::Request) => self.state = SlotState::Free,
            _ => self.abandoned = true,
        }
    }

    fn is_free(&self) -> bool {
        matches!(self.state, SlotState::Free) || self.abandoned && matches!(self.state, SlotState::Done(_))
    }

    /// The command whose answer contains the result.
    pub(super) fn answering(&self) -> CommandCode {
        self.read.map_or(self.code, |read| read.code)
    }

    /// The request to send for this step of the command.
    pub(super) fn request(&self, part: CommandPart) -> Request<'_> {
        let (code, arguments, data) = match (part, self.read) {
            (CommandPart::Read, Some(read)) => (read.code, read.arguments, &[][..]),
            (CommandPart::AbortCode, _) => (CommandCode::SdoAbortCodeGet, Arguments::NONE, &[][..]),
            _ => (self.code, self.arguments, &self.bytes[..usize::from(self.arguments.len).min(SLOT_BYTES)]),
        };
        Request::Unknown(UnknownCommand { code, arguments, data })
    }

    /// Keeps an answer's header fields and its data segment.
    pub(super) fn keep(&mut self, header: &AnswerHeader, data: &[u8]) {
        self.held = data.len().min(SLOT_BYTES);
        self.bytes[..self.held].copy_from_slice(&data[..self.held]);
        self.returned = Returned { ret: header.ret, len: header.len };
    }
}

/// The slots of both queues: those of immediate commands first.
#[derive(Clone, Debug)]
pub(super) struct CommandSlots {
    pub(super) all: [CommandSlot; IMMEDIATE_SLOTS + NON_IMMEDIATE_SLOTS],
    sequence: u64,
    /// False if all slots are free or done, so that a cycle with process data alone need not search them.
    maybe_pending: bool,
}

impl CommandSlots {
    pub(super) const fn new() -> Self {
        Self { all: [CommandSlot::FREE; IMMEDIATE_SLOTS + NON_IMMEDIATE_SLOTS], sequence: 0, maybe_pending: false }
    }

    /// Queues a command and, for a pair, the command that reads its result.
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
            return Err(HostError::ReservedForDriver { code });
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
        self.all[slot] = CommandSlot {
            state: SlotState::Waiting(CommandPart::Request),
            sequence: self.sequence,
            code,
            arguments,
            read,
            submitted: now,
            busy_ns,
            bytes: data,
            ..CommandSlot::FREE
        };
        Ok(Ticket { slot, sequence: self.sequence })
    }

    /// The oldest waiting command of the immediate or of the non-immediate queue.
    pub(super) fn first_waiting(&self, immediate: bool) -> Option<usize> {
        if !self.maybe_pending {
            return None;
        }
        let lane = if immediate { 0..IMMEDIATE_SLOTS } else { IMMEDIATE_SLOTS..self.all.len() };
        lane.filter(|slot| matches!(self.all[*slot].state, SlotState::Waiting(CommandPart::Request)))
            .min_by_key(|slot| self.all[*slot].sequence)
    }

    /// A command that has ended, and whose result or abort code is waiting to be read: its slot, and what has to be
    /// read.
    pub(super) fn waiting_read(&self) -> Option<(usize, CommandPart)> {
        if !self.maybe_pending {
            return None;
        }
        self.all.iter().enumerate().find_map(|(slot, this)| match this.state {
            SlotState::Waiting(part @ (CommandPart::Read | CommandPart::AbortCode)) => Some((slot, part)),
            _ => None,
        })
    }

    /// The slot of the non-immediate command that is in flight or running, or whose result is still to be read. Until its
    /// end no other non-immediate command may begin.
    pub(super) fn running(&self) -> Option<usize> {
        use CommandPart::{AbortCode, Read, Request};
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

    /// Ends all commands that are queued or running; this error is their result.
    pub(super) fn fail_all(&mut self, error: HostError) {
        for slot in &mut self.all {
            if !matches!(slot.state, SlotState::Free | SlotState::Done(_)) {
                slot.state = SlotState::Done(Err(error));
            }
        }
    }

    /// Ends commands that have been queued or running for too long, or whose result could not be read for too long.
    pub(super) fn expire(&mut self, now: Ns, queue_ns: Ns) {
        if !self.maybe_pending {
            return;
        }
        self.maybe_pending = false;
        for slot in &mut self.all {
            let code = slot.code;
            let waited_ns = now.saturating_sub(slot.submitted);
            match slot.state {
                SlotState::Waiting(CommandPart::Request) if waited_ns >= queue_ns => {
                    slot.state = SlotState::Done(Err(HostError::NotSent { code, waited_ns }));
                }
                // The command ran, but its result cannot be read.
                SlotState::Waiting(CommandPart::Read | CommandPart::AbortCode) if waited_ns >= queue_ns => {
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

    /// The earliest time at which a command's timeout passes.
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

/// Whether a command only reads, so that it may run again if its answer was lost. `[OURS]` 6 (PDO_DATA_OP), 81 (MDIO) and
/// 144 (MBX_STAT) only read if their arguments select a read.
pub(super) fn only_reads(code: CommandCode, arguments: &Arguments) -> bool {
    let reads = match code.command().map(|row| row.effect) {
        Some(CommandEffect::Reads) => true,
        Some(CommandEffect::Acts) | None => false,
        Some(CommandEffect::ByArguments) => match code {
            CommandCode::PdoData => {
                let operation = PdoOperation(arguments.info[0]);
                operation.contains(PdoOperation::VALID) && !operation.contains(PdoOperation::WRITE)
            }
            CommandCode::Mdio => arguments.parameter == 1,
            CommandCode::MailboxStatus => arguments.parameter != 1,
            _ => false,
        },
    };
    reads && has_result(code, arguments) && code.is_immediate(arguments.parameter)
}

/// Whether the answer to a command contains a result.
pub(super) fn has_result(code: CommandCode, arguments: &Arguments) -> bool {
    let form = match code.command().map(|row| row.answer) {
        Some(AnswerForm::ByFunction) => code.function(arguments.parameter).map(|function| function.answer),
        form => form,
    };
    form.is_some_and(|form| form != AnswerForm::Nothing)
}

/// Prepares the second command of a pair; fails if it is not a read.
pub(super) fn read_of(read: &impl Encode) -> Result<Read, HostError> {
    let (code, arguments) = read.command(&mut [0; SLOT_BYTES])?;
    if arguments.len > 0 || !only_reads(code, &arguments) {
        return Err(HostError::NotARead { code });
    }
    Ok(Read { code, arguments })
}

/// Checks that the answer's valid data were kept completely; fails if they are longer than the slot.
pub(super) fn whole(slot: &CommandSlot) -> Result<(), Malformed> {
    Malformed::at_most("valid data length", slot.returned.len.into(), slot.held).map(drop)
}
