//! The SDO information server of a slave, which answers in fragments if the mailbox is short.

use crate::ethercat::WireError;
use crate::ethercat::coe::{
    AbortCode, EntryDescription, EntryRequest, InformationFragment, InformationKind, ObjectDescription, ObjectListType,
    ValueInfo, decode_u16,
};
use crate::slave::Slave;
use crate::slave::dictionary::{EntryDescription as Entry, ObjectDescription as Object};

/// Bytes of a mailbox in front of the data of a fragment: mailbox header, CoE header and SDO information header.
const OVERHEAD: usize = 6 + 2 + InformationFragment::HEADER_LEN;
/// The capacity that is reserved for a response, bytes. Only a longer response allocates.
const ANSWER_ROOM: usize = 1024;
/// \[OURS] The maximum length of an entry name in a response, bytes; a longer name is cut.
const NAME_ROOM: usize = 256;

/// An SDO information response, which is sent fragment by fragment.
#[derive(Clone, Debug, Default)]
pub(super) struct Information {
    answer: Vec<u8>,
    kind: Option<InformationKind>,
    /// The number of bytes sent so far.
    sent: usize,
}

impl Information {
    /// Drops the rest of the present response, because a new request has come or the mailbox restarts.
    pub(super) fn reset(&mut self) {
        self.answer.clear();
        self.answer.reserve(ANSWER_ROOM);
        (self.kind, self.sent) = (None, 0);
    }

    /// Whether a fragment is still to be sent.
    pub(super) const fn is_waiting(&self) -> bool {
        self.kind.is_some()
    }

    /// Handles a request; [`Self::next`] returns the response.
    ///
    /// # Errors
    /// [`WireError::Short`]: the request is too short.
    pub(super) fn ask(&mut self, question: InformationFragment<'_>, device: &dyn Slave) -> Result<(), WireError> {
        self.reset();
        let data = question.data;
        let answered = match question.kind {
            InformationKind::ListRequest => {
                let list = ObjectListType::from_code(decode_u16(data)?);
                self.list(list, device)
            }
            InformationKind::ObjectRequest => {
                let index = decode_u16(data)?;
                device.describe_object(index).map(|object| self.put_object(&object))
            }
            InformationKind::EntryRequest => {
                let request = EntryRequest::decode(data)?;
                device.describe_entry(request.object).map(|entry| self.put_entry(&entry, request.wanted))
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

    fn put_object(&mut self, object: &Object<'_>) {
        let described = ObjectDescription {
            index: object.index,
            data_type: object.data_type.0,
            max_sub: object.max_sub,
            code: object.code,
            name: object.name.as_bytes(),
        };
        self.put(InformationKind::ObjectResponse, |room| described.encode(room));
    }

    /// Encodes an entry description with the requested values, as far as the device defines them. Units are not supported.
    fn put_entry(&mut self, entry: &Entry<'_>, wanted: ValueInfo) {
        let mut info = ValueInfo(wanted.0 & (ValueInfo::ACCESS | ValueInfo::CATEGORY | ValueInfo::MAPPING).0);
        let mut data = [0; 3 * 8 + NAME_ROOM];
        let mut len = 0;
        let bytes = usize::from(entry.bits.div_ceil(8)).min(8);
        if let Some(values) = &entry.values {
            let numbers =
                [(ValueInfo::DEFAULT, values.default), (ValueInfo::MIN, values.min), (ValueInfo::MAX, values.max)];
            for (bit, number) in numbers.into_iter().filter(|(bit, _)| wanted.contains(*bit)) {
                data[len..len + bytes].copy_from_slice(&number.to_le_bytes()[..bytes]);
                info = info | bit;
                len += bytes;
            }
        }
        let name = &entry.name.as_bytes()[..entry.name.len().min(NAME_ROOM)];
        data[len..len + name.len()].copy_from_slice(name);
        let described = EntryDescription {
            object: entry.at,
            info,
            data_type: entry.data_type.0,
            bits: entry.bits,
            access: entry.access,
            data: &data[..len + name.len()],
        };
        self.put(InformationKind::EntryResponse, |room| described.encode(room));
    }

    fn put(&mut self, kind: InformationKind, encode: impl FnOnce(&mut [u8]) -> Result<usize, WireError>) {
        self.answer.resize(ANSWER_ROOM, 0);
        // If the name of the object or of the entry does not fit into the buffer, the response has no data.
        let len = encode(&mut self.answer).unwrap_or(0);
        self.answer.truncate(len);
        self.kind = Some(kind);
    }

    fn list(&mut self, list: ObjectListType, device: &dyn Slave) -> Result<(), AbortCode> {
        if device.object_from(0).is_none() {
            return Err(AbortCode::NO_DICTIONARY);
        }
        self.answer.extend_from_slice(&list.code().to_le_bytes());
        if list == ObjectListType::Lengths {
            for one in ObjectListType::LISTS {
                let count = device.object_list(one).len() as u16;
                self.answer.extend_from_slice(&count.to_le_bytes());
            }
        } else {
            if !ObjectListType::LISTS.contains(&list) {
                return Err(AbortCode::PARAMETER_INCOMPATIBLE);
            }
            device.object_list(list).iter().for_each(|index| self.answer.extend_from_slice(&index.to_le_bytes()));
        }
        self.kind = Some(InformationKind::ListResponse);
        Ok(())
    }

    /// The next fragment for a mailbox of `mailbox` bytes; `None` if nothing is left.
    pub(super) fn next(&mut self, mailbox: usize) -> Option<InformationFragment<'_>> {
        let kind = self.kind?;
        // The number of data bytes is even, so that a fragment of an object list does not split a 16-bit index. It is at least
        // 2, so that the fragments come to an end even with a mailbox that is too short.
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
