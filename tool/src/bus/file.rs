//! Reads local files that are to be written to a slave.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use super::BusVerbError;

/// Reads at most `bytes_max` + 1 bytes of a file. The additional byte shows the caller that the file is too long.
/// Without the limit, a device file such as `/dev/zero` would never end.
///
/// # Errors
/// [`BusVerbError::Read`] if the file cannot be opened or read.
pub fn read_file(file: &Path, bytes_max: usize) -> Result<Vec<u8>, BusVerbError> {
    let mut content = Vec::new();
    let read = File::open(file).and_then(|file| file.take(bytes_max as u64 + 1).read_to_end(&mut content));
    read.map(|_| content).map_err(|source| BusVerbError::Read { file: file.to_owned(), source })
}
