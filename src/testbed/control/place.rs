//! The location of control sockets: a folder that only the user can write to, with one socket for each name.

use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

use super::ControlError;
use crate::address::config::variable;

/// The file name extension of control sockets.
const EXTENSION: &str = "control";
const NAME_MAX: usize = 64;

/// The path of the control socket `name`. A name with a `/` is a path itself. Otherwise the socket is in
/// `$XDG_RUNTIME_DIR/ecmsk`, or without that variable in the folder `ecmsk-UID` within the folder for temporary files
/// \[OURS]. A missing folder is created, with access for its owner only.
///
/// # Errors
/// [`ControlError::Name`] for an invalid name; [`ControlError::Folder`] if the folder cannot be created or others may
/// write to it.
pub fn place(name: &str) -> Result<PathBuf, ControlError> {
    if name.contains('/') {
        return Ok(name.into());
    }
    let is_plain = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte));
    if !is_plain || name.starts_with('.') || !(1..=NAME_MAX).contains(&name.len()) {
        return Err(ControlError::Name(name.to_owned()));
    }
    let folder = folder();
    owned(&folder)
        .map_err(|error| ControlError::Folder { folder: folder.display().to_string(), message: error.to_string() })?;
    Ok(folder.join(format!("{name}.{EXTENSION}")))
}

/// The names of the control sockets at which a board listens, sorted.
pub(super) fn running() -> Vec<String> {
    let entries = fs::read_dir(folder()).into_iter().flatten().flatten();
    let listens =
        |path: &Path| path.extension().is_some_and(|end| end == EXTENSION) && UnixStream::connect(path).is_ok();
    let name = |path: PathBuf| Some(path.file_stem()?.to_str()?.to_owned());
    let mut names: Vec<_> = entries.map(|entry| entry.path()).filter(|path| listens(path)).filter_map(name).collect();
    names.sort();
    names
}

fn folder() -> PathBuf {
    match variable("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_absolute()) {
        Some(folder) => folder.join("ecmsk"),
        None => temporary().join(format!("ecmsk-{}", rustix::process::geteuid().as_raw())),
    }
}

/// The folder of temporary files. In a privileged (setuid) process the environment is ignored, and the folder is
/// `/tmp`.
fn temporary() -> PathBuf {
    variable("TMPDIR").map(PathBuf::from).filter(|folder| folder.is_absolute()).unwrap_or_else(|| "/tmp".into())
}

/// Makes sure that the folder exists, belongs to this user, and is not writable for others. Otherwise another user
/// could create a socket there and answer instead of a board.
fn owned(folder: &Path) -> io::Result<()> {
    const WRITABLE_BY_OTHERS: u32 = 0o022;
    match fs::DirBuilder::new().mode(0o700).create(folder) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let there = fs::symlink_metadata(folder)?;
    let is_own = there.is_dir() && there.uid() == rustix::process::geteuid().as_raw();
    if is_own && there.mode() & WRITABLE_BY_OTHERS == 0 {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::PermissionDenied, "it is no folder that this user alone may write to"))
}
