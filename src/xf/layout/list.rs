//! Lists of fields that are built at compile time.

use super::{ByteCount, FieldDecl, Fixed};
use crate::xf::fields::{Field, FieldPosition};

/// The fields of a layout in the order of their positions, each name once.
#[derive(Clone, Copy, Debug)]
pub struct FieldList {
    fields: [Field; Self::MOST],
    len: usize,
}

impl FieldList {
    /// The maximum number of fields of a request or an answer.
    const MOST: usize = 12;
    /// A list without fields, to which [`Self::with`] and [`Self::and`] add fields.
    pub const NONE: Self = Self { fields: [super::par().field; Self::MOST], len: 0 };

    /// The list of a declared field alone, with its byte count and its fixed number if it has them.
    pub const fn of(decl: FieldDecl) -> Self {
        let list = match decl.count {
            Some(ByteCount { field, .. }) => Self::NONE.with(Field { counts: Some(decl.field.name), ..field }),
            None => Self::NONE,
        };
        match decl.fixed {
            Some(Fixed { field, .. }) => list.with(field).with(decl.field),
            None => list.with(decl.field),
        }
    }

    /// Adds the fields of another list in the order of positions. A field is left out if this list has one of the same
    /// name.
    pub const fn and(mut self, other: Self) -> Self {
        let mut n = 0;
        while n < other.len {
            self = self.with(other.fields[n]);
            n += 1;
        }
        self
    }

    /// Appends a declared field at the end, whatever its position.
    pub const fn then(mut self, decl: FieldDecl) -> Self {
        self.fields[self.len] = decl.field;
        self.len += 1;
        self
    }

    /// Inserts a field in the order of positions, unless the list has a field of that name.
    pub const fn with(mut self, field: Field) -> Self {
        let mut n = 0;
        while n < self.len {
            if same(self.fields[n].name, field.name) {
                return self;
            }
            n += 1;
        }
        while n > 0 && order(&self.fields[n - 1]) > order(&field) {
            self.fields[n] = self.fields[n - 1];
            n -= 1;
        }
        self.fields[n] = field;
        self.len += 1;
        self
    }

    /// The list with the field `first` before all others. [`Self::with`] keeps fields in the order of their positions;
    /// `after` ignores that order.
    pub const fn after(self, first: Field) -> Self {
        let (mut list, mut n) = (Self::NONE.with(first), 0);
        while n < self.len {
            list.fields[n + 1] = self.fields[n];
            n += 1;
        }
        list.len += n;
        list
    }

    /// Converts the fields to those of an answer: `par` becomes `ret`, and byte counts are left out, since the field
    /// that they count shows its own length.
    pub const fn returned(self) -> Self {
        let (mut list, mut n) = (Self::NONE, 0);
        while n < self.len {
            let field = self.fields[n];
            if field.counts.is_none() {
                let position = if matches!(field.position, FieldPosition::Parameter) {
                    FieldPosition::Return
                } else {
                    field.position
                };
                list = list.with(Field { position, ..field });
            }
            n += 1;
        }
        list
    }

    /// The end of the last field in the data segment; for a field of variable length, its beginning.
    pub const fn end(&self) -> usize {
        let (mut end, mut n) = (0, 0);
        while n < self.len {
            if let FieldPosition::Data(byte) = self.fields[n].position {
                let field_end = byte as usize + self.fields[n].bytes as usize;
                end = if field_end > end { field_end } else { end };
            }
            n += 1;
        }
        end
    }

    /// The number of fields in the list, at most 12.
    pub const fn len(&self) -> usize {
        self.len
    }

    /// The fields as an array of exactly `N` fields, the length of the list.
    pub const fn array<const N: usize>(&self) -> [Field; N] {
        let (mut fields, mut n) = ([self.fields[0]; N], 0);
        while n < N {
            fields[n] = self.fields[n];
            n += 1;
        }
        fields
    }
}

/// Turns a list into a slice with static lifetime.
macro_rules! field_slice {
    ($list:expr) => {{
        const LIST: $crate::xf::layout::FieldList = $list;
        const FIELDS: [$crate::xf::fields::Field; LIST.len()] = LIST.array();
        &FIELDS
    }};
}

/// Expands to the type itself; if it has a lifetime parameter, the parameter becomes `'static`.
macro_rules! type_of {
    ($name:ident) => { $name };
    ($name:ident <$life:lifetime>) => { $name<'static> };
}

pub(in crate::xf) use {field_slice, type_of};

const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut n = 0;
    while n < a.len() && n < b.len() && a[n] == b[n] {
        n += 1;
    }
    n == a.len() && n == b.len()
}

/// Sort key of a field's position: header fields come before the data segment.
const fn order(field: &Field) -> u32 {
    let (part, byte) = match field.position {
        FieldPosition::Parameter | FieldPosition::Return => (0, 0),
        FieldPosition::Info(byte) => (1, byte as u32),
        FieldPosition::Reserve => (2, 0),
        FieldPosition::Length => (3, 0),
        FieldPosition::Data(byte) => (4, byte as u32),
    };
    part << 28 | byte << 8 | field.shift as u32
}
