//! SDO transfers of values of any length: expedited, normal or segmented, of one sub-index or with complete access.

use crate::ethercat::Ns;
use crate::ethercat::coe::{
    AbortCode, CoeMessage, FIRST_OVERHEAD, ObjectAddress, SEGMENT_OVERHEAD, SdoRequest, SdoResponse, SdoScope,
    SdoValuePart,
};
use crate::ethercat::mailbox::{MAILBOX_HEADER_LEN, MailboxProtocol};
use crate::ethercat::sii::MailboxProtocols;
use crate::master::bus::Bus;
use crate::master::handle::{End, Ending};
use crate::master::mailbox::{Mailbox, MailboxError, Peer};

/// \[OURS] The longest value, answer of SDO information, or file that the master reads, bytes.
pub const VALUE_BYTES_MAX: usize = 0x10_0000;

/// The most bytes of a value for which [`NumberTransfer`] needs no allocation: the value is then kept as a number.
const NUMBER_BYTES: usize = 4;

/// The least bytes of data in a segment other than the last one (ETG.1000.6 5.6.2).
const SEGMENT_BYTES_MIN: usize = 7;

/// Why an SDO transfer has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SdoError {
    /// The slave or the master has aborted the transfer.
    #[error("aborted with {0}")]
    Abort(AbortCode),
    /// The slave has not answered, or the request could not be sent; the mailbox error says why.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
}

impl SdoError {
    /// The abort code for this error; [`AbortCode::TIMEOUT`] if the slave has not answered.
    pub const fn abort_code(self) -> AbortCode {
        match self {
            Self::Abort(code) => code,
            Self::Mailbox(MailboxError::WrongAnswer) => AbortCode::COMMAND,
            Self::Mailbox(MailboxError::Fault(_) | MailboxError::NoMailbox | MailboxError::TooLong) => {
                AbortCode::UNSUPPORTED_ACCESS
            }
            Self::Mailbox(_) => AbortCode::TIMEOUT,
        }
    }
}

/// A running SDO transfer of one object of a slave.
pub(super) struct Sdo {
    mailbox: Mailbox,
    object: ObjectAddress,
    /// How long the slave may take for each answer.
    timeout_ns: Ns,
}

impl Sdo {
    async fn open(bus: Bus, peer: Peer, object: ObjectAddress) -> Result<Self, MailboxError> {
        let mailbox = peer.open(bus, MailboxProtocols::COE).await?;
        Ok(Self { mailbox, object, timeout_ns: peer.timeout_ns })
    }

    async fn send(&mut self, request: SdoRequest<'_>) -> Result<Ns, SdoError> {
        let until = self.mailbox.now().saturating_add(self.timeout_ns);
        let encode = |room: &mut [u8]| CoeMessage::SdoRequest(request).encode(room).ok();
        self.mailbox.send(MailboxProtocol::Coe, until, encode).await?;
        Ok(until)
    }

