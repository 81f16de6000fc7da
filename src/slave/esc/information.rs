//! SDO information: what a slave answers to questions about its objects, in fragments if the mailbox is short.

use crate::coe::{AbortCode, EntryRequest, InformationFragment, InformationKind, ObjectListType, decode_u16};
use crate::ethercat::WireError;
use crate::slave::ObjectDirectory;

/// Bytes of a mailbox in front of the data of a fragment: headers of mailbox, CoE and information.
const OVERHEAD: usize = 6 + 2 + InformationFragment::HEADER_LEN;
/// How many bytes of an answer there is room for before a longer one needs more.
const ANSWER_ROOM: usize = 1024;

/// An answer that is given fragment by fragment.
#[derive(Clone, Debug, Default)]
pub(super) struct Information {
    answer: Vec<u8>,
    kind: Option<InformationKind>,
    /// How many bytes have gone.
    sent: usize,
}

impl Information {
    /// Gives up what is left of an answer.
    pub(super) fn reset(&mut self) {
        self.answer.clear();
        self.answer.reserve(ANSWER_ROOM);
        (self.kind, self.sent) = (None, 0);
    }

    /// Whether there is a fragment to come.
    pub(super) const fn is_waiting(&self) -> bool {
        self.kind.is_some()
    }

    /// Takes a question; [`Self::next`] gives the answer.
    ///
    /// # Errors
    /// [`WireError::Short`]: the question is too short.
    pub(super) fn ask(
        &mut self,
        question: InformationFragment<'_>,
        directory: Option<&dyn ObjectDirectory>,
    ) -> Result<(), WireError> {
        self.reset();
        let data = question.data;
        let answered = match question.kind {
            InformationKind::ListRequest => {
                let list = ObjectListType::from_code(decode_u16(data)?);
                directory.ok_or(AbortCode::NO_DICTIONARY).and_then(|directory| self.list(list, directory))
            }
            InformationKind::ObjectRequest => {
                let index = decode_u16(data)?;
                directory.ok_or(AbortCode::NO_DICTIONARY).and_then(|directory| {
                    let object = directory.object(index)?;
                    self.put(InformationKind::ObjectResponse, |room| object.encode(room));
                    Ok(())
                })
            }
            InformationKind::EntryRequest => {
                let request = EntryRequest::decode(data)?;
                directory.ok_or(AbortCode::NO_DICTIONARY).and_then(|directory| {
                    let mut entry = directory.entry(request.object)?;
                    // Unit, default, least and greatest value are in no description here.
                    entry.info = crate::coe::ValueInfo(entry.info.0 & request.wanted.0);
                    self.put(InformationKind::EntryResponse, |room| entry.encode(room));
                    Ok(())
                })
            }
            _ => Err(AbortCode::COMMAND),
        };
        if let Err(AbortCode(code)) = answered {
            self.answer.clear();
            self.answer.extend_from_slice(&code.to_le_bytes());
            self.kind = Some(InformationKind::Error);
        }
        Ok(())
    }

    fn put(&mut self, kind: InformationKind, encode: impl FnOnce(&mut [u8]) -> Result<usize, WireError>) {
        self.answer.resize(ANSWER_ROOM, 0);
        // A name that is longer than that is left out with its object.
        let len = encode(&mut self.answer).unwrap_or(0);
        self.answer.truncate(len);
        self.kind = Some(kind);
    }

    fn list(&mut self, list: ObjectListType, directory: &dyn ObjectDirectory) -> Result<(), AbortCode> {
        self.answer.extend_from_slice(&list.code().to_le_bytes());
        match list {
            ObjectListType::Lengths => {
                for list in ObjectListType::LISTS {
                    let mut count: u16 = 0;
                    directory.each_object(list, &mut |_| count += 1);
                    self.answer.extend_from_slice(&count.to_le_bytes());
                }
            }
            ObjectListType::Unknown(_) => return Err(AbortCode::PARAMETER_INCOMPATIBLE),
            list => directory.each_object(list, &mut |index| self.answer.extend_from_slice(&index.to_le_bytes())),
        }
        self.kind = Some(InformationKind::ListResponse);
        Ok(())
    }

    /// The next fragment for a mailbox of that length.
    pub(super) fn next(&mut self, mailbox: usize) -> Option<InformationFragment<'_>> {
        let kind = self.kind?;
        // Indices are not torn.
        let room = (mailbox.saturating_sub(OVERHEAD) & !1).max(2);
        let (from, whole) = (self.sent, self.answer.len());
        let len = (whole - from).min(room);
        self.sent += len;
        let left = (whole - self.sent).div_ceil(room);
        if left == 0 {
            self.kind = None;
        }
        let left = u16::try_from(left).unwrap_or(u16::MAX);
        Some(InformationFragment { kind, incomplete: left > 0, left, data: &self.answer[from..from + len] })
    }
}
