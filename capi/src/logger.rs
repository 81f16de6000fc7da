//! The log. The part of it that `ECMSK_LOG` selects is written to standard error, and its warnings go to `ecmsk exec` if
//! that has started the program. Without either the library prints nothing, like the vendor's library.
//!
//! No call of the program waits for the log: standard error may be a pipe that nobody reads, or a terminal that is paused,
//! while an axis moves. Lines go into a queue ([`notes`](ecmsk::notes)), and a thread writes them. At its end the process
//! waits for these lines for a limited time, after the boards were released.

use std::io::Write;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use std::{io, mem, process};

use ecmsk::link::config;
use ecmsk::notes::{Note, NoteThread, Notes};
use ecmsk::summary::writer::{self, SummaryWriter};
use log::{Level, LevelFilter, Log, Metadata, Record};

/// How long the end of the process waits for the last lines. \[OURS] A reader that works takes them at once.
const END_WAIT_MAX: Duration = Duration::from_millis(100);

/// Installs the log of the process. A Rust program that links the static library may have installed its own before, which is
/// used then.
pub fn set_up() {
    let wanted = config::variable("ECMSK_LOG").and_then(|wanted| wanted.into_string().ok());
    let shown = wanted.filter(|wanted| !wanted.is_empty());
    let shown = shown.map(|wanted| {
        let target = env_logger::Target::Pipe(Box::new(StandardError));
        env_logger::Builder::new().parse_filters(&wanted).target(target).build()
    });
    let summary_writer = writer::of_process();
    let level = |wanted: bool, level| if wanted { level } else { LevelFilter::Off };
    let shown_level = shown.as_ref().map_or(LevelFilter::Off, env_logger::Logger::filter);
    let max = shown_level.max(level(summary_writer.is_some(), LevelFilter::Warn));
    if max > LevelFilter::Off && log::set_boxed_logger(Box::new(Logger { shown, summary_writer })).is_ok() {
        log::set_max_level(max);
    }
}

/// Waits until the queued lines are written, at most 100 ms. Called at the end of the process.
pub fn finish() {
    // A thread holds the lock for a few instructions. If this process ends in a signal handler that has interrupted these
    // instructions, the lock never becomes free.
    if let Ok(lines) = LINES.try_lock()
        && let Some(lines) = lines.as_ref().filter(|lines| lines.process == process::id())
        && let Some(teller) = &lines.teller
    {
        teller.flush_within(END_WAIT_MAX);
    }
}

/// Ends the thread that writes lines, because Windows may unload this library when no board is open. The thread starts
/// again with the next line of an open board.
#[cfg(windows)]
pub fn rest() {
    let lines = LINES.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some(teller) = lines.and_then(|lines| lines.teller) {
        teller.end_within(END_WAIT_MAX);
    }
}

/// The lines of this process on their way to standard error. Calls of this library hold the lock for a few instructions;
/// the thread that writes never holds it. So a child of fork that may use this library finds the lock free.
static LINES: Mutex<Option<Lines>> = Mutex::new(None);

struct Lines {
    /// The id of the process that has queued the lines. A child of fork has another id, and not the thread that writes them, so
    /// it begins a queue of its own.
    process: u32,
    notes: Notes<Vec<u8>>,
    /// The thread that writes lines; `None`: it was not started yet, or the system could not start one. Then the lines
    /// stay queued, and the next line tries to start it.
    teller: Option<NoteThread<Vec<u8>>>,
}

impl Lines {
    fn begin(process: u32) -> Self {
        Self { process, notes: Notes::default(), teller: None }
    }

    fn add(&mut self, line: Vec<u8>) {
        self.notes.push(line);
        if self.teller.is_none() {
            self.teller = NoteThread::start(&self.notes, tell).ok();
        }
    }
}

/// Writes a queued line. Runs on the thread that writes lines.
fn tell(note: Note<Vec<u8>>) {
    match note {
        Note::Item(line) => write_now(&line),
        Note::Dropped(count) => write_now(
            format!("ecmsk: {count} lines of the log were dropped here, those before were not read in time\n")
                .as_bytes(),
        ),
    }
}

/// Writes to standard error. An error is ignored, since there is nowhere to report it.
fn write_now(bytes: &[u8]) {
    let _ = raw::write_all(bytes);
}

/// The output that `env_logger` writes to: each write is one log record, which is queued as one line for standard error.
struct StandardError;

impl Write for StandardError {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if cfg!(windows) && !crate::forked::any_open() {
            // No board is open, so Windows may unload this library, and no thread of it may exist. The call writes the
            // line itself, which delays no axis.
            write_now(bytes);
            return Ok(bytes.len());
        }
        let mut lines = LINES.lock().unwrap_or_else(PoisonError::into_inner);
        let here = process::id();
        let lines = lines.get_or_insert_with(|| Lines::begin(here));
        if lines.process != here {
            // This is a child of fork. A thread of the parent may have held a lock of the old queue, so the queue is
            // leaked, not dropped.
            mem::forget(mem::replace(lines, Lines::begin(here)));
        }
        lines.add(bytes.to_vec());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(unix)]
mod raw {
    use std::io;

    /// Writes to standard error without the lock of [`std::io::stderr`]: a child of fork would find it held by a thread of its
    /// parent that waits for the reader.
    pub fn write_all(mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            // SAFETY: the bytes are valid for that length, and are only read.
            let written = unsafe { libc::write(libc::STDERR_FILENO, bytes.as_ptr().cast(), bytes.len()) };
            match usize::try_from(written) {
                Ok(written) => bytes = &bytes[written..],
                Err(_) => wait_for_room(io::Error::last_os_error())?,
            }
        }
        Ok(())
    }

    /// Waits after a write that was interrupted or, if the program has made standard error non-blocking, has found no room.
    fn wait_for_room(error: io::Error) -> io::Result<()> {
        match error.kind() {
            io::ErrorKind::Interrupted => Ok(()),
            io::ErrorKind::WouldBlock => {
                let mut polled = libc::pollfd { fd: libc::STDERR_FILENO, events: libc::POLLOUT, revents: 0 };
                // SAFETY: `polled` is one valid structure, and the count is 1. If the wait fails, the next write reports the
                // error.
                unsafe { libc::poll(&raw mut polled, 1, -1) };
                Ok(())
            }
            _ => Err(error),
        }
    }
}

#[cfg(not(unix))]
mod raw {
    use std::io::{self, Write};

    pub fn write_all(bytes: &[u8]) -> io::Result<()> {
        io::stderr().write_all(bytes)
    }
}

struct Logger {
    shown: Option<env_logger::Logger>,
    summary_writer: Option<&'static SummaryWriter>,
}

impl Logger {
    fn shows(&self, metadata: &Metadata<'_>) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.enabled(metadata))
    }

    /// Whether `ecmsk exec` gets the message: warnings of this project, and none of other crates.
    fn tells(&self, metadata: &Metadata<'_>) -> bool {
        let of_ours = || ["ecmsk", "NEXTWUSBLib"].iter().any(|name| metadata.target().starts_with(name));
        self.summary_writer.is_some() && metadata.level() <= Level::Warn && of_ours()
    }
}

impl Log for Logger {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        self.shows(metadata) || self.tells(metadata)
    }

    fn log(&self, record: &Record<'_>) {
        if self.tells(record.metadata())
            && let Some(summary_writer) = self.summary_writer
        {
            summary_writer.queue_message(record.args().to_string());
        }
        if let Some(shown) = &self.shown {
            shown.log(record);
        }
    }

    fn flush(&self) {
        finish();
    }
}
