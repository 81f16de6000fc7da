//! The option `--record`: adds the key `record=` to a link, and checks before the start that the recording can be created.

use std::path::{Path, PathBuf};

use ecmsk::link::record;
use ecmsk::link::uri::{LinkUri, UriError};

use super::link_option::with_key;

/// Why a verb cannot make a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file of `--record` cannot be used.
    #[error("cannot record to {}: {reason}; name another file with --record", .file.display())]
    File {
        /// The path of the file.
        file: PathBuf,
        /// Why the file cannot be used.
        reason: String,
    },
    /// The link with `record=` is invalid.
    #[error(transparent)]
    Uri(#[from] UriError),
}

/// Adds the key `record=` to a link.
///
/// # Errors
/// The folder does not exist, the name cannot be written in a link, or the link has a recording already.
pub fn with_record(link: &LinkUri, file: &Path) -> Result<LinkUri, RecordError> {
    let refuse = |reason: String| RecordError::File { file: file.to_owned(), reason };
    // The path is made absolute, because a program may change its working directory before it opens the board.
    let absolute = std::path::absolute(file).map_err(|error| refuse(error.to_string()))?;
    let folder = absolute.parent().filter(|_| !absolute.is_dir());
    if !folder.ok_or_else(|| refuse("it is a folder".into()))?.is_dir() {
        return Err(refuse("its folder does not exist".into()));
    }
    let text = absolute.to_str().ok_or_else(|| refuse("its name is not UTF-8".into()))?;
    Ok(with_key(link, "record", text)?)
}

/// Makes sure that the recording can be created. With `overwrite`, removes an existing recording.
///
/// # Errors
/// The file exists and `overwrite` is not set, or it cannot be removed.
pub fn make_room(file: &Path, overwrite: bool) -> Result<(), RecordError> {
    record::make_room(file, overwrite).map_err(|error| {
        let hint = if overwrite { "" } else { ", and --overwrite is not given" };
        RecordError::File { file: file.to_owned(), reason: format!("{error}{hint}") }
    })
}
