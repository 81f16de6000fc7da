//! Service data objects (SDO): requests that read and write objects, and their responses.
//!
//! A value of at most 4 bytes is part of the request or response itself (expedited). A longer value begins after the
//! SDO header, as far as the mailbox has room; segments with alternating toggle bits carry the rest.

use super::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::WireError;
use crate::ethercat::wire_error::{room_for, split};

/// Length in bytes of an SDO header after the CoE header: command, index, sub-index and 4 bytes of data or size.
pub const SDO_LEN: usize = 8;
/// The minimum number of data bytes in a segment on the wire, set by the standard. Shorter data are padded, and the
/// command byte says by how many bytes.
const SEGMENT_LEN_MIN: usize = 7;
/// Bytes of a mailbox that the first message of a segmented transfer uses for headers: mailbox header, CoE header, and SDO
/// header with the size.
pub const FIRST_OVERHEAD: usize = 6 + 2 + SDO_LEN;
/// Bytes of a mailbox that a segment uses for headers: mailbox header, CoE header and SDO command byte.
pub const SEGMENT_OVERHEAD: usize = 6 + 2 + 1;

/// The bits of the command byte, which is the first byte of an SDO.
mod command {
    /// Bits 5 to 7 of a request's command byte, the command specifier: this constant and the three below it.
    pub const DOWNLOAD_SEGMENT: u8 = 0 << 5;
    pub const DOWNLOAD: u8 = 1 << 5;
    pub const UPLOAD: u8 = 2 << 5;
    pub const UPLOAD_SEGMENT: u8 = 3 << 5;
    /// Bits 5 to 7 of the command byte of an abort, in a request or a response.
    pub const ABORT: u8 = 4 << 5;
    /// Bits 5 to 7 of a response's command byte, the command specifier: this constant and the three below it.
    pub const UPLOADED_SEGMENT: u8 = 0 << 5;
    pub const DOWNLOADED_SEGMENT: u8 = 1 << 5;
    pub const UPLOADED: u8 = 2 << 5;
    pub const DOWNLOADED: u8 = 3 << 5;
    pub const SPECIFIER: u8 = 0b111 << 5;
    /// Bit 4 of downloads and uploads: complete access.
    pub const COMPLETE: u8 = 1 << 4;
    /// Bit 4 of segments: the toggle bit.
    pub const TOGGLE: u8 = 1 << 4;
    /// Bit 1: expedited. The 4 bytes after the object address hold the value itself.
    pub const EXPEDITED: u8 = 1 << 1;
    /// Bit 0: the length of the value is given. In an expedited transfer bits 2 and 3 give the number of unused bytes;
    /// otherwise the 4 bytes after the object address give the length.
    pub const SIZED: u8 = 1 << 0;
    /// Bit 0 of segments: no more segments follow.
    pub const LAST: u8 = 1 << 0;
}

