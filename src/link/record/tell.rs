//! Messages of a recorder to the user of the program. They are shown at any log level: otherwise the user would not
//! know that frames are missing, which can make a recording useless.

use std::io::{self, Write};
use std::time::Duration;

use crate::threads;

/// How long the recorder waits until a message is written. Standard error may be a pipe that nobody reads. \[OURS]
const WRITE_WAIT_MAX: Duration = Duration::from_millis(200);

/// Writes a line to the program's log if that shows warnings, and otherwise to standard error.
pub(super) fn tell(line: String) {
    // A thread of its own writes the line, since the write may wait forever for a reader of the pipe.
    let told = threads::spawn("ecmsk-tell", move || {
        if log::log_enabled!(log::Level::Warn) {
            log::warn!("{line}");
        } else {
            // A single write, so that no output of other threads gets into the line.
            let _ = io::stderr().write_all(format!("ecmsk: {line}\n").as_bytes());
        }
    });
    if let Ok(told) = told {
        threads::end_within(told, WRITE_WAIT_MAX);
    }
}
