//! The SDO slot (SK-6): one transfer at a time, the answer stays until the next one ends.

use super::Reason;
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{Ns, SdoRequest};
use crate::sk::{CommandId, RawSlot, SdoCommand, SdoResponse};

/// A transfer that the host has requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SdoTransfer {
    pub(super) slave: u8,
    pub(super) object: ObjectAddress,
    /// `None`: an upload. `Some`: a download of that size, and the value as it was in Data2.
    pub(super) write: Option<(SdoSize, u32)>,
}

impl SdoTransfer {
    const fn id(&self) -> CommandId {
        match self.write {
            None => CommandId::SdoRead,
            Some(_) => CommandId::SdoWrite,
        }
    }

    /// Slave and object, if it is a download.
    fn written(&self) -> Option<(u8, ObjectAddress)> {
        self.write.map(|_| (self.slave, self.object))
    }
}

/// What happened to a request that was not rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Accepted {
    New,
    /// The same transfer waits or runs already.
    Repeats,
}

/// The SDO slot of the response, and the transfer of the host under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct SdoSlot {
    answer: RawSlot,
    waiting: Option<SdoTransfer>,
    running: Option<SdoTransfer>,
}

impl SdoSlot {
    pub(super) const fn new() -> Self {
        Self { answer: RawSlot::ZERO, waiting: None, running: None }
    }

    /// The SDO slot of the response.
    pub(super) const fn answer(&self) -> &RawSlot {
        &self.answer
    }

    /// Takes a command of the host. SK-6 \[OURS]: a request is rejected while another transfer is under way. A request
    /// that repeats the transfer under way is part of it, since programs that poll send it in every frame.
    pub(super) fn command(&mut self, command: SdoCommand) -> Result<Accepted, Reason> {
        let transfer = match command {
            SdoCommand::Read { slave, object } => SdoTransfer { slave, object, write: None },
            SdoCommand::Write { slave, object, size, value } => {
                SdoTransfer { slave, object, write: Some((size, value)) }
            }
            SdoCommand::GetStatus | SdoCommand::Other(_) => return Ok(Accepted::New),
        };
        match self.waiting.or(self.running) {
            Some(under_way) if under_way == transfer => Ok(Accepted::Repeats),
            Some(_) => Err(Reason::SdoBusy),
            None => {
                self.waiting = Some(transfer);
                Ok(Accepted::New)
            }
        }
    }

    /// The transfer that waits to be started; `None`: none does.
    pub(super) fn waiting(&self, timeout_ns: Ns) -> Option<SdoRequest> {
        let SdoTransfer { slave, object, write } = self.waiting?;
        Some(SdoRequest { slave, object, write: write.map(|(size, value)| (size, value & size.mask())), timeout_ns })
    }

    /// Slave and object of the transfer that waits, if it is a download.
    pub(super) fn waiting_write(&self) -> Option<(u8, ObjectAddress)> {
        self.waiting.as_ref().and_then(SdoTransfer::written)
    }

    /// Slave and object of the transfer under way, if it is a download.
    pub(super) fn running_write(&self) -> Option<(u8, ObjectAddress)> {
        self.running.as_ref().and_then(SdoTransfer::written)
    }

    /// The transfer that waited was started.
    pub(super) fn started(&mut self) {
        self.running = self.waiting.take();
    }

    /// The transfer under way has ended: puts its answer into the slot. Which transfer it was.
    pub(super) fn finish(&mut self, result: Result<u32, AbortCode>) -> Option<SdoTransfer> {
        let transfer = self.running.take()?;
        let (id, slave, object) = (transfer.id(), transfer.slave, transfer.object);
        self.answer = match result {
            // The answer to a download repeats all bytes of Data2 as they were sent, since programs compare them (LIB,
            // habits).
            Ok(read) => {
                let value = transfer.write.map_or(read, |(_, value)| value);
                SdoResponse::Done { id, slave, object, value }.encode()
            }
            Err(code) => SdoResponse::Aborted { id, slave, object, code }.encode(),
        };
        Some(transfer)
    }
}
