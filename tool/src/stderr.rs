//! Standard error of the tool: written at once, or by a thread of its own where nothing may wait for whoever reads it.

use std::io::{self, Write};
use std::sync::OnceLock;

use ecmsk::port::notes::{Note, Notes, Teller};

use super::visible::Visible;

/// Bytes of a line that is to be written.
type Line = Vec<u8>;

/// What is to be written, once [`queue`] was called.
static QUEUE: OnceLock<(Notes<Line>, Teller<Line>)> = OnceLock::new();

/// From now on lines are put into a bounded queue, which a thread writes to standard error: nobody who says something waits for
/// whoever reads it. What is not read in time is dropped, the oldest lines first, and the number of those is written instead.
///
/// # Errors
/// The system gives no thread.
pub fn queue() -> io::Result<()> {
    let notes = Notes::<Line>::default();
    let teller = Teller::start(&notes, |note| match note {
        Note::Told(line) => write_now(&line),
        Note::Dropped(count) => {
            write_now(format!("note: {count} lines were dropped, those before were not read in time\n").as_bytes());
        }
    });
    // Once is enough.
    let _ = QUEUE.set((notes, teller?));
    Ok(())
}

/// Writes a line, or has it written.
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
    let bytes = shown(&bytes);
    match QUEUE.get() {
        Some((notes, _)) => notes.tell(bytes),
        None => write_now(&bytes),
    }
}

/// What was said, with what would control a terminal by its code.
fn shown(bytes: &[u8]) -> Vec<u8> {
    let mut shown = Vec::with_capacity(bytes.len());
    // Nothing fails that goes to memory.
    let _ = Visible::new(&mut shown).write_all(bytes);
    shown
}

/// That nobody may be there to read it is not worth a panic.
fn write_now(bytes: &[u8]) {
    let _ = io::stderr().write_all(bytes);
}

/// Where the log of the tool goes: a record is written in one piece.
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
