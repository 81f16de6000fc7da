//! Checks the recording of a program, or of a verb, that has ended.

use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;

use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{Lacks, lacks_at_end};

use super::stderr::say;

/// The exit code if a program or a verb succeeded but its recording is incomplete. \[OURS] It is that of `timeout` for a
/// program that it has ended, and none that shells or `env` use.
pub const NOT_WHOLE: u8 = 124;

/// The link of a verb that talks to a chip or to a network, and may record on the way.
static OPENED: OnceLock<LinkUri> = OnceLock::new();

/// A verb opens this link.
pub fn opens(link: &LinkUri) {
    // A verb opens one.
    let _ = OPENED.set(link.clone());
}

/// The exit code of a verb that has closed its link: another one if it succeeded and its recording is not whole.
pub fn of_opened(code: ExitCode) -> ExitCode {
    let lacks = not_whole(OPENED.get()).filter(|_| code == ExitCode::SUCCESS);
    lacks.map_or(code, |lacks| {
        say("warning", &lacks);
        ExitCode::from(NOT_WHOLE)
    })
}

/// What the recording of the link lacks, with its file's name; `None` if nothing is known to be missing, or the link
/// does not record to a file.
pub fn not_whole(link: Option<&LinkUri>) -> Option<String> {
    let file = link?.value("record")?;
    let path = Path::new(file);
    // The end of a pipe is checked by its reader. A program that has opened no board has made no file.
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

/// Whether another process still records to the file: one that the program has started and not waited for.
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
