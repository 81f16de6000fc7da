//! A field of a request or an answer.

use crate::xf::layout::{FieldReader, FieldWriter};
use crate::xf::response::Returned;
use crate::xf::{Malformed, Reserve, segment};

/// Names of values with their numbers, or names of bits with their masks: bit 2 is 4.
pub type Names = &'static [(&'static str, u32)];

/// The position of a field's first byte, in the header or in the data segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldPosition {
    /// The parameter `par`, byte 0x0D of a command.
    Parameter,
    /// The return byte `ret`, byte 0x0D of an answer.
    Return,
    /// An information byte, `i0` to `i3`; a wider field continues in the next ones.
    Info(u8),
    /// Word 0x08 of a command, called reserve in the manuals.
    Reserve,
    /// Word 0x0E of a command, for commands in which it is not a length.
    Length,
    /// A byte of the data segment: its offset from the beginning of the segment.
    Data(u16),
}

/// The kind of a field's content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldKind {
    /// An unsigned number, shown in decimal.
    Number,
    /// A signed number, shown in decimal.
    Signed,
    /// A number, shown in hexadecimal.
    Hex,
    /// A number of which some values have names; other values are allowed, too.
    Named(Names),
    /// A number that must be one of these named values.
    Choice(Names),
    /// Bits, some of which have names; the numbers in [`Names`] are masks. Unnamed bits are kept.
    Bits(Names),
    /// A CiA 402 state of a drive, as the state bits of the statusword.
    DriveState,
    /// The abort code of an SDO transfer.
    Abort,
    /// A number if the value has 1, 2 or 4 bytes, otherwise a text; the length of the valid data decides.
    NumberOrText,
    /// As many bytes as [`Field::bytes`] says or, if that is 0, all bytes up to the end of the valid data.
    Bytes,
    /// A text up to the end of the valid data.
    Text,
    /// Mapped objects of a PDO, u32 each as in the mapping object: bits 31 to 16 index, 15 to 8 sub-index, 7 to 0
    /// length in bits. The number of objects is the u16 at byte `count_at` of the data segment.
    Objects {
        /// Offset in the data segment, in bytes, of the u16 that counts the objects.
        count_at: u16,
    },
    /// A set of slaves: bit b of byte k is slave 8 k + b.
    SlaveSet,
}

/// A field of a request or an answer: a named value at a position in the header or the data segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// The name by which [`FunctionFields::field`](super::FunctionFields::field) finds the field, such as `slaves`.
    pub name: &'static str,
    /// The position of the field's first byte.
    pub position: FieldPosition,
    /// The field's size in bytes; 0 if it extends to the end of the valid data.
    pub bytes: u8,
    /// The field's lowest bit, counted from bit 0 of its first byte. Several fields may share the same bytes, each with
    /// bits of its own.
    pub shift: u8,
    /// The number of bits that the field uses, from bit `shift` on; 0 for a field of variable length or longer than 4
    /// bytes.
    pub width: u8,
    /// How the bytes are interpreted and shown: as a number, as named bits, as a text and so on.
    pub kind: FieldKind,
    /// The value of the field in a request that does not set it; `None` if a request has to set it.
    pub default: Option<u32>,
    /// The name of the field, if any, whose length in bytes this field holds. Setting that other field in a
    /// [`Draft`](super::Draft) also sets this field.
    pub counts: Option<&'static str>,
}

/// The value of a field, as a program sets it in a request or reads it from an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    /// The value of a field that is a number.
    Number(i64),
    /// Bytes: of a text, of objects of 4 bytes each, of a set of slaves.
    Bytes(&'a [u8]),
}

impl Field {
    /// Whether the field's value is a [`Value::Number`]; otherwise it is [`Value::Bytes`].
    pub const fn is_number(&self) -> bool {
        !matches!(self.kind, FieldKind::Bytes | FieldKind::Text | FieldKind::Objects { .. } | FieldKind::SlaveSet)
    }

    /// A mask of [`Self::width`] bits, from bit 0 on.
    const fn mask(&self) -> u32 {
        if self.width >= 32 { u32::MAX } else { (1 << self.width) - 1 }
    }

