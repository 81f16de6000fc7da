//! Object dictionaries as tables: one row contains everything that an SDO transfer needs to know about an object.
//!
//! A kind of device lists its objects in a constant slice of [`Object`], ascending by address, and implements [`Device`].
//! [`read`] and [`write()`] transfer any object of the table and return the standard abort codes; [`upload`] and
//! [`download`] do the same for values of at most 4 bytes. There are two ways to keep the value of a row:
//!
//! - *stored*: in the [`Values`] of the device. The device reads the value through a [`Slot`], which is resolved at compile
//!   time, so that there is neither a search nor a type error at run time.
//! - *live*: in a field of the device, behind accessor functions. Values that a cycle transfers are live.
//!
//! [`object_from`], [`describe_object`] and [`describe_entry`] describe the objects of a table, for masters that use SDO
//! information.
//!
//! ```
//! use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
//! use ecmsk::ethercat::AlState;
//! use ecmsk::slave::dictionary::{self, Device, Object, Slot, Values, check, slot};
//!
//! struct Heater { values: Values, celsius: i16 }
//!
//! const OBJECTS: &[Object<Heater>] = &[
//!     Object::u16(0x2000, 0, "Setpoint").rw().range(0, 300).default(20),
//!     Object::i16(0x2001, 0, "Temperature").live(|heater| heater.celsius.into()),
//! ];
//! const _: () = check(OBJECTS);
//! const SETPOINT: Slot<u16> = slot(OBJECTS, 0x2000, 0);
//!
//! impl Device for Heater {
//!     fn objects() -> &'static [Object<Self>] { OBJECTS }
//!     fn values(&self) -> &Values { &self.values }
//!     fn values_mut(&mut self) -> &mut Values { &mut self.values }
//!     fn al_state(&self) -> AlState { AlState::PreOp }
//! }
//!
//! let mut heater = Heater { values: Values::new(OBJECTS), celsius: -4 };
//! dictionary::download(&mut heater, ObjectAddress::new(0x2000, 0), SdoSize::Two, 90).unwrap();
//! assert_eq!(heater.values.get(SETPOINT), 90);
//! let hot = dictionary::download(&mut heater, ObjectAddress::new(0x2000, 0), SdoSize::Two, 301);
//! assert_eq!(hot, Err(AbortCode::VALUE_HIGH));
//! ```

mod complete;
mod information;
mod object;
mod values;

pub use crate::ethercat::coe::DataTypeCode;
pub use information::{
    EntryDescription, EntryValues, MAPPING_ACCESS, NUMBER_OF_ENTRIES, ObjectDescription, access_of, describe_entry,
    describe_object, is_listed, object_from,
};
pub use object::{Access, DataType, Object, PdoDirection, check, join, only_if, rows};
pub use values::{Slot, Value, Values, slot};

use super::SdoValue;
use crate::ethercat::AlState;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use object::Cell;

/// A device with an object dictionary.
pub trait Device: Sized + 'static {
    /// The table of objects, ascending by address. Apply [`check`] to it in a constant.
    fn objects() -> &'static [Object<Self>];

    /// The stored values of the device's objects, for uploads.
    fn values(&self) -> &Values;

    /// The stored values of the device's objects, mutable for downloads.
    fn values_mut(&mut self) -> &mut Values;

    /// The AL state, which decides whether some objects can be written.
    fn al_state(&self) -> AlState;
}

/// SDO upload of a value of at most 4 bytes, or of the first 4 bytes of a longer one.
///
/// # Errors
/// The abort codes of [`read`].
pub fn upload<D: Device>(device: &D, at: ObjectAddress) -> Result<SdoValue, AbortCode> {
    SdoValue::of(|value| read(device, at, SdoScope::Entry, value))
}

/// SDO download of 1, 2 or 4 bytes.
///
/// # Errors
/// The abort codes of [`write()`].
pub fn download<D: Device>(device: &mut D, at: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
    write(device, at, SdoScope::Entry, &value.to_le_bytes()[..size.bytes().into()])
}

