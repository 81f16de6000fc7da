//! Service data objects: requests that read and write objects, and what is answered.
//!
//! A value of at most 4 bytes travels in the request or the answer itself (expedited); a longer one behind it, as far as
//! the mailbox has room, and the rest in segments with alternating toggle bits.

use super::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::WireError;
use crate::ethercat::wire_error::{room_for, split};

/// Bytes of a request or an answer behind the CoE header, without data behind it: command, index, sub-index, 4 bytes.
pub const SDO_LEN: usize = 8;
/// The least data that a segment has on the wire.
const SEGMENT_LEN_MIN: usize = 7;
/// How many bytes of a mailbox are no data of a value in the first message of a longer one: the headers of mailbox and CoE,
/// the SDO with the length in it.
pub const FIRST_OVERHEAD: usize = 6 + 2 + SDO_LEN;
/// How many bytes of a mailbox are no data of a value in a segment: the headers of mailbox and CoE, the command.
pub const SEGMENT_OVERHEAD: usize = 6 + 2 + 1;

/// Bits of the command byte.
mod command {
    /// Bits 5 to 7 of a request.
    pub const DOWNLOAD_SEGMENT: u8 = 0 << 5;
    pub const DOWNLOAD: u8 = 1 << 5;
    pub const UPLOAD: u8 = 2 << 5;
    pub const UPLOAD_SEGMENT: u8 = 3 << 5;
    /// Bits 5 to 7 of a request or an answer.
    pub const ABORT: u8 = 4 << 5;
    /// Bits 5 to 7 of an answer.
    pub const UPLOADED_SEGMENT: u8 = 0 << 5;
    pub const DOWNLOADED_SEGMENT: u8 = 1 << 5;
    pub const UPLOADED: u8 = 2 << 5;
    pub const DOWNLOADED: u8 = 3 << 5;
    pub const SPECIFIER: u8 = 0b111 << 5;
    /// With download and upload.
    pub const COMPLETE: u8 = 1 << 4;
    /// With segments.
    pub const TOGGLE: u8 = 1 << 4;
    /// The value is in the 4 bytes.
    pub const EXPEDITED: u8 = 1 << 1;
    /// The length is said.
    pub const SIZED: u8 = 1 << 0;
    /// No more segments follow.
    pub const LAST: u8 = 1 << 0;
}

/// A value, or the beginning of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoValuePart<'a> {
    /// A whole value of 1 to 4 bytes.
    Expedited(&'a [u8]),
    /// A whole value of at most 4 bytes, of which nobody says how many they are.
    Unsized(&'a [u8; 4]),
    /// The first bytes of a value of `size` bytes, or all of them.
    First {
        /// The length of the whole value, bytes.
        size: u32,
        /// Its first bytes.
        data: &'a [u8],
    },
}

/// What a master asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoRequest<'a> {
    /// Writes an object.
    Download {
        /// Which one.
        object: ObjectAddress,
        /// One sub-index or all.
        scope: SdoScope,
        /// The value, or its beginning.
        value: SdoValuePart<'a>,
    },
    /// The next bytes of a value that is written.
    DownloadSegment {
        /// Changes with each segment; false for the first one.
        toggle: bool,
        /// No segment follows.
        last: bool,
        /// The bytes.
        data: &'a [u8],
    },
    /// Reads an object.
    Upload {
        /// Which one.
        object: ObjectAddress,
        /// One sub-index or all.
        scope: SdoScope,
    },
    /// Asks for the next bytes of a value that is read.
    UploadSegment {
        /// Changes with each segment; false for the first one.
        toggle: bool,
    },
    /// Ends a transfer. Slaves abort by the same message.
    Abort {
        /// The object of the transfer.
        object: ObjectAddress,
        /// Why.
        code: AbortCode,
    },
    /// A command that the standard does not have, with what follows it.
    Unknown(u8, &'a [u8]),
}

/// What a slave answers. An abort is [`SdoRequest::Abort`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoResponse<'a> {
    /// The object was written, or segments may follow.
    Download {
        /// Which one.
        object: ObjectAddress,
        /// One sub-index or all.
        scope: SdoScope,
    },
    /// The segment was taken.
    DownloadSegment {
        /// That of the request.
        toggle: bool,
    },
    /// The object was read.
    Upload {
        /// Which one.
        object: ObjectAddress,
        /// One sub-index or all.
        scope: SdoScope,
        /// The value, or its beginning.
        value: SdoValuePart<'a>,
    },
    /// The next bytes of a value that is read.
    UploadSegment {
        /// That of the request.
        toggle: bool,
        /// No segment follows.
        last: bool,
        /// The bytes.
        data: &'a [u8],
    },
    /// A command that the standard does not have, with what follows it.
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

/// The object that an SDO is about, its 4 bytes, and what follows.
fn parts(body: &[u8]) -> Result<(ObjectAddress, &[u8; 4], &[u8]), WireError> {
    let ([_, low, high, sub], rest) = split::<4>(body, "SDO")?;
    let (four, rest) = split::<4>(rest, "data of an SDO")?;
    Ok((ObjectAddress::new(u16::from_le_bytes([*low, *high]), *sub), four, rest))
}

/// The value of a download or an uploaded one; `None`: the bits of the command have no meaning.
fn value<'a>(command: u8, four: &'a [u8; 4], rest: &'a [u8]) -> Option<SdoValuePart<'a>> {
    match (command & command::EXPEDITED != 0, command & command::SIZED != 0) {
        (true, true) => Some(SdoValuePart::Expedited(&four[..4 - usize::from(command >> 2 & 0b11)])),
        (true, false) => Some(SdoValuePart::Unsized(four)),
        (false, true) => Some(SdoValuePart::First { size: u32::from_le_bytes(*four), data: rest }),
        (false, false) => None,
    }
}

/// The bytes of a segment: if there are 7, bits 1 to 3 of the command say how many of them do not count.
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
    /// Decodes what follows the CoE header.
    ///
    /// # Errors
    /// [`WireError::Short`].
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

    /// Writes what follows the CoE header; how many bytes it has.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]; [`WireError::Field`] for expedited data of another length than 1 to 4.
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
    /// Decodes what follows the CoE header.
    ///
    /// # Errors
    /// [`WireError::Short`].
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
                let value = value(command, four, rest);
                let known = value.map(|value| Self::Upload { object, scope: scope_of(command), value });
                Ok(known.unwrap_or(Self::Unknown(command, &body[1..])))
            }
            command::DOWNLOADED => {
                let (object, ..) = parts(body)?;
                Ok(Self::Download { object, scope: scope_of(command) })
            }
            _ => Ok(Self::Unknown(command, &body[1..])),
        }
    }

    /// Writes what follows the CoE header; how many bytes it has.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]; [`WireError::Field`] for expedited data of another length than 1 to 4.
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
