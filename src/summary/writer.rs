//! Reports to `ecmsk exec` what happens in a program: writes [`Line`]s to a file that the tool has created. The
//! environment variable [`FILE_VARIABLE`] has the name of the file.
//!
//! The program never waits for the file: lines go into a queue, and if the queue is full they are dropped and counted. While a
//! board is open, a thread writes the queued lines several times a second. Closing a board also writes them, since the process
//! may end next. Messages of the log that differ only in their numbers are written once, followed by their count.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, OnceLock, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::{Line, TEXTS_MAX};
use crate::address::config;
use crate::threads;

/// The environment variable with the path of the file for the lines. `ecmsk exec` sets it.
pub const FILE_VARIABLE: &str = "ECMSK_TOLD";

/// \[OURS] The maximum number of lines in the queue; further ones are dropped and counted.
const QUEUE_LEN: usize = 1024;
/// The interval at which the thread writes the queued lines to the file. \[OURS]
const PERIOD: Duration = Duration::from_millis(100);
/// Counts are written whenever the run time has grown by 1/64 since the last time. So the file of a program that runs for weeks
/// stays small, and the counts of a killed program are almost up to date. \[OURS]
const COUNTS_PERIOD_FRACTION: u32 = 64;
/// The longest interval at which counts are written. \[OURS]
const COUNTS_PERIOD_MAX: Duration = Duration::from_secs(10);

/// An entry of the queue: a line for the file, or a message of the log, from which [`WriterState`] makes a line only if it is
/// the first of its kind.
enum Fact {
    Line(Line),
    /// A message of the log.
    Message(String),
}

/// Writes what happens in this process to the file from which `ecmsk exec` makes its summary.
pub struct SummaryWriter {
    queue: SyncSender<Fact>,
    dropped: AtomicU64,
    state: Mutex<WriterState>,
}

struct WriterState {
    facts: Receiver<Fact>,
    file: Box<dyn Write + Send>,
    /// The kinds of log messages. The key is the text of a message with `#` in place of each number.
    messages: BTreeMap<String, Message>,
    boards: Vec<WatchedBoard>,
    /// The number of boards that the process has opened.
    boards_opened: u32,
    /// The thread that writes the queued lines; it runs while a board is open.
    thread: Option<JoinHandle<()>>,
    began: Instant,
    counts_written: Instant,
    dropped: u64,
}

/// A kind of log message.
struct Message {
    /// The id of the kind in [`Line::Message`].
    id: u32,
    /// The number of messages of this kind.
    times: u64,
    /// The value of `times` that was last written to the file.
    times_written: u64,
}

/// A link whose counts are written to the file.
pub(super) trait Counted: Send + Sync {
    /// The counts so far, with their names.
    fn counts(&self) -> Vec<(String, u64)>;

    /// Whether the link was closed. Its counts do not change after that.
    fn is_closed(&self) -> bool;
}

/// An open board whose counts are written to the file.
struct WatchedBoard {
    number: u32,
    link: Weak<dyn Counted>,
    /// The counts as last written to the file.
    written: BTreeMap<String, u64>,
}

/// The writer of this process; `None` unless `ecmsk exec` has set [`FILE_VARIABLE`] for it.
pub fn of_process() -> Option<&'static SummaryWriter> {
    static WRITER: OnceLock<Option<SummaryWriter>> = OnceLock::new();
    let summary_writer = WRITER.get_or_init(|| {
        let file = open(Path::new(&config::variable(FILE_VARIABLE)?)).ok()?;
        Some(SummaryWriter::to(Box::new(file)))
    });
    summary_writer.as_ref()
}

/// Opens the file. It has to be an existing regular file, because the tool has created it.
fn open(path: &Path) -> io::Result<File> {
    if !std::fs::symlink_metadata(path)?.is_file() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    OpenOptions::new().append(true).open(path)
}

impl SummaryWriter {
    fn to(file: Box<dyn Write + Send>) -> Self {
        let (queue, facts) = sync_channel(QUEUE_LEN);
        let now = Instant::now();
        let state = WriterState {
            facts,
            file,
            messages: BTreeMap::new(),
            boards: Vec::new(),
            boards_opened: 0,
            thread: None,
            began: now,
            counts_written: now,
            dropped: 0,
        };
        Self { queue, dropped: AtomicU64::new(0), state: Mutex::new(state) }
    }

