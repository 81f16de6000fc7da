//! Complete access: all sub-indices of an object in one transfer (ETG.1000.6 5.6.2, ETG.1020 12.2).
//!
//! If an object has more sub-indices than 0, sub-index 0 occupies 16 bits of the transfer; the upper 8 bits are 0.
//! \[OURS] As in most slaves, a write-only value is read as zeros, and the data for a read-only value are ignored.

use super::object::DataType;
use super::{Access, Device, Object, find, read_entry, write_entry};
use crate::ethercat::coe::{AbortCode, ObjectAddress};

/// A sub-index, and where its value is in the data of the transfer: `offset` and `len` in bytes.
struct Part {
    at: ObjectAddress,
    access: Access,
    offset: usize,
    len: usize,
}

/// The first sub-index of a transfer that begins at `at`.
///
/// # Errors
/// The abort codes of [`super::read`] with complete access.
fn first_part<D: Device>(device: &D, at: ObjectAddress) -> Result<Part, AbortCode> {
    if at.sub > 1 {
        return Err(AbortCode::UNSUPPORTED_ACCESS);
    }
    find(device, at)?;
    if rows(device, at.index).any(|row| row.data == DataType::Text) {
        return Err(AbortCode::COMPLETE_ACCESS);
    }
    part_from(device, at, 0).ok_or(AbortCode::NO_SUB_INDEX)
}

/// The rows of the object in the table of the dictionary, without rows that do not apply to this device
/// ([`Object::only_if`]).
fn rows<D: Device>(device: &D, index: u16) -> impl Iterator<Item = &'static Object<D>> {
    D::objects().iter().filter(move |row| row.index == index && row.only_if.is_none_or(|has| has(device)))
}

/// The first existing sub-index from `at.sub` on. `offset` is the position of its value in the data of the transfer,
/// bytes. `None`: there is none.
fn part_from<D: Device>(device: &D, at: ObjectAddress, offset: usize) -> Option<Part> {
    let row = rows(device, at.index).find(|row| at.sub < row.first_sub.saturating_add(row.count))?;
    let at = ObjectAddress::new(at.index, at.sub.max(row.first_sub));
    Some(Part { at, access: row.access, offset, len: row.data.bytes().into() })
}

/// The next existing sub-index after `part`. `None`: `part` is the last one.
fn part_behind<D: Device>(device: &D, part: &Part) -> Option<Part> {
    let next = ObjectAddress::new(part.at.index, part.at.sub.checked_add(1)?);
    let is_padded = part.at.sub == 0 && part_from(device, next, 0).is_some();
    part_from(device, next, part.offset + part.len + usize::from(is_padded))
}

pub(super) fn read<D: Device>(device: &D, at: ObjectAddress, value: &mut [u8]) -> Result<usize, AbortCode> {
    value.fill(0);
    let mut part = first_part(device, at)?;
    loop {
        let room = value.get_mut(part.offset..).unwrap_or_default();
        if part.access != Access::WriteOnly {
            read_entry(device, part.at, room)?;
        }
        match part_behind(device, &part) {
            Some(next) => part = next,
            None => return Ok(part.offset + part.len),
        }
    }
}

pub(super) fn write<D: Device>(device: &mut D, at: ObjectAddress, value: &[u8]) -> Result<(), AbortCode> {
    let first = first_part(device, at)?;
    let mut part = Some(first);
    let ends = std::iter::from_fn(|| {
        let current = part.take()?;
        part = part_behind(device, &current);
        Some(part.as_ref().map_or(current.offset + current.len, |next| next.offset))
    });
    // A transfer may end before the end of the object, but not within a sub-index.
    if !ends.into_iter().any(|end| end == value.len()) {
        return Err(AbortCode::LENGTH);
    }
    let mut part = part_from(device, at, 0);
    while let Some(current) = part.filter(|current| current.offset < value.len()) {
        if current.access != Access::ReadOnly {
            write_entry(device, current.at, &value[current.offset..current.offset + current.len])?;
        }
        part = part_behind(device, &current);
    }
    Ok(())
}
