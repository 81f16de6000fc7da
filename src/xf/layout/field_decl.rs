//! The declaration of a field in a layout: its position and its properties.

use super::{FieldContent, FieldReader, FieldValue, FieldWriter, ValueAnswer};
use crate::xf::fields::{Field, FieldKind, FieldPosition, Names};
use crate::xf::{Allowed, Malformed};

/// The declaration of a field: its position and the properties declared with it. [`Self::of`] then adds the name and
/// the properties of the Rust type. A field may have two more numbers on the wire: one that counts its bytes, and a
/// fixed one.
#[derive(Clone, Copy, Debug)]
pub struct FieldDecl {
    /// The field. Its name, size, width and kind may be missing until [`FieldDecl::of`] adds them.
    pub field: Field,
    /// The number on the wire that counts the field's bytes.
    pub count: Option<ByteCount>,
    /// A fixed number on the wire, which is written and checked together with the field.
    pub fixed: Option<Fixed>,
}

/// A field in the parameter byte of a command, `par`.
pub const fn par() -> FieldDecl {
    FieldDecl::new(FieldPosition::Parameter)
}

/// A field in the return byte of an answer, `ret`.
pub const fn ret() -> FieldDecl {
    FieldDecl::new(FieldPosition::Return)
}

/// A field that begins in an information byte of a command: byte 0 is `i0`, byte 3 is `i3`.
pub const fn info(byte: u8) -> FieldDecl {
    FieldDecl::new(FieldPosition::Info(byte))
}

/// A field in word 0x08 of a command, which the manuals call reserve.
pub const fn reserve() -> FieldDecl {
    FieldDecl::new(FieldPosition::Reserve)
}

/// A field in word 0x0E of a command, for commands in which this word is not a length.
pub const fn length() -> FieldDecl {
    FieldDecl::new(FieldPosition::Length)
}

/// A field that begins at this byte of the data segment.
pub const fn at(byte: u16) -> FieldDecl {
    FieldDecl::new(FieldPosition::Data(byte))
}

/// A field from a byte of the data segment to the end of the valid data. In a request it may be empty.
pub const fn tail(byte: u16) -> FieldDecl {
    at(byte).or(0)
}

/// Declares the field of an answer that is a single value. Only its name is given here: [`ValueAnswer::AT`] of the
/// value's type is its position.
pub const fn value(name: &'static str) -> FieldDecl {
    at(0).named(name)
}

impl FieldDecl {
    const fn new(position: FieldPosition) -> Self {
        let (kind, default, counts) = (FieldKind::Number, None, None);
        Self {
            field: Field { name: "", position, bytes: 0, shift: 0, width: 0, kind, default, counts },
            count: None,
            fixed: None,
        }
    }

    const fn with(self, field: Field) -> Self {
        Self { field, ..self }
    }

    /// Sets the field's name, if it differs from that of the Rust field.
    pub const fn named(self, name: &'static str) -> Self {
        self.with(Field { name, ..self.field })
    }

    /// Sets the field's size in bytes, if it differs from that of the type.
    pub const fn bytes(self, bytes: u8) -> Self {
        self.with(Field { bytes, ..self.field })
    }

    /// Limits the field to `width` bits of its bytes, from bit `shift` on.
    pub const fn part(self, shift: u8, width: u8) -> Self {
        self.with(Field { shift, width, ..self.field })
    }

    /// Sets how the content is interpreted and shown, if the type does not define it.
    pub const fn kind(self, kind: FieldKind) -> Self {
        self.with(Field { kind, ..self.field })
    }

    /// Shows the field in hexadecimal.
    pub const fn hex(self) -> Self {
        self.kind(FieldKind::Hex)
    }

    /// Limits the field to these named numbers.
    pub const fn one_of(self, names: Names) -> Self {
        self.kind(FieldKind::Choice(names))
    }

    /// Makes the field a set of these named bits.
    pub const fn bits(self, names: Names) -> Self {
        self.kind(FieldKind::Bits(names))
    }

    /// Sets the default: the value of the field in a request that does not set it.
    pub const fn or(self, default: u32) -> Self {
        self.with(Field { default: Some(default), ..self.field })
    }

    /// Makes the field contain the number of bytes of another field, if a request sets that other field.
    pub const fn counts(self, field: &'static str) -> Self {
        self.with(Field { counts: Some(field), default: Some(0), ..self.field })
    }

    /// Makes another field contain the number of bytes of this field. `at` declares the position of that other field,
    /// which has 2 bytes unless `at` sets its size. `name` is the name of that other field in errors, and `allowed`
    /// limits the number of bytes.
    pub const fn counted(self, at: Self, name: &'static str, allowed: Allowed) -> Self {
        let field = at.or(0).of::<u16>("bytes").field;
        Self { count: Some(ByteCount { field, name, allowed, valid: None }), ..self }
    }

