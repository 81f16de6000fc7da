//! The mailbox of a slave: one request and its answer, whatever else the slave sends in between, and whatever gets lost.
//!
//! No request is done twice: if a frame that writes one is lost, the same message is written again with the same counter, by
//! which the slave knows it. Nor is the first request in PreOP taken for one of another master. No answer is lost: if a frame that
//! reads one is lost, the slave is asked for a repeat.

use super::bus::{Bus, Unanswered};
use super::mailbox_state::MailboxState;
use super::{Event, MailboxInfo};
use crate::ethercat::coe::{CoeMessage, ObjectAddress, SdoRequest, SdoScope};
use crate::ethercat::mailbox::{
    MAILBOX_HEADER_LEN, MailboxCounter, MailboxFault, MailboxHeader, MailboxMessage, MailboxProtocol, encode_around,
};
use crate::ethercat::registers::{
    SmActivate, SmPdiControl, SmStatus, sync_manager_activate, sync_manager_pdi_control, sync_manager_status,
};
use crate::ethercat::sii::MailboxProtocols;
use crate::ethercat::{Command, Ns};

/// \[OURS] How long the master waits until it looks again whether there is an answer.
const POLL_NS: Ns = 100_000;
/// \[OURS] How long a slave may take to repeat its last message.
const REPEAT_MAX_NS: Ns = 50_000_000;
/// What the first request to a mailbox asks for, which every slave with CoE has: the device type. Its value is of no interest.
pub(super) const FIRST_OBJECT: ObjectAddress = ObjectAddress::new(0x1000, 0);
/// \[OURS] How long the master waits for that answer.
const FIRST_MAX_NS: Ns = 20_000_000;
/// The sync managers of the mailbox.
const REQUESTS: u8 = 0;
const ANSWERS: u8 = 1;

/// Why a request has no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MailboxError {
    /// The slave has no mailbox, or does not speak the protocol.
    #[error("the slave has no mailbox for this protocol, as its EEPROM says")]
    NoMailbox,
    /// The request is longer than the mailbox.
    #[error("the request does not fit into the slave's mailbox")]
    TooLong,
    /// Another request is under way.
    #[error("a request to this slave is under way; wait until it has ended")]
    Busy,
    /// The slave does not answer datagrams.
    #[error("the slave does not answer; check its cable and its power")]
    NoAnswer,
    /// The time is up.
    #[error("the slave has given no answer when the time was up")]
    TimeUp,
    /// The slave says what was wrong with the request.
    #[error("the slave answers with {0}")]
    Fault(MailboxFault),
    /// The answer is none to the request, or longer than what was asked for.
    #[error("the slave's answer is none to the request")]
    WrongAnswer,
}

/// Whose mailbox is used, and how long the slave may take for each answer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peer {
    /// Its number, from 1.
    pub(super) slave: u8,
    pub(super) station: u16,
    pub(super) mailbox: Option<MailboxInfo>,
    pub(super) timeout_ns: Ns,
}

impl Peer {
    /// Takes the mailbox, if the slave speaks the protocol, and takes away what has been left in it.
    pub(super) async fn open(self, bus: Bus, protocol: MailboxProtocols) -> Result<Mailbox, MailboxError> {
        let info = self.mailbox.filter(|info| info.protocols.contains(protocol)).ok_or(MailboxError::NoMailbox)?;
        let mut mailbox = Mailbox::open(bus, self.slave, self.station, info).ok_or(MailboxError::Busy)?;
        mailbox.drain().await?;
        mailbox.begin(self.timeout_ns).await?;
        Ok(mailbox)
    }
}

/// The mailbox of one slave, for one user at a time.
pub(super) struct Mailbox {
    bus: Bus,
    /// Its number, from 1.
    slave: u8,
    station: u16,
    info: MailboxInfo,
    /// A message as it lies in its box. The memory for it is the slave's, whoever uses the mailbox.
    bytes: Vec<u8>,
    /// The slave has not answered the last request.
    is_waiting: bool,
    /// The message was asked for once more, so that it may be an older one.
    is_repeated: bool,
}

impl Drop for Mailbox {
    fn drop(&mut self) {
        let (bytes, is_waiting) = (std::mem::take(&mut self.bytes), self.is_waiting);
        self.bus.with(|shared| {
            if let Some(live) = shared.live_mut(self.slave) {
                (live.mailbox.is_open, live.mailbox_bytes) = (false, bytes);
                live.mailbox.owes |= is_waiting;
            }
        });
    }
}

impl Mailbox {
    /// Takes the mailbox of a slave; `None`: another one has it.
    pub(super) fn open(bus: Bus, slave: u8, station: u16, info: MailboxInfo) -> Option<Self> {
        let bytes = bus.with(|shared| {
            let live = shared.live_mut(slave)?;
            let is_free = !std::mem::replace(&mut live.mailbox.is_open, true);
            is_free.then(|| std::mem::take(&mut live.mailbox_bytes))
        });
        bytes.map(|bytes| Self { bus, slave, station, info, bytes, is_waiting: false, is_repeated: false })
    }

