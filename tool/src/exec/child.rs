//! Runs the program as if it had been started directly: signals reach it, and its exit code becomes that of the tool.

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

fn not_started(program: &Path, source: io::Error) -> ExecError {
    let program = program.to_owned();
    match source.kind() {
        io::ErrorKind::NotFound => ExecError::NotFound { program },
        io::ErrorKind::PermissionDenied if program.is_dir() => {
            ExecError::NotExecutable { program, source, hint: "it is a folder: name the program in it" }
        }
        io::ErrorKind::PermissionDenied => ExecError::NotExecutable { program, source, hint: MAKE_EXECUTABLE },
        io::ErrorKind::OutOfMemory | io::ErrorKind::WouldBlock => {
            ExecError::System { what: "start the program", source }
        }
        _ => {
            let hint = "it is no program for this machine: build it here, or start a script through its interpreter";
            ExecError::NotExecutable { program, source, hint }
        }
    }
}

fn failed(what: &'static str) -> impl Fn(io::Error) -> ExecError {
    move |source| ExecError::System { what, source }
}
