//! What was fetched: whether it is what we know.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;

/// The one file in `folder`, if it is the one that we know.
pub fn checked(folder: &Path, expected: &'static str) -> Result<PathBuf, Error> {
    let entry = fs::read_dir(folder).and_then(|mut entries| entries.next().transpose());
    let file = entry.map_err(Error::file("list", folder))?.map(|entry| entry.path()).unwrap_or_default();
    let said = command::output(Command::new("sha256sum").arg("--").arg(&file))?;
    let found = String::from_utf8_lossy(&said).split_whitespace().next().unwrap_or_default().to_owned();
    if found == expected { Ok(file) } else { Err(Error::Fetched { file, expected, found }) }
}

/// Removes a folder, if it is there.
pub fn remove(folder: &Path) -> Result<(), Error> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::file("remove", folder)(error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_with_other_bytes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.whl");
        fs::write(&file, "a\n").unwrap();
        let right = "87428fc522803d31065e7bce3cf03fe475096631e5e07bbd7a0fde60c4cf25c7";
        assert_eq!(checked(folder.path(), right).unwrap(), file);
        let other = "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5";
        let error = checked(folder.path(), other).unwrap_err().to_string();
        assert!(error.contains("a.whl") && error.contains(right) && error.contains(other), "{error}");
    }
}
