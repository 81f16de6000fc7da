//! Finds the library of this build, and lays it where the system looks first.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

use std::path::{Path, PathBuf};

use super::ExecError;
#[cfg(unix)]
use unix as system;
#[cfg(windows)]
use windows as system;

pub use system::{FILE_NAME, LibraryFolder, SEARCH_PATH, UNLINKABLE, UNOPENED};

/// The library for a program: `given` (a file, or a folder that has it), else where it usually is, beside this tool
/// first.
pub fn find(given: Option<&Path>, program: Option<&Path>) -> Result<PathBuf, ExecError> {
    let file = match given {
        Some(file) if file.is_file() => file.to_owned(),
        Some(folder) => in_one_of(vec![folder.to_owned()])?,
        None => in_one_of(usual_folders(program)?)?,
    };
    system::check(&file, program)?;
    std::path::absolute(&file).map_err(|source| not_a_library(&file, source.to_string()))
}

fn usual_folders(program: Option<&Path>) -> Result<Vec<PathBuf>, ExecError> {
    let tool = std::env::current_exe().map_err(|source| ExecError::System { what: "find this tool's file", source })?;
    Ok(system::usual_folders(tool.parent().unwrap_or(Path::new("/")), program))
}

fn in_one_of(folders: Vec<PathBuf>) -> Result<PathBuf, ExecError> {
    let files = folders.iter().flat_map(|folder| system::NAMES.iter().map(|name| folder.join(name)));
    let found = files.into_iter().find(|file| file.is_file());
    found.ok_or(ExecError::NoLibrary { looked_in: folders })
}

fn not_a_library(file: &Path, reason: String) -> ExecError {
    ExecError::NotALibrary { file: file.to_owned(), reason }
}