    /// Queues a line without waiting; drops it if the queue is full.
    pub fn queue_line(&self, line: Line) {
        self.put(Fact::Line(line));
    }

    /// Queues a message of the log without waiting; drops it if the queue is full.
    pub fn queue_message(&self, text: String) {
        self.put(Fact::Message(text));
    }

    fn put(&self, fact: Fact) {
        if self.queue.try_send(fact).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Adds a board that was just opened. Its counts are written from now on.
    pub(super) fn add_board(&'static self, link: Weak<dyn Counted>) {
        let mut state = self.state();
        let number = state.boards_opened;
        state.boards_opened += 1;
        state.boards.push(WatchedBoard { number, link, written: BTreeMap::new() });
        if state.thread.is_none() {
            // If the system provides no thread, queued lines are written only when the board is closed.
            state.thread = threads::spawn("ecmsk-summary", || self.run()).ok();
        }
    }

    /// The main loop of the thread that writes the queued lines.
    fn run(&self) {
        while self.write() {
            std::thread::park_timeout(PERIOD);
        }
    }

    /// Writes the queued lines, and the counts if they are due. Returns whether a board is open.
    fn write(&self) -> bool {
        let mut state = self.state();
        let counts_period = (state.began.elapsed() / COUNTS_PERIOD_FRACTION).clamp(PERIOD, COUNTS_PERIOD_MAX);
        let with_counts = state.counts_written.elapsed() >= counts_period;
        state.write(self.dropped.load(Ordering::Relaxed), with_counts);
        !state.boards.is_empty()
    }

    /// Writes the queued lines and all counts.
    pub fn write_all(&self) {
        self.state().write(self.dropped.load(Ordering::Relaxed), true);
    }

    /// Called when a board was closed: writes the queued lines and the counts. If no board is open any more, ends the thread,
    /// since the program may unload the library next.
    pub(super) fn closed(&self) {
        let thread = {
            let mut state = self.state();
            state.write(self.dropped.load(Ordering::Relaxed), true);
            if state.boards.is_empty() { state.thread.take() } else { None }
        };
        if let Some(thread) = thread {
            thread.thread().unpark();
            // A panic of the thread was reported when it happened.
            let _ = thread.join();
        }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, WriterState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl WriterState {
    fn write(&mut self, dropped: u64, with_counts: bool) {
        let mut lines = String::new();
        // Child processes of the program may write to the same file, so each line begins with the process id.
        let process = std::process::id();
        let mut add = |line: &Line| lines.push_str(&format!("{process} {line}\n"));
        while let Ok(fact) = self.facts.try_recv() {
            match fact {
                Fact::Line(line) => add(&line),
                Fact::Message(text) => {
                    let known = self.messages.len();
                    match self.messages.get_mut(&without_figures(&text)) {
                        Some(message) => message.times += 1,
                        None if known >= TEXTS_MAX => self.dropped += 1,
                        None => {
                            let id = known as u32;
                            self.messages.insert(without_figures(&text), Message { id, times: 1, times_written: 1 });
                            add(&Line::Message { id, text });
                        }
                    }
                }
            }
        }
        if with_counts {
            self.counts_written = Instant::now();
            for message in self.messages.values_mut().filter(|message| message.times > message.times_written) {
                message.times_written = message.times;
                add(&Line::Repeated { id: message.id, times: message.times });
            }
            for WatchedBoard { number, link, written } in &mut self.boards {
                let Some(link) = link.upgrade() else { continue };
                for (name, value) in link.counts() {
                    // A count may fall: the time of a wait for a state returns to 0 when the state is reached.
                    if value != written.get(&name).copied().unwrap_or_default() {
                        add(&Line::Count { board: *number, name: name.clone(), value });
                        written.insert(name, value);
                    }
                }
            }
            self.boards.retain(|board| board.link.upgrade().is_some_and(|link| !link.is_closed()));
            if dropped + self.dropped > 0 {
                add(&Line::Dropped(dropped + self.dropped));
            }
        }
        // If writing fails, the tool has ended or its disk is full, and nobody can be informed. All lines go into one
        // write, so that lines of several processes do not mix.
        let _ = self.file.write_all(lines.as_bytes());
    }
}

/// Replaces each number, also a hexadecimal one, by `#`, so that messages which differ only in their numbers become
/// equal.
fn without_figures(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    for word in text.split_inclusive(|c: char| !c.is_ascii_alphanumeric()) {
        if word.starts_with(|c: char| c.is_ascii_digit()) {
            short.push('#');
            short.extend(word.chars().last().filter(|c| !c.is_ascii_alphanumeric()));
        } else {
            short.push_str(word);
        }
    }
    short
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn told(file: &Shared) -> Vec<Line> {
        let text = String::from_utf8(file.0.lock().unwrap().clone()).unwrap();
        let own = format!("{} ", std::process::id());
        text.lines().map(|line| Line::parse(line.strip_prefix(&own).unwrap()).unwrap()).collect()
    }

    /// Messages that differ only in their numbers are written once, followed by their count.
    #[test]
    fn the_same_is_told_once() {
        let file = Shared::default();
        let summary_writer = SummaryWriter::to(Box::new(file.clone()));
        for n in 0..900 {
            summary_writer.queue_message(format!("CSP in slot {n} rejected at {} us: not now (0x{n:04X})", 1000 * n));
        }
        summary_writer.queue_message("another one".to_owned());
        summary_writer.write_all();
        summary_writer.write_all();
        let first = "CSP in slot 0 rejected at 0 us: not now (0x0000)".to_owned();
        let expected = [
            Line::Message { id: 0, text: first },
            Line::Message { id: 1, text: "another one".to_owned() },
            Line::Repeated { id: 0, times: 900 },
        ];
        assert_eq!(told(&file), expected);
    }

    /// Queueing never waits. Lines for which the queue has no room are counted as dropped, and so are messages of more than
    /// `TEXTS_MAX` kinds.
    #[test]
    fn a_full_queue_drops_and_counts() {
        let file = Shared::default();
        let summary_writer = SummaryWriter::to(Box::new(file.clone()));
        for _ in 0..QUEUE_LEN + 10 {
            summary_writer.queue_message("the same".to_owned());
        }
        summary_writer.write_all();
        assert_eq!(told(&file).last(), Some(&Line::Dropped(10)));
        for n in 0..300_u32 {
            // The name consists of letters only, so that each message is of another kind.
            let name: String = n.to_string().chars().map(|c| char::from(b'a' + c as u8 - b'0')).collect();
            summary_writer.queue_message(name);
        }
        summary_writer.write_all();
        let texts = told(&file).iter().filter(|line| matches!(line, Line::Message { .. })).count();
        assert_eq!((texts, told(&file).last()), (TEXTS_MAX, Some(&Line::Dropped(10 + 101))));
    }

    /// If a program reaches a state after the time of its wait was written, the time is written again, as 0.
    #[test]
    fn a_count_that_falls_is_told() {
        struct Wait(AtomicU64);
        impl Counted for Wait {
            fn counts(&self) -> Vec<(String, u64)> {
                vec![("op_unreached_ms".to_owned(), self.0.load(Ordering::Relaxed))]
            }

            fn is_closed(&self) -> bool {
                false
            }
        }
        let file = Shared::default();
        let mut state = SummaryWriter::to(Box::new(file.clone())).state.into_inner().unwrap();
        let wait = Arc::new(Wait(AtomicU64::new(0)));
        let counted: Arc<dyn Counted> = wait.clone();
        state.boards.push(WatchedBoard { number: 0, link: Arc::downgrade(&counted), written: BTreeMap::new() });
        for ms in [0, 90, 90, 0, 0] {
            wait.0.store(ms, Ordering::Relaxed);
            state.write(0, true);
        }
        let count = |value| Line::Count { board: 0, name: "op_unreached_ms".to_owned(), value };
        assert_eq!(told(&file), [count(90), count(0)]);
    }
}
