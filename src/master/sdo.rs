//! SDO transfers: values of any length, expedited, normal or in segments, one sub-index or all.

use super::MailboxInfo;
use super::bus::Bus;
use super::mailbox::{Mailbox, MailboxError};
use crate::coe::{
    AbortCode, CoeMessage, FIRST_OVERHEAD, ObjectAddress, SEGMENT_OVERHEAD, SdoRequest, SdoResponse, SdoScope,
    SdoValuePart,
};
use crate::ethercat::Ns;
use crate::ethercat::mailbox::{MAILBOX_HEADER_LEN, MailboxProtocol};
use crate::ethercat::sii::MailboxProtocols;

/// \[OURS] The longest value that is read, bytes.
pub const VALUE_BYTES_MAX: usize = 0x10_0000;

/// Why a transfer has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SdoError {
    /// The slave, or the master, has aborted it.
    #[error("aborted with {0}")]
    Abort(AbortCode),
    /// There was no answer.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
}

impl SdoError {
    /// The abort code that says the same; [`AbortCode::TIMEOUT`] where there was no answer.
    pub const fn abort_code(self) -> AbortCode {
        match self {
            Self::Abort(code) => code,
            Self::Mailbox(MailboxError::WrongAnswer) => AbortCode::COMMAND,
            Self::Mailbox(MailboxError::Fault(_) | MailboxError::NoMailbox) => AbortCode::UNSUPPORTED_ACCESS,
            Self::Mailbox(_) => AbortCode::TIMEOUT,
        }
    }
}

/// A transfer: of which slave and object.
pub(super) struct Sdo {
    mailbox: Mailbox,
    object: ObjectAddress,
    scope: SdoScope,
    /// How long the slave may take for each answer.
    timeout_ns: Ns,
}

/// What a transfer is about.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target {
    pub(super) slave: u8,
    pub(super) station: u16,
    pub(super) mailbox: Option<MailboxInfo>,
    pub(super) object: ObjectAddress,
    pub(super) scope: SdoScope,
    pub(super) timeout_ns: Ns,
}

impl Sdo {
    fn open(bus: Bus, target: &Target) -> Result<Self, MailboxError> {
        let has_coe = |info: &MailboxInfo| info.protocols.contains(MailboxProtocols::COE);
        let info = target.mailbox.filter(has_coe).ok_or(MailboxError::NoMailbox)?;
        let mailbox = Mailbox::open(bus, target.slave, target.station, info).ok_or(MailboxError::Busy)?;
        Ok(Self { mailbox, object: target.object, scope: target.scope, timeout_ns: target.timeout_ns })
    }

    async fn send(&mut self, request: SdoRequest<'_>) -> Result<Ns, SdoError> {
        let until = self.mailbox.now().saturating_add(self.timeout_ns);
        let encode = |room: &mut [u8]| CoeMessage::SdoRequest(request).encode(room).ok();
        self.mailbox.send(MailboxProtocol::Coe, until, encode).await?;
        Ok(until)
    }

