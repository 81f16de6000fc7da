//! A field of a request or an answer.

use crate::xf::layout::{Reader, Writer};
use crate::xf::response::Returned;
use crate::xf::{Malformed, Reserve, segment};

/// Names of values, or of bits, with their numbers.
pub type Names = &'static [(&'static str, u32)];

/// Where a field begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// `par`, byte 0x0D of a command.
    Parameter,
    /// `ret`, byte 0x0D of an answer.
    Return,
    /// An information byte, `i0` to `i3`; a wider field goes on in the next ones.
    Info(u8),
    /// Word 0x08 of a command, which the manuals call reserve.
    Reserve,
    /// Word 0x0E of a command, where that is no length.
    Length,
    /// A byte of the data segment.
    Data(u16),
}

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A number, shown as a decimal one.
    Number,
    /// The same, with a sign.
    Signed,
    /// A number, shown in hexadecimal.
    Hex,
    /// A number of which some have names.
    Named(Names),
    /// A number that has to be one of these.
    Choice(Names),
    /// Bits with names.
    Bits(Names),
    /// A state of CiA 402, as bits of the statusword.
    DriveState,
    /// The abort code of an SDO transfer.
    Abort,
    /// A number of 1, 2 or 4 bytes, or else a text: as the length says.
    NumberOrText,
    /// Bytes to the end of what is valid, or so many.
    Bytes,
    /// A text to the end of what is valid.
    Text,
    /// Objects of a PDO, u32 each; how many of them is the u16 at that byte of the data segment.
    Objects {
        /// Where the number of objects stands.
        count_at: u16,
    },
    /// A set of slaves: bit b of byte k is slave 8 k + b.
    SlaveSet,
}

/// A field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Where it begins.
    pub place: Place,
    /// How many bytes it has, 0 if it goes to the end of what is valid.
    pub bytes: u8,
    /// The lowest of its bits.
    pub shift: u8,
    /// How many bits it has.
    pub width: u8,
    /// What it holds.
    pub kind: Kind,
    /// What it holds if a request does not name it; `None`: it has to be named.
    pub default: Option<u32>,
    /// The field whose bytes it counts, if that is named.
    pub counts: Option<&'static str>,
}

/// A value of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    /// A number.
    Number(i64),
    /// Bytes: of a text, of objects of 4 bytes each, of a set of slaves.
    Bytes(&'a [u8]),
}

impl Field {
    /// Whether it is a number; other fields are bytes.
    pub const fn is_number(&self) -> bool {
        !matches!(self.kind, Kind::Bytes | Kind::Text | Kind::Objects { .. } | Kind::SlaveSet)
    }

    /// The bits of the field.
    const fn mask(&self) -> u32 {
        if self.width >= 32 { u32::MAX } else { (1 << self.width) - 1 }
    }

    /// The value in an answer, the field being `base` bytes further on; `None` if the answer does not have it.
    pub fn get<'a>(&self, returned: Returned, data: &'a [u8], base: usize) -> Option<Value<'a>> {
        let valid = &data[..data.len().min(returned.len.into())];
        let bytes: &[u8] = match self.place {
            Place::Return => return Some(self.number(&[returned.ret])),
            Place::Data(at) => valid.get(base + usize::from(at)..)?,
            // These are fields of requests.
            _ => return None,
        };
        match self.kind {
            Kind::NumberOrText => Some(match bytes {
                [_] | [_, _] | [_, _, _, _] => self.number(bytes),
                text => Value::Bytes(text),
            }),
            Kind::Objects { count_at } => {
                let count = valid.get(base + usize::from(count_at)..)?.first_chunk()?;
                Some(Value::Bytes(bytes.get(..4 * usize::from(u16::from_le_bytes(*count)))?))
            }
            _ if self.is_number() => Some(self.number(bytes.get(..self.bytes.into())?)),
            _ if self.bytes > 0 => Some(Value::Bytes(bytes.get(..self.bytes.into())?)),
            _ => Some(Value::Bytes(bytes)),
        }
    }

    /// The field among the bytes that it shares with others.
    fn number(&self, bytes: &[u8]) -> Value<'static> {
        let number = little_endian(bytes);
        let number = if self.bytes == 0 { number } else { number >> self.shift & self.mask() };
        Value::Number(if self.kind == Kind::Signed { (number as i32).into() } else { number.into() })
    }

    /// Writes a number, and leaves the bits beside it.
    ///
    /// # Errors
    /// The data segment is too short.
    #[inline]
    pub(in crate::xf) fn put(&self, number: u32, to: &mut Writer<'_>) -> Result<(), Malformed> {
        let (width, arguments) = (usize::from(self.bytes), &mut to.arguments);
        let merged = |before: u32| before & !(self.mask() << self.shift) | number << self.shift;
        match self.place {
            Place::Parameter | Place::Return => arguments.parameter = merged(arguments.parameter.into()) as u8,
            Place::Reserve => arguments.reserve = Reserve(merged(arguments.reserve.0.into()) as u16),
            Place::Length => arguments.len = number as u16,
            Place::Info(byte) => {
                let bytes = &mut arguments.info[usize::from(byte)..][..width];
                bytes.copy_from_slice(&merged(little_endian(bytes)).to_le_bytes()[..width]);
            }
            Place::Data(at) => {
                let before = little_endian(segment::get_at(to.data, at.into(), width)?);
                to.put_at(at.into(), &merged(before).to_le_bytes()[..width])?;
            }
        }
        Ok(())
    }

    /// Reads the number.
    ///
    /// # Errors
    /// The data segment is too short.
    #[inline]
    pub(in crate::xf) fn take(&self, from: &Reader<'_>) -> Result<u32, Malformed> {
        let (width, arguments) = (usize::from(self.bytes), &from.arguments);
        let number = match self.place {
            Place::Parameter | Place::Return => arguments.parameter.into(),
            Place::Reserve => arguments.reserve.0.into(),
            Place::Length => arguments.len.into(),
            Place::Info(byte) => little_endian(&arguments.info[usize::from(byte)..][..width]),
            Place::Data(at) => little_endian(segment::get_at(from.data, at.into(), width)?),
        };
        Ok(number >> self.shift & self.mask())
    }

    /// The number as the bits of the field.
    ///
    /// # Errors
    /// It does not fit.
    pub(super) fn checked(&self, number: i64) -> Result<u32, Malformed> {
        let least = if self.kind == Kind::Signed { i32::MIN.into() } else { 0 };
        let most = if self.kind == Kind::Signed { i32::MAX } else { -1 } as u32 & self.mask();
        if (least..=i64::from(most)).contains(&number) {
            return Ok(number as u32);
        }
        let found = u32::try_from(number).unwrap_or(u32::MAX);
        Err(Malformed { field: self.name, found, allowed: crate::xf::Allowed::Between(0, most) })
    }
}

fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}
