//! Layouts: where each value of a request or an answer stands, said once. How it is written, how it is read and its
//! table of fields follow from that.
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
//! - `mod.rs`: the traits: a layout, a part of it, a value of one field
//! - `spot.rs`: where a part stands, and what goes with it
//! - `list.rs`: lists of fields that are made while the crate is compiled
//! - `declare.rs`: the macro

mod declare;
mod list;
mod spot;

pub use list::FieldList;
pub(super) use list::{field_slice, type_of};
pub use spot::{Count, Fixed, Spot, at, info, length, par, reserve, ret, tail, value};

pub(super) use declare::{layout, part};

use super::fields::{AnswerFields, Kind, Place};
use super::request::Arguments;
use super::response::Returned;
use super::{Malformed, segment};

/// What a request or an answer is written into.
#[derive(Debug)]
pub struct Writer<'a> {
    /// The fields of the header. The parameter of a command is the return byte of an answer.
    pub arguments: Arguments,
    /// The data segment.
    pub data: &'a mut [u8],
}

impl<'a> Writer<'a> {
    pub fn new(data: &'a mut [u8]) -> Self {
        Self { arguments: Arguments::NONE, data }
    }

    /// Writes bytes from byte `at` of the data segment on, which are valid then.
    ///
    /// # Errors
    /// The segment is shorter.
    pub fn put_at(&mut self, at: usize, bytes: &[u8]) -> Result<(), Malformed> {
        let end = segment::put_at(self.data, at, bytes)?;
        self.arguments.len = self.arguments.len.max(end);
        Ok(())
    }

    /// The fields of the header of an answer.
    pub fn returned(&self) -> Returned {
        Returned { ret: self.arguments.parameter, len: self.arguments.len }
    }
}

/// What a request or an answer is read from.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'d> {
    /// The fields of the header. The parameter of a command is the return byte of an answer.
    pub arguments: Arguments,
    /// The data segment.
    pub data: &'d [u8],
}

impl<'d> Reader<'d> {
    /// An answer.
    pub fn of(returned: Returned, data: &'d [u8]) -> Self {
        Self { arguments: Arguments { parameter: returned.ret, len: returned.len, ..Arguments::NONE }, data }
    }
}

