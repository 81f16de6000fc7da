//! Reads a line that is typed at the terminal, without a thread.

use std::io;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// \[OURS] The longest answer in bytes. A terminal returns a whole line at once; a longer line is cut.
const LINE_BYTES_MAX: usize = 256;
const AT_ONCE: Timespec = Timespec { tv_sec: 0, tv_nsec: 0 };

/// Reads one line from the terminal without blocking; [`Self::take`] polls for it.
pub struct TypedLine;

impl TypedLine {
    pub const fn start() -> Self {
        Self
    }

    /// The line, once it was typed; empty at the end of the input. It bypasses the buffer of [`io::Stdin`], so that
    /// input after this line is left for the next reader.
    pub fn take(&mut self) -> Option<String> {
        let stdin = io::stdin();
        let mut fds = [PollFd::new(&stdin, PollFlags::IN)];
        if !poll(&mut fds, Some(&AT_ONCE)).is_ok_and(|ready| ready > 0) {
            return None;
        }
        let mut line = [0; LINE_BYTES_MAX];
        let read = rustix::io::read(&stdin, &mut line).unwrap_or(0);
        Some(String::from_utf8_lossy(&line[..read]).into_owned())
    }
}
