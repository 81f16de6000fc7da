//! Layouts: the position of each value of a request or an answer, declared once. Writing, reading and the table of fields
//! follow from the declaration.
//!
//! ```text
//! layout! {
//!     /// What the type is for.
//!     pub struct StateSet {
//!         /// Which slaves.
//!         pub slaves: Slaves = par(),
//!         /// The state they shall reach.
//!         pub state: EtherCatState = info(0),
//!     }
//! }
//! ```
//!
//! - `mod.rs`: the traits: a layout, the content of a field, the value of one field
//! - `field_decl.rs`: the declaration of a field: its position and its properties
//! - `list.rs`: lists of fields that are built at compile time
//! - `declare.rs`: the macro

mod declare;
mod field_decl;
mod list;

pub use field_decl::{ByteCount, FieldDecl, Fixed, at, info, length, par, reserve, ret, tail, value};
pub use list::FieldList;
pub(super) use list::{field_slice, type_of};

pub(super) use declare::{layout, part};

use super::fields::{AnswerFields, FieldKind, FieldPosition};
use super::request::Arguments;
use super::response::Returned;
use super::{Malformed, segment};

/// What a request or an answer is encoded into: the header fields and the data segment.
#[derive(Debug)]
pub struct FieldWriter<'a> {
    /// The header fields. `parameter` is a command's parameter, or an answer's return byte.
    pub arguments: Arguments,
    /// The data segment.
    pub data: &'a mut [u8],
}

impl<'a> FieldWriter<'a> {
    pub fn new(data: &'a mut [u8]) -> Self {
        Self { arguments: Arguments::NONE, data }
    }

    /// Writes bytes from byte `at` of the data segment on, and marks them as valid.
    ///
    /// # Errors
    /// The data segment is shorter than `at` and the number of bytes together.
    pub fn put_at(&mut self, at: usize, bytes: &[u8]) -> Result<(), Malformed> {
        let end = segment::put_at(self.data, at, bytes)?;
        self.arguments.len = self.arguments.len.max(end);
        Ok(())
    }

    /// The return byte and the length that were written, as the header fields of an answer.
    pub fn returned(&self) -> Returned {
        Returned { ret: self.arguments.parameter, len: self.arguments.len }
    }
}

/// What a request or an answer is decoded from: the header fields and the data segment.
#[derive(Clone, Copy, Debug)]
pub struct FieldReader<'d> {
    /// The header fields. `parameter` is a command's parameter, or an answer's return byte.
    pub arguments: Arguments,
    /// The data segment.
    pub data: &'d [u8],
}

impl<'d> FieldReader<'d> {
    /// Reads an answer from its return byte, its length and its data segment.
    pub fn of(returned: Returned, data: &'d [u8]) -> Self {
        Self { arguments: Arguments { parameter: returned.ret, len: returned.len, ..Arguments::NONE }, data }
    }
}

/// A type whose values have positions in the header and in the data segment.
pub trait FieldLayout<'d>: Sized {
    /// The fields of the layout, in the order of their positions.
    const FIELDS: FieldList;
    /// The size of the data segment that the layout needs, in bytes.
    const END: usize = Self::FIELDS.end();

    /// Writes each value at its position. Fails if the data segment is too short, or if a value exceeds a limit of the
    /// chip.
    fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed>;

    /// Reads each value from its position. Fails if the data segment is too short, or if the manuals do not allow a
    /// value.
    fn take(from: &FieldReader<'d>) -> Result<Self, Malformed>;

    /// Encodes the values into a data segment that is all 0. All bytes up to [`Self::END`] are then valid.
    fn encoded(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let mut to = FieldWriter::new(data);
        to.put_at(Self::END, &[])?;
        self.put(&mut to)?;
        Ok(to.arguments)
    }

    /// Decodes the values; fails if the segment is too short.
    fn decoded(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
        segment::get_at(data, 0, Self::END)?;
        Self::take(&FieldReader { arguments: *arguments, data })
    }

    /// Like [`Self::encoded`], for an answer.
    fn answered(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.encoded(data).map(|arguments| Returned { ret: arguments.parameter, len: arguments.len })
    }

    /// Like [`Self::decoded`], for an answer, using only its valid bytes.
    fn of_answer(returned: Returned, data: &'d [u8]) -> Result<Self, Malformed> {
        let FieldReader { arguments, data } = FieldReader::of(returned, returned.valid(data)?);
        Self::decoded(&arguments, data)
    }
}

/// The possible forms of an answer, each with its length and its fields.
pub trait Forms {
    /// The forms in the order in which they are tried; the length of an answer selects its form.
    const FORMS: &'static [AnswerFields];
}

/// A value that is a number in one field.
pub trait FieldValue: Copy {
    /// The field's size in bytes, unless the layout says otherwise.
    const BYTES: u8;
    /// The field's kind, unless the layout says otherwise.
    const KIND: FieldKind;

    /// The value as the number that the field contains.
    fn number(self) -> u32;

