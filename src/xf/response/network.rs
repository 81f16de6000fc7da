//! Answers with properties of slaves.

use super::{Answer, Returned};
use crate::xf::Malformed;
use crate::xf::fields::{AnswerFields, FieldKind};
use crate::xf::layout::{Forms, tail};

/// The answer to [`SlaveInfoGet`](crate::xf::request::SlaveInfoGet): a property of a slave. The manuals give no sizes,
/// so the length of the answer decides the type (XF EN 643).
///
/// `[OURS]` The chip answers the properties 0 to 2, 8 and 9 with 4 bytes, 4 to 7 with 2 bytes, and 3 with a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlaveInfo<'a> {
    /// A property of one byte.
    U8(u8),
    /// A property of two bytes.
    U16(u16),
    /// A property of four bytes.
    U32(u32),
    /// The name, or a property of any other length.
    Text(&'a [u8]),
}

impl SlaveInfo<'_> {
    /// The property as a number; `None` for a text.
    pub const fn number(self) -> Option<u32> {
        match self {
            Self::U8(n) => Some(n as u32),
            Self::U16(n) => Some(n as u32),
            Self::U32(n) => Some(n),
            Self::Text(_) => None,
        }
    }
}

impl<'a> Answer<'a> for SlaveInfo<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        match self {
            Self::U8(n) => (&[*n][..]).encode(data),
            Self::U16(n) => n.encode(data),
            Self::U32(n) => n.encode(data),
            Self::Text(text) => text.encode(data),
        }
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        Ok(match *returned.valid(data)? {
            [n] => Self::U8(n),
            [a, b] => Self::U16(u16::from_le_bytes([a, b])),
            [a, b, c, d] => Self::U32(u32::from_le_bytes([a, b, c, d])),
            ref text => Self::Text(text),
        })
    }
}

impl Forms for SlaveInfo<'_> {
    const FORMS: &'static [AnswerFields] =
        &[AnswerFields::of(&[tail(0).kind(FieldKind::NumberOrText).of::<&[u8]>("value").field])];
}
