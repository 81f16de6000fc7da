//! The mailbox of a slave: it takes requests from sync manager 0, puts responses into sync manager 1, and repeats the last
//! response on request of the master.

use super::file_server::FileServer;
use super::information::Information;
use super::managers::{ManagerEvents, Managers};
use super::memory::Memory;
use super::sdo_server::{SdoAnswer, SdoServer};
use crate::ethercat::coe::{CoeMessage, Emergency, SdoRequest};
use crate::ethercat::foe::FoeMessage;
use crate::ethercat::mailbox::{
    MAILBOX_HEADER_LEN, MailboxCounter, MailboxFault, MailboxHeader, MailboxMessage, MailboxProtocol, encode_around,
};
use crate::ethercat::registers::{SmActivate, SmPdiControl, SmStatus};
use crate::ethercat::{Ns, WireError, registers::SyncManager};
use crate::slave::Slave;

/// The number of the sync manager for requests of the master.
pub(super) const REQUESTS: u8 = 0;
/// The number of the sync manager for responses of the slave.
pub(super) const ANSWERS: u8 = 1;
/// \[OURS] The maximum number of pending emergencies; further ones are lost.
pub const EMERGENCIES_MAX: usize = 8;

/// A buffer for one message that is kept for reuse. `is_used` says whether the message is still needed.
#[derive(Clone, Debug, Default)]
struct Slot {
    bytes: Vec<u8>,
    is_used: bool,
}

impl Slot {
    fn keep(&mut self, bytes: &[u8]) {
        self.bytes.clear();
        self.bytes.extend_from_slice(bytes);
        self.is_used = true;
    }
}

/// The mailbox of a slave: its message counters, the messages that wait or are in sync manager 1, and the servers that answer
/// requests.
#[derive(Clone, Debug, Default)]
pub(super) struct Mailbox {
    /// The message counter of the last request.
    last_request: MailboxCounter,
    /// The message counter of the last response.
    counter: MailboxCounter,
    request: Vec<u8>,
    /// A response that is not in sync manager 1 yet.
    answer: Slot,
    /// The earliest time for putting the response `answer` into sync manager 1.
    answer_due: Ns,
    /// An additional delay of SDO responses, ns.
    sdo_delay_ns: Ns,
    now: Ns,
    /// A response that was in sync manager 1 when the master requested a repeat. It is posted again after the repeated
    /// message.
    put_back: Slot,
    /// The message that was put into sync manager 1 last.
    posted: Vec<u8>,
    /// Whether the message in sync manager 1 is the last read message, posted again because the master requested a repeat.
    is_repeat: bool,
    /// The last message that the master has read.
    read: Slot,
    emergencies: [Emergency; EMERGENCIES_MAX],
    emergencies_waiting: usize,
    sdo: SdoServer,
    information: Information,
    files: FileServer,
    /// Whether the slave is in bootstrap, where only FoE is served.
    is_in_bootstrap: bool,
    /// Whether the message counters and the last read message survive Init. Some devices keep them, which masters have to cope
    /// with.
    remembers: bool,
}

impl Mailbox {
    /// Restarts the mailbox, because the slave has entered PreOP or bootstrap. `requests` and `answers` are the lengths of
    /// the sync managers, bytes.
    pub(super) fn reset(&mut self, requests: usize, answers: usize, is_in_bootstrap: bool) {
        for (bytes, len) in [
            (&mut self.request, requests),
            (&mut self.answer.bytes, answers),
            (&mut self.put_back.bytes, answers),
            (&mut self.posted, answers),
        ] {
            bytes.clear();
            bytes.reserve(len);
        }
        (self.answer.is_used, self.put_back.is_used) = (false, false);
        if !self.remembers {
            self.read.is_used = false;
            self.read.bytes.clear();
            self.read.bytes.reserve(answers);
            (self.last_request, self.counter) = (MailboxCounter::NONE, MailboxCounter::NONE);
        }
        (self.is_repeat, self.emergencies_waiting, self.answer_due) = (false, 0, 0);
        self.sdo.reset();
        self.information.reset();
        self.files.reset(is_in_bootstrap);
        self.is_in_bootstrap = is_in_bootstrap;
    }

    /// Makes the message counters and the last read message survive Init from now on, as in some devices. Sets both counters to
    /// `last_request` and the message to `read`, as if a previous master had exchanged them.
    pub(super) fn remember(&mut self, last_request: MailboxCounter, read: &[u8]) {
        (self.remembers, self.last_request, self.counter) = (true, last_request, last_request);
        self.read.keep(read);
    }