/// SDO upload: copies the value into `value`, as far as there is room. Returns the length of the whole value, bytes.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`], [`AbortCode::NO_SUB_INDEX`], [`AbortCode::WRITE_ONLY`]. With complete access:
/// [`AbortCode::UNSUPPORTED_ACCESS`] for a start at another sub-index than 0 or 1, [`AbortCode::COMPLETE_ACCESS`] for a
/// text.
pub fn read<D: Device>(device: &D, at: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
    match scope {
        SdoScope::Entry => read_entry(device, at, value),
        SdoScope::Complete => complete::read(device, at, value),
    }
}

/// SDO download of a whole value.
///
/// The order of the checks is \[OURS]: the object exists, is writable, has this size, is writable in the present AL
/// state, and the value is in its range. The row's own check ([`Object::accept`] or the setter) comes last.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`], [`AbortCode::NO_SUB_INDEX`], [`AbortCode::READ_ONLY`], [`AbortCode::TOO_LONG`],
/// [`AbortCode::TOO_SHORT`], [`AbortCode::DEVICE_STATE`], [`AbortCode::VALUE_HIGH`], [`AbortCode::VALUE_LOW`], or the
/// code of the row's own check. After such an error the object keeps its value. With complete access also the codes of
/// [`read`], and [`AbortCode::LENGTH`] if the value ends within a sub-index or beyond the last one. If a sub-index
/// refuses its value, the sub-indices in front of it have already been written \[OURS].
pub fn write<D: Device>(device: &mut D, at: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
    match scope {
        SdoScope::Entry => write_entry(device, at, value),
        SdoScope::Complete => complete::write(device, at, value),
    }
}

fn read_entry<D: Device>(device: &D, at: ObjectAddress, value: &mut [u8]) -> Result<usize, AbortCode> {
    let (row, offset) = find_row(device, at)?;
    let object = &D::objects()[row];
    if matches!(object.access, Access::WriteOnly) {
        return Err(AbortCode::WRITE_ONLY);
    }
    let number = match object.cell {
        Cell::Text(text) => return Ok(put_first(text(device).as_bytes(), value)),
        Cell::Live { get, .. } => get(device),
        Cell::Stored { .. } => number(device, object, cell_of::<D>(row, offset)),
    };
    let bits = object.data.encode(number);
    Ok(put_first(&bits.to_le_bytes()[..object.data.bytes().into()], value))
}

fn write_entry<D: Device>(device: &mut D, at: ObjectAddress, value: &[u8]) -> Result<(), AbortCode> {
    let Place { row, cell } = find(device, at)?;
    let object = &D::objects()[row];
    match object.access {
        Access::ReadOnly => return Err(AbortCode::READ_ONLY),
        _ if value.len() > object.data.bytes().into() => return Err(AbortCode::TOO_LONG),
        _ if value.len() < object.data.bytes().into() => return Err(AbortCode::TOO_SHORT),
        Access::ReadWriteUpTo(highest) if device.al_state() > highest => return Err(AbortCode::DEVICE_STATE),
        Access::ReadWrite | Access::ReadWriteUpTo(_) | Access::WriteOnly => {}
    }
    let number = object.data.decode(number_of(value));
    in_range(object, number)?;
    match object.cell {
        Cell::Text(_) | Cell::Live { set: None, .. } => Err(AbortCode::READ_ONLY),
        Cell::Live { set: Some(set), .. } => set(device, number),
        Cell::Stored { accept, changed } => {
            if let Some(accept) = accept {
                accept(device, at, number)?;
            }
            device.values_mut().set_bits(cell, object.data.encode(number));
            if let Some(changed) = changed {
                changed(device);
            }
            Ok(())
        }
    }
}

fn in_range<D>(object: &Object<D>, number: i64) -> Result<(), AbortCode> {
    if number > object.max {
        return Err(AbortCode::VALUE_HIGH);
    }
    if number < object.min { Err(AbortCode::VALUE_LOW) } else { Ok(()) }
}

