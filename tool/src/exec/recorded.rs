//! What became of the recording of a program that has ended.

use std::path::Path;

use ecmsk::link::uri::LinkUri;
use ecmsk::recording::{Lacks, lacks_at_end};

/// Exit code of a program that ended well and whose recording is not whole. \[OURS] That of `timeout` for a program that was
/// not let end; no code that shells or `env` use.
pub const NOT_WHOLE: u8 = 124;

/// What the recording of that link lacks, with its file's name; `None` if nothing is known to be missing, or the link does
/// not record to a file.
pub fn not_whole(link: Option<&LinkUri>) -> Option<String> {
    let file = link?.value("record")?;
    let path = Path::new(file);
    // A pipe is its reader's business, and a program that has opened no board has made no file.
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

/// Whether somebody still records to it: a program that the one which has ended started and did not wait for.
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
