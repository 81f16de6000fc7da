//! The mailbox of a slave: one request and its answer at a time, also when the slave sends other messages or frames are
//! lost.
//!
//! No request is executed twice: if a frame that writes a request is lost, the same message is written again with the
//! same counter, by which the slave recognises it. In PreOP a slave may drop the first request as a repeat of a request
//! of another master, so a harmless request comes first. No answer is lost: if a frame that reads an answer is lost,
//! the master asks the slave for a repeat.
//!
//! Files: `state.rs` is what the mailbox of a slave keeps between requests. Each mailbox protocol has a file with its jobs:
//! `coe/`, `foe.rs`. To add one, add its file here, and a row in `ends!` of `master/handle.rs` for each type of result.

pub(super) mod coe;
mod foe;
pub(super) mod state;

pub use coe::{SdoError, VALUE_BYTES_MAX};
pub use foe::FileError;

use self::state::MailboxState;
use super::bus::{Bus, Unanswered};
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

/// \[OURS] The interval in which the master checks for an answer.
const POLL_NS: Ns = 100_000;
/// \[OURS] How long a slave may take to repeat its last message.
const REPEAT_MAX_NS: Ns = 50_000_000;
/// The object of the first request to a mailbox, the device type, which every slave with CoE has. Its value is not
/// used.
pub(in crate::master) const FIRST_OBJECT: ObjectAddress = ObjectAddress::new(0x1000, 0);
/// \[OURS] How long the master waits for the answer to the first request.
const FIRST_MAX_NS: Ns = 20_000_000;
/// The sync managers of the mailbox: for requests and for answers.
const REQUESTS: u8 = 0;
const ANSWERS: u8 = 1;

/// Why a request has no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MailboxError {
    /// The slave has no mailbox, or does not support the protocol.
    #[error("by its EEPROM the slave has no mailbox for this protocol")]
    NoMailbox,
    /// The request is longer than the mailbox.
    #[error("the request does not fit into the slave's mailbox")]
    TooLong,
    /// Another request to the mailbox is under way.
    #[error("a request to this slave is under way; wait until it has ended")]
    Busy,
    /// The slave does not answer datagrams.
    #[error("the slave does not answer; check its cable and its power")]
    NoAnswer,
    /// The timeout has passed without an answer.
    #[error("the slave did not answer before the timeout")]
    TimeUp,
    /// The slave has answered with a mailbox error.
    #[error("the slave answers with {0}")]
    Fault(MailboxFault),
    /// The answer does not belong to the request, or is longer than allowed.
    #[error("the slave's answer does not belong to the request")]
    WrongAnswer,
}

/// The slave whose mailbox is used, and how long it may take for each answer.
#[derive(Clone, Copy, Debug)]
pub(in crate::master) struct Peer {
    /// The number of the slave, from 1.
    pub(in crate::master) slave: u8,
    pub(in crate::master) station: u16,
    pub(in crate::master) mailbox: Option<MailboxInfo>,
    pub(in crate::master) timeout_ns: Ns,
}

impl Peer {
    /// Claims the mailbox if the slave supports the protocol, drains messages that were left in it, and sends the
    /// harmless first request if none was sent since the slave entered PreOP.
    pub(in crate::master) async fn open(self, bus: Bus, protocol: MailboxProtocols) -> Result<Mailbox, MailboxError> {
        let info = self.mailbox.filter(|info| info.protocols.contains(protocol)).ok_or(MailboxError::NoMailbox)?;
        let mut mailbox = Mailbox::open(bus, self.slave, self.station, info).ok_or(MailboxError::Busy)?;
        mailbox.drain().await?;
        mailbox.begin(self.timeout_ns).await?;
        Ok(mailbox)
    }
}