    /// The value with that number.
    ///
    /// # Errors
    /// The manuals do not allow the number.
    fn of(number: u32) -> Result<Self, Malformed>;
}

/// Implements [`FieldValue`] for types: size, kind, conversion to a number, conversion from a number.
macro_rules! field_values {
    ($($type:ty, $bytes:literal, $kind:expr, |$value:ident| $number:expr, |$found:ident| $read:expr;)*) => {$(
        impl $crate::xf::layout::FieldValue for $type {
            const BYTES: u8 = $bytes;
            const KIND: $crate::xf::fields::FieldKind = $kind;

            fn number(self) -> u32 {
                let $value = self;
                $number
            }

            fn of($found: u32) -> Result<Self, $crate::xf::Malformed> {
                $read
            }
        }
    )*};
}

pub(super) use field_values;

field_values! {
    u8, 1, FieldKind::Number, |value| value.into(), |number| Ok(number as u8);
    u16, 2, FieldKind::Number, |value| value.into(), |number| Ok(number as u16);
    u32, 4, FieldKind::Number, |value| value, |number| Ok(number);
    i32, 4, FieldKind::Signed, |value| value as u32, |number| Ok(number as i32);
}

/// A type that can be the content of a field: a number, or bytes.
pub trait FieldContent<'d>: Sized {
    /// The size in bytes, unless the layout says otherwise; 0 if the content extends to the end of the valid data.
    const BYTES: u8;
    /// The kind of the content, unless the layout says otherwise.
    const KIND: FieldKind;

    /// Writes the content at its position, which `decl` declares, and the numbers that belong to it: its byte count and
    /// a fixed number, if declared. Fails if the data segment is too short, or if the content is longer than allowed.
    fn put(&self, decl: &FieldDecl, to: &mut FieldWriter<'_>) -> Result<(), Malformed>;

    /// Reads the content from its position, which `decl` declares. Fails if the data segment is too short, or if the
    /// manuals do not allow the content.
    fn take(decl: &FieldDecl, from: &FieldReader<'d>) -> Result<Self, Malformed>;
}

impl<T: FieldValue> FieldContent<'_> for T {
    const BYTES: u8 = T::BYTES;
    const KIND: FieldKind = T::KIND;

    #[inline]
    fn put(&self, decl: &FieldDecl, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        if let Some(fixed) = &decl.fixed {
            fixed.put(to)?;
        }
        decl.field.put(self.number(), to)
    }

    #[inline]
    fn take(decl: &FieldDecl, from: &FieldReader<'_>) -> Result<Self, Malformed> {
        if let Some(fixed) = &decl.fixed {
            fixed.check(from)?;
        }
        Self::of(decl.field.take(from)?)
    }
}

impl<const N: usize> FieldContent<'_> for [u8; N] {
    const BYTES: u8 = N as u8;
    const KIND: FieldKind = FieldKind::Bytes;

    #[inline]
    fn put(&self, decl: &FieldDecl, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        to.put_at(decl.byte(), self)
    }

    #[inline]
    fn take(decl: &FieldDecl, from: &FieldReader<'_>) -> Result<Self, Malformed> {
        segment::get(segment::get_at(from.data, decl.byte(), N)?)
    }
}

/// Bytes of variable length, given by a count or by the length field.
impl<'d> FieldContent<'d> for &'d [u8] {
    const BYTES: u8 = 0;
    const KIND: FieldKind = FieldKind::Bytes;

    #[inline]
    fn put(&self, decl: &FieldDecl, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        if let Some(count) = &decl.count {
            count.put(self.len(), to)?;
        }
        if matches!(decl.field.kind, FieldKind::Text) && self.contains(&0) {
            return Err(Malformed::only("a byte of the file name", 0, "1 to 255"));
        }
        to.put_at(decl.byte(), self)
    }

    #[inline]
    fn take(decl: &FieldDecl, from: &FieldReader<'d>) -> Result<Self, Malformed> {
        let begin = decl.byte();
        let named = usize::from(from.arguments.len).saturating_sub(begin);
        match &decl.count {
            Some(count) => segment::get_at(from.data, begin, count.take(begin, from)?),
            None if matches!(decl.field.kind, FieldKind::Text) => {
                Ok(text(from.data.get(begin..).unwrap_or_default(), named))
            }
            None => segment::get_at(from.data, begin, named),
        }
    }
}

/// A text at the end of the data.
///
/// `[OURS]` The text ends where the length field says, or before that at the first byte 0. A length field that ends
/// before the text is ignored, since the chip reads fixed layouts whatever the length says.
fn text(rest: &[u8], named: usize) -> &[u8] {
    let rest = if named == 0 { rest } else { &rest[..named.min(rest.len())] };
    rest.split(|byte| *byte == 0).next().unwrap_or_default()
}

/// An answer that is a single value at a fixed position.
pub trait ValueAnswer: FieldValue {
    /// Where the value is in the answer: in the return byte, or at a byte of the data segment.
    const AT: FieldPosition;
}
