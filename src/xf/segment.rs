//! Reads and writes the data segment of a packet.

use bytemuck::Pod;

use super::Malformed;

/// The field name in the error for a data segment that is too short.
const FIELD: &str = "bytes of the data segment";

/// Reads a layout from the beginning of the data segment.
///
/// # Errors
/// The segment is shorter than the layout.
pub fn get<T: Pod>(data: &[u8]) -> Result<T, Malformed> {
    Malformed::at_least(FIELD, data.len(), size_of::<T>())?;
    Ok(bytemuck::pod_read_unaligned(&data[..size_of::<T>()]))
}

/// Writes a layout to the beginning of the data segment and returns its length.
///
/// # Errors
/// The segment is shorter than the layout.
pub fn put<T: Pod>(data: &mut [u8], layout: &T) -> Result<u16, Malformed> {
    put_at(data, 0, bytemuck::bytes_of(layout))
}

/// Reads `len` bytes from byte `at` on.
///
/// # Errors
/// The segment is shorter than `at` and `len` together.
pub fn get_at(data: &[u8], at: usize, len: usize) -> Result<&[u8], Malformed> {
    Malformed::at_least(FIELD, data.len(), at.saturating_add(len))?;
    Ok(&data[at..at + len])
}

/// Writes bytes from byte `at` on and returns their end, counted from the beginning of the segment.
///
/// # Errors
/// The segment is shorter than `at` and the number of bytes together.
pub fn put_at(data: &mut [u8], at: usize, bytes: &[u8]) -> Result<u16, Malformed> {
    let end = at.saturating_add(bytes.len());
    Malformed::at_least(FIELD, data.len(), end)?;
    data[at..end].copy_from_slice(bytes);
    // A segment has at most 1408 bytes; a longer slice from another caller is an error too.
    u16::try_from(end).map_err(|_| Malformed::only(FIELD, u32::MAX, "at most 65535"))
}
