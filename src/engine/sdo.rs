//! The SDO slot (SK-6). The board runs one SDO transfer at a time. The slot shows its answer until the next transfer
//! ends. While a transfer waits or runs, the board holds one more request of the host.

use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{Ns, SdoRequest};
use crate::sk::{CommandId, RawSlot, SdoCommand, SdoResponse};

/// An SDO transfer that the host has requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SdoTransfer {
    pub(super) slave: u8,
    pub(super) object: ObjectAddress,
    /// `None`: an upload. `Some`: a download, with its size and all 4 bytes of Data2.
    pub(super) write: Option<(SdoSize, u32)>,
    /// When the host requested the transfer, board time.
    asked_at: Ns,
}

impl SdoTransfer {
    fn of(command: SdoCommand, asked_at: Ns) -> Option<Self> {
        let (slave, object, write) = match command {
            SdoCommand::Read { slave, object } => (slave, object, None),
            SdoCommand::Write { slave, object, size, value } => (slave, object, Some((size, value))),
            SdoCommand::GetStatus | SdoCommand::Other(_) => return None,
        };
        Some(Self { slave, object, write, asked_at })
    }

    /// Whether both requests are identical in every bit, whenever they were sent, so that they count as one transfer.
    fn repeats(&self, other: &Self) -> bool {
        Self { asked_at: other.asked_at, ..*self } == *other
    }

    const fn id(&self) -> CommandId {
        match self.write {
            None => CommandId::SdoRead,
            Some(_) => CommandId::SdoWrite,
        }
    }

    /// The slave and object that the transfer writes; `None`: it is an upload.
    fn written(&self) -> Option<(u8, ObjectAddress)> {
        self.write.map(|_| (self.slave, self.object))
    }
}

/// What the board did with an SDO request of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Accepted {
    New,
    /// The request repeats the host's newest one, which is still waiting or running: both count as one transfer.
    Repeats,
    /// The board holds the request, in place of an older held one: it holds only one, and has dropped the older one
    /// without running it. The id is the command id (SDO_RD or SDO_WR) of the dropped request.
    Replaces(CommandId),
}

/// The SDO slot of the response, and the transfers that the host has requested.
#[derive(Clone, Copy, Debug)]
pub(super) struct SdoSlot {
    answer: RawSlot,
    running: Option<SdoTransfer>,
    /// The request that the bus starts next. It waits while the bus runs another job.
    waiting: Option<SdoTransfer>,
    /// A request that came while another one of the host waited or ran. It runs after that one.
    held: Option<SdoTransfer>,
}

impl SdoSlot {
    pub(super) const fn new() -> Self {
        Self { answer: RawSlot::ZERO, running: None, waiting: None, held: None }
    }

    /// The content of the SDO slot of the response.
    pub(super) const fn answer(&self) -> &RawSlot {
        &self.answer
    }

    /// Takes an SDO command of the host. SK-6 \[OURS]: if a request comes while another one waits or runs, the board
    /// holds it and runs it next, since a client library writes two objects within a millisecond and does not wait for
    /// answers. The board holds only one request: a third one replaces it. A request that repeats the newest one counts
    /// as the same transfer, since programs that poll send it in every frame.
    pub(super) fn command(&mut self, command: SdoCommand, at: Ns) -> Accepted {
        let Some(transfer) = SdoTransfer::of(command, at) else { return Accepted::New };
        let newest = self.held.or(self.waiting).or(self.running);
        if newest.is_some_and(|newest| transfer.repeats(&newest)) {
            return Accepted::Repeats;
        }
        if newest.is_none() {
            self.waiting = Some(transfer);
            return Accepted::New;
        }
        self.held.replace(transfer).map_or(Accepted::New, |replaced| Accepted::Replaces(replaced.id()))
    }

    /// Whether a transfer is waiting that the host has requested at the time `by` or earlier.
    pub(super) fn waits_since(&self, by: Ns) -> bool {
        self.waiting.is_some_and(|transfer| transfer.asked_at <= by)
    }

    /// The transfer that waits until the bus can start it; `None`: no transfer waits. `timeout_ns`: how long the slave
    /// may take to answer.
    pub(super) fn waiting(&self, timeout_ns: Ns) -> Option<SdoRequest> {
        let SdoTransfer { slave, object, write, .. } = self.waiting?;
        Some(SdoRequest { slave, object, write: write.map(|(size, value)| (size, value & size.mask())), timeout_ns })
    }

    /// Slave and object of the waiting transfer, if it is a download.
    pub(super) fn waiting_write(&self) -> Option<(u8, ObjectAddress)> {
        self.waiting.as_ref().and_then(SdoTransfer::written)
    }

    /// Slave and object of the running transfer, if it is a download.
    pub(super) fn running_write(&self) -> Option<(u8, ObjectAddress)> {
        self.running.as_ref().and_then(SdoTransfer::written)
    }

    /// Called when the bus has started the waiting transfer.
    pub(super) fn started(&mut self) {
        self.running = self.waiting.take();
    }

    /// Called when the running transfer has ended: puts its answer into the SDO slot. Returns the transfer.
    pub(super) fn finish(&mut self, result: Result<u32, AbortCode>) -> Option<SdoTransfer> {
        let transfer = self.running.take()?;
        self.waiting = self.held.take();
        let (id, slave, object) = (transfer.id(), transfer.slave, transfer.object);
        self.answer = match result {
            // The answer to a download repeats all bytes of Data2 as the host sent them: programs wait until Data2 of
            // the answer equals Data2 of their request (LIB-24).
            Ok(read) => {
                let value = transfer.write.map_or(read, |(_, value)| value);
                SdoResponse::Done { id, slave, object, value }.encode()
            }
            Err(code) => SdoResponse::Aborted { id, slave, object, code }.encode(),
        };
        Some(transfer)
    }
}
