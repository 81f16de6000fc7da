//! Runs the program on Windows: a shared console and 32-bit exit codes.

use std::path::Path;
use std::process::{Command, ExitCode, ExitStatus};

use super::{ExecError, failed, not_started};
use crate::signals;

/// The advice for a file that the user may not execute.
pub const MAKE_EXECUTABLE: &str = "look at the rights of its file, and at what a virus scanner says of it";

/// Starts `command` and waits for its end.
///
/// Ctrl-C, Ctrl-Break and closing the console reach the program directly, because it shares the console.
pub fn run(command: &mut Command, program: &Path) -> Result<ExitStatus, ExecError> {
    signals::leave_to_program().map_err(failed("leave Ctrl-C to the program"))?;
    let mut child = command.spawn().map_err(|source| not_started(program, source))?;
    child.wait().map_err(failed("wait for the program"))
}

/// The exit code of the tool: that of the program, which has 32 bits. If it does not fit into the 8 bits of
/// [`ExitCode`], this function ends the process with it.
pub fn end_as(ended: ExitStatus) -> ExitCode {
    match ended.code().map(|code| (code, u8::try_from(code))) {
        Some((_, Ok(code))) => ExitCode::from(code),
        Some((code, Err(_))) => std::process::exit(code),
        None => ExitCode::FAILURE,
    }
}
