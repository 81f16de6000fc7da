//! Standard output, buffered.

use std::io::{self, BufWriter, StdoutLock, Write};

use super::visible::Visible;

/// Standard output for text, see [`Visible`].
pub type Out = Visible<BufWriter<StdoutLock<'static>>>;

/// Standard output, locked and buffered. [`Out::flush`] it at the end: an error in its `drop` is lost.
///
/// Unlike `println!` it never panics; a closed pipe is an error of the kind `BrokenPipe`.
pub fn stdout() -> Out {
    Visible::new(BufWriter::with_capacity(64 * 1024, io::stdout().lock()))
}

/// Writes `text` and flushes. A picture in pixels is no text and is written to [`io::stdout`] directly.
pub fn print(text: impl AsRef<[u8]>) -> io::Result<()> {
    let mut out = stdout();
    out.write_all(text.as_ref())?;
    out.flush()
}

/// Writes text with the tool's own colours and flushes. Text from outside in it must have passed
/// [`visible`](super::visible::visible).
pub fn print_coloured(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}
