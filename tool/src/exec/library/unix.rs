//! How the dynamic linker of Linux finds a library.

use std::fs::{self, File};
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};

use ecmsk::link::config;
use tempfile::TempDir;

use super::{ExecError, not_a_library};

/// The file name that the linker (`-lNEXTWUSBLib`) and programs that load the library at run time use.
pub const FILE_NAME: &str = "libNEXTWUSBLib.so";
/// The file name that a linked program uses: the library's SONAME.
const SONAME: &str = "libNEXTWUSBLib.so.0";
/// The file names by which programs ask for the library.
pub const NAMES: &[&str] = &[FILE_NAME, SONAME];
/// The environment variable with the folders that the dynamic linker searches first.
pub const SEARCH_PATH: &str = "LD_LIBRARY_PATH";
/// The separator between the folders of [`SEARCH_PATH`].
pub const SEPARATOR: &str = ":";
/// The hint for a program that has opened no board.
pub const UNOPENED: &str =
    "if it should have, see by `ldd` whether it links libNEXTWUSBLib.so, and not the static library";

/// Why a folder cannot be on the search path, with the next step.
pub const UNLINKABLE: &str = "it takes no `:`, `;` or `$`, and with --clock no blank; set TMPDIR to another folder";

/// The usual folders of the library: the folder of this tool, `../lib` relative to it, and the sub-folder of `../lib`
/// for the libraries of this architecture on Debian.
pub fn usual_folders(beside_tool: &Path, _program: Option<&Path>) -> Vec<PathBuf> {
    let stage = beside_tool.parent().map(|above| above.join("lib"));
    let debian = stage.as_ref().map(|lib| lib.join(format!("{}-linux-gnu", std::env::consts::ARCH)));
    std::iter::once(beside_tool.to_owned()).chain(stage).chain(debian).collect()
}

/// Checks that the file is a library. The dynamic linker would silently skip a file that is no library, and load the
/// next one that it finds.
pub fn check(file: &Path, _program: Option<&Path>) -> Result<(), ExecError> {
    let mut magic = [0; 4];
    match File::open(file).and_then(|mut file| file.read_exact(&mut magic)) {
        Ok(()) if magic == *b"\x7fELF" => Ok(()),
        Ok(()) => Err(not_a_library(file, "it is no ELF file".into())),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            Err(not_a_library(file, "it is too short".into()))
        }
        Err(error) => Err(not_a_library(file, error.to_string())),
    }
}

/// Makes a private folder with the library under both of its names, and with its configuration file if there is one.
pub fn folder(library: &Path) -> Result<TempDir, ExecError> {
    let place = std::env::temp_dir();
    let failed = |source| ExecError::Folder { place: place.clone(), source };
    // The path must be absolute, because the program may change its working directory.
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
    // The library looks for its configuration file in the folder from which it was loaded.
    let configuration = library.with_file_name(config::FILE_NAME);
    if configuration.exists() {
        symlink(configuration, folder.path().join(config::FILE_NAME)).map_err(failed)?;
    }
    Ok(folder)
}

/// The folder that is put first on the search path.
pub fn first<'a>(folder: &'a Path, _library: &'a Path) -> &'a Path {
    folder
}
