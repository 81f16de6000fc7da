//! The SDO server of a slave: one transfer at a time, expedited, normal or segmented.

use crate::ethercat::coe::{
    AbortCode, FIRST_OVERHEAD, ObjectAddress, SEGMENT_OVERHEAD, SdoRequest, SdoResponse, SdoScope, SdoValuePart,
};
use crate::slave::Slave;

/// \[OURS] The maximum length of a value that a master can write, bytes.
pub const VALUE_BYTES_MAX: u32 = 0x1_0000;
/// The capacity that is reserved for a value, bytes. Only a longer value allocates.
const VALUE_ROOM: usize = 512;

/// The present segmented transfer.
#[derive(Clone, Copy, Debug, Default)]
enum Transfer {
    #[default]
    None,
    /// The master reads a value in segments; the first `sent` bytes of the value were sent.
    Upload { object: ObjectAddress, sent: usize, toggle: bool },
    /// The master writes a value of `size` bytes in segments.
    Download { object: ObjectAddress, scope: SdoScope, size: usize, toggle: bool },
}

/// The server's answer to an SDO request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SdoAnswer<'a> {
    Response(SdoResponse<'a>),
    Abort(ObjectAddress, AbortCode),
    /// No answer: the master has aborted the transfer.
    None,
}

/// The SDO server of a slave: the segmented transfer in progress, with the value that it transfers.
#[derive(Clone, Debug, Default)]
pub(super) struct SdoServer {
    transfer: Transfer,
    value: Vec<u8>,
}

impl SdoServer {
    /// Ends the present transfer without a message to the master.
    pub(super) fn reset(&mut self) {
        self.transfer = Transfer::None;
        self.value.clear();
        self.value.reserve(VALUE_ROOM);
    }

    /// Answers a request. `mailbox` is the length of the response mailbox, bytes: a value that does not fit is uploaded in
    /// segments.
    pub(super) fn answer(&mut self, request: SdoRequest<'_>, mailbox: usize, device: &mut dyn Slave) -> SdoAnswer<'_> {
        match request {
            SdoRequest::Upload { object, scope } => self.upload(object, scope, mailbox, device),
            SdoRequest::UploadSegment { toggle } => self.upload_segment(toggle, mailbox),
            SdoRequest::Download { object, scope, value } => self.download(object, scope, value, device),
            SdoRequest::DownloadSegment { toggle, last, data } => self.download_segment(toggle, last, data, device),
            SdoRequest::Abort { .. } => {
                self.reset();
                SdoAnswer::None
            }
            SdoRequest::Unknown(..) => self.abort(AbortCode::COMMAND),
        }
    }

    /// Aborts the present transfer, and answers with an abort code.
    fn abort(&mut self, code: AbortCode) -> SdoAnswer<'_> {
        let object = match self.transfer {
            Transfer::Upload { object, .. } | Transfer::Download { object, .. } => object,
            Transfer::None => ObjectAddress::new(0, 0),
        };
        self.reset();
        SdoAnswer::Abort(object, code)
    }

    fn upload(
        &mut self,
        object: ObjectAddress,
        scope: SdoScope,
        mailbox: usize,
        device: &mut dyn Slave,
    ) -> SdoAnswer<'_> {
        self.reset();
        self.value.resize(VALUE_ROOM, 0);
        let read = match device.read(object, scope, &mut self.value) {
            Ok(len) if len > self.value.len() => {
                self.value.resize(len, 0);
                device.read(object, scope, &mut self.value)
            }
            read => read,
        };
        let len = match read {
            Ok(len) => len.min(self.value.len()),
            Err(code) => return SdoAnswer::Abort(object, code),
        };
        self.value.truncate(len);
        let first = len.min(mailbox.saturating_sub(FIRST_OVERHEAD));
        if first < len {
            self.transfer = Transfer::Upload { object, sent: first, toggle: false };
        }
        let value = match len {
            1..=4 => SdoValuePart::Expedited(&self.value),
            _ => SdoValuePart::First { size: len as u32, data: &self.value[..first] },
        };
        SdoAnswer::Response(SdoResponse::Upload { object, scope, value })
    }

    fn upload_segment(&mut self, toggle: bool, mailbox: usize) -> SdoAnswer<'_> {
        let Transfer::Upload { object, sent, toggle: expected } = self.transfer else {
            return self.abort(AbortCode::COMMAND);
        };
        if toggle != expected {
            return self.abort(AbortCode::TOGGLE_BIT);
        }
        let left = self.value.len() - sent;
        let len = left.min(mailbox.saturating_sub(SEGMENT_OVERHEAD).max(1));
        let last = len == left;
        self.transfer =
            if last { Transfer::None } else { Transfer::Upload { object, sent: sent + len, toggle: !toggle } };
        SdoAnswer::Response(SdoResponse::UploadSegment { toggle, last, data: &self.value[sent..][..len] })
    }

    fn download(
        &mut self,
        object: ObjectAddress,
        scope: SdoScope,
        value: SdoValuePart<'_>,
        device: &mut dyn Slave,
    ) -> SdoAnswer<'_> {
        self.reset();
        let written = match value {
            SdoValuePart::Expedited(data) => device.write(object, scope, data),
            SdoValuePart::Unsized(four) => {
                // An expedited request without the size indicator: use the length of the object, at most four bytes.
                let len = device.read(object, scope, &mut []).unwrap_or(four.len()).min(four.len());
                device.write(object, scope, &four[..len])
            }
            SdoValuePart::First { size, .. } if size > VALUE_BYTES_MAX => Err(AbortCode::OUT_OF_MEMORY),
            SdoValuePart::First { size, data } => {
                let size = size as usize;
                match data.get(..size) {
                    Some(whole) => device.write(object, scope, whole),
                    None => {
                        self.value.extend_from_slice(data);
                        self.transfer = Transfer::Download { object, scope, size, toggle: false };
                        Ok(())
                    }
                }
            }
        };
        match written {
            Ok(()) => SdoAnswer::Response(SdoResponse::Download { object, scope }),
            Err(code) => SdoAnswer::Abort(object, code),
        }
    }

    fn download_segment(&mut self, toggle: bool, last: bool, data: &[u8], device: &mut dyn Slave) -> SdoAnswer<'_> {
        let Transfer::Download { object, scope, size, toggle: expected } = self.transfer else {
            return self.abort(AbortCode::COMMAND);
        };
        if toggle != expected {
            return self.abort(AbortCode::TOGGLE_BIT);
        }
        if self.value.len() + data.len() > size {
            return self.abort(AbortCode::TOO_LONG);
        }
        self.value.extend_from_slice(data);
        self.transfer = Transfer::Download { object, scope, size, toggle: !toggle };
        if last {
            if self.value.len() < size {
                return self.abort(AbortCode::TOO_SHORT);
            }
            if let Err(code) = device.write(object, scope, &self.value) {
                return self.abort(code);
            }
            self.reset();
        }
        SdoAnswer::Response(SdoResponse::DownloadSegment { toggle })
    }
}