    /// Handles a loss of power: message counters and the last read message no longer survive Init.
    pub(super) fn forget(&mut self) {
        self.remembers = false;
    }

    /// Delays the responses to SDO requests by `ns`, from the next request on; 0 ends the delay.
    pub(super) const fn delay_sdo(&mut self, ns: Ns) {
        self.sdo_delay_ns = ns;
    }

    /// Queues an emergency for an error that has occurred or was cleared. If [`EMERGENCIES_MAX`] are pending, the new
    /// one is lost.
    pub(super) fn raise(&mut self, emergency: Emergency) {
        if let Some(place) = self.emergencies.get_mut(self.emergencies_waiting) {
            *place = emergency;
            self.emergencies_waiting += 1;
        }
    }

    /// Whether [`Self::serve`] has something to do: since its last call the network has accessed a sync manager of the
    /// mailbox (`done`), or a message is waiting to be put into sync manager 1.
    pub(super) const fn is_touched(&self, done: ManagerEvents) -> bool {
        const BOTH: u16 = 1 << REQUESTS | 1 << ANSWERS;
        (done.written | done.read | done.activated) & BOTH != 0
            || self.answer.is_used
            || self.put_back.is_used
            || self.emergencies_waiting > 0
            || self.information.is_waiting()
    }

    /// Serves the mailbox after a frame: repeats a message, handles requests, and posts responses.
    pub(super) fn serve(
        &mut self,
        now: Ns,
        done: ManagerEvents,
        managers: &mut Managers,
        memory: &mut Memory,
        device: &mut dyn Slave,
    ) {
        self.now = now;
        if done.read & 1 << ANSWERS != 0 {
            let posted = std::mem::take(&mut self.posted);
            self.read.keep(&posted);
            self.posted = posted;
        }
        self.repeat(managers, memory);
        // Two rounds: the first one may post a response that was waiting, so that the second one can process the next request.
        for _ in 0..2 {
            self.take_request(managers, memory, device);
            self.post(managers, memory);
        }
    }

    /// Puts the last read message into sync manager 1 again if the master requests a repeat.
    fn repeat(&mut self, managers: &mut Managers, memory: &mut Memory) {
        let SyncManager { activate, pdi, .. } = managers.registers(ANSWERS);
        let asked = activate.contains(SmActivate::REPEAT) != pdi.contains(SmPdiControl::REPEAT_ACKNOWLEDGE);
        if !asked {
            return;
        }
        if let Some(newer) = managers.take_back(ANSWERS, memory)
            && !self.is_repeat
        {
            self.put_back.keep(newer);
        }
        if self.read.is_used && managers.put(ANSWERS, &self.read.bytes, memory) {
            self.posted.clone_from(&self.read.bytes);
            self.is_repeat = true;
        }
        managers.acknowledge_repeat(ANSWERS, memory);
    }

    fn take_request(&mut self, managers: &mut Managers, memory: &mut Memory, device: &mut dyn Slave) {
        // Only one request is processed at a time.
        let is_busy = self.answer.is_used || self.information.is_waiting();
        if is_busy || !managers.registers(REQUESTS).status.contains(SmStatus::FULL) {
            return;
        }
        let Some(bytes) = managers.take(REQUESTS, memory) else { return };
        let mut request = std::mem::take(&mut self.request);
        request.clear();
        request.extend_from_slice(bytes);
        let room = usize::from(managers.registers(ANSWERS).len);
        self.handle(&request, room, device);
        self.request = request;
    }

    fn handle(&mut self, request: &[u8], room: usize, device: &mut dyn Slave) {
        self.answer_due = self.now;
        let message = match MailboxMessage::decode(request) {
            Ok(message) => message,
            // The length in the header exceeds the mailbox.
            Err(_) => return self.answer_fault(MailboxFault::INVALID_SIZE, room),
        };
        if message.header.counter.repeats(self.last_request) {
            return;
        }
        self.last_request = message.header.counter;
        match message.header.protocol {
            MailboxProtocol::Coe if !self.is_in_bootstrap => self.handle_coe(message.data, room, device),
            MailboxProtocol::Foe => self.handle_foe(message.data, (request.len(), room), device),
            MailboxProtocol::Error => {}
            _ => self.answer_fault(MailboxFault::UNSUPPORTED_PROTOCOL, room),
        }
    }

