//! Standard output and standard error of verbs that move axes or serve clients. Each of the two has a queue of limited length
//! and a thread that writes it. So no other thread waits when nobody reads, as with a full pipe or a terminal stopped by
//! Ctrl-S.
//!
//! Lines of both streams appear in the order in which they were queued, as long as both are read in time.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::notes::{FLUSH_LIMIT, Note, NoteThread, Notes};

use super::lock::lock;
use super::stderr::said;

/// Longest time that a line waits for earlier lines of the other stream. \[OURS]
const ORDER_WAIT_MAX: Duration = Duration::from_millis(50);
/// The longest time that the tool, after a signal, waits at its end for queued lines to be written, and the longest wait of
/// [`flush_error`]. Without a signal the wait at the end is [`FLUSH_LIMIT`]. \[OURS]
const END_WAIT_AFTER_SIGNAL: Duration = Duration::from_millis(200);
/// Interval at which a waiting thread checks whether its wait is over: its lines were written, or a signal has arrived.
/// \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(1);

/// Standard output or standard error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    Output,
    Error,
}

/// Bytes that are queued for a stream.
struct Entry {
    bytes: Vec<u8>,
    /// The number of entries of the other stream that were queued before this one and are written first.
    others_before: u64,
}

/// The queues of both streams, and what the two threads that write them share.
#[derive(Default)]
struct Shared {
    /// The number of queued entries, for each stream.
    queued: Mutex<[u64; 2]>,
    /// The number of entries that were written or dropped, for each stream.
    done: [AtomicU64; 2],
    /// For each stream: whether the thread of the other stream has waited for it until the limit, and the stream has
    /// written nothing since. The other thread does not wait again then.
    is_stalled: [AtomicBool; 2],
    notes: [Notes<Entry>; 2],
    /// The error with which standard output has failed.
    failed: Mutex<Option<io::Error>>,
}

struct Streams {
    shared: Arc<Shared>,
    note_threads: [NoteThread<Entry>; 2],
}

/// The queues of standard output and standard error, and the threads that write them; empty until [`queue`] is called.
static STREAMS: OnceLock<Streams> = OnceLock::new();
/// Holds the number of the signal that has arrived, or 0. The signal handler stores it. A signal ends [`wait_for_output`]
/// and shortens the wait of [`finish`].
static SIGNAL: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// From now on both streams are written by threads of their own, through queues.
///
/// # Errors
/// The system provides no thread.
pub fn queue() -> io::Result<()> {
    if STREAMS.get().is_some() {
        return Ok(());
    }
    let shared = Arc::new(Shared::default());
    let note_thread = |stream: Stream| {
        let of = Arc::clone(&shared);
        NoteThread::start(&shared.notes[stream as usize], move |note| of.write(stream, note))
    };
    let note_threads = [note_thread(Stream::Output)?, note_thread(Stream::Error)?];
    // If another thread has called this function meanwhile, its queues are kept and these are dropped.
    let _ = STREAMS.set(Streams { shared, note_threads });
    Ok(())
}

/// Gives this module the integer in which a signal handler stores the number of a signal. From then on a signal ends
/// [`wait_for_output`] with an error, and shortens the wait of [`finish`].
pub fn end_waits_on(signal: &Arc<AtomicUsize>) {
    // Setting it fails only the second time, and a process has only one such integer.
    let _ = SIGNAL.set(Arc::clone(signal));
}

/// The number of the signal that has arrived; `None` if there was none.
pub fn signal() -> Option<u8> {
    let signal = SIGNAL.get()?.load(Ordering::SeqCst);
    (signal != 0).then_some(signal as u8)
}

/// Queues bytes for a stream without waiting. Returns false if [`queue`] was not called.
pub fn queue_bytes(stream: Stream, bytes: &[u8]) -> bool {
    let Some(Streams { shared, .. }) = STREAMS.get() else { return false };
    shared.queue_bytes(stream, bytes.to_vec());
    true
}

/// Checks that no write to standard output has failed so far.
///
/// # Errors
/// The error of the write that failed.
pub fn check_output() -> io::Result<()> {
    STREAMS.get().map_or(Ok(()), |streams| streams.shared.check())
}

/// Waits until all queued standard output is written, or a signal arrives. To be called only while no axis moves, because the
/// wait for whoever reads the output has no limit.
///
/// # Errors
/// Standard output cannot be written to; [`io::ErrorKind::Interrupted`]: a signal arrived first.
pub fn wait_for_output() -> io::Result<()> {
    let Some(Streams { shared, .. }) = STREAMS.get() else { return Ok(()) };
    let queued = shared.queued()[Stream::Output as usize];
    while shared.done[Stream::Output as usize].load(Ordering::Acquire) < queued {
        shared.check()?;
        if signal().is_some() {
            return Err(io::ErrorKind::Interrupted.into());
        }
        thread::sleep(LOOK_INTERVAL);
    }
    shared.check()
}

