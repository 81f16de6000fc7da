//! What a recorder says to whoever runs the program: a recording that is not what it should be is no matter of a log level.

use std::io::{self, Write};
use std::time::Duration;

use crate::threads;

/// How long a message may keep the recorder: somebody who does not read standard error holds nothing up. \[OURS]
const PATIENCE: Duration = Duration::from_millis(200);

/// Says a line on standard error, or in the program's log where that shows warnings.
pub(super) fn tell(line: String) {
    // A thread of its own: a write to a pipe that nobody reads never ends.
    let told = threads::spawn("ecmsk-tell", move || {
        if log::log_enabled!(log::Level::Warn) {
            log::warn!("{line}");
        } else {
            // In one piece: others write there too.
            let _ = io::stderr().write_all(format!("ecmsk: {line}\n").as_bytes());
        }
    });
    if let Ok(told) = told {
        threads::end_within(told, PATIENCE);
    }
}