    /// Requires that the length field of the header also covers the counted bytes. `name` is the name of the length field
    /// in errors.
    pub const fn all_valid(self, name: &'static str) -> Self {
        match self.count {
            Some(count) => Self { count: Some(ByteCount { valid: Some(name), ..count }), ..self },
            None => self,
        }
    }

    /// Adds a fixed number with a position of its own, such as a key that the manuals prescribe. It is written before
    /// the field, and checked when the field is read.
    pub const fn after(self, fixed: Fixed) -> Self {
        Self { fixed: Some(fixed), ..self }
    }

    /// Completes the declaration of a field: adds the name of the Rust field, unless the declaration has one, and the
    /// properties of its type.
    pub const fn of<'d, T: FieldContent<'d>>(self, name: &'static str) -> Self {
        let field = self.field;
        let bytes = if field.bytes > 0 { field.bytes } else { T::BYTES };
        let whole = if bytes > 4 { 0 } else { bytes * 8 };
        self.with(Field {
            name: if field.name.is_empty() { name } else { field.name },
            bytes,
            width: if field.width > 0 { field.width } else { whole },
            kind: if matches!(field.kind, FieldKind::Number) { T::KIND } else { field.kind },
            ..field
        })
    }

    /// The declared field with the size, kind and position of the type `T`, for an answer that is a single value.
    pub const fn returned<T: ValueAnswer>(self) -> Field {
        Field { position: T::AT, ..self.of::<T>("").field }
    }

    /// The offset in the data segment at which the field begins, in bytes; 0 for a field in the header.
    pub const fn byte(&self) -> usize {
        match self.field.position {
            FieldPosition::Data(byte) => byte as usize,
            _ => 0,
        }
    }

    /// Writes the content at the field's position.
    #[inline]
    pub fn put<'d, T: FieldContent<'d>>(&self, part: &T, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        part.put(self, to)
    }

    /// Reads the content from the field's position.
    #[inline]
    pub fn take<'d, T: FieldContent<'d>>(&self, from: &FieldReader<'d>) -> Result<T, Malformed> {
        T::take(self, from)
    }
}

/// A number on the wire that counts the bytes of a field of variable length.
#[derive(Clone, Copy, Debug)]
pub struct ByteCount {
    /// The field that contains the number of bytes.
    pub field: Field,
    name: &'static str,
    allowed: Allowed,
    valid: Option<&'static str>,
}

impl ByteCount {
    /// Returns the number of bytes; fails if it is above the allowed maximum.
    fn checked(&self, found: u32) -> Result<u32, Malformed> {
        match self.allowed {
            Allowed::AtMost(most) | Allowed::Between(_, most) if found > most => {
                Err(Malformed { field: self.name, found, allowed: self.allowed })
            }
            _ => Ok(found),
        }
    }

    pub(super) fn put(&self, bytes: usize, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        self.field.put(self.checked(u32::try_from(bytes).unwrap_or(u32::MAX))?, to)
    }

    /// Reads the size of the field that begins at byte `begin`.
    ///
    /// `[OURS]` Valid bytes beyond this size are ignored. If fewer bytes are valid, a request is malformed only if the
    /// field is declared with [`FieldDecl::all_valid`].
    pub(super) fn take(&self, begin: usize, from: &FieldReader<'_>) -> Result<usize, Malformed> {
        let bytes = self.checked(self.field.take(from)?)? as usize;
        if let Some(name) = self.valid {
            Malformed::at_least(name, from.arguments.len.into(), begin + bytes)?;
        }
        Ok(bytes)
    }
}

/// A number whose value the manuals prescribe, such as the key 0x5A in 402_CTL_SET.
#[derive(Clone, Copy, Debug)]
pub struct Fixed {
    /// The field that contains the number. The fixed value is the field's default.
    pub field: Field,
    /// Mask of the bits that are compared with the fixed number when the field is read; other bits may have any value.
    looked_at: u32,
    name: &'static str,
    allowed: &'static str,
}

impl Fixed {
    /// Makes the default of the declared field a fixed number. Only the bits in `looked_at` are compared, and errors name
    /// the number `name`.
    pub const fn new<T: FieldValue>(
        decl: FieldDecl,
        looked_at: u32,
        name: &'static str,
        allowed: &'static str,
    ) -> Self {
        Self { field: decl.of::<T>("number").field, looked_at, name, allowed }
    }

    /// Writes the fixed number, which is the field's default, into the field.
    pub fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        self.field.put(self.field.default.unwrap_or(0), to)
    }

    /// Reads the number and compares it.
    ///
    /// # Errors
    /// The number differs from the fixed one.
    pub fn check(&self, from: &FieldReader<'_>) -> Result<(), Malformed> {
        let (found, fixed) = (self.field.take(from)?, self.field.default.unwrap_or(0));
        let is_right = found & self.looked_at == fixed & self.looked_at;
        if is_right { Ok(()) } else { Err(Malformed::only(self.name, found, self.allowed)) }
    }
}