    /// Sends a request and gives what `take` makes of its answer; `None`: it is none to this request, and is left out.
    async fn ask<R>(
        &mut self,
        request: SdoRequest<'_>,
        mut take: impl FnMut(SdoResponse<'_>) -> Option<R>,
    ) -> Result<R, SdoError> {
        let until = match self.send(request).await {
            Ok(until) => until,
            Err(error) => return Err(error),
        };
        loop {
            let data = match self.mailbox.receive(MailboxProtocol::Coe, until).await {
                Ok(data) => data,
                Err(MailboxError::TimeUp) => {
                    self.give_up(AbortCode::TIMEOUT).await;
                    return Err(MailboxError::TimeUp.into());
                }
                Err(error) => return Err(error.into()),
            };
            match CoeMessage::decode(data) {
                Ok(CoeMessage::SdoRequest(SdoRequest::Abort { code, .. })) => return Err(SdoError::Abort(code)),
                Ok(CoeMessage::SdoResponse(response)) => {
                    if let Some(code) = abort_in(response) {
                        return Err(SdoError::Abort(code));
                    }
                    if let Some(taken) = take(response) {
                        return Ok(taken);
                    }
                }
                _ => {}
            }
        }
    }

    /// Tells the slave that the transfer has ended.
    async fn give_up(&mut self, code: AbortCode) {
        // It has ended whether the slave takes note or not.
        let _ = self.send(SdoRequest::Abort { object: self.object, code }).await;
    }

    async fn fail<R>(&mut self, code: AbortCode) -> Result<R, SdoError> {
        self.give_up(code).await;
        Err(SdoError::Abort(code))
    }

    /// How many bytes a message has room for, of which some are no data of a value.
    const fn room(&self, overhead: usize) -> usize {
        (self.mailbox.room() + MAILBOX_HEADER_LEN).saturating_sub(overhead)
    }
}

/// Some slaves abort by the service of answers.
fn abort_in(response: SdoResponse<'_>) -> Option<AbortCode> {
    let SdoResponse::Unknown(command, rest) = response else { return None };
    let mut whole = [command, 0, 0, 0, 0, 0, 0, 0];
    whole[1..].copy_from_slice(rest.first_chunk::<7>()?);
    match SdoRequest::decode(&whole) {
        Ok(SdoRequest::Abort { code, .. }) => Some(code),
        _ => None,
    }
}

/// Reads an object.
pub(super) async fn upload(bus: Bus, target: Target) -> Result<Vec<u8>, SdoError> {
    let mut sdo = Sdo::open(bus, &target)?;
    sdo.mailbox.drain().await?;
    let (object, scope) = (sdo.object, sdo.scope);
    let (size, mut value) = sdo
        .ask(SdoRequest::Upload { object, scope }, |response| match response {
            SdoResponse::Upload { object: other, value, .. } if other == object => Some(match value {
                SdoValuePart::Expedited(data) => (data.len(), data.to_vec()),
                SdoValuePart::Unsized(four) => (four.len(), four.to_vec()),
                // What follows a value in its message has no meaning.
                SdoValuePart::First { size, data } => {
                    let size = usize::try_from(size).unwrap_or(usize::MAX);
                    (size, data[..data.len().min(size)].to_vec())
                }
            }),
            _ => None,
        })
        .await?;
    if size > VALUE_BYTES_MAX {
        return sdo.fail(AbortCode::OUT_OF_MEMORY).await;
    }
    let mut toggle = false;
    while value.len() < size {
        let (more, is_last) = sdo
            .ask(SdoRequest::UploadSegment { toggle }, |response| match response {
                SdoResponse::UploadSegment { toggle: other, last, data } if other == toggle => {
                    Some((data.to_vec(), last))
                }
                _ => None,
            })
            .await?;
        value.extend_from_slice(&more);
        if value.len() > size {
            return sdo.fail(AbortCode::TOO_LONG).await;
        }
        if is_last {
            break;
        }
        if more.is_empty() {
            return sdo.fail(AbortCode::COMMAND).await;
        }
        toggle = !toggle;
    }
    if value.len() < size {
        return Err(SdoError::Abort(AbortCode::TOO_SHORT));
    }
    Ok(value)
}

/// Writes an object.
pub(super) async fn download(bus: Bus, target: Target, value: Vec<u8>) -> Result<(), SdoError> {
    let mut sdo = Sdo::open(bus, &target)?;
    sdo.mailbox.drain().await?;
    let (object, scope) = (sdo.object, sdo.scope);
    let first = value.len().min(sdo.room(FIRST_OVERHEAD));
    let (part, sent) = match value.len() {
        1..=4 => (SdoValuePart::Expedited(&value), value.len()),
        len => (SdoValuePart::First { size: u32::try_from(len).unwrap_or(u32::MAX), data: &value[..first] }, first),
    };
    sdo.ask(SdoRequest::Download { object, scope, value: part }, |response| match response {
        SdoResponse::Download { object: other, .. } if other == object => Some(()),
        _ => None,
    })
    .await?;
    let room = sdo.room(SEGMENT_OVERHEAD).max(1);
    let (mut toggle, count) = (false, value[sent..].chunks(room).len());
    for (n, data) in value[sent..].chunks(room).enumerate() {
        let last = n + 1 == count;
        sdo.ask(SdoRequest::DownloadSegment { toggle, last, data }, |response| match response {
            SdoResponse::DownloadSegment { toggle: other } if other == toggle => Some(()),
            _ => None,
        })
        .await?;
        toggle = !toggle;
    }
    Ok(())
}
