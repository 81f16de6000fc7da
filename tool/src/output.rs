//! Buffered standard output. For verbs during which axes move it goes through the queue of [`streams`].

use std::fmt::Display;
use std::io::{self, BufWriter, StdoutLock, Write};

use super::streams::{self, Stream};
use super::visible::{Visible, visible_bytes};

/// Standard output for text, with control characters made visible, see [`Visible`].
pub type Out = Visible<BufWriter<StdoutLock<'static>>>;

/// Standard output, locked and buffered. [`Out::flush`] it at the end: an error in its `drop` is lost.
///
/// Unlike `println!` it never panics; a closed pipe is an error of the kind `BrokenPipe`.
pub fn stdout() -> Out {
    Visible::new(BufWriter::with_capacity(64 * 1024, io::stdout().lock()))
}

/// Writes `text` and waits until it is written. A picture in pixels is no text and is written to [`io::stdout`]
/// directly.
///
/// # Errors
/// Standard output cannot be written. For a verb that talks to a board also [`io::ErrorKind::Interrupted`]: a signal
/// arrived before the text was written.
pub fn print(text: impl AsRef<[u8]>) -> io::Result<()> {
    print_bytes(&visible_bytes(text.as_ref()))
}

/// Writes text with the tool's own colours and waits until it is written. What comes from outside the tool, such as names in a
/// recording or messages of a server, must have passed [`visible`](super::visible::visible) before: its control characters
/// could control the terminal.
///
/// # Errors
/// The errors of [`print()`].
pub fn print_coloured(text: &str) -> io::Result<()> {
    print_bytes(text.as_bytes())
}

/// Like [`print()`], but only queues the text, so it may be called while axes move.
///
/// # Errors
/// An earlier text could not be written.
pub fn tell(text: impl AsRef<[u8]>) -> io::Result<()> {
    streams::check_output()?;
    let bytes = visible_bytes(text.as_ref());
    if streams::queue_bytes(Stream::Output, &bytes) { Ok(()) } else { print_now(&bytes) }
}

fn print_bytes(bytes: &[u8]) -> io::Result<()> {
    if streams::queue_bytes(Stream::Output, bytes) { streams::wait_for_output() } else { print_now(bytes) }
}

fn print_now(bytes: &[u8]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(bytes)?;
    out.flush()
}

/// A number of things: `1 slave`, `3 slaves`.
pub fn counted<N: Display + PartialEq + From<u8>>(count: N, one: &str) -> String {
    format!("{count} {one}{}", if count == N::from(1) { "" } else { "s" })
}

/// A time of a recording as `dump` and `find` print it, with each nanosecond: `1.758000000`.
pub fn seconds(since_ns: i64) -> String {
    let (ns, sign) = (since_ns.unsigned_abs(), if since_ns < 0 { "-" } else { "" });
    format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}