    /// The field's value in an answer; `None` if the valid data end before the field. `base` is 0, or for fields that
    /// repeat ([`AnswerFields::every`](super::AnswerFields::every)) the offset in bytes of the repetition to read.
    pub fn get<'a>(&self, returned: Returned, data: &'a [u8], base: usize) -> Option<Value<'a>> {
        let valid = &data[..data.len().min(returned.len.into())];
        let bytes: &[u8] = match self.position {
            FieldPosition::Return => return Some(self.number(&[returned.ret])),
            FieldPosition::Data(at) => valid.get(base + usize::from(at)..)?,
            // The other positions (parameter, information bytes, reserve, length) occur only in requests.
            _ => return None,
        };
        match self.kind {
            FieldKind::NumberOrText => Some(match bytes {
                [_] | [_, _] | [_, _, _, _] => self.number(bytes),
                text => Value::Bytes(text),
            }),
            FieldKind::Objects { count_at } => {
                let count = valid.get(base + usize::from(count_at)..)?.first_chunk()?;
                Some(Value::Bytes(bytes.get(..4 * usize::from(u16::from_le_bytes(*count)))?))
            }
            _ if self.is_number() => Some(self.number(bytes.get(..self.bytes.into())?)),
            _ if self.bytes > 0 => Some(Value::Bytes(bytes.get(..self.bytes.into())?)),
            _ => Some(Value::Bytes(bytes)),
        }
    }

    /// Extracts the field's bits from the bytes that it shares with others.
    fn number(&self, bytes: &[u8]) -> Value<'static> {
        let number = little_endian(bytes);
        let number = if self.bytes == 0 { number } else { number >> self.shift & self.mask() };
        Value::Number(if self.kind == FieldKind::Signed { (number as i32).into() } else { number.into() })
    }

    /// Writes a number into the field's bits. Other bits of the same bytes keep their values.
    ///
    /// # Errors
    /// The data segment is too short.
    #[inline]
    pub(in crate::xf) fn put(&self, number: u32, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        let (width, arguments) = (usize::from(self.bytes), &mut to.arguments);
        let merged = |before: u32| before & !(self.mask() << self.shift) | number << self.shift;
        match self.position {
            FieldPosition::Parameter | FieldPosition::Return => {
                arguments.parameter = merged(arguments.parameter.into()) as u8
            }
            FieldPosition::Reserve => arguments.reserve = Reserve(merged(arguments.reserve.0.into()) as u16),
            FieldPosition::Length => arguments.len = number as u16,
            FieldPosition::Info(byte) => {
                let bytes = &mut arguments.info[usize::from(byte)..][..width];
                bytes.copy_from_slice(&merged(little_endian(bytes)).to_le_bytes()[..width]);
            }
            FieldPosition::Data(at) => {
                let before = little_endian(segment::get_at(to.data, at.into(), width)?);
                to.put_at(at.into(), &merged(before).to_le_bytes()[..width])?;
            }
        }
        Ok(())
    }

    /// Reads the field's number.
    ///
    /// # Errors
    /// The data segment is too short.
    #[inline]
    pub(in crate::xf) fn take(&self, from: &FieldReader<'_>) -> Result<u32, Malformed> {
        let (width, arguments) = (usize::from(self.bytes), &from.arguments);
        let number = match self.position {
            FieldPosition::Parameter | FieldPosition::Return => arguments.parameter.into(),
            FieldPosition::Reserve => arguments.reserve.0.into(),
            FieldPosition::Length => arguments.len.into(),
            FieldPosition::Info(byte) => little_endian(&arguments.info[usize::from(byte)..][..width]),
            FieldPosition::Data(at) => little_endian(segment::get_at(from.data, at.into(), width)?),
        };
        Ok(number >> self.shift & self.mask())
    }

    /// Converts a number to the field's bits, a negative one to its two's complement.
    ///
    /// # Errors
    /// The number does not fit into the field.
    pub(super) fn checked(&self, number: i64) -> Result<u32, Malformed> {
        let least = if self.kind == FieldKind::Signed { i32::MIN.into() } else { 0 };
        let most = if self.kind == FieldKind::Signed { i32::MAX } else { -1 } as u32 & self.mask();
        if (least..=i64::from(most)).contains(&number) {
            return Ok(number as u32);
        }
        let found = u32::try_from(number).unwrap_or(u32::MAX);
        let allowed = match self.kind {
            FieldKind::Signed => crate::xf::Allowed::Only("-2147483648 to 2147483647"),
            _ => crate::xf::Allowed::Between(0, most),
        };
        Err(Malformed { field: self.name, found, allowed })
    }
}

fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}
