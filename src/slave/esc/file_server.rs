//! The FoE server of a slave: one transfer at a time, packet by packet.
//!
//! Source: ETG.1000.6 5.8; rules ECAT-12.

use crate::ethercat::foe::{FOE_OVERHEAD, FoeError, FoeMessage};
use crate::slave::files::{FILE_BYTES_MAX, FileStore};

/// The FoE transfer in progress.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Transfer {
    #[default]
    None,
    /// The master reads a file; packet number `packet` was sent last.
    Read { packet: u32 },
    /// The master writes a file; packet number `packet` is expected next.
    Write { packet: u32 },
}

/// The FoE server of a slave: the transfer in progress, with the name and the bytes of its file.
#[derive(Clone, Debug, Default)]
pub(super) struct FileServer {
    transfer: Transfer,
    name: Vec<u8>,
    bytes: Vec<u8>,
    is_in_bootstrap: bool,
}

/// The number of file bytes that fit into one message of a mailbox of `mailbox` bytes.
fn packet_bytes(mailbox: usize) -> usize {
    mailbox.saturating_sub(FOE_OVERHEAD).max(1)
}

impl FileServer {
    /// Ends the present transfer without a message, because the mailbox restarts. `is_in_bootstrap` says whether it restarts in
    /// bootstrap.
    pub(super) fn reset(&mut self, is_in_bootstrap: bool) {
        self.is_in_bootstrap = is_in_bootstrap;
        self.end();
    }

    fn end(&mut self) {
        self.transfer = Transfer::None;
        // Releases the memory, because a file may be long.
        self.bytes = Vec::new();
    }

    /// Answers a message; `None` if no answer is due. `mailboxes` are the lengths of the request and response mailboxes,
    /// bytes.
    pub(super) fn answer(
        &mut self,
        message: &FoeMessage<'_>,
        mailboxes: (usize, usize),
        files: &mut FileStore,
    ) -> Option<FoeMessage<'_>> {
        let answered = match *message {
            FoeMessage::Read { name, .. } => self.read(name, files).map(Some),
            FoeMessage::Write { name, .. } => self.write(name, files).map(Some),
            FoeMessage::Data { packet, data } => self.take(packet, data, mailboxes.0, files).map(Some),
            FoeMessage::Ack { packet } => return self.acknowledged(packet, mailboxes.1),
            FoeMessage::Error { .. } => {
                self.end();
                Ok(None)
            }
            FoeMessage::Busy { .. } | FoeMessage::Unknown(..) => Err(FoeError::ILLEGAL),
        };
        match answered {
            Ok(None) => None,
            Ok(Some(Sent::Ack(packet))) => Some(FoeMessage::Ack { packet }),
            Ok(Some(Sent::Packet(packet))) => Some(self.packet(packet, mailboxes.1)),
            Err(code) => Some(self.refuse(code)),
        }
    }

    /// Ends the transfer with an error code.
    fn refuse(&mut self, code: FoeError) -> FoeMessage<'_> {
        self.end();
        FoeMessage::Error { code, text: code.text().unwrap_or_default().as_bytes() }
    }

    /// A data packet of the file being read; empty beyond the end of the file.
    fn packet(&self, packet: u32, mailbox: usize) -> FoeMessage<'_> {
        let room = packet_bytes(mailbox);
        let start = (packet as usize - 1).saturating_mul(room).min(self.bytes.len());
        let data = &self.bytes[start..start.saturating_add(room).min(self.bytes.len())];
        FoeMessage::Data { packet, data }
    }

    fn read(&mut self, name: &[u8], files: &FileStore) -> Result<Sent, FoeError> {
        self.end();
        self.bytes = files.read(name, self.is_in_bootstrap)?.to_vec();
        self.transfer = Transfer::Read { packet: 1 };
        Ok(Sent::Packet(1))
    }

    /// Handles the acknowledgement of a packet: returns the next packet, or `None` after the last one.
    fn acknowledged(&mut self, packet: u32, mailbox: usize) -> Option<FoeMessage<'_>> {
        match self.transfer {
            Transfer::Read { packet: sent } if sent == packet => {
                let room = packet_bytes(mailbox);
                if (packet as usize).saturating_mul(room) > self.bytes.len() {
                    self.end();
                    return None;
                }
                self.transfer = Transfer::Read { packet: packet + 1 };
                Some(self.packet(packet + 1, mailbox))
            }
            Transfer::Read { .. } => Some(self.refuse(FoeError::PACKET_NUMBER)),
            _ => Some(self.refuse(FoeError::ILLEGAL)),
        }
    }

    fn write(&mut self, name: &[u8], files: &FileStore) -> Result<Sent, FoeError> {
        self.end();
        files.may_write(name, self.is_in_bootstrap)?;
        self.name.clear();
        self.name.extend_from_slice(name);
        self.transfer = Transfer::Write { packet: 1 };
        Ok(Sent::Ack(0))
    }

    /// Handles a data packet of a file that the master writes. A packet that does not fill the mailbox ends the file; after a
    /// full last packet the master sends an empty one.
    fn take(&mut self, packet: u32, data: &[u8], mailbox: usize, files: &mut FileStore) -> Result<Sent, FoeError> {
        let Transfer::Write { packet: expected } = self.transfer else { return Err(FoeError::ILLEGAL) };
        if packet != expected {
            return Err(FoeError::PACKET_NUMBER);
        }
        if self.bytes.len() + data.len() > FILE_BYTES_MAX {
            return Err(FoeError::DISK_FULL);
        }
        self.bytes.extend_from_slice(data);
        self.transfer = Transfer::Write { packet: packet + 1 };
        if data.len() < packet_bytes(mailbox) {
            files.write(&self.name, self.is_in_bootstrap, &self.bytes)?;
            self.end();
        }
        Ok(Sent::Ack(packet))
    }
}

/// An answer other than an error: a data packet of the file, or an acknowledgement, each with its packet number.
#[derive(Clone, Copy, Debug)]
enum Sent {
    Packet(u32),
    Ack(u32),
}