/// The value that a download request or an upload response carries: the whole value, or its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoValuePart<'a> {
    /// A whole value of 1 to 4 bytes.
    Expedited(&'a [u8]),
    /// A whole value of at most 4 bytes whose exact length the sender did not give.
    Unsized(&'a [u8; 4]),
    /// The first bytes of a value of `size` bytes, or all of them if they fit into the mailbox. Segments carry the
    /// rest.
    First {
        /// The length of the whole value, bytes.
        size: u32,
        /// The first bytes of the value.
        data: &'a [u8],
    },
}

/// An SDO request from the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoRequest<'a> {
    /// Writes an object (download).
    Download {
        /// The object to write.
        object: ObjectAddress,
        /// One sub-index or the whole object.
        scope: SdoScope,
        /// The value, or its first part.
        value: SdoValuePart<'a>,
    },
    /// The next bytes of a value that the master writes.
    DownloadSegment {
        /// The toggle bit: false for the first segment, then alternating.
        toggle: bool,
        /// Whether this is the last segment.
        last: bool,
        /// Data of the segment.
        data: &'a [u8],
    },
    /// Reads an object (upload).
    Upload {
        /// The object to read.
        object: ObjectAddress,
        /// One sub-index or the whole object.
        scope: SdoScope,
    },
    /// Requests the next bytes of a value that the master reads.
    UploadSegment {
        /// The toggle bit: false for the first segment, then alternating.
        toggle: bool,
    },
    /// Aborts a transfer. A slave aborts with the same message.
    Abort {
        /// The object of the aborted transfer.
        object: ObjectAddress,
        /// The reason why the transfer is aborted.
        code: AbortCode,
    },
    /// A command code that the standard does not define, with the bytes after it.
    Unknown(u8, &'a [u8]),
}

/// An SDO response from a slave. A slave's abort is decoded as [`SdoRequest::Abort`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoResponse<'a> {
    /// The slave has written the object, or is ready for the first segment.
    Download {
        /// The object written.
        object: ObjectAddress,
        /// One sub-index or the whole object.
        scope: SdoScope,
    },
    /// The slave has accepted a segment of a download.
    DownloadSegment {
        /// The toggle bit of the request.
        toggle: bool,
    },
    /// The slave has read the object.
    Upload {
        /// The object read.
        object: ObjectAddress,
        /// One sub-index or the whole object.
        scope: SdoScope,
        /// The value, or its first part.
        value: SdoValuePart<'a>,
    },
    /// The next bytes of a value that the master reads.
    UploadSegment {
        /// The toggle bit of the request.
        toggle: bool,
        /// Whether this is the last segment.
        last: bool,
        /// Data of the segment.
        data: &'a [u8],
    },
    /// A command code that the standard does not define, with the bytes after it.
    Unknown(u8, &'a [u8]),
}

const fn scope_of(command: u8) -> SdoScope {
    if command & command::COMPLETE == 0 { SdoScope::Entry } else { SdoScope::Complete }
}

const fn scope_bit(scope: SdoScope) -> u8 {
    match scope {
        SdoScope::Entry => 0,
        SdoScope::Complete => command::COMPLETE,
    }
}

const fn toggle_bit(toggle: bool) -> u8 {
    if toggle { command::TOGGLE } else { 0 }
}

/// Splits an SDO into the object's address, the 4 bytes of value or size, and the bytes after them.
fn parts(body: &[u8]) -> Result<(ObjectAddress, &[u8; 4], &[u8]), WireError> {
    let ([_, low, high, sub], rest) = split::<4>(body, "SDO")?;
    let (four, rest) = split::<4>(rest, "data of an SDO")?;
    Ok((ObjectAddress::new(u16::from_le_bytes([*low, *high]), *sub), four, rest))
}

/// The value in a download request or an upload response; `None` if the command bits are not a valid combination.
fn value<'a>(command: u8, four: &'a [u8; 4], rest: &'a [u8]) -> Option<SdoValuePart<'a>> {
    match (command & command::EXPEDITED != 0, command & command::SIZED != 0) {
        (true, true) => Some(SdoValuePart::Expedited(&four[..4 - usize::from(command >> 2 & 0b11)])),
        (true, false) => Some(SdoValuePart::Unsized(four)),
        (false, true) => Some(SdoValuePart::First { size: u32::from_le_bytes(*four), data: rest }),
        (false, false) => None,
    }
}

/// The data of a segment. In a segment of 7 bytes, bits 1 to 3 of the command byte give the number of unused bytes.
fn segment(command: u8, body: &[u8]) -> Result<&[u8], WireError> {
    let data = &body[1..];
    match data.len() {
        0..SEGMENT_LEN_MIN => {
            Err(WireError::Short { part: "data of a segment", needed: SEGMENT_LEN_MIN, found: data.len() })
        }
        SEGMENT_LEN_MIN => Ok(&data[..SEGMENT_LEN_MIN - usize::from(command >> 1 & 0b111)]),
        _ => Ok(data),
    }
}

fn put_segment(specifier: u8, toggle: bool, last: bool, data: &[u8], room: &mut [u8]) -> Result<usize, WireError> {
    let len = 1 + data.len().max(SEGMENT_LEN_MIN);
    let room = room_for(room, "SDO segment", len)?;
    let unused = SEGMENT_LEN_MIN.saturating_sub(data.len()) as u8;
    room[0] = specifier | toggle_bit(toggle) | unused << 1 | if last { command::LAST } else { 0 };
    room[1..][..data.len()].copy_from_slice(data);
    room[1 + data.len()..].fill(0);
    Ok(len)
}

fn put_sdo(command: u8, object: ObjectAddress, four: [u8; 4], room: &mut [u8]) -> Result<usize, WireError> {
    let [low, high] = object.index.to_le_bytes();
    let room = room_for(room, "SDO", SDO_LEN)?;
    room[..4].copy_from_slice(&[command, low, high, object.sub]);
    room[4..].copy_from_slice(&four);
    Ok(SDO_LEN)
}

fn put_value(command: u8, object: ObjectAddress, value: SdoValuePart<'_>, room: &mut [u8]) -> Result<usize, WireError> {
    match value {
        SdoValuePart::Expedited(data @ ([_] | [_, _] | [_, _, _] | [_, _, _, _])) => {
            let mut four = [0; 4];
            four[..data.len()].copy_from_slice(data);
            let unused = (4 - data.len() as u8) << 2;
            put_sdo(command | command::EXPEDITED | command::SIZED | unused, object, four, room)
        }
        SdoValuePart::Expedited(data) => {
            let found = u32::try_from(data.len()).unwrap_or(u32::MAX);
            Err(WireError::Field { part: "bytes of an expedited value", found, allowed: "1 to 4" })
        }
        SdoValuePart::Unsized(four) => put_sdo(command | command::EXPEDITED, object, *four, room),
        SdoValuePart::First { size, data } => {
            let len = SDO_LEN + data.len();
            let room = room_for(room, "SDO", len)?;
            put_sdo(command | command::SIZED, object, size.to_le_bytes(), room)?;
            room[SDO_LEN..].copy_from_slice(data);
            Ok(len)
        }
    }
}

fn put_unknown(command: u8, data: &[u8], room: &mut [u8]) -> Result<usize, WireError> {
    let (first, rest) = room_for(room, "SDO", 1 + data.len())?.split_at_mut(1);
    first[0] = command;
    rest.copy_from_slice(data);
    Ok(1 + data.len())
}

fn command_of(body: &[u8]) -> Result<u8, WireError> {
    split::<1>(body, "SDO command").map(|([command], _)| *command)
}

impl<'a> SdoRequest<'a> {
    /// Decodes a request from the bytes after the CoE header.
    ///
    /// # Errors
    /// [`WireError::Short`]: the bytes end before the request does.
    pub fn decode(body: &'a [u8]) -> Result<Self, WireError> {
        let command = command_of(body)?;
        let toggle = command & command::TOGGLE != 0;
        match command & command::SPECIFIER {
            command::DOWNLOAD_SEGMENT => {
                let last = command & command::LAST != 0;
                Ok(Self::DownloadSegment { toggle, last, data: segment(command, body)? })
            }
            command::DOWNLOAD => {
                let (object, four, rest) = parts(body)?;
                let value = value(command, four, rest);
                let known = value.map(|value| Self::Download { object, scope: scope_of(command), value });
                Ok(known.unwrap_or(Self::Unknown(command, &body[1..])))
            }
            command::UPLOAD => {
                let (object, ..) = parts(body)?;
                Ok(Self::Upload { object, scope: scope_of(command) })
            }
            command::UPLOAD_SEGMENT => Ok(Self::UploadSegment { toggle }),
            command::ABORT => {
                let (object, four, _) = parts(body)?;
                Ok(Self::Abort { object, code: AbortCode(u32::from_le_bytes(*four)) })
            }
            _ => Ok(Self::Unknown(command, &body[1..])),
        }
    }

    /// Writes the bytes after the CoE header and returns their number.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the request does not fit. [`WireError::Field`]: expedited data are not 1 to 4 bytes long.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        match *self {
            Self::Download { object, scope, value } => {
                put_value(command::DOWNLOAD | scope_bit(scope), object, value, room)
            }
            Self::DownloadSegment { toggle, last, data } => {
                put_segment(command::DOWNLOAD_SEGMENT, toggle, last, data, room)
            }
            Self::Upload { object, scope } => put_sdo(command::UPLOAD | scope_bit(scope), object, [0; 4], room),
            Self::UploadSegment { toggle } => {
                put_sdo(command::UPLOAD_SEGMENT | toggle_bit(toggle), ObjectAddress::new(0, 0), [0; 4], room)
            }
            Self::Abort { object, code } => put_sdo(command::ABORT, object, code.0.to_le_bytes(), room),
            Self::Unknown(command, data) => put_unknown(command, data, room),
        }
    }
}