    fn state<R: Default>(&self, change: impl FnOnce(&mut MailboxState) -> R) -> R {
        self.bus.with(|shared| shared.live_mut(self.slave).map(|live| change(&mut live.mailbox)).unwrap_or_default())
    }

    pub(super) fn now(&self) -> Ns {
        self.bus.now()
    }

    pub(super) async fn pause(&self, ns: Ns) {
        self.bus.sleep(ns).await;
    }

    /// How long the mailbox of answers is, bytes.
    pub(super) const fn answer_len(&self) -> usize {
        self.info.areas.send.len as usize
    }

    /// How many bytes of data a message to the slave can have.
    pub(super) const fn room(&self) -> usize {
        (self.info.areas.receive.len as usize).saturating_sub(MAILBOX_HEADER_LEN)
    }

    /// Sends a message.
    pub(super) async fn send(
        &mut self,
        protocol: MailboxProtocol,
        until: Ns,
        encode: impl FnOnce(&mut [u8]) -> Option<usize>,
    ) -> Result<(), MailboxError> {
        let counter = self.state(|state| {
            state.counter = if state.is_shared { MailboxCounter::NONE } else { state.counter.next() };
            state.counter
        });
        self.bytes.clear();
        self.bytes.resize(self.info.areas.receive.len.into(), 0);
        let len = self.bytes.get_mut(MAILBOX_HEADER_LEN..).and_then(encode).ok_or(MailboxError::TooLong)?;
        let header = MailboxHeader::new(protocol, counter);
        encode_around(header, len, &mut self.bytes).map_err(|_| MailboxError::TooLong)?;
        self.state(|state| state.owes |= self.is_waiting);
        self.is_waiting = true;
        let mut was_lost = false;
        loop {
            let written = self
                .bus
                .queue_with(Command::Fpwr, self.station, self.info.areas.receive.start, &self.bytes, 1)
                .answer(&mut [])
                .await;
            match written {
                Ok(1) => return Ok(()),
                // The first one has come, and fills the box until the slave takes it.
                Ok(0) if was_lost => return Ok(()),
                Ok(0) if !self.is_reached().await? => return Err(MailboxError::NoAnswer),
                Ok(_) => {}
                Err(_) => was_lost = true,
            }
            if self.bus.now() >= until {
                return Err(MailboxError::TimeUp);
            }
            self.bus.sleep(POLL_NS).await;
        }
    }

    /// Whether the slave answers at all.
    async fn is_reached(&self) -> Result<bool, MailboxError> {
        match self.bus.read::<1>(self.station, sync_manager_status(REQUESTS)).await {
            Ok(_) => Ok(true),
            Err(Unanswered::Counter(_)) => Ok(false),
            Err(Unanswered::Lost) => Err(MailboxError::NoAnswer),
        }
    }

    /// Waits for the next message of a protocol; its data. Emergencies become events, and other messages are left out.
    pub(super) async fn receive(&mut self, protocol: MailboxProtocol, until: Ns) -> Result<&[u8], MailboxError> {
        loop {
            if self.collect().await? && self.is_answer(protocol)? {
                self.is_waiting = false;
                break;
            }
            if self.bus.now() >= until {
                return Err(MailboxError::TimeUp);
            }
            self.bus.sleep(POLL_NS).await;
        }
        Ok(MailboxMessage::decode(&self.bytes).map(|message| message.data).unwrap_or_default())
    }

    /// What was received is none to the request. Whether it may be one to a request before, or an older one once more, so that the right
    /// one still comes.
    pub(super) fn leaves_out(&mut self) -> bool {
        let is_late = self.is_repeated || self.state(|state| std::mem::take(&mut state.owes));
        self.is_waiting |= is_late;
        is_late
    }

    /// The slave has answered this request. Slaves answer one after the other, so that nothing of those before is to come.
    pub(super) fn settle(&self) {
        self.state(|state| state.owes = false);
    }

    /// There is no answer to the message that was sent.
    pub(super) const fn wants_no_answer(&mut self) {
        self.is_waiting = false;
    }

    /// Reads the message that the slave has sent, as it lies in its box; `None`: there is none. An emergency becomes an event,
    /// too.
    pub(super) async fn take(&mut self) -> Result<Option<Vec<u8>>, MailboxError> {
        let is_full = self.collect().await?;
        if is_full {
            // Whatever it is, it is the user's.
            let _ = self.is_answer(MailboxProtocol::Coe);
        }
        self.bus.with(|shared| {
            if let Some(live) = shared.live_mut(self.slave) {
                live.has_mail = false;
            }
        });
        Ok(is_full.then(|| self.bytes.clone()))
    }

