//! Runs the program on Unix: signals and exit codes.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, ExitCode, ExitStatus};
use std::sync::{Arc, Mutex};
use std::{io, thread};

use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process, waitid};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;

use super::{ExecError, failed, not_started};
use crate::lock::lock;
use crate::signals;

/// The advice for a file that the user may not execute.
pub const MAKE_EXECUTABLE: &str = "make it executable with `chmod +x`";

/// Starts `command` and waits for its end.
///
/// A terminal sends SIGINT and SIGQUIT to the program too, because it is in the same process group. So the tool catches
/// these signals and does nothing. SIGTERM and SIGHUP, which only the tool gets, are passed on to the program. The tool
/// ends when the program ends.
pub fn run(command: &mut Command, program: &Path) -> Result<ExitStatus, ExecError> {
    // The signals are caught and not ignored, because a child process inherits ignored signals. Signals that were
    // already ignored when the tool started (`nohup`) stay ignored. This is done before the program starts, so that no
    // signal is lost.
    let ours = signals::not_ignored(&[SIGINT, SIGQUIT, SIGTERM, SIGHUP]);
    let mut signals = Signals::new(ours).map_err(failed("catch signals"))?;
    // The process id of the program while it runs; `None` before it is started and after its end was collected.
    let running = Arc::new(Mutex::new(None));
    let mut started = lock(&running);
    // A separate thread handles the signals, so that the end of the program is noticed even if a signal is lost. The
    // thread waits for the lock until the program runs.
    let passed_on = Arc::clone(&running);
    let pass_on = move || {
        for signal in signals.forever() {
            match signal {
                SIGTERM => pass_on(&passed_on, Signal::TERM),
                SIGHUP => pass_on(&passed_on, Signal::HUP),
                _ => {}
            }
        }
    };
    thread::Builder::new().name("signals".into()).spawn(pass_on).map_err(failed("start a thread"))?;
    let mut child = command.spawn().map_err(|source| not_started(program, source))?;
    let id = Pid::from_child(&child);
    *started = Some(id);
    drop(started);

    let wait = || waitid(WaitId::Pid(id), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT);
    while let Err(error) = wait() {
        if error != Errno::INTR {
            return Err(failed("wait for the program")(io::Error::from(error)));
        }
    }
    lock(&running).take();
    child.wait().map_err(failed("wait for the program"))
}

/// The exit code of the program; after signal n, 128 + n, as in a shell.
pub fn end_as(ended: ExitStatus) -> ExitCode {
    let code = ended.code().or_else(|| ended.signal().map(|signal| 128 + signal));
    // An exit code has 8 bits. It fits, since the largest signal number is 64.
    ExitCode::from(code.and_then(|code| u8::try_from(code).ok()).unwrap_or(u8::MAX))
}

/// Passes a signal on to the program. After the end of the program was collected, nothing is sent, because its process
/// id may then belong to another process.
fn pass_on(running: &Mutex<Option<Pid>>, signal: Signal) {
    let running = lock(running);
    if let Some(id) = *running {
        // Sending fails only if the program has already ended.
        let _ = kill_process(id, signal);
    }
}