/// A type whose values have places in the header and the data segment.
pub trait Layout<'d>: Sized {
    /// Its fields.
    const FIELDS: FieldList;
    /// How many bytes of the data segment there have to be.
    const END: usize = Self::FIELDS.end();

    /// Writes the values.
    fn put(&self, to: &mut Writer<'_>) -> Result<(), Malformed>;

    /// Reads the values.
    fn take(from: &Reader<'d>) -> Result<Self, Malformed>;

    /// Writes the values into a segment that is all 0. All bytes up to [`Self::END`] are valid then.
    fn encoded(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let mut to = Writer::new(data);
        to.put_at(Self::END, &[])?;
        self.put(&mut to)?;
        Ok(to.arguments)
    }

    /// Reads the values from a segment that may be too short.
    fn decoded(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
        segment::get_at(data, 0, Self::END)?;
        Self::take(&Reader { arguments: *arguments, data })
    }

    /// As [`Self::encoded`], for an answer.
    fn answered(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.encoded(data).map(|arguments| Returned { ret: arguments.parameter, len: arguments.len })
    }

    /// As [`Self::decoded`], for an answer, of which the valid bytes count.
    fn of_answer(returned: Returned, data: &'d [u8]) -> Result<Self, Malformed> {
        let Reader { arguments, data } = Reader::of(returned, returned.valid(data)?);
        Self::decoded(&arguments, data)
    }
}

/// An answer as fields.
pub trait Forms {
    /// The forms that it can have.
    const FORMS: &'static [AnswerFields];
}

/// A value of one field, which is a number.
pub trait FieldValue: Copy {
    /// How many bytes the field has where nothing else is said.
    const BYTES: u8;
    /// What the field holds where nothing else is said.
    const KIND: Kind;

    /// The number.
    fn number(self) -> u32;

    /// The value with that number.
    ///
    /// # Errors
    /// The manuals do not allow it.
    fn of(number: u32) -> Result<Self, Malformed>;
}

/// Types as [`FieldValue`]s: bytes, kind, the value as a number, the number as a value.
macro_rules! field_values {
    ($($type:ty, $bytes:literal, $kind:expr, |$value:ident| $number:expr, |$found:ident| $read:expr;)*) => {$(
        impl $crate::xf::layout::FieldValue for $type {
            const BYTES: u8 = $bytes;
            const KIND: $crate::xf::fields::Kind = $kind;

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
    u8, 1, Kind::Number, |value| value.into(), |number| Ok(number as u8);
    u16, 2, Kind::Number, |value| value.into(), |number| Ok(number as u16);
    u32, 4, Kind::Number, |value| value, |number| Ok(number);
    i32, 4, Kind::Signed, |value| value as u32, |number| Ok(number as i32);
}

/// What stands at a spot: a number, or bytes.
pub trait Part<'d>: Sized {
    /// How many bytes it has where nothing else is said; 0 if it goes to the end of what is valid.
    const BYTES: u8;
    /// What it holds where nothing else is said.
    const KIND: Kind;

    /// Writes it.
    fn put(&self, spot: &Spot, to: &mut Writer<'_>) -> Result<(), Malformed>;

    /// Reads it.
    fn take(spot: &Spot, from: &Reader<'d>) -> Result<Self, Malformed>;
}

impl<T: FieldValue> Part<'_> for T {
    const BYTES: u8 = T::BYTES;
    const KIND: Kind = T::KIND;

    #[inline]
    fn put(&self, spot: &Spot, to: &mut Writer<'_>) -> Result<(), Malformed> {
        if let Some(fixed) = &spot.fixed {
            fixed.put(to)?;
        }
        spot.field.put(self.number(), to)
    }

    #[inline]
    fn take(spot: &Spot, from: &Reader<'_>) -> Result<Self, Malformed> {
        if let Some(fixed) = &spot.fixed {
            fixed.check(from)?;
        }
        Self::of(spot.field.take(from)?)
    }
}

impl<const N: usize> Part<'_> for [u8; N] {
    const BYTES: u8 = N as u8;
    const KIND: Kind = Kind::Bytes;

    #[inline]
    fn put(&self, spot: &Spot, to: &mut Writer<'_>) -> Result<(), Malformed> {
        to.put_at(spot.byte(), self)
    }

    #[inline]
    fn take(spot: &Spot, from: &Reader<'_>) -> Result<Self, Malformed> {
        segment::get(segment::get_at(from.data, spot.byte(), N)?)
    }
}

/// Bytes that go on as far as a count or the length field says.
impl<'d> Part<'d> for &'d [u8] {
    const BYTES: u8 = 0;
    const KIND: Kind = Kind::Bytes;

    #[inline]
    fn put(&self, spot: &Spot, to: &mut Writer<'_>) -> Result<(), Malformed> {
        if let Some(count) = &spot.count {
            count.put(self.len(), to)?;
        }
        if matches!(spot.field.kind, Kind::Text) && self.contains(&0) {
            return Err(Malformed::only("a byte of the file name", 0, "1 to 255"));
        }
        to.put_at(spot.byte(), self)
    }

    #[inline]
    fn take(spot: &Spot, from: &Reader<'d>) -> Result<Self, Malformed> {
        let begin = spot.byte();
        let named = usize::from(from.arguments.len).saturating_sub(begin);
        match &spot.count {
            Some(count) => segment::get_at(from.data, begin, count.take(begin, from)?),
            None if matches!(spot.field.kind, Kind::Text) => {
                Ok(text(from.data.get(begin..).unwrap_or_default(), named))
            }
            None => segment::get_at(from.data, begin, named),
        }
    }
}

/// A text at the end of the data.
///
/// `[OURS]` It ends where the length field says, or before that at the first byte 0; a length field that leaves no text
/// is not believed, since the chip reads fixed layouts whatever the length says.
fn text(rest: &[u8], named: usize) -> &[u8] {
    let rest = if named == 0 { rest } else { &rest[..named.min(rest.len())] };
    rest.split(|byte| *byte == 0).next().unwrap_or_default()
}

/// An answer that is one value, which has its place.
pub trait ValueAnswer: FieldValue {
    /// Where it stands.
    const AT: Place;
}
