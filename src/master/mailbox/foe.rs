//! Files by FoE: each packet has an acknowledgement, and a packet that does not fill the mailbox ends the file.

use super::coe::VALUE_BYTES_MAX;
use super::{Mailbox, MailboxError, Peer};
use crate::ethercat::Ns;
use crate::ethercat::foe::{FOE_OVERHEAD, FoeError, FoeMessage};
use crate::ethercat::mailbox::{MAILBOX_HEADER_LEN, MailboxProtocol};
use crate::ethercat::sii::MailboxProtocols;
use crate::master::bus::Bus;
use crate::master::{Job, Master};

/// \[OURS] How long the master waits before it sends a packet again that a slave has answered with busy.
const BUSY_NS: Ns = 10_000_000;
/// \[OURS] How often a slave may answer one packet with busy.
const BUSY_MAX: u32 = 6_000;

/// Why a file was not read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FileError {
    /// The slave or the master has ended the transfer with an FoE error.
    #[error("ended with error {0}")]
    File(FoeError),
    /// The slave has not answered, or the request could not be sent; the mailbox error says why.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
}

impl Master {
    /// Starts to read a file of at most [`VALUE_BYTES_MAX`] bytes. `password`: 0, or the one
    /// that the slave requires. `timeout_ns`: how long the slave may take for each packet.
    pub fn read_file(
        &mut self,
        slave: u8,
        name: &[u8],
        password: u32,
        timeout_ns: Ns,
    ) -> Job<Result<Vec<u8>, FileError>> {
        let (bus, peer, name) = (self.bus.clone(), self.peer(slave, timeout_ns), name.to_vec());
        self.start(async move { read(bus, peer, &name, password).await })
    }

    /// Starts to write a file. `password`: 0, or the one that the slave requires. `timeout_ns`: how long the slave may
    /// take for each packet.
    pub fn write_file(
        &mut self,
        slave: u8,
        name: &[u8],
        password: u32,
        content: &[u8],
        timeout_ns: Ns,
    ) -> Job<Result<(), FileError>> {
        let (bus, peer) = (self.bus.clone(), self.peer(slave, timeout_ns));
        let (name, content) = (name.to_vec(), content.to_vec());
        self.start(async move { write(bus, peer, &name, password, &content).await })
    }
}

/// A running FoE transfer, with exclusive access to the mailbox, and the timeout of each answer.
struct Transfer {
    mailbox: Mailbox,
    timeout_ns: Ns,
}

/// The answer of a slave to a packet.
enum Answer {
    /// The slave has acknowledged the packet.
    Taken,
    /// The slave has sent the requested packet, whose data were appended to the content. `is_last`: it ends the file.
    Data { is_last: bool },
}

impl Transfer {
    async fn open(bus: Bus, peer: Peer) -> Result<Self, MailboxError> {
        let mailbox = peer.open(bus, MailboxProtocols::FOE).await?;
        Ok(Self { mailbox, timeout_ns: peer.timeout_ns })
    }

    /// Sends a message, and repeats it while the slave is busy. Returns when the slave acknowledges packet number
    /// `packet`, or sends the packet with that number.
    async fn ask(&mut self, message: FoeMessage<'_>, packet: u32, content: &mut Vec<u8>) -> Result<Answer, FileError> {
        for _ in 0..BUSY_MAX {
            let until = self.mailbox.now().saturating_add(self.timeout_ns);
            self.mailbox.send(MailboxProtocol::Foe, until, |room| message.encode(room).ok()).await?;
            let until = self.mailbox.now().saturating_add(self.timeout_ns);
            loop {
                let room = self.mailbox.answer_len().saturating_sub(FOE_OVERHEAD);
                let data = self.mailbox.receive(MailboxProtocol::Foe, until).await?;
                let wrong = match FoeMessage::decode(data).map_err(|_| MailboxError::WrongAnswer)? {
                    FoeMessage::Ack { packet: other } if other == packet => return Ok(Answer::Taken),
                    FoeMessage::Data { packet: other, data } if other == packet => {
                        content.extend_from_slice(data);
                        return Ok(Answer::Data { is_last: data.len() < room });
                    }
                    FoeMessage::Error { code, .. } => return Err(FileError::File(code)),
                    FoeMessage::Busy { .. } => break,
                    FoeMessage::Ack { .. } | FoeMessage::Data { .. } => FoeError::PACKET_NUMBER,
                    _ => FoeError::ILLEGAL,
                };
                // A repeated older message is no answer to this one, so it is skipped.
                if !self.mailbox.leaves_out() {
                    return self.fail(wrong).await;
                }
            }
            self.mailbox.pause(BUSY_NS).await;
        }
        Err(MailboxError::TimeUp.into())
    }

    async fn say(&mut self, message: FoeMessage<'_>) -> Result<(), MailboxError> {
        let until = self.mailbox.now().saturating_add(self.timeout_ns);
        self.mailbox.send(MailboxProtocol::Foe, until, |room| message.encode(room).ok()).await
    }

    async fn fail<R>(&mut self, code: FoeError) -> Result<R, FileError> {
        // The transfer has ended even if the slave does not receive this.
        let _ = self.say(FoeMessage::Error { code, text: &[] }).await;
        self.mailbox.wants_no_answer();
        Err(FileError::File(code))
    }
}

/// Reads a file packet by packet; a packet that does not fill the mailbox is the last one. A file of more than
/// [`VALUE_BYTES_MAX`] bytes is an error.
async fn read(bus: Bus, peer: Peer, name: &[u8], password: u32) -> Result<Vec<u8>, FileError> {
    let mut transfer = Transfer::open(bus, peer).await?;
    let mut content = Vec::new();
    let mut answer = transfer.ask(FoeMessage::Read { password, name }, 1, &mut content).await?;
    let mut packet = 1;
    loop {
        match answer {
            Answer::Taken => return transfer.fail(FoeError::ILLEGAL).await,
            Answer::Data { is_last: true } => {
                transfer.say(FoeMessage::Ack { packet }).await?;
                transfer.mailbox.wants_no_answer();
                return Ok(content);
            }
            Answer::Data { is_last: false } if content.len() > VALUE_BYTES_MAX => {
                return transfer.fail(FoeError::DISK_FULL).await;
            }
            Answer::Data { is_last: false } => {}
        }
        answer = transfer.ask(FoeMessage::Ack { packet }, packet + 1, &mut content).await?;
        packet += 1;
    }
}

/// Writes a file packet by packet. The last packet has fewer bytes than fit, and may be empty.
async fn write(bus: Bus, peer: Peer, name: &[u8], password: u32, content: &[u8]) -> Result<(), FileError> {
    let mut transfer = Transfer::open(bus, peer).await?;
    let room = (transfer.mailbox.room() + MAILBOX_HEADER_LEN).saturating_sub(FOE_OVERHEAD).max(1);
    let mut unused = Vec::new();
    let mut answer = transfer.ask(FoeMessage::Write { password, name }, 0, &mut unused).await?;
    let mut rest = content;
    for packet in 1.. {
        if matches!(answer, Answer::Data { .. }) {
            return transfer.fail(FoeError::ILLEGAL).await;
        }
        let (data, behind) = rest.split_at(rest.len().min(room));
        answer = transfer.ask(FoeMessage::Data { packet, data }, packet, &mut unused).await?;
        if data.len() < room {
            break;
        }
        rest = behind;
    }
    if matches!(answer, Answer::Data { .. }) { transfer.fail(FoeError::ILLEGAL).await } else { Ok(()) }
}
