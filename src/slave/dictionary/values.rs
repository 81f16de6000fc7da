//! The stored values of a device, and the slots for reading them.

use std::marker::PhantomData;

use super::object::{Cell, DataType, Object};

/// A Rust type that a [`Slot`] reads a stored value as, such as `u16` for UNSIGNED16.
pub trait Value: Copy {
    /// The data type that an object must have so that its value is of this Rust type.
    const DATA: DataType;

    /// The value in the low bits of the argument, as many bits as the type has.
    fn from_bits(bits: u64) -> Self;

    /// The bits of the value, zero-extended.
    fn to_bits(self) -> u64;
}

macro_rules! values {
    ($($rust:ident $unsigned:ident $data:ident;)*) => {
        $(impl Value for $rust {
            const DATA: DataType = DataType::$data;

            fn from_bits(bits: u64) -> Self {
                bits as Self
            }

            fn to_bits(self) -> u64 {
                (self as $unsigned) as u64
            }
        })*
    };
}

values! {
    i8 u8 I8;
    u8 u8 U8;
    i16 u16 I16;
    u16 u16 U16;
    i32 u32 I32;
    u32 u32 U32;
    i64 u64 I64;
    u64 u64 U64;
}

impl Value for bool {
    const DATA: DataType = DataType::Bool;

    fn from_bits(bits: u64) -> Self {
        bits & 1 != 0
    }

    fn to_bits(self) -> u64 {
        self.into()
    }
}

/// The location of a stored value of type `T` in [`Values`]; made by [`slot`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot<T> {
    cell: u16,
    value: PhantomData<T>,
}

/// Finds the slot of a stored object. To be evaluated at compile time, in a constant.
///
/// # Panics
/// If the table has no stored object of that type at that address. In a constant this is a compile-time error.
pub const fn slot<D, T: Value>(objects: &[Object<D>], index: u16, sub: u8) -> Slot<T> {
    let mut cell = 0;
    let mut n = 0;
    while n < objects.len() {
        let object = &objects[n];
        if object.index == index && sub >= object.first_sub && sub - object.first_sub < object.count {
            assert!(object.data as u8 == T::DATA as u8, "the object has another data type");
            assert!(matches!(object.cell, Cell::Stored { .. }), "the object is not a stored one");
            return Slot { cell: cell + (sub - object.first_sub) as u16, value: PhantomData };
        }
        cell += object.count as u16;
        n += 1;
    }
    panic!("no such object")
}

/// The stored values of one device, one cell for each sub-index of its table. They are allocated once, by [`Self::new`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Values(Box<[u64]>);

impl Values {
    /// The values at power-on: the default of each sub-index in a table of objects.
    pub fn new<D>(objects: &[Object<D>]) -> Self {
        let defaults = objects.iter().flat_map(|object| (0..object.count).map(|_| object.data.encode(object.default)));
        Self(defaults.collect())
    }

    /// The value in a slot.
    pub fn get<T: Value>(&self, slot: Slot<T>) -> T {
        T::from_bits(self.0[usize::from(slot.cell)])
    }

    /// Writes a value on behalf of the device itself, without checking access and range.
    pub fn set<T: Value>(&mut self, slot: Slot<T>, value: T) {
        self.0[usize::from(slot.cell)] = value.to_bits();
    }

    /// Copies the stored values of all objects with an index in `indexes` from `other`, for example when a device saves
    /// or restores its parameters. `objects` is the table of both.
    pub fn copy<D>(&mut self, other: &Self, objects: &[Object<D>], indexes: std::ops::RangeInclusive<u16>) {
        let mut cell = 0;
        for object in objects {
            let cells = cell..cell + usize::from(object.count);
            cell = cells.end;
            if indexes.contains(&object.index) {
                self.0[cells.clone()].copy_from_slice(&other.0[cells]);
            }
        }
    }

    pub(super) fn bits(&self, cell: usize) -> u64 {
        self.0[cell]
    }

    pub(super) fn set_bits(&mut self, cell: usize, bits: u64) {
        self.0[cell] = bits;
    }
}
