//! Runs the program as if the user had started it directly: it gets the signals, and the tool ends with its exit code.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

use std::io;
use std::path::Path;

#[cfg(unix)]
pub use unix::{end_as, run};
#[cfg(windows)]
pub use windows::{end_as, run};

#[cfg(unix)]
use unix::MAKE_EXECUTABLE;
#[cfg(windows)]
use windows::MAKE_EXECUTABLE;

use super::ExecError;
use crate::image::Image;

fn not_started(program: &Path, source: io::Error) -> ExecError {
    let program = program.to_owned();
    match source.kind() {
        io::ErrorKind::NotFound => ExecError::NotFound { program },
        io::ErrorKind::PermissionDenied => {
            let is_folder = program.is_dir().then(|| "it is a folder: name the program in it".to_owned());
            let hint = is_folder.or_else(|| no_program(&program)).unwrap_or_else(|| MAKE_EXECUTABLE.to_owned());
            ExecError::NotExecutable { program, source, hint }
        }
        io::ErrorKind::OutOfMemory | io::ErrorKind::WouldBlock => {
            ExecError::System { what: "start the program", source }
        }
        _ => {
            let other = || {
                "it is no program for this machine: build it here, or start a script through its interpreter".to_owned()
            };
            let hint = no_program(&program).unwrap_or_else(other);
            ExecError::NotExecutable { program, source, hint }
        }
    }
}

/// The advice for a file that is no program for this machine: a source file, a script, or a Windows program.
fn no_program(file: &Path) -> Option<String> {
    let name = file.display();
    let extension = file.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default();
    match &*extension {
        "c" | "cc" | "cpp" | "cxx" => Some(format!(
            "it is a source: compile it, g++ {name} -o PROGRAM $(pkg-config --cflags --libs nextwusblib), and name PROGRAM (docs/GUIDE-CPP.md)"
        )),
        "cs" | "vb" => Some("it is a source: compile it, and name the program; docs/DOTNET.md says how".to_owned()),
        "rs" => Some("it is a source: compile it with cargo, and name the program".to_owned()),
        "py" => Some(format!("start it through its interpreter: ecmsk exec [OPTIONS] -- python3 {name}")),
        _ if cfg!(windows) => None,
        _ => match Image::read(file).ok()?.managed {
            Some(_) => Some(format!("it is a .NET program: ecmsk exec [OPTIONS] -- mono {name} (docs/DOTNET.md)")),
            None => Some(
                "it is a program of Windows: run it there, or below Wine, with this project's NEXTWUSBLib.dll beside it (docs/WINDOWS.md)"
                    .to_owned(),
            ),
        },
    }
}

fn failed(what: &'static str) -> impl Fn(io::Error) -> ExecError {
    move |source| ExecError::System { what, source }
}
