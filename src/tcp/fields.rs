//! Fields of a message: written one after the other into a fixed buffer, and read from a slice. Numbers are
//! little-endian.

use super::wire_error::{PAYLOAD_MAX, WireError};
use crate::link::{Stamp, Wait};
use crate::sk::FRAME_LEN;

/// The value of an 8-byte field that means "no time limit" ([`Wait::Forever`]), or "no time" where a [`Stamp`] is optional.
const NONE: u64 = u64::MAX;
/// The maximum length of a text in a message, in bytes. A longer text is cut. \[OURS]
pub const TEXT_MAX: usize = 256;

/// The longest part of a file in a message, bytes; a longer part is cut. \[OURS]
pub const PART_MAX: usize = 512;

/// Writes the fields of a message into a fixed buffer. Every message fits the buffer: a frame, some numbers and at most
/// three texts.
pub(super) struct Put<'a> {
    bytes: &'a mut [u8],
    pub(super) at: usize,
}

impl<'a> Put<'a> {
    pub(super) const fn new(bytes: &'a mut [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.bytes[self.at..self.at + bytes.len()].copy_from_slice(bytes);
        self.at += bytes.len();
    }

    pub(super) fn u8(&mut self, value: u8) {
        self.bytes(&[value]);
    }

    pub(super) fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    pub(super) fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    pub(super) fn wait(&mut self, wait: Wait) {
        self.u64(match wait {
            Wait::Forever => NONE,
            Wait::Now => 0,
            Wait::For(limit) => u64::try_from(limit.as_nanos()).unwrap_or(NONE - 1).min(NONE - 1),
        });
    }

    pub(super) fn stamp(&mut self, at: Option<Stamp>) {
        self.u64(at.map_or(NONE, |at| at.0));
    }

    /// Writes the length of the part and then the part, cut to [`PART_MAX`].
    pub(super) fn part(&mut self, part: &[u8]) {
        let part = &part[..part.len().min(PART_MAX)];
        self.u16(part.len() as u16);
        self.bytes(part);
    }

    /// Writes the length of the text and then the text, cut to [`TEXT_MAX`].
    pub(super) fn text(&mut self, text: &str) {
        let text = &text[..text.floor_char_boundary(TEXT_MAX)];
        self.u16(text.len() as u16);
        self.bytes(text.as_bytes());
    }
}

/// Reads the fields of a message from its payload.
pub(super) struct Get<'a> {
    kind: u8,
    left: &'a [u8],
}

impl<'a> Get<'a> {
    pub(super) const fn new(kind: u8, payload: &'a [u8]) -> Self {
        Self { kind, left: payload }
    }

    /// Checks that the payload has no bytes after the last field.
    pub(super) const fn end(self) -> Result<(), WireError> {
        if self.left.is_empty() { Ok(()) } else { Err(WireError::Trailing { kind: self.kind, extra: self.left.len() }) }
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<&'a [u8; N], WireError> {
        let short = WireError::Short { kind: self.kind, needed: N, found: self.left.len() };
        let (array, rest) = self.left.split_first_chunk().ok_or(short)?;
        self.left = rest;
        Ok(array)
    }

    pub(super) fn u8(&mut self) -> Result<u8, WireError> {
        Ok(u8::from_le_bytes(*self.array()?))
    }

    pub(super) fn u16(&mut self) -> Result<u16, WireError> {
        Ok(u16::from_le_bytes(*self.array()?))
    }

    pub(super) fn u32(&mut self) -> Result<u32, WireError> {
        Ok(u32::from_le_bytes(*self.array()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, WireError> {
        Ok(u64::from_le_bytes(*self.array()?))
    }

    pub(super) fn flag(&mut self) -> Result<bool, WireError> {
        match self.u8()? {
            0 => Ok(false),
            1 => Ok(true),
            found => Err(WireError::Value { kind: self.kind, field: "a flag", found: found.into() }),
        }
    }

    pub(super) fn wait(&mut self) -> Result<Wait, WireError> {
        Ok(match self.u64()? {
            NONE => Wait::Forever,
            0 => Wait::Now,
            limit => Wait::For(std::time::Duration::from_nanos(limit)),
        })
    }

    pub(super) fn stamp(&mut self) -> Result<Option<Stamp>, WireError> {
        let at = self.u64()?;
        Ok((at != NONE).then_some(Stamp(at)))
    }

    pub(super) fn text(&mut self) -> Result<&'a str, WireError> {
        let length = usize::from(self.u16()?);
        if length > TEXT_MAX {
            return Err(WireError::Value { kind: self.kind, field: "the length of a text", found: length as u64 });
        }
        let short = WireError::Short { kind: self.kind, needed: length, found: self.left.len() };
        let (text, rest) = self.left.split_at_checked(length).ok_or(short)?;
        self.left = rest;
        std::str::from_utf8(text).map_err(|_| WireError::Text { kind: self.kind })
    }

    /// A part of a file, of at most [`PART_MAX`] bytes.
    pub(super) fn part(&mut self) -> Result<&'a [u8], WireError> {
        let length = usize::from(self.u16()?);
        if length > PART_MAX {
            return Err(self.value("the length of a part", length as u64));
        }
        let short = WireError::Short { kind: self.kind, needed: length, found: self.left.len() };
        let (part, rest) = self.left.split_at_checked(length).ok_or(short)?;
        self.left = rest;
        Ok(part)
    }

    pub(super) const fn value(&self, field: &'static str, found: u64) -> WireError {
        WireError::Value { kind: self.kind, field, found }
    }
}

// The largest messages fit the payload: one with a frame and some numbers, and one with three texts and some numbers.
const _: () = assert!(FRAME_LEN + 128 <= PAYLOAD_MAX && 3 * (2 + TEXT_MAX) + 128 <= PAYLOAD_MAX);
