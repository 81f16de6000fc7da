//! Standard output, in large pieces.

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

/// Writes `text` and ends. What is no text, a picture in pixels, goes to [`io::stdout`] itself.
pub fn print(text: impl AsRef<[u8]>) -> io::Result<()> {
    let mut out = stdout();
    out.write_all(text.as_ref())?;
    out.flush()
}

/// Writes text that has colours of the tool's own and ends: what comes from outside has gone through
/// [`visible`](super::visible::visible) already.
pub fn print_coloured(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}
