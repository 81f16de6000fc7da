//! Standard error of the tool. By default it is written directly. Verbs that move axes or serve clients write it through the
//! queue of [`streams`], so that they never wait for whoever reads it.

use std::io::{self, Write};

use super::streams::{self, Stream};
use super::visible::visible_bytes;

/// Writes a line, directly or through the queue.
pub fn line(text: &str) {
    write(format!("{text}\n").as_bytes());
}

/// Prints a line on standard error: `kind: what`.
pub fn say(kind: &str, what: &dyn std::fmt::Display) {
    line(&format!("{kind}: {what}"));
}

/// Writes text that may include the tool's own control sequences. What comes from outside the tool, such as names in a
/// recording or messages of a server, must have passed [`visible`](super::visible::visible) before: its control characters
/// could control the terminal.
pub fn raw(text: &str) {
    put(text.as_bytes());
}

fn write(bytes: &[u8]) {
    put(&visible_bytes(bytes));
}

/// Writes bytes directly or through the queue. Errors are ignored, since standard error may be closed.
fn put(bytes: &[u8]) {
    if !streams::queue_bytes(Stream::Error, bytes) {
        let _ = io::stderr().write_all(bytes);
    }
}

/// The writer for log records. Each record is queued as a whole, so that no other line comes in between.
pub struct Log;

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