/// The location of a sub-index: its row in the table, and its cell in [`Values`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) row: usize,
    pub(super) cell: usize,
}

/// Finds a sub-index by its address: its row in the table, and its cell in [`Values`]. The error is the abort code.
pub(super) fn find<D: Device>(device: &D, at: ObjectAddress) -> Result<Place, AbortCode> {
    let (row, offset) = find_row(device, at)?;
    Ok(Place { row, cell: cell_of::<D>(row, offset) })
}

/// Finds the row that contains the sub-index `at`. Returns the index of the row, and the offset of the sub-index from
/// the first sub-index of the row.
fn find_row<D: Device>(device: &D, at: ObjectAddress) -> Result<(usize, usize), AbortCode> {
    let objects = D::objects();
    let first = objects.partition_point(|object| object.index < at.index);
    let mut index_exists = false;
    for (row, object) in (first..).zip(&objects[first..]).take_while(|(_, object)| object.index == at.index) {
        if object.only_if.is_none_or(|has| has(device)) {
            index_exists = true;
            if let Some(offset) = at.sub.checked_sub(object.first_sub)
                && offset < object.count
            {
                return Ok((row, offset.into()));
            }
        }
    }
    Err(if index_exists { AbortCode::NO_SUB_INDEX } else { AbortCode::NO_OBJECT })
}

/// The index in [`Values`] of a sub-index of a row: the number of sub-indices in all earlier rows, plus `offset`. This sum
/// takes time, so it is computed only for stored values.
fn cell_of<D: Device>(row: usize, offset: usize) -> usize {
    D::objects()[..row].iter().map(|object| usize::from(object.count)).sum::<usize>() + offset
}

/// The present value of an object as a number; 0 for a text, which process data cannot have. `cell` is used only if the
/// value is stored.
#[inline(always)]
pub(super) fn number<D: Device>(device: &D, object: &Object<D>, cell: usize) -> i64 {
    match object.cell {
        Cell::Live { get, .. } => get(device),
        Cell::Stored { .. } => object.data.decode(device.values().bits(cell)),
        Cell::Text(_) => 0,
    }
}

/// Writes a value that has come in process data. \[OURS] A value that an SDO download would refuse is ignored, and the
/// object keeps its value; the other values of the same process data are not affected.
#[inline(always)]
pub(super) fn take_output<D: Device>(device: &mut D, object: &Object<D>, cell: usize, number: i64) {
    if let Some(output) = object.output {
        return output(device, number);
    }
    if in_range(object, number).is_err() {
        return;
    }
    match object.cell {
        Cell::Live { set: Some(set), .. } => {
            let _ = set(device, number);
        }
        Cell::Stored { accept, changed } => {
            let bits = object.data.encode(number);
            // Process data write a mapped object in every cycle, but applying a new value is expensive. So an unchanged
            // value is skipped.
            if device.values().bits(cell) == bits
                || accept.is_some_and(|accept| accept(device, object.address(), number).is_err())
            {
                return;
            }
            device.values_mut().set_bits(cell, bits);
            if let Some(changed) = changed {
                changed(device);
            }
        }
        Cell::Text(_) | Cell::Live { set: None, .. } => {}
    }
}

/// Copies `bytes` into `value`, as far as there is room. Returns the number of bytes in `bytes`.
pub(super) fn put_first(bytes: &[u8], value: &mut [u8]) -> usize {
    let shown = bytes.len().min(value.len());
    value[..shown].copy_from_slice(&bytes[..shown]);
    bytes.len()
}

/// At most the first 8 bytes as a little-endian number; fewer bytes are zero-extended.
pub(super) fn number_of(bytes: &[u8]) -> u64 {
    let mut whole = [0; 8];
    let len = bytes.len().min(8);
    whole[..len].copy_from_slice(&bytes[..len]);
    u64::from_le_bytes(whole)
}