impl<'a> SdoResponse<'a> {
    /// Decodes a response from the bytes after the CoE header.
    ///
    /// # Errors
    /// [`WireError::Short`]: the bytes end before the response does.
    pub fn decode(body: &'a [u8]) -> Result<Self, WireError> {
        let command = command_of(body)?;
        let toggle = command & command::TOGGLE != 0;
        match command & command::SPECIFIER {
            command::UPLOADED_SEGMENT => {
                let last = command & command::LAST != 0;
                Ok(Self::UploadSegment { toggle, last, data: segment(command, body)? })
            }
            command::DOWNLOADED_SEGMENT => Ok(Self::DownloadSegment { toggle }),
            command::UPLOADED => {
                let (object, four, rest) = parts(body)?;
                // Some slaves send the size of a longer value without setting the bit [`command::SIZED`].
                let unsized_first = SdoValuePart::First { size: u32::from_le_bytes(*four), data: rest };
                let value = value(command, four, rest).unwrap_or(unsized_first);
                Ok(Self::Upload { object, scope: scope_of(command), value })
            }
            command::DOWNLOADED => {
                let (object, ..) = parts(body)?;
                Ok(Self::Download { object, scope: scope_of(command) })
            }
            _ => Ok(Self::Unknown(command, &body[1..])),
        }
    }

    /// Writes the bytes after the CoE header and returns their number.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the response does not fit. [`WireError::Field`]: expedited data are not 1 to 4 bytes long.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        match *self {
            Self::Download { object, scope } => put_sdo(command::DOWNLOADED | scope_bit(scope), object, [0; 4], room),
            Self::DownloadSegment { toggle } => {
                let command = command::DOWNLOADED_SEGMENT | toggle_bit(toggle);
                put_sdo(command, ObjectAddress::new(0, 0), [0; 4], room)
            }
            Self::Upload { object, scope, value } => {
                put_value(command::UPLOADED | scope_bit(scope), object, value, room)
            }
            Self::UploadSegment { toggle, last, data } => {
                put_segment(command::UPLOADED_SEGMENT, toggle, last, data, room)
            }
            Self::Unknown(command, data) => put_unknown(command, data, room),
        }
    }
}
