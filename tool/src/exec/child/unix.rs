//! Running the program on Unix: signals and exit codes.

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
/// A terminal sends SIGINT and SIGQUIT to the program as well, which is in the same process group, so the tool leaves
/// them to the program. SIGTERM and SIGHUP, which only the tool gets, are passed on. The tool then ends as the
/// program does.
pub fn run(command: &mut Command, program: &Path) -> Result<ExitStatus, ExecError> {
    // The signals are caught and not ignored, because a program inherits that a signal is ignored. Those that the
    // tool was started to ignore (`nohup`) stay ignored. This happens before the program starts, so that no signal is
    // lost in between.
    let ours = signals::not_ignored(&[SIGINT, SIGQUIT, SIGTERM, SIGHUP]);
    let mut signals = Signals::new(ours.chain([SIGCHLD])).map_err(failed("catch signals"))?;
    let mut child = command.spawn().map_err(|source| not_started(program, source))?;
    loop {
        for signal in signals.wait() {
            match signal {
                SIGTERM => pass_on(&child, Signal::TERM),
                SIGHUP => pass_on(&child, Signal::HUP),
                _ => {}
            }
        }
        if let Some(ended) = child.try_wait().map_err(failed("wait for the program"))? {
            return Ok(ended);
        }
    }
}

/// The exit code of the program, or 128 + n after signal n, as shells have it.
pub fn end_as(ended: ExitStatus) -> ExitCode {
    let code = ended.code().or_else(|| ended.signal().map(|signal| 128 + signal));
    // Exit codes have 8 bits, and signals go up to 64.
    ExitCode::from(code.and_then(|code| u8::try_from(code).ok()).unwrap_or(u8::MAX))
}

/// Passes a signal on to the program, which has not been waited for yet, so its process id cannot be that of another
/// process.
fn pass_on(child: &Child, signal: Signal) {
    // The program may have ended already.
    let _ = kill_process(Pid::from_child(child), signal);
}
