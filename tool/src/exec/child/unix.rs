//! Signals and exit codes as Unix has them.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitCode, ExitStatus};

use rustix::process::{Pid, Signal, kill_process};
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;

use super::{ExecError, failed, not_started};
use crate::signals;

/// What to do about a program that may not be executed.
pub const MAKE_EXECUTABLE: &str = "make it executable with `chmod +x`";

/// Starts `command` and waits for its end.
///
/// A terminal sends SIGINT and SIGQUIT to the program itself, which is in the same process group: they are not for this
/// tool. SIGTERM and SIGHUP come to this tool alone and are handed on. It then ends as the program does.
pub fn run(command: &mut Command, program: &Path) -> Result<ExitStatus, ExecError> {
    // Caught, not ignored: a program inherits what is ignored, but not what is caught. What this tool was told to ignore
    // (`nohup`) stays so for both. And caught before the start, so that no signal falls between.
    let ours = signals::not_ignored(&[SIGINT, SIGQUIT, SIGTERM, SIGHUP]);
    let mut signals = Signals::new(ours.chain([SIGCHLD])).map_err(failed("catch signals"))?;
    let mut child = command.spawn().map_err(|source| not_started(program, source))?;
    loop {
        for signal in signals.wait() {
            match signal {
                SIGTERM => hand_on(&child, Signal::TERM),
                SIGHUP => hand_on(&child, Signal::HUP),
                _ => {}
            }
        }
        if let Some(ended) = child.try_wait().map_err(failed("wait for the program"))? {
            return Ok(ended);
        }
    }
}

/// The program's code, or 128 + n after signal n, as shells have it.
pub fn end_as(ended: ExitStatus) -> ExitCode {
    let code = ended.code().or_else(|| ended.signal().map(|signal| 128 + signal));
    // Codes have 8 bits, signals go to 64.
    ExitCode::from(code.and_then(|code| u8::try_from(code).ok()).unwrap_or(u8::MAX))
}

/// The child has not been waited for yet, so its id is nobody else's.
fn hand_on(child: &Child, signal: Signal) {
    // It may have ended a moment ago; then there is nobody to tell.
    let _ = kill_process(Pid::from_child(child), signal);
}
