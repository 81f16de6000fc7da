//! Checks the recording of a program, or of a verb, that has ended.

use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;

use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{Lacks, lacks_at_end};

use super::stderr::say;

/// The exit code if a program or a verb succeeded but its recording is incomplete. \[OURS] `timeout` uses the same code
/// for a program that it ended; shells and `env` do not use it.
pub const NOT_WHOLE: u8 = 124;

/// The link of a verb that talks to a chip or to a network, and may make a recording.
static OPENED: OnceLock<LinkUri> = OnceLock::new();

/// Notes that a verb opens this link.
pub fn opens(link: &LinkUri) {
    // A verb opens only one link.
    let _ = OPENED.set(link.clone());
}

/// The exit code of a verb that has closed its link: `code`, or [`NOT_WHOLE`] if it succeeded and its recording is
/// incomplete.
pub fn of_opened(code: ExitCode) -> ExitCode {
    let lacks = not_whole(OPENED.get()).filter(|_| code == ExitCode::SUCCESS);
    lacks.map_or(code, |lacks| {
        say("warning", &lacks);
        ExitCode::from(NOT_WHOLE)
    })
}

/// What the recording of the link lacks, with the name of its file. `None` if nothing is known to be missing, or if the
/// link does not record to a file.
pub fn not_whole(link: Option<&LinkUri>) -> Option<String> {
    let file = link?.value("record")?;
    let path = Path::new(file);
    // The reader of a pipe checks its end. A program that has opened no board has created no file.
    if !path.metadata().is_ok_and(|there| there.is_file()) {
        return None;
    }
    match lacks_at_end(path) {
        Ok(lacks) if lacks.is_nothing() => None,
        Ok(Lacks { .. }) if still_recorded(path) => None,
        Ok(lacks) => Some(format!("{file}: {lacks}")),
        Err(error) => Some(format!("{file} cannot be read back: {error}; look at its disk")),
    }
}

/// Whether another process still records to the file: a child process that the program did not wait for.
fn still_recorded(path: &Path) -> bool {
    let Ok(file) = std::fs::File::open(path) else { return false };
    match file.try_lock_shared() {
        Ok(()) => {
            let _ = file.unlock();
            false
        }
        Err(error) => matches!(error, std::fs::TryLockError::WouldBlock),
    }
}