    fn handle_coe(&mut self, data: &[u8], room: usize, device: &mut dyn Slave) {
        let request = match CoeMessage::decode(data) {
            Ok(request) => request,
            Err(_) => return self.answer_fault(MailboxFault::TOO_SHORT, room),
        };
        match request {
            CoeMessage::SdoRequest(request) => {
                self.answer_due = self.now.saturating_add(self.sdo_delay_ns);
                let mut sdo = std::mem::take(&mut self.sdo);
                match sdo.answer(request, room, device) {
                    SdoAnswer::Response(response) => self.answer_coe(CoeMessage::SdoResponse(response), room),
                    SdoAnswer::Abort(object, code) => {
                        self.answer_coe(CoeMessage::SdoRequest(SdoRequest::Abort { object, code }), room);
                    }
                    SdoAnswer::None => {}
                }
                self.sdo = sdo;
            }
            CoeMessage::Information(question) => {
                if self.information.ask(question, device).is_err() {
                    self.answer_fault(MailboxFault::TOO_SHORT, room);
                }
            }
            // Messages that only slaves send, and services that simulated slaves do not support.
            _ => self.answer_fault(MailboxFault::SERVICE_UNSUPPORTED, room),
        }
    }

    fn handle_foe(&mut self, data: &[u8], mailboxes: (usize, usize), device: &mut dyn Slave) {
        let Some(store) = device.files() else {
            return self.answer_fault(MailboxFault::UNSUPPORTED_PROTOCOL, mailboxes.1);
        };
        let Ok(message) = FoeMessage::decode(data) else {
            return self.answer_fault(MailboxFault::TOO_SHORT, mailboxes.1);
        };
        let mut files = std::mem::take(&mut self.files);
        if let Some(answer) = files.answer(&message, mailboxes, store) {
            self.write_answer(MailboxProtocol::Foe, mailboxes.1, |place| answer.encode(place));
        }
        self.files = files;
    }

    fn next_header(&mut self, protocol: MailboxProtocol) -> MailboxHeader {
        self.counter = self.counter.next();
        MailboxHeader::new(protocol, self.counter)
    }

    fn answer_fault(&mut self, fault: MailboxFault, room: usize) {
        self.write_answer(MailboxProtocol::Error, room, |place| {
            let len = MailboxFault::LEN.min(place.len());
            place[..len].copy_from_slice(&fault.encode()[..len]);
            Ok(len)
        });
    }

    fn answer_coe(&mut self, message: CoeMessage<'_>, room: usize) {
        self.write_answer(MailboxProtocol::Coe, room, |place| message.encode(place));
    }

    /// Writes a response, padded to the length of the mailbox. A response that does not fit is dropped; masters cannot
    /// configure such a small mailbox.
    fn write_answer(
        &mut self,
        protocol: MailboxProtocol,
        room: usize,
        encode: impl FnOnce(&mut [u8]) -> Result<usize, WireError>,
    ) {
        let header = self.next_header(protocol);
        let bytes = &mut self.answer.bytes;
        bytes.clear();
        bytes.resize(room, 0);
        let written = bytes.get_mut(MAILBOX_HEADER_LEN..).map(encode);
        self.answer.is_used = matches!(written, Some(Ok(len)) if encode_around(header, len, bytes).is_ok());
    }

    /// Puts the next waiting message into sync manager 1, if the master has read the previous one.
    fn post(&mut self, managers: &mut Managers, memory: &mut Memory) {
        let manager = managers.registers(ANSWERS);
        if !manager.is_enabled() || manager.status.contains(SmStatus::FULL) {
            return;
        }
        let room = usize::from(manager.len);
        if self.put_back.is_used {
            std::mem::swap(&mut self.posted, &mut self.put_back.bytes);
            self.put_back.is_used = false;
        } else {
            if !self.answer.is_used {
                self.write_waiting(room);
            }
            if self.now < self.answer_due || !std::mem::take(&mut self.answer.is_used) {
                return;
            }
            std::mem::swap(&mut self.posted, &mut self.answer.bytes);
        }
        self.is_repeat = false;
        managers.put(ANSWERS, &self.posted, memory);
    }

    /// Encodes the next pending SDO information fragment or emergency.
    fn write_waiting(&mut self, room: usize) {
        let mut information = std::mem::take(&mut self.information);
        if let Some(fragment) = information.next(room) {
            self.answer_coe(CoeMessage::Information(fragment), room);
        } else if self.emergencies_waiting > 0 {
            let emergency = self.emergencies[0];
            self.emergencies.rotate_left(1);
            self.emergencies_waiting -= 1;
            self.answer_coe(CoeMessage::Emergency(emergency), room);
        }
        self.information = information;
    }
}