/// Exclusive access to the mailbox of one slave. Dropping it releases the mailbox.
pub(in crate::master) struct Mailbox {
    bus: Bus,
    /// The number of the slave, from 1.
    slave: u8,
    station: u16,
    info: MailboxInfo,
    /// One mailbox message, for sending or receiving. The buffer is kept per slave between accesses.
    bytes: Vec<u8>,
    /// Whether the slave has not answered the last request yet.
    is_waiting: bool,
    /// Whether a repeat was requested for this message, so that it may be an older one.
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
    /// Claims the mailbox of a slave; `None`: it is in use.
    pub(in crate::master) fn open(bus: Bus, slave: u8, station: u16, info: MailboxInfo) -> Option<Self> {
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

    pub(in crate::master) fn now(&self) -> Ns {
        self.bus.now()
    }

    pub(in crate::master) async fn pause(&self, ns: Ns) {
        self.bus.sleep(ns).await;
    }

    /// The length of the mailbox for answers, bytes.
    pub(in crate::master) const fn answer_len(&self) -> usize {
        self.info.areas.send.len as usize
    }

    /// The most bytes of data in a message to the slave.
    pub(in crate::master) const fn room(&self) -> usize {
        (self.info.areas.receive.len as usize).saturating_sub(MAILBOX_HEADER_LEN)
    }

    /// Writes a message into the slave's mailbox. Tries it again while the mailbox is full, or if the frame is lost,
    /// until the time `until`.
    pub(in crate::master) async fn send(
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
                // The lost frame has reached the slave, and its message fills the mailbox until the slave reads it.
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

    /// Whether the slave answers datagrams at all.
    async fn is_reached(&self) -> Result<bool, MailboxError> {
        match self.bus.read::<1>(self.station, sync_manager_status(REQUESTS)).await {
            Ok(_) => Ok(true),
            Err(Unanswered::Counter(_)) => Ok(false),
            Err(Unanswered::Lost) => Err(MailboxError::NoAnswer),
        }
    }

    /// Waits for the next message of a protocol and returns its data. Emergencies become events, and all other messages
    /// are dropped.
    pub(in crate::master) async fn receive(
        &mut self,
        protocol: MailboxProtocol,
        until: Ns,
    ) -> Result<&[u8], MailboxError> {
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

    /// Called for a message that does not answer the request. Returns whether it may belong to an earlier request or be
    /// a repeated older message, so that the right answer may still come.
    pub(in crate::master) fn leaves_out(&mut self) -> bool {
        let is_late = self.is_repeated || self.state(|state| std::mem::take(&mut state.owes));
        self.is_waiting |= is_late;
        is_late
    }

    /// Called when the slave has answered the present request. Slaves answer in order, so from here on no answer to an
    /// earlier request is expected.
    pub(in crate::master) fn settle(&self) {
        self.state(|state| state.owes = false);
    }

    /// Called after a message that the slave does not answer, such as an abort: from here on no answer is awaited.
    pub(in crate::master) const fn wants_no_answer(&mut self) {
        self.is_waiting = false;
    }

    /// Reads the message in the slave's mailbox, undecoded; `None`: the mailbox is empty. An emergency also becomes an
    /// event.
    pub(in crate::master) async fn take(&mut self) -> Result<Option<Vec<u8>>, MailboxError> {
        let is_full = self.collect().await?;
        if is_full {
            // The user gets the message whatever its kind is; this call only notes emergencies.
            let _ = self.is_answer(MailboxProtocol::Coe);
        }
        self.bus.with(|shared| {
            if let Some(live) = shared.live_mut(self.slave) {
                live.has_mail = false;
            }
        });
        Ok(is_full.then(|| self.bytes.clone()))
    }

    /// Sends a harmless first request after a slave has entered PreOP. Some slaves still remember the counter of the
    /// last request of another master, through Init, and drop a first request with the same counter as a repeat. Only
    /// this harmless request can be dropped so: the next request has another counter.
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
            // The content of the answer does not matter. If there is none, the next request shows whether the slave
            // answers at all.
            _ => Ok(()),
        }
    }

    /// Drops messages in the mailbox that are unsolicited, or that answer an abandoned request.
    pub(in crate::master) async fn drain(&mut self) -> Result<(), MailboxError> {
        // \[OURS] At most 16 messages are dropped, so that this also ends for a slave that fills its mailbox again each
        // time.
        for _ in 0..16 {
            if !self.collect().await? {
                break;
            }
            // An answer without a waiting request is dropped; this call only notes emergencies.
            let _ = self.is_answer(MailboxProtocol::Coe);
        }
        Ok(())
    }

    /// Reads a message from the slave's mailbox. Returns false if there is none, or if a repeat has brought the last
    /// message again.
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
                    return Ok(counter == 1 && self.is_new());
                }
                Err(_) if repeats == 3 => return Err(MailboxError::NoAnswer),
                // If the frame was lost on its way back, the slave counts the message as read, and its mailbox is
                // empty. So the slave is asked to put the message in again.
                Err(_) => self.ask_for_repeat().await?,
            }
            repeats += 1;
        }
    }

    /// Asks the slave to put its last message into the mailbox again.
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
                // The slave does not support repeats, so the master reads what its mailbox contains now.
                return Ok(());
            }
            self.bus.sleep(POLL_NS).await;
        }
    }

    /// Returns false if a repeat has brought the last message again.
    ///
    /// \[OURS] Only the counter decides this, and only for a slave that counts its messages. Some slaves always send
    /// the same counter, or other values than the standard defines, and no master refuses that. Whether a message
    /// answers the request is decided by its content.
    fn is_new(&self) -> bool {
        let Ok(message) = MailboxMessage::decode(&self.bytes) else { return !self.is_repeated };
        let counter = message.header.counter;
        self.state(|state| {
            let last = std::mem::replace(&mut state.received, counter);
            if !self.is_repeated {
                state.is_counting = last != MailboxCounter::NONE && !counter.repeats(last);
                return true;
            }
            !(state.is_counting && counter.repeats(last))
        })
    }

    /// Whether the message belongs to the protocol and is no emergency. An emergency becomes an event.
    ///
    /// # Errors
    /// [`MailboxError::WrongAnswer`] if the message is longer than the mailbox, [`MailboxError::Fault`] if it is a
    /// mailbox error of the slave.
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
