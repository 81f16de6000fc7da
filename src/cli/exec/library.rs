//! Finds the library of this build, and lays it where the dynamic linker looks first.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, Read};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};

use ecmsk::link::config;
use tempfile::TempDir;

use super::ExecError;

/// What the linker (`-lNEXTWUSBLib`) and programs that load the library by hand ask for.
pub const FILE_NAME: &str = "libNEXTWUSBLib.so";
/// What a program linked with it asks for: the library's SONAME.
const SONAME: &str = "libNEXTWUSBLib.so.0";
/// The folders that the dynamic linker looks into before its own.
pub const SEARCH_PATH: &str = "LD_LIBRARY_PATH";

/// The library: `given` (a file, or a folder that has it), else beside this tool, else in `../lib` from there, else in the
/// folder there in which Debian has the libraries of this architecture.
pub fn find(given: Option<&Path>) -> Result<PathBuf, ExecError> {
    let file = match given {
        Some(file) if file.is_file() => file.to_owned(),
        Some(folder) => in_one_of(vec![folder.to_owned()])?,
        None => in_one_of(usual_folders()?)?,
    };
    check(&file)?;
    std::path::absolute(&file).map_err(|source| not_a_library(&file, source.to_string()))
}

fn usual_folders() -> Result<Vec<PathBuf>, ExecError> {
    let tool = std::env::current_exe().map_err(|source| ExecError::System { what: "find this tool's file", source })?;
    let folder = tool.parent().unwrap_or(Path::new("/"));
    let stage = folder.parent().map(|above| above.join("lib"));
    let debian = stage.as_ref().map(|lib| lib.join(format!("{}-linux-gnu", std::env::consts::ARCH)));
    Ok(std::iter::once(folder.to_owned()).chain(stage).chain(debian).collect())
}

fn in_one_of(folders: Vec<PathBuf>) -> Result<PathBuf, ExecError> {
    let files = folders.iter().flat_map(|folder| [folder.join(FILE_NAME), folder.join(SONAME)]);
    let found = files.into_iter().find(|file| file.is_file());
    found.ok_or(ExecError::NoLibrary { looked_in: folders })
}

/// The dynamic linker passes over what is no library without a word, and takes the next one it finds.
fn check(file: &Path) -> Result<(), ExecError> {
    let mut magic = [0; 4];
    match File::open(file).and_then(|mut file| file.read_exact(&mut magic)) {
        Ok(()) if magic == *b"\x7fELF" => Ok(()),
        Ok(()) => Err(not_a_library(file, "it is no ELF file".into())),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            Err(not_a_library(file, "it is too short".into()))
        }
        Err(error) => Err(not_a_library(file, error.to_string())),
    }
}

fn not_a_library(file: &Path, reason: String) -> ExecError {
    ExecError::NotALibrary { file: file.to_owned(), reason }
}

/// A folder of this process alone that has the library under both its names, and its configuration if there is one. It
/// goes when this is dropped.
pub struct LibraryFolder {
    folder: TempDir,
    library: PathBuf,
}

impl LibraryFolder {
    /// Makes it in the system's folder for such things (`TMPDIR`).
    pub fn make(library: &Path) -> Result<Self, ExecError> {
        let place = std::env::temp_dir();
        let failed = |source| ExecError::Folder { place: place.clone(), source };
        // The program may change its folder.
        let place = std::path::absolute(&place).map_err(failed)?;
        let failed = |source| ExecError::Folder { place: place.clone(), source };
        if place.as_os_str().as_bytes().iter().any(|byte| b":;$".contains(byte)) {
            return Err(ExecError::UnlinkableFolder { folder: place });
        }
        let private = fs::Permissions::from_mode(0o700);
        let folder = tempfile::Builder::new().prefix("ecmsk-exec-").permissions(private).tempdir_in(&place);
        let folder = folder.map_err(failed)?;
        for name in [SONAME, FILE_NAME] {
            symlink(library, folder.path().join(name)).map_err(failed)?;
        }
        // The library looks for it beside the name that it was loaded by.
        let configuration = library.with_file_name(config::FILE);
        if configuration.exists() {
            symlink(configuration, folder.path().join(config::FILE)).map_err(failed)?;
        }
        Ok(Self { folder, library: library.to_owned() })
    }

    /// The library's file.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// The file that the library makes when the program opens a board.
    pub fn opened(&self) -> PathBuf {
        self.folder.path().join(".opened")
    }

    /// The search path with this folder in front of what is there.
    pub fn first_on(&self, path: Option<&OsStr>) -> OsString {
        let mut all = self.folder.path().as_os_str().to_owned();
        // An empty path would add an empty entry, which means the current folder.
        if let Some(path) = path.filter(|path| !path.is_empty()) {
            all.push(":");
            all.push(path);
        }
        all
    }
}
