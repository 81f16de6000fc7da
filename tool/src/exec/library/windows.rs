//! As Windows finds a library: beside the program first, then in the system's folders, then in those of `PATH`.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::{ExecError, not_a_library};
use crate::exec::link::program_file;
use crate::image::{Image, Width};

/// What programs ask for.
pub const FILE_NAME: &str = "NEXTWUSBLib.dll";
/// The library's names.
pub const NAMES: &[&str] = &[FILE_NAME];
/// The folders that Windows looks into last.
pub const SEARCH_PATH: &str = "PATH";
/// Stands between two of them.
pub const SEPARATOR: &str = ";";
/// What to do about a program that has opened no board.
pub const UNOPENED: &str =
    "if it should have, see by `ecmsk doctor DIR` which NEXTWUSBLib.dll it has in its folder DIR";

/// What `PATH` does not take in a folder's name, and what to do.
pub const UNLINKABLE: &str = "PATH takes no `;` and no quotes; put the library into another folder";

/// Width of this tool.
const OURS: Width = if cfg!(target_pointer_width = "64") { Width::X64 } else { Width::X86 };

/// Beside this tool; for a program of another width in the folder of that width beside the tool's, where a package has it.
pub fn usual_folders(beside_tool: &Path, program: Option<&Path>) -> Vec<PathBuf> {
    let width = program.and_then(width_of);
    if width.is_none_or(|width| width == OURS) {
        return vec![beside_tool.to_owned()];
    }
    let other = width.and_then(Width::folder).zip(beside_tool.parent());
    other.map_or_else(|| vec![beside_tool.to_owned()], |(name, above)| vec![above.join(name)])
}

/// A library of the program's width; and none of another maker stands where Windows looks first.
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

/// A folder of this process alone for the word that the library was used; the library stays where it is.
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

/// What Windows is to look into first.
pub fn first<'a>(_folder: &'a Path, library: &'a Path) -> &'a Path {
    library.parent().unwrap_or(Path::new("\\"))
}
