//! Finds the library of this build, and puts it first on the search path of the operating system.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::ExecError;
#[cfg(unix)]
use unix as system;
#[cfg(windows)]
use windows as system;

pub use system::{FILE_NAME, SEARCH_PATH, UNLINKABLE, UNOPENED};

/// Finds the library for a program. `given` is the library file, or a folder that contains it. Without it, the usual
/// folders are searched: first the folder of the tool, or on Windows only the folder for a program of that width.
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

/// The folder that is put first on the search path. On Linux it is a private folder with the library in it, on Windows
/// it is the folder of the library. On both systems, a private folder has the files that the library writes for this
/// tool. It is removed when this value is dropped.
pub struct LibraryFolder {
    folder: TempDir,
    library: PathBuf,
}

impl LibraryFolder {
    /// Makes the private folder in the folder for temporary files (`TMPDIR`, on Windows `TMP`).
    pub fn make(library: &Path) -> Result<Self, ExecError> {
        Ok(Self { folder: system::folder(library)?, library: library.to_owned() })
    }

    /// The path at which the program will find the library.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// The file that the library creates when the program opens a board. If it does not exist when the program has
    /// ended, the program has opened no board.
    pub fn opened_file(&self) -> PathBuf {
        self.folder.path().join(".opened")
    }

    /// Creates the file to which the library writes the reasons why calls of the program fail.
    pub fn reasons_file(&self) -> Result<PathBuf, ExecError> {
        let file = self.folder.path().join(".told");
        match std::fs::File::create_new(&file) {
            Ok(_) => Ok(file),
            Err(source) => Err(ExecError::Folder { place: self.folder.path().to_owned(), source }),
        }
    }

    /// The private folder.
    #[cfg(target_os = "linux")]
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The new value of the search path variable: the library's folder, followed by `path`, the present value.
    pub fn first_on(&self, path: Option<&OsStr>) -> OsString {
        let mut all = system::first(self.folder.path(), &self.library).as_os_str().to_owned();
        // An empty `path` is not appended: it would add an empty entry, which means the current folder on Linux.
        if let Some(path) = path.filter(|path| !path.is_empty()) {
            all.push(system::SEPARATOR);
            all.push(path);
        }
        all
    }
}
