//! Commands and their results, as a program queues and takes them.

use super::slots::{self, SLOT_BYTES, SlotState, Ticket};
use super::{Host, HostError, HostState};
use crate::ethercat::Ns;
use crate::xf::{Call, CommandCode};

impl Host {
    /// Queues a command. There is one queue for immediate commands and one for non-immediate commands. Only one
    /// non-immediate command runs at a time; immediate commands are sent meanwhile.
    ///
    /// # Errors
    /// The queue is full, the command is too long or reserved for the driver, its data are not valid for the chip, or
    /// the driver has stopped; then the error is the reason of the stop.
    pub fn submit<'d, C: Call<'d>>(&mut self, now: Ns, call: &C) -> Result<Ticket, HostError> {
        self.submit_within(now, call, self.config.timeouts.busy_ns)
    }

    /// Like [`Self::submit`]; `busy_ns` is the time in nanoseconds for which a non-immediate command may run. File
    /// transfers and the initialisation of the network need a long one.
    ///
    /// # Errors
    /// As with [`Self::submit`].
    pub fn submit_within<'d, C: Call<'d>>(&mut self, now: Ns, call: &C, busy_ns: Ns) -> Result<Ticket, HostError> {
        self.running_or_error()?;
        self.room_for(call)?;
        self.slots.submit(now, busy_ns, call, None)
    }

    /// Queues two commands, the second of which reads the result of the first: SDO_REQ and SDO_GET, PDO_CONFIG_REQ and
    /// _GET, EEPROM_REQ and _GET, RAW_ECAT_FUNC_REQ and _GET, FOE_FUNC_REQ and _GET, STATE_UPDATE and STATE_GET. No
    /// other command that would change the result runs between them. The ticket belongs to the second command; if the
    /// first one fails, its error is the result.
    ///
    /// # Errors
    /// As with [`Self::submit`]; or the second command does not only read, so that it could not be repeated without
    /// harm if its answer is lost.
    pub fn submit_pair<'d, 'e, C: Call<'d>, R: Call<'e>>(
        &mut self,
        now: Ns,
        call: &C,
        read: &R,
        busy_ns: Ns,
    ) -> Result<Ticket, HostError> {
        self.running_or_error()?;
        let read = slots::read_of(read)?;
        self.room_for(call)?;
        self.slots.submit(now, busy_ns, call, Some(read))
    }

    /// Whether the command of a ticket is done. This is also true if its result was already taken.
    pub fn is_done(&self, ticket: Ticket) -> bool {
        let slot = &self.slots.all[ticket.slot];
        slot.sequence != ticket.sequence || matches!(slot.state, SlotState::Free | SlotState::Done(_))
    }

    /// Takes the result of a command, which frees its slot in the queue; `None` while the command is not done. `call`
    /// is the submitted command, or the second one of a pair.
    ///
    /// The result is an error if the command failed, if it was not sent, or if its answer does not fit `call`. It is
    /// [`HostError::UnknownTicket`] if the result was already taken, and [`HostError::OtherCommand`] if the ticket
    /// belongs to another command than `call`.
    pub fn take<'h, 'd, C: Call<'d>>(
        &'h mut self,
        ticket: Ticket,
        call: &C,
    ) -> Option<Result<C::Answer<'h>, HostError>> {
        let slot = &mut self.slots.all[ticket.slot];
        if slot.sequence != ticket.sequence || slot.state == SlotState::Free {
            return Some(Err(HostError::UnknownTicket));
        }
        let expected = slot.answering();
        let parameter = slot.read.map_or(slot.arguments, |read| read.arguments).parameter;
        if expected != C::CODE || C::FUNCTION.is_some_and(|function| function != parameter) {
            return Some(Err(HostError::OtherCommand { expected, found: C::CODE }));
        }
        let SlotState::Done(result) = slot.state else { return None };
        slot.state = SlotState::Free;
        let slot = &self.slots.all[ticket.slot];
        let decode = || {
            slots::whole(slot)?;
            Ok(call.answer(slot.returned, &slot.bytes[..slot.held])?)
        };
        Some(result.and_then(|()| decode()))
    }

    /// Drops a command whose result is not needed: its slot in the queue is freed when the command is done. A command
    /// that was not sent yet is not sent any more.
    pub fn abandon(&mut self, ticket: Ticket) {
        let slot = &mut self.slots.all[ticket.slot];
        if slot.sequence == ticket.sequence {
            slot.abandon();
        }
    }

    /// Drops all commands and results as [`Self::abandon`] does, so that a more urgent command need not wait.
    pub fn abandon_all(&mut self) {
        self.slots.all.iter_mut().for_each(slots::CommandSlot::abandon);
    }

    /// Checks that a command fits into a packet, once the data segment size n is known.
    fn room_for<'d, C: Call<'d>>(&self, call: &C) -> Result<(), HostError> {
        let found = usize::from(call.encode(&mut [0; SLOT_BYTES])?.len);
        let most = self.size.bytes();
        if self.state == HostState::Running && found > most && C::CODE != CommandCode::SpiReconfig {
            return Err(HostError::TooLong { code: C::CODE, found, most });
        }
        Ok(())
    }
}
