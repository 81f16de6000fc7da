//! Files of this machine that go to a slave.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use super::BusVerbError;

/// Reads a file, up to one byte more than allowed, since a device has no end.
///
/// # Errors
/// [`BusVerbError::Read`]
pub fn read_file(file: &Path, bytes_max: usize) -> Result<Vec<u8>, BusVerbError> {
    let mut content = Vec::new();
    let read = File::open(file).and_then(|file| file.take(bytes_max as u64 + 1).read_to_end(&mut content));
    read.map(|_| content).map_err(|source| BusVerbError::Read { file: file.to_owned(), source })
}
