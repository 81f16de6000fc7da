//! Where a part of a layout stands, and what goes with it.

use super::{FieldValue, Part, Reader, ValueAnswer, Writer};
use crate::xf::fields::{Field, Kind, Names, Place};
use crate::xf::{Allowed, Malformed};

/// A field before its name and its type are known, and what goes with it on the wire.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// The field.
    pub field: Field,
    /// The number of its bytes.
    pub count: Option<Count>,
    /// A fixed number that goes with it.
    pub fixed: Option<Fixed>,
}

/// `par`.
pub const fn par() -> Spot {
    Spot::new(Place::Parameter)
}

/// `ret`.
pub const fn ret() -> Spot {
    Spot::new(Place::Return)
}

/// An information byte.
pub const fn info(byte: u8) -> Spot {
    Spot::new(Place::Info(byte))
}

/// Word 0x08 of a command.
pub const fn reserve() -> Spot {
    Spot::new(Place::Reserve)
}

/// Word 0x0E of a command, where that is no length.
pub const fn length() -> Spot {
    Spot::new(Place::Length)
}

/// A byte of the data segment.
pub const fn at(byte: u16) -> Spot {
    Spot::new(Place::Data(byte))
}

/// A byte of the data segment from which on the field goes to the end of what is valid. A request need not have it.
pub const fn tail(byte: u16) -> Spot {
    at(byte).or(0)
}

/// An answer that is one value, with its name.
pub const fn value(name: &'static str) -> Spot {
    at(0).named(name)
}

impl Spot {
    const fn new(place: Place) -> Self {
        let (kind, default, counts) = (Kind::Number, None, None);
        Self {
            field: Field { name: "", place, bytes: 0, shift: 0, width: 0, kind, default, counts },
            count: None,
            fixed: None,
        }
    }

    const fn with(self, field: Field) -> Self {
        Self { field, ..self }
    }

    /// A name that is not the one of the Rust field.
    pub const fn named(self, name: &'static str) -> Self {
        self.with(Field { name, ..self.field })
    }

    /// As many bytes, where the type has not as many.
    pub const fn bytes(self, bytes: u8) -> Self {
        self.with(Field { bytes, ..self.field })
    }

    /// Some bits of its bytes.
    pub const fn part(self, shift: u8, width: u8) -> Self {
        self.with(Field { shift, width, ..self.field })
    }

    /// What it holds, where the type does not say it.
    pub const fn kind(self, kind: Kind) -> Self {
        self.with(Field { kind, ..self.field })
    }

    /// It is shown in hexadecimal.
    pub const fn hex(self) -> Self {
        self.kind(Kind::Hex)
    }

    /// It is one of these numbers.
    pub const fn one_of(self, names: Names) -> Self {
        self.kind(Kind::Choice(names))
    }

    /// It is a set of these bits.
    pub const fn bits(self, names: Names) -> Self {
        self.kind(Kind::Bits(names))
    }

    /// What it is in a request that does not name it.
    pub const fn or(self, default: u32) -> Self {
        self.with(Field { default: Some(default), ..self.field })
    }

    /// It counts the bytes of that field, if that is named.
    pub const fn counts(self, field: &'static str) -> Self {
        self.with(Field { counts: Some(field), default: Some(0), ..self.field })
    }

    /// How many bytes it has stands at another spot, as a number of 2 bytes unless that says otherwise. `name` is what
    /// an error calls the number.
    pub const fn counted(self, at: Self, name: &'static str, allowed: Allowed) -> Self {
        let field = at.or(0).of::<u16>("bytes").field;
        Self { count: Some(Count { field, name, allowed, valid: None }), ..self }
    }

    /// What counts has to be valid, too. `name` is what an error calls the length field.
    pub const fn all_valid(self, name: &'static str) -> Self {
        match self.count {
            Some(count) => Self { count: Some(Count { valid: Some(name), ..count }), ..self },
            None => self,
        }
    }

    /// A fixed number stands before it.
    pub const fn after(self, fixed: Fixed) -> Self {
        Self { fixed: Some(fixed), ..self }
    }