/// Waits until all queued standard output is written, at most `limit`. Returns whether it is.
///
/// # Errors
/// Standard output cannot be written to.
pub fn flush_output(limit: Duration) -> io::Result<bool> {
    let Some(Streams { shared, note_threads: [output, _] }) = STREAMS.get() else { return Ok(true) };
    let is_written = output.flush_within(limit);
    shared.check().map(|()| is_written)
}

/// Waits for a limited time until all queued standard error is written, because the caller will write to it directly.
pub fn flush_error() {
    if let Some(Streams { note_threads: [_, error], .. }) = STREAMS.get() {
        error.flush_within(END_WAIT_AFTER_SIGNAL);
    }
}

/// Ends the output of the tool: waits until everything is written, at most [`FLUSH_LIMIT`], or 200 ms after a signal.
///
/// # Errors
/// Standard output cannot be written to.
pub fn finish() -> io::Result<()> {
    let Some(Streams { shared, note_threads }) = STREAMS.get() else { return Ok(()) };
    let limit = if signal().is_some() { END_WAIT_AFTER_SIGNAL } else { FLUSH_LIMIT };
    note_threads.iter().for_each(|note_thread| _ = note_thread.flush_within(limit));
    shared.check()
}

impl Shared {
    fn queued(&self) -> MutexGuard<'_, [u64; 2]> {
        lock(&self.queued)
    }

    fn queue_bytes(&self, stream: Stream, bytes: Vec<u8>) {
        let (own, other) = stream.with_other();
        let mut queued = self.queued();
        queued[own] += 1;
        self.notes[own].push(Entry { bytes, others_before: queued[other] });
    }

    fn check(&self) -> io::Result<()> {
        let failed = lock(&self.failed);
        let again = |error: &io::Error| match error.raw_os_error() {
            Some(code) => io::Error::from_raw_os_error(code),
            None => io::Error::new(error.kind(), error.to_string()),
        };
        failed.as_ref().map_or(Ok(()), |error| Err(again(error)))
    }

    /// Writes an entry. Only the thread of this stream calls it.
    fn write(&self, stream: Stream, note: Note<Entry>) {
        let (own, _) = stream.with_other();
        match note {
            Note::Item(entry) => {
                self.wait_for_others(stream, entry.others_before);
                self.put(stream, &entry.bytes);
                self.is_stalled[own].store(false, Ordering::Release);
                self.done[own].fetch_add(1, Ordering::Release);
            }
            Note::Dropped(count) => {
                self.done[own].fetch_add(count, Ordering::Release);
                let of = if stream == Stream::Output { " of standard output" } else { "" };
                let dropped = format!("{count} lines{of} were dropped, those before were not read in time");
                let line = said("note", &dropped) + "\n";
                match stream {
                    Stream::Output => self.queue_bytes(Stream::Error, line.into_bytes()),
                    Stream::Error => self.put(stream, line.as_bytes()),
                }
            }
        }
    }

    /// Waits until the other stream has written the entries queued before this one, unless nobody reads that stream.
    fn wait_for_others(&self, stream: Stream, others_before: u64) {
        let (_, other) = stream.with_other();
        let began = Instant::now();
        while self.done[other].load(Ordering::Acquire) < others_before
            && !self.is_stalled[other].load(Ordering::Acquire)
        {
            if began.elapsed() >= ORDER_WAIT_MAX {
                self.is_stalled[other].store(true, Ordering::Release);
                return;
            }
            thread::sleep(LOOK_INTERVAL);
        }
    }

    fn put(&self, stream: Stream, bytes: &[u8]) {
        if stream == Stream::Error {
            // Errors are ignored, since standard error may be closed.
            let _ = io::stderr().write_all(bytes);
            return;
        }
        if self.check().is_err() {
            return;
        }
        let mut out = io::stdout().lock();
        if let Err(error) = out.write_all(bytes).and_then(|()| out.flush()) {
            *lock(&self.failed) = Some(error);
        }
    }
}

impl Stream {
    /// The array indexes of this stream and of the other one.
    const fn with_other(self) -> (usize, usize) {
        match self {
            Self::Output => (0, 1),
            Self::Error => (1, 0),
        }
    }
}
