//! How the library tells `ecmsk exec` what goes wrong: lines in a file that the tool has made for it, named by the variable
//! [`TOLD`].
//!
//! A program never waits for whoever reads: a fact goes into a queue, and what finds it full is counted. While a board is
//! open a thread writes, some times a second; so does a board that is closed, for that may be the end of the process. The
//! log's lines are told once each, but for figures in them, and then how often.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::link::WatchLink;
use super::{Line, TEXTS_MAX};
use crate::link::{Link, config};
use crate::threads;

/// The variable that names the file.
pub const TOLD: &str = "ECMSK_TOLD";

/// Facts that may wait to be written. \[OURS]
const QUEUE: usize = 1024;
/// How often what waits is written. \[OURS]
const PERIOD: Duration = Duration::from_millis(100);
/// Counts that change all the time are written less and less often, so that the file of a program that runs for weeks stays
/// small: what a killed program tells is this part of its run old at most, but never older than [`COUNTS_PERIOD_MAX`]. \[OURS]
const COUNTS_PART: u32 = 64;
/// See [`COUNTS_PART`]. \[OURS]
const COUNTS_PERIOD_MAX: Duration = Duration::from_secs(10);

/// What waits to be written.
enum Fact {
    Line(Line),
    /// The log has said this.
    Said(String),
}

/// Tells a tool.
pub struct Teller {
    queue: SyncSender<Fact>,
    dropped: AtomicU64,
    writer: Mutex<Writer>,
}

struct Writer {
    facts: Receiver<Fact>,
    file: Box<dyn Write + Send>,
    /// Texts of the log without their figures, their numbers, how often they came, and how often that was told.
    said: BTreeMap<String, (u32, u64, u64)>,
    boards: Vec<Watched>,
    numbers: u32,
    /// Runs while there are boards.
    thread: Option<JoinHandle<()>>,
    began: Instant,
    counted: Instant,
    dropped: u64,
}

/// A board that is open.
struct Watched {
    number: u32,
    link: Weak<WatchLink>,
    /// Counts that were told.
    told: BTreeMap<String, u64>,
}

/// The teller of this process, if a tool has asked for one by [`TOLD`].
pub fn of_process() -> Option<&'static Teller> {
    static TELLER: OnceLock<Option<Teller>> = OnceLock::new();
    let teller = TELLER.get_or_init(|| {
        let file = open(Path::new(&config::variable(TOLD)?)).ok()?;
        Some(Teller::to(Box::new(file)))
    });
    teller.as_ref()
}

/// The file has to be there, and a file: what else has that name is nobody's who asked.
fn open(path: &Path) -> io::Result<File> {
    if !std::fs::symlink_metadata(path)?.is_file() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    OpenOptions::new().append(true).open(path)
}

impl Teller {
    /// Tells by that file.
    fn to(file: Box<dyn Write + Send>) -> Self {
        let (queue, facts) = sync_channel(QUEUE);
        let now = Instant::now();
        let writer = Writer {
            facts,
            file,
            said: BTreeMap::new(),
            boards: Vec::new(),
            numbers: 0,
            thread: None,
            began: now,
            counted: now,
            dropped: 0,
        };
        Self { queue, dropped: AtomicU64::new(0), writer: Mutex::new(writer) }
    }

    /// Tells a fact. Never waits.
    pub fn tell(&self, line: Line) {
        self.put(Fact::Line(line));
    }

    /// Tells what the log says. Never waits.
    pub fn say(&self, text: String) {
        self.put(Fact::Said(text));
    }