    /// The spot of a field with this name, unless it has one, and this type.
    pub const fn of<'d, T: Part<'d>>(self, name: &'static str) -> Self {
        let field = self.field;
        let bytes = if field.bytes > 0 { field.bytes } else { T::BYTES };
        let whole = if bytes > 4 { 0 } else { bytes * 8 };
        self.with(Field {
            name: if field.name.is_empty() { name } else { field.name },
            bytes,
            width: if field.width > 0 { field.width } else { whole },
            kind: if matches!(field.kind, Kind::Number) { T::KIND } else { field.kind },
            ..field
        })
    }

    /// The field of an answer that is such a value.
    pub const fn returned<T: ValueAnswer>(self) -> Field {
        Field { place: T::AT, ..self.of::<T>("").field }
    }

    /// The byte of the data segment where it begins.
    pub const fn byte(&self) -> usize {
        match self.field.place {
            Place::Data(byte) => byte as usize,
            _ => 0,
        }
    }

    /// Writes what stands here.
    #[inline]
    pub fn put<'d, T: Part<'d>>(&self, part: &T, to: &mut Writer<'_>) -> Result<(), Malformed> {
        part.put(self, to)
    }

    /// Reads what stands here.
    #[inline]
    pub fn take<'d, T: Part<'d>>(&self, from: &Reader<'d>) -> Result<T, Malformed> {
        T::take(self, from)
    }
}

/// How many bytes a field has, as a number in another one.
#[derive(Clone, Copy, Debug)]
pub struct Count {
    /// Where the number stands.
    pub field: Field,
    name: &'static str,
    allowed: Allowed,
    valid: Option<&'static str>,
}

impl Count {
    /// The number, if it is allowed.
    fn checked(&self, found: u32) -> Result<u32, Malformed> {
        match self.allowed {
            Allowed::AtMost(most) | Allowed::Between(_, most) if found > most => {
                Err(Malformed { field: self.name, found, allowed: self.allowed })
            }
            _ => Ok(found),
        }
    }

    pub(super) fn put(&self, bytes: usize, to: &mut Writer<'_>) -> Result<(), Malformed> {
        self.field.put(self.checked(u32::try_from(bytes).unwrap_or(u32::MAX))?, to)
    }

    /// The number of a field that begins at byte `begin`.
    ///
    /// `[OURS]` If the length field has more, what is over is left out; if it has less, the request is malformed, where
    /// the length field counts.
    pub(super) fn take(&self, begin: usize, from: &Reader<'_>) -> Result<usize, Malformed> {
        let bytes = self.checked(self.field.take(from)?)? as usize;
        if let Some(name) = self.valid {
            Malformed::at_least(name, from.arguments.len.into(), begin + bytes)?;
        }
        Ok(bytes)
    }
}

/// A number that the manuals fix.
#[derive(Clone, Copy, Debug)]
pub struct Fixed {
    /// Where it stands; its default is the number.
    pub field: Field,
    /// The bits of it that are looked at.
    looked_at: u32,
    name: &'static str,
    allowed: &'static str,
}

impl Fixed {
    /// The default of this spot. `name` is what an error calls it.
    pub const fn new<T: FieldValue>(spot: Spot, looked_at: u32, name: &'static str, allowed: &'static str) -> Self {
        Self { field: spot.of::<T>("number").field, looked_at, name, allowed }
    }

    /// Writes it.
    pub fn put(&self, to: &mut Writer<'_>) -> Result<(), Malformed> {
        self.field.put(self.field.default.unwrap_or(0), to)
    }

    /// Reads it.
    ///
    /// # Errors
    /// It is another one.
    pub fn check(&self, from: &Reader<'_>) -> Result<(), Malformed> {
        let (found, fixed) = (self.field.take(from)?, self.field.default.unwrap_or(0));
        let is_right = found & self.looked_at == fixed & self.looked_at;
        if is_right { Ok(()) } else { Err(Malformed::only(self.name, found, self.allowed)) }
    }
}
