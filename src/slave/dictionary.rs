//! Object dictionaries as tables: one row says all that an SDO transfer has to know of an object.
//!
//! A device lists its objects in a constant slice of [`Object`], ascending by address, and implements [`Device`];
//! [`upload`] and [`download`] then do the rest, abort codes included. A row keeps its value in one of two ways:
//!
//! - *stored*: in the device's [`Values`]. The device reads it through a [`Slot`], which is looked up when the program
//!   is compiled: neither a search nor a wrong type is possible at run time.
//! - *live*: in a field of the device, behind accessor functions. What a cycle moves lives there.
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

mod object;
mod values;

pub use object::{Access, DataType, Object, PdoDirection, check, join, only_if, rows};
pub use values::{Slot, Value, Values, slot};

use super::SdoValue;
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::ethercat::AlState;
use object::Cell;

/// Something that has an object dictionary.
pub trait Device: Sized + 'static {
    /// Its objects, ascending by address; [`check`] them when compiling.
    fn objects() -> &'static [Object<Self>];

    /// The stored values.
    fn values(&self) -> &Values;

    /// The stored values, for a download.
    fn values_mut(&mut self) -> &mut Values;

    /// Its AL state, by which some objects can be written or not.
    fn al_state(&self) -> AlState;
}

/// SDO upload. Text longer than 4 bytes is cut to its first 4.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`], [`AbortCode::NO_SUB_INDEX`], [`AbortCode::WRITE_ONLY`].
pub fn upload<D: Device>(device: &D, at: ObjectAddress) -> Result<SdoValue, AbortCode> {
    let (object, cell) = find(device, at)?;
    if matches!(object.access, Access::WriteOnly) {
        return Err(AbortCode::WRITE_ONLY);
    }
    let size = object.data.bytes();
    Ok(match object.cell {
        Cell::Text(text) => first_bytes(text(device)),
        Cell::Stored { .. } => SdoValue { size, bits: device.values().bits(cell) },
        Cell::Live { get, .. } => SdoValue { size, bits: object.data.encode(get(device)) },
    })
}

/// SDO download.
///
/// Checked in this order \[OURS]: does the object exist, can it be written, does the size fit, does the AL state allow
/// it, is the value in range, and what the row's own check says.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`], [`AbortCode::NO_SUB_INDEX`], [`AbortCode::READ_ONLY`], [`AbortCode::TOO_LONG`],
/// [`AbortCode::TOO_SHORT`], [`AbortCode::DEVICE_STATE`], [`AbortCode::VALUE_HIGH`], [`AbortCode::VALUE_LOW`], or the
/// code of the row's own check; the value is then as before.
pub fn download<D: Device>(device: &mut D, at: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
    let (object, cell) = find(device, at)?;
    match object.access {
        Access::ReadOnly => return Err(AbortCode::READ_ONLY),
        _ if size.bytes() > object.data.bytes() => return Err(AbortCode::TOO_LONG),
        _ if size.bytes() < object.data.bytes() => return Err(AbortCode::TOO_SHORT),
        Access::ReadWriteUpTo(highest) if device.al_state() > highest => return Err(AbortCode::DEVICE_STATE),
        Access::ReadWrite | Access::ReadWriteUpTo(_) | Access::WriteOnly => {}
    }
    let number = object.data.decode(value);
    if number > object.max {
        return Err(AbortCode::VALUE_HIGH);
    }
    if number < object.min {
        return Err(AbortCode::VALUE_LOW);
    }
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

/// The row at an address and its place in [`Values`]. A plain walk: SDO transfers are rare and tables short.
fn find<D: Device>(device: &D, at: ObjectAddress) -> Result<(&'static Object<D>, usize), AbortCode> {
    let mut cell = 0;
    let mut index_exists = false;
    for object in D::objects() {
        if object.index == at.index && object.only_if.is_none_or(|has| has(device)) {
            index_exists = true;
            if let Some(offset) = at.sub.checked_sub(object.first_sub)
                && offset < object.count
            {
                return Ok((object, cell + usize::from(offset)));
            }
        }
        cell += usize::from(object.count);
    }
    Err(if index_exists { AbortCode::NO_SUB_INDEX } else { AbortCode::NO_OBJECT })
}

fn first_bytes(text: &str) -> SdoValue {
    let size = text.len().min(4);
    let mut bytes = [0; 4];
    bytes[..size].copy_from_slice(&text.as_bytes()[..size]);
    SdoValue { size: size as u8, bits: u32::from_le_bytes(bytes) }
}
