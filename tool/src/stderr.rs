//! Standard error of the tool. By default it is written directly; a server writes it in a thread of its own, so that
//! it never waits for a reader.

use std::io::{self, Write};
use std::sync::OnceLock;

use ecmsk::notes::{Note, Notes, Teller};

use super::visible::visible_bytes;

/// The bytes of a line.
type Line = Vec<u8>;

/// The queue of lines, once [`queue`] was called.
static QUEUE: OnceLock<(Notes<Line>, Teller<Line>)> = OnceLock::new();

/// From now on lines are put into a bounded queue, from which a thread writes them to standard error, so that no
/// other thread waits for its reader. If the reader is too slow the oldest lines are dropped, and their number is
/// written instead.
///
/// # Errors
/// The system provides no thread.
pub fn queue() -> io::Result<()> {
    let notes = Notes::<Line>::default();
    let teller = Teller::start(&notes, |note| match note {
        Note::Told(line) => write_now(&line),
        Note::Dropped(count) => {
            write_now(format!("note: {count} lines were dropped, those before were not read in time\n").as_bytes());
        }
    });
    // A second call has no effect.
    let _ = QUEUE.set((notes, teller?));
    Ok(())
}

/// Writes a line, directly or by the queue.
pub fn line(text: &str) {
    write(format!("{text}\n").into_bytes());
}

/// Waits until everything is written, for a limited time if lines are put into a queue.
pub fn finish() {
    if let Some((_, teller)) = QUEUE.get() {
        teller.end();
    }
}

fn write(bytes: Vec<u8>) {
    let bytes = visible_bytes(&bytes);
    match QUEUE.get() {
        Some((notes, _)) => notes.tell(bytes),
        None => write_now(&bytes),
    }
}

/// A closed standard error is ignored.
fn write_now(bytes: &[u8]) {
    let _ = io::stderr().write_all(bytes);
}

/// The target of the log; a record is written in one piece.
pub struct Log;

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write(bytes.to_vec());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