    /// Of a slave that has entered PreOP nobody knows which counter it takes for that of a repeat: some remember the last request of
    /// another master over Init, and would drop the first one of this master that has the same. So that is a request that may be
    /// dropped; what follows has another counter than either.
    async fn begin(&mut self, timeout_ns: Ns) -> Result<(), MailboxError> {
        let is_counted = self.state(|state| state.is_shared || state.counter != MailboxCounter::NONE);
        if is_counted || !self.info.protocols.contains(MailboxProtocols::COE) {
            return Ok(());
        }
        let until = self.now().saturating_add(timeout_ns.min(FIRST_MAX_NS));
        let request = CoeMessage::SdoRequest(SdoRequest::Upload { object: FIRST_OBJECT, scope: SdoScope::Entry });
        self.send(MailboxProtocol::Coe, until, |room| request.encode(room).ok()).await?;
        match self.receive(MailboxProtocol::Coe, until).await {
            Err(MailboxError::NoAnswer) => Err(MailboxError::NoAnswer),
            // Whatever it is; and without an answer the next request shows whether there is ever one.
            _ => Ok(()),
        }
    }

    /// Takes away what the slave has sent without being asked, or as an answer to a request that was given up.
    pub(super) async fn drain(&mut self) -> Result<(), MailboxError> {
        // \[OURS] A slave that fills its box each time is not waited for.
        for _ in 0..16 {
            if !self.collect().await? {
                break;
            }
            // An answer that nobody waits for has no meaning.
            let _ = self.is_answer(MailboxProtocol::Coe);
        }
        Ok(())
    }

    /// Reads the message that the slave has sent, if there is one.
    async fn collect(&mut self) -> Result<bool, MailboxError> {
        let status = self.bus.read::<1>(self.station, sync_manager_status(ANSWERS)).await;
        let [status] = status.map_err(|_| MailboxError::NoAnswer)?;
        if !SmStatus(status).contains(SmStatus::FULL) {
            return Ok(false);
        }
        self.bytes.clear();
        self.bytes.resize(self.info.areas.send.len.into(), 0);
        let start = self.info.areas.send.start;
        let mut repeats = 0;
        loop {
            let ticket = self.bus.queue_with(Command::Fprd, self.station, start, &self.bytes, 1);
            match ticket.answer(&mut self.bytes).await {
                Ok(counter) => {
                    self.is_repeated = repeats > 0;
                    return Ok(counter == 1 && (self.is_new() || repeats == 0));
                }
                Err(_) if repeats == 3 => return Err(MailboxError::NoAnswer),
                // The slave may have taken it for read.
                Err(_) => self.ask_for_repeat().await?,
            }
            repeats += 1;
        }
    }

    /// Has the slave put its last message into the box once more.
    async fn ask_for_repeat(&self) -> Result<(), MailboxError> {
        let until = self.bus.now().saturating_add(REPEAT_MAX_NS);
        let repeat = self.state(|state| {
            state.repeat = !state.repeat;
            state.repeat
        });
        let asked = if repeat { SmActivate::ENABLE | SmActivate::REPEAT } else { SmActivate::ENABLE };
        let written = self.bus.write(self.station, sync_manager_activate(ANSWERS), &[asked.0]).await;
        written.map_err(|_| MailboxError::NoAnswer)?;
        loop {
            let done = self.bus.read::<1>(self.station, sync_manager_pdi_control(ANSWERS)).await;
            let [done] = done.map_err(|_| MailboxError::NoAnswer)?;
            if SmPdiControl(done).contains(SmPdiControl::REPEAT_ACKNOWLEDGE) == repeat {
                return Ok(());
            }
            if self.bus.now() >= until {
                // Slaves without repeats are read as they are.
                return Ok(());
            }
            self.bus.sleep(POLL_NS).await;
        }
    }

    /// Whether the message is another one than the last, which a repeat may bring again: not every slave counts its messages right.
    fn is_new(&self) -> bool {
        let Ok(message) = MailboxMessage::decode(&self.bytes) else { return false };
        let counter = message.header.counter;
        self.state(|state| !counter.repeats(std::mem::replace(&mut state.received, counter)))
    }

    /// Whether the message is one of the protocol and no emergency.
    ///
    /// # Errors
    /// [`MailboxError::WrongAnswer`]: it is longer than its box; [`MailboxError::Fault`].
    fn is_answer(&self, protocol: MailboxProtocol) -> Result<bool, MailboxError> {
        let message = MailboxMessage::decode(&self.bytes).map_err(|_| MailboxError::WrongAnswer)?;
        if message.header.protocol == MailboxProtocol::Error {
            return MailboxFault::decode(message.data).map_or(Ok(false), |fault| Err(MailboxError::Fault(fault)));
        }
        if message.header.protocol == MailboxProtocol::Coe
            && let Ok(CoeMessage::Emergency(emergency)) = CoeMessage::decode(message.data)
        {
            let event = Event::Emergency { slave: self.slave, emergency };
            self.bus.with(|shared| shared.tell(event));
            return Ok(false);
        }
        Ok(message.header.protocol == protocol)
    }
}
