//! Checks whether a recording is complete, when the program or verb that made it has ended.

use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;

use ecmsk::link::record::flight;
use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{Lacks, lacks_at_end};

use super::stderr::say;

/// The exit code of a program or verb that succeeded but whose recording is incomplete. \[OURS] Shells and `env` give other
/// meanings to 125 and above. 124 means a timeout only for a program that runs under `timeout`.
pub const NOT_WHOLE: u8 = 124;

/// The link that a verb of `xf`, `bus` or `params` has opened. It may contain a recording.
static OPENED: OnceLock<LinkUri> = OnceLock::new();

/// Stores the link that a verb of the tool opens. When the verb has ended, [`of_opened`] checks whether the recording that
/// this link makes is complete.
pub fn note_opened(link: &LinkUri) {
    // Setting it can fail only for a second link, and a verb opens only one.
    let _ = OPENED.set(link.clone());
}

/// The exit code of a verb that has closed its link: `code`, or [`NOT_WHOLE`] with a warning if the verb succeeded but its
/// recording is incomplete.
pub fn of_opened(code: ExitCode) -> ExitCode {
    let lacks = not_whole(OPENED.get()).filter(|_| code == ExitCode::SUCCESS);
    lacks.map_or(code, |lacks| {
        say("warning", &lacks);
        ExitCode::from(NOT_WHOLE)
    })
}

/// What the recordings of the link lack to be complete, with the name of the file or folder. `None` if nothing is known to be
/// missing, or if the link does not record.
pub fn not_whole(link: Option<&LinkUri>) -> Option<String> {
    let link = link?;
    let folder =
        link.value("flight").and_then(|folder| Some(format!("{folder}: {}", flight::lacks(Path::new(folder))?)));
    let lacks: Vec<String> = [link.value("record").and_then(file_not_whole), folder].into_iter().flatten().collect();
    (!lacks.is_empty()).then(|| lacks.join("; "))
}

/// What the recording in a file lacks.
fn file_not_whole(file: &str) -> Option<String> {
    let path = Path::new(file);
    // The recording is not checked if it goes to a pipe. There is no file if the program has opened no board.
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

/// Whether another process is still writing the recording, such as a child that the program did not wait for. The writer holds
/// a lock on the file.
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
