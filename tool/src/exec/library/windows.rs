//! How Windows finds a library: in the folder of the program, then in the system folders, then in the folders of
//! `PATH`.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::{ExecError, not_a_library};
use crate::exec::link::program_file;
use crate::image::{Image, Width};

/// The file name by which programs ask for the library.
pub const FILE_NAME: &str = "NEXTWUSBLib.dll";
/// The file names by which programs ask for the library.
pub const NAMES: &[&str] = &[FILE_NAME];
/// The environment variable with the folders that Windows searches last.
pub const SEARCH_PATH: &str = "PATH";
/// The separator between the folders of [`SEARCH_PATH`].
pub const SEPARATOR: &str = ";";
/// The hint for a program that has opened no board.
pub const UNOPENED: &str =
    "if it should have, see by `ecmsk doctor DIR` which NEXTWUSBLib.dll it has in its folder DIR";

/// Why a folder cannot be on `PATH`, with the next step.
pub const UNLINKABLE: &str = "PATH takes no `;` and no quotes; put the library into another folder";

/// The width (32 or 64 bits) of this tool, and so of the library beside it.
const OURS: Width = if cfg!(target_pointer_width = "64") { Width::X64 } else { Width::X86 };

/// The usual folder of the library: the folder of the tool. For a program of the other width it is the folder `x86` or
/// `x64` next to it, as in the package.
pub fn usual_folders(beside_tool: &Path, program: Option<&Path>) -> Vec<PathBuf> {
    let width = program.and_then(width_of);
    if width.is_none_or(|width| width == OURS) {
        return vec![beside_tool.to_owned()];
    }
    let other = width.and_then(Width::folder).zip(beside_tool.parent());
    other.map_or_else(|| vec![beside_tool.to_owned()], |(name, above)| vec![above.join(name)])
}

/// Checks that the library has the width of the program, and that the folder of the program has no other library with
/// this name, because Windows searches that folder first.
pub fn check(file: &Path, program: Option<&Path>) -> Result<(), ExecError> {
    let library = Image::read(file).map_err(|error| not_a_library(file, error.to_string()))?;
    let Some(program) = program.and_then(program_file) else { return Ok(()) };
    if let Ok(image) = Image::read(&program)
        && image.width != library.width
    {
        let reason = format!("it is {}, and {} is {}", library.width, program.display(), image.width);
        return Err(not_a_library(file, reason));
    }
    let beside = program.with_file_name(FILE_NAME);
    match Image::read(&beside) {
        Ok(other) if !other.is_ours() => Err(ExecError::Beside { beside, ours: file.to_owned() }),
        _ => Ok(()),
    }
}

fn width_of(program: &Path) -> Option<Width> {
    let file = program_file(program)?;
    Some(Image::read(&file).ok()?.width)
}

/// Creates a private folder for the file that shows whether the library was used. The library itself is not moved.
pub fn folder(library: &Path) -> Result<TempDir, ExecError> {
    let place = std::env::temp_dir();
    let failed = |source| ExecError::Folder { place: place.clone(), source };
    let folder = tempfile::Builder::new().prefix("ecmsk-exec-").tempdir_in(&place).map_err(failed)?;
    let beside = first(folder.path(), library);
    if beside.as_os_str().as_encoded_bytes().iter().any(|byte| b";\"".contains(byte)) {
        return Err(ExecError::UnlinkableFolder { folder: beside.to_owned() });
    }
    Ok(folder)
}

/// The folder that is put first on `PATH`: the folder of the library.
pub fn first<'a>(_folder: &'a Path, library: &'a Path) -> &'a Path {
    library.parent().unwrap_or(Path::new("\\"))
}