    /// Sends a request and returns what `take` makes of the answer. `take` returns an abort code for a message that
    /// does not answer the request. Such a message is dropped if it may answer an abandoned request; otherwise it ends
    /// the transfer.
    async fn ask<R>(
        &mut self,
        request: SdoRequest<'_>,
        mut take: impl FnMut(SdoResponse<'_>) -> Result<R, AbortCode>,
    ) -> Result<R, SdoError> {
        let until = self.send(request).await?;
        loop {
            let data = match self.mailbox.receive(MailboxProtocol::Coe, until).await {
                Ok(data) => data,
                Err(MailboxError::TimeUp) => {
                    self.give_up(AbortCode::TIMEOUT).await;
                    return Err(MailboxError::TimeUp.into());
                }
                Err(error) => return Err(error.into()),
            };
            let wrong = match CoeMessage::decode(data) {
                Ok(CoeMessage::SdoRequest(SdoRequest::Abort { object, code })) => {
                    if self.is_for_this(object) {
                        return Err(SdoError::Abort(code));
                    }
                    continue;
                }
                Ok(CoeMessage::SdoResponse(response)) => {
                    if let Some((object, code)) = abort_in(response) {
                        if self.is_for_this(object) {
                            return Err(SdoError::Abort(code));
                        }
                        continue;
                    }
                    match take(response) {
                        Ok(taken) => {
                            self.mailbox.settle();
                            return Ok(taken);
                        }
                        Err(code) => code,
                    }
                }
                // An unsolicited message is skipped.
                Ok(_) => continue,
                Err(_) => AbortCode::LENGTH,
            };
            if !self.mailbox.leaves_out() {
                return self.fail(wrong).await;
            }
        }
    }

    /// Whether an abort belongs to this transfer. An abort of another object may answer a request that was given up. If
    /// no such answer is expected, the abort counts for this transfer: some slaves abort segments with object 0x0000:0,
    /// against the standard.
    fn is_for_this(&mut self, object: ObjectAddress) -> bool {
        object == self.object || !self.mailbox.leaves_out()
    }

    /// Tells the slave that the transfer is aborted.
    async fn give_up(&mut self, code: AbortCode) {
        // The transfer has ended even if the slave does not receive this.
        let _ = self.send(SdoRequest::Abort { object: self.object, code }).await;
        self.mailbox.wants_no_answer();
    }

    async fn fail<R>(&mut self, code: AbortCode) -> Result<R, SdoError> {
        self.give_up(code).await;
        Err(SdoError::Abort(code))
    }

    /// The most bytes of a value in a message; `overhead`: bytes of the message that are not part of a value.
    const fn room(&self, overhead: usize) -> usize {
        (self.mailbox.room() + MAILBOX_HEADER_LEN).saturating_sub(overhead)
    }
}

/// The object and code of an abort in a response: some slaves send an abort with the mailbox service of responses.
fn abort_in(response: SdoResponse<'_>) -> Option<(ObjectAddress, AbortCode)> {
    let SdoResponse::Unknown(command, rest) = response else { return None };
    let mut whole = [command, 0, 0, 0, 0, 0, 0, 0];
    whole[1..].copy_from_slice(rest.first_chunk::<7>()?);
    match SdoRequest::decode(&whole) {
        Ok(SdoRequest::Abort { object, code }) => Some((object, code)),
        _ => None,
    }
}

/// A receiver of an uploaded value.
pub(super) trait Value: Default {
    /// Prepares for a value of `len` bytes.
    fn reserve(&mut self, len: usize);
    /// Appends bytes to the value.
    fn extend(&mut self, bytes: &[u8]);
    /// The number of bytes received so far.
    fn len(&self) -> usize;
}

impl Value for Vec<u8> {
    fn reserve(&mut self, len: usize) {
        self.reserve_exact(len);
    }

    fn extend(&mut self, bytes: &[u8]) {
        self.extend_from_slice(bytes);
    }

    fn len(&self) -> usize {
        self.len()
    }
}

/// A received value of which only the first 4 bytes are kept.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Beginning {
    bytes: [u8; NUMBER_BYTES],
    len: usize,
}

impl Value for Beginning {
    fn reserve(&mut self, _: usize) {}

    fn extend(&mut self, bytes: &[u8]) {
        self.bytes.iter_mut().skip(self.len).zip(bytes).for_each(|(to, byte)| *to = *byte);
        self.len += bytes.len();
    }

    fn len(&self) -> usize {
        self.len
    }
}

/// The transfer of a value of up to 4 bytes, which allocates nothing.
pub(in crate::master) enum NumberTransfer {
    /// Upload of an object of any length, of which the first 4 bytes are kept.
    Upload,
    /// Download of the first bytes of the array; the second field is their number.
    Download([u8; NUMBER_BYTES], usize),
}

impl NumberTransfer {
    /// The download of a value; `None`: the value has more than 4 bytes.
    pub(super) fn download(value: &[u8]) -> Option<Self> {
        let mut bytes = [0; NUMBER_BYTES];
        bytes.get_mut(..value.len())?.copy_from_slice(value);
        Some(Self::Download(bytes, value.len()))
    }

    pub(in crate::master) async fn run(self, bus: Bus, peer: Peer, object: ObjectAddress, scope: SdoScope) -> End {
        match self {
            Self::Upload => {
                let beginning = upload(bus, peer, object, scope).await;
                beginning.map(|Beginning { bytes, .. }| u32::from_le_bytes(bytes)).into_end()
            }
            Self::Download(bytes, len) => download(bus, peer, object, scope, &bytes[..len]).await.into_end(),
        }
    }
}

