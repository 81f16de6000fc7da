//! Answers with items about slaves.

use super::{Answer, Returned};
use crate::xf::Malformed;
use crate::xf::fields::{AnswerFields, FieldKind};
use crate::xf::layout::{Forms, tail};

/// The answer to [`SlaveInfoGet`](crate::xf::request::SlaveInfoGet). The manuals give no sizes, so the length of the
/// answer decides the type (XF EN 643).
///
/// `[OURS]` The chip answers items 0 to 2, 8 and 9 with 4 bytes, 4 to 7 with 2 bytes, and 3 with a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlaveInfo<'a> {
    /// An item of one byte.
    U8(u8),
    /// An item of two bytes.
    U16(u16),
    /// An item of four bytes.
    U32(u32),
    /// The name, or an item of any other length.
    Text(&'a [u8]),
}

impl SlaveInfo<'_> {
    /// The item as a number; `None` for a text.
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
