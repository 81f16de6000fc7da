//! SDO information: the list of a slave's objects, and their descriptions.

use super::{SdoError, VALUE_BYTES_MAX};
use crate::ethercat::coe::{
    AbortCode, CoeMessage, EntryRequest, InformationFragment, InformationKind, ObjectListType, SdoRequest,
    decode_abort, decode_u16,
};
use crate::ethercat::mailbox::MailboxProtocol;
use crate::ethercat::sii::MailboxProtocols;
use crate::master::bus::Bus;
use crate::master::mailbox::{FIRST_OBJECT, MailboxError, Peer};

/// Reads a list of the slave's objects, for example of all objects. Returns their indices.
pub(super) async fn list(bus: Bus, peer: Peer, list: ObjectListType) -> Result<Vec<u16>, SdoError> {
    let question = list.code().to_le_bytes();
    let answer = ask(bus, peer, InformationKind::ListRequest, &question, InformationKind::ListResponse).await?;
    // The first number of the answer is the type of the list.
    if decode_u16(&answer) != Ok(list.code()) {
        return Err(MailboxError::WrongAnswer.into());
    }
    Ok(answer.as_chunks().0.iter().skip(1).map(|index| u16::from_le_bytes(*index)).collect())
}

/// Reads the description of an object, undecoded.
pub(super) async fn object(bus: Bus, peer: Peer, index: u16) -> Result<Vec<u8>, SdoError> {
    let question = index.to_le_bytes();
    ask(bus, peer, InformationKind::ObjectRequest, &question, InformationKind::ObjectResponse).await
}

/// Reads the description of a sub-index, undecoded.
pub(super) async fn entry(bus: Bus, peer: Peer, request: EntryRequest) -> Result<Vec<u8>, SdoError> {
    ask(bus, peer, InformationKind::EntryRequest, &request.encode(), InformationKind::EntryResponse).await
}

/// Sends a request, and joins the fragments of the answer.
async fn ask(
    bus: Bus,
    peer: Peer,
    kind: InformationKind,
    question: &[u8],
    wanted: InformationKind,
) -> Result<Vec<u8>, SdoError> {
    let mut mailbox = peer.open(bus, MailboxProtocols::COE).await?;
    let question = CoeMessage::Information(InformationFragment::whole(kind, question));
    let until = mailbox.now().saturating_add(peer.timeout_ns);
    mailbox.send(MailboxProtocol::Coe, until, |room| question.encode(room).ok()).await?;
    let mut answer = Vec::new();
    let mut until = mailbox.now().saturating_add(peer.timeout_ns);
    let mut expected = None;
    loop {
        let data = mailbox.receive(MailboxProtocol::Coe, until).await?;
        let fragment = match CoeMessage::decode(data) {
            Ok(CoeMessage::Information(fragment)) => fragment,
            // Some slaves refuse SDO information by an SDO abort.
            Ok(CoeMessage::SdoRequest(SdoRequest::Abort { object, code })) if object != FIRST_OBJECT => {
                // The abort may answer an earlier transfer, which the master has given up.
                if mailbox.leaves_out() {
                    continue;
                }
                return Err(SdoError::Abort(code));
            }
            Ok(_) => continue,
            Err(_) => return Err(MailboxError::WrongAnswer.into()),
        };
        if fragment.kind == InformationKind::Error {
            return Err(decode_abort(fragment.data).map_or(MailboxError::WrongAnswer.into(), SdoError::Abort));
        }
        if fragment.kind != wanted {
            if mailbox.leaves_out() {
                continue;
            }
            return Err(MailboxError::WrongAnswer.into());
        }
        // Each fragment states how many fragments are left, so this number must count down. Some slaves do not set the
        // bit "incomplete": there only this number shows that fragments follow.
        if expected.is_some_and(|expected| expected != fragment.left) {
            return Err(MailboxError::WrongAnswer.into());
        }
        answer.extend_from_slice(fragment.data);
        if answer.len() > VALUE_BYTES_MAX {
            return Err(SdoError::Abort(AbortCode::OUT_OF_MEMORY));
        }
        let (incomplete, left) = (fragment.incomplete, fragment.left);
        if !incomplete && left == 0 {
            return Ok(answer);
        }
        expected = left.checked_sub(1);
        if expected.is_none() {
            return Err(MailboxError::WrongAnswer.into());
        }
        until = mailbox.now().saturating_add(peer.timeout_ns);
    }
}