    fn put(&self, fact: Fact) {
        if self.queue.try_send(fact).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A link whose troubles are told: `inner`, which was just opened, with a look at what goes by.
    pub fn watch(&'static self, inner: Arc<dyn Link>) -> Arc<dyn Link> {
        let link = Arc::new(WatchLink::new(inner, self));
        let mut writer = self.writer();
        let number = writer.numbers;
        writer.numbers += 1;
        writer.boards.push(Watched { number, link: Arc::downgrade(&link), told: BTreeMap::new() });
        if writer.thread.is_none() {
            // Without a thread what is told waits for the end of the board.
            writer.thread = threads::spawn("ecmsk-tell", || self.run()).ok();
        }
        link
    }

    /// Writes while there are boards.
    fn run(&self) {
        while self.write() {
            std::thread::park_timeout(PERIOD);
        }
    }

    /// Writes what waits, and counts if it is time; whether boards are open.
    fn write(&self) -> bool {
        let mut writer = self.writer();
        let due = (writer.began.elapsed() / COUNTS_PART).clamp(PERIOD, COUNTS_PERIOD_MAX);
        let counts = writer.counted.elapsed() >= due;
        writer.write(self.dropped.load(Ordering::Relaxed), counts);
        !writer.boards.is_empty()
    }

    /// Writes all that is known.
    pub fn write_all(&self) {
        self.writer().write(self.dropped.load(Ordering::Relaxed), true);
    }

    /// A board was closed: writes all that is known, and ends the thread if it was the last one, for the library may be
    /// unloaded next.
    pub(super) fn closed(&self) {
        let thread = {
            let mut writer = self.writer();
            writer.write(self.dropped.load(Ordering::Relaxed), true);
            if writer.boards.is_empty() { writer.thread.take() } else { None }
        };
        if let Some(thread) = thread {
            thread.thread().unpark();
            // A panic there was told already.
            let _ = thread.join();
        }
    }

    fn writer(&self) -> std::sync::MutexGuard<'_, Writer> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Writer {
    fn write(&mut self, dropped: u64, with_counts: bool) {
        let mut lines = String::new();
        // Processes that the program starts tell in the same file.
        let process = std::process::id();
        let mut add = |line: &Line| lines.push_str(&format!("{process} {line}\n"));
        while let Ok(fact) = self.facts.try_recv() {
            match fact {
                Fact::Line(line) => add(&line),
                Fact::Said(text) => {
                    let (next, full) = (self.said.len(), self.said.len() >= TEXTS_MAX);
                    match self.said.get_mut(&without_figures(&text)) {
                        Some((_, times, _)) => *times += 1,
                        None if full => self.dropped += 1,
                        None => {
                            self.said.insert(without_figures(&text), (next as u32, 1, 1));
                            add(&Line::Said { id: next as u32, text });
                        }
                    }
                }
            }
        }
        if with_counts {
            self.counted = Instant::now();
            for (id, times, told) in self.said.values_mut().filter(|(_, times, told)| times > told) {
                *told = *times;
                add(&Line::Again { id: *id, times: *times });
            }
            for Watched { number, link, told } in &mut self.boards {
                let Some(link) = link.upgrade() else { continue };
                for (name, value) in link.counts() {
                    if value > told.get(&name).copied().unwrap_or_default() {
                        add(&Line::Count { board: *number, name: name.clone(), value });
                        told.insert(name, value);
                    }
                }
            }
            self.boards.retain(|board| board.link.upgrade().is_some_and(|link| !link.is_closed()));
            if dropped + self.dropped > 0 {
                add(&Line::Dropped(dropped + self.dropped));
            }
        }
        // The tool may be gone, or its disk full: then nobody is told. One write, so that lines of several processes do not
        // mix.
        let _ = self.file.write_all(lines.as_bytes());
    }
}

/// A text of which the figures do not count: the same thing said again has others. Hexadecimal ones are figures too.
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

    /// TOOL-153 What is said again with other figures is told once, and then how often.
    #[test]
    fn the_same_is_told_once() {
        let file = Shared::default();
        let teller = Teller::to(Box::new(file.clone()));
        for n in 0..900 {
            teller.say(format!("CSP in slot {n} rejected at {} us: not now (0x{n:04X})", 1000 * n));
        }
        teller.say("another one".to_owned());
        teller.write_all();
        teller.write_all();
        let first = "CSP in slot 0 rejected at 0 us: not now (0x0000)".to_owned();
        let expected = [
            Line::Said { id: 0, text: first },
            Line::Said { id: 1, text: "another one".to_owned() },
            Line::Again { id: 0, times: 900 },
        ];
        assert_eq!(told(&file), expected);
    }

    /// TOOL-153 Nobody waits for room: what finds none is counted, and so is the kind of text beyond what is kept.
    #[test]
    fn a_full_queue_drops_and_counts() {
        let file = Shared::default();
        let teller = Teller::to(Box::new(file.clone()));
        for _ in 0..QUEUE + 10 {
            teller.say("the same".to_owned());
        }
        teller.write_all();
        assert_eq!(told(&file).last(), Some(&Line::Dropped(10)));
        for n in 0..300_u32 {
            // No figures: each is a text of its own.
            let name: String = n.to_string().chars().map(|c| char::from(b'a' + c as u8 - b'0')).collect();
            teller.say(name);
        }
        teller.write_all();
        let texts = told(&file).iter().filter(|line| matches!(line, Line::Said { .. })).count();
        assert_eq!((texts, told(&file).last()), (TEXTS_MAX, Some(&Line::Dropped(10 + 101))));
    }
}