/// Uploads an object. It is an error if the size of the value is above [`VALUE_BYTES_MAX`], or if bytes of it are
/// missing.
pub(super) async fn upload<V: Value>(
    bus: Bus,
    peer: Peer,
    object: ObjectAddress,
    scope: SdoScope,
) -> Result<V, SdoError> {
    let mut sdo = Sdo::open(bus, peer, object).await?;
    let mut value = V::default();
    let size = sdo
        .ask(SdoRequest::Upload { object, scope }, |response| {
            let SdoResponse::Upload { object: other, value: part, .. } = response else {
                return Err(AbortCode::COMMAND);
            };
            let (size, data) = match part {
                _ if other != object => return Err(AbortCode::COMMAND),
                SdoValuePart::Expedited(data) => (data.len(), data),
                SdoValuePart::Unsized(four) => (four.len(), &four[..]),
                // Bytes after the value in its message have no meaning.
                SdoValuePart::First { size, data } => {
                    let size = usize::try_from(size).unwrap_or(usize::MAX);
                    (size, &data[..data.len().min(size)])
                }
            };
            value.reserve(size.min(VALUE_BYTES_MAX));
            value.extend(data);
            Ok(size)
        })
        .await?;
    if size > VALUE_BYTES_MAX {
        return sdo.fail(AbortCode::OUT_OF_MEMORY).await;
    }
    let mut toggle = false;
    while value.len() < size {
        let before = value.len();
        let is_last = sdo
            .ask(SdoRequest::UploadSegment { toggle }, |response| match response {
                SdoResponse::UploadSegment { toggle: other, last, data } if other == toggle => {
                    let room = size - value.len();
                    value.extend(&data[..data.len().min(room)]);
                    Ok(if data.len() > room { Err(AbortCode::TOO_LONG) } else { Ok(last) })
                }
                SdoResponse::UploadSegment { .. } => Err(AbortCode::TOGGLE_BIT),
                _ => Err(AbortCode::COMMAND),
            })
            .await?;
        match is_last {
            Ok(true) => break,
            // Every segment but the last one must have at least [`SEGMENT_BYTES_MIN`] bytes: otherwise the transfer
            // might never end.
            Ok(false) if value.len() - before >= SEGMENT_BYTES_MIN => {}
            Ok(false) => return sdo.fail(AbortCode::COMMAND).await,
            Err(code) => return sdo.fail(code).await,
        }
        toggle = !toggle;
    }
    if value.len() < size {
        return Err(SdoError::Abort(AbortCode::TOO_SHORT));
    }
    Ok(value)
}

/// Downloads a value of any length to an object: expedited, or in as many segments as the mailbox requires.
pub(super) async fn download(
    bus: Bus,
    peer: Peer,
    object: ObjectAddress,
    scope: SdoScope,
    value: &[u8],
) -> Result<(), SdoError> {
    let mut sdo = Sdo::open(bus, peer, object).await?;
    let first = value.len().min(sdo.room(FIRST_OVERHEAD));
    let (part, sent) = match value.len() {
        1..=4 => (SdoValuePart::Expedited(value), value.len()),
        len => (SdoValuePart::First { size: u32::try_from(len).unwrap_or(u32::MAX), data: &value[..first] }, first),
    };
    sdo.ask(SdoRequest::Download { object, scope, value: part }, |response| match response {
        SdoResponse::Download { object: other, .. } if other == object => Ok(()),
        _ => Err(AbortCode::COMMAND),
    })
    .await?;
    let room = sdo.room(SEGMENT_OVERHEAD).max(1);
    let (mut toggle, count) = (false, value[sent..].chunks(room).len());
    for (n, data) in value[sent..].chunks(room).enumerate() {
        let last = n + 1 == count;
        sdo.ask(SdoRequest::DownloadSegment { toggle, last, data }, |response| match response {
            SdoResponse::DownloadSegment { toggle: other } if other == toggle => Ok(()),
            SdoResponse::DownloadSegment { .. } => Err(AbortCode::TOGGLE_BIT),
            _ => Err(AbortCode::COMMAND),
        })
        .await?;
        toggle = !toggle;
    }
    Ok(())
}
