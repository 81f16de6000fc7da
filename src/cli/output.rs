//! Standard output, in large pieces.

use std::io::{self, BufWriter, StdoutLock, Write};

/// Standard output, locked and buffered. [`BufWriter::flush`] it at the end: an error in its `drop` is lost.
///
/// Unlike `println!` it never panics; a closed pipe is an error of the kind `BrokenPipe`.
pub fn stdout() -> BufWriter<StdoutLock<'static>> {
    BufWriter::with_capacity(64 * 1024, io::stdout().lock())
}

/// Writes `text` and ends.
pub fn print(text: impl AsRef<[u8]>) -> io::Result<()> {
    let mut out = stdout();
    out.write_all(text.as_ref())?;
    out.flush()
}
