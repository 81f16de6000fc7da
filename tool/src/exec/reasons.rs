//! Shows the user why calls of the program have failed: reads the file to which the library writes these reasons while the
//! program runs, prints each reason once, and a summary at the end.
//!
//! A separate thread does this. If nobody reads standard error, only this thread waits, and neither the program nor the passing
//! on of signals.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use ecmsk::notes::WAIT_SLICE;
use ecmsk::summary::{Alarm, HeldBack, Line, Summary, is_sum};

use crate::stderr::say;
use crate::summary::json;

/// How often the tool reads the file to which the library writes reasons. \[OURS]
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Longest time that the tool waits until the summary is written, since standard error may have no reader. \[OURS]
const SUMMARY_WAIT_MAX: Duration = Duration::from_secs(2);

/// What is printed about the problems that the library has written down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportMode {
    /// Each reason when it first occurs, and a summary when the program has ended.
    Words,
    /// Only the summary, because the user has asked for the log, which contains the reasons.
    Summary,
    /// Only the summary, as one JSON object.
    Json,
    /// Neither reasons nor a summary are printed.
    Quiet,
}

/// The handle of the thread that reads the library's file and prints reasons.
pub struct ReasonReader {
    ended: Arc<AtomicBool>,
    thread: Option<thread::Thread>,
    summary: Receiver<Summary>,
}

impl ReasonReader {
    /// Starts the thread. `file` must exist; it is read as it grows.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn follow(file: &Path, mode: ReportMode) -> io::Result<Self> {
        let mut follower = Follower::new(File::open(file)?, mode);
        let ended = Arc::new(AtomicBool::new(false));
        let (sender, summary) = mpsc::channel();
        let end = Arc::clone(&ended);
        let thread = thread::Builder::new().name("told".into()).spawn(move || {
            loop {
                // The end flag is read before the file, so that everything written before the program's end is read below.
                let last = end.load(Ordering::Acquire);
                follower.read();
                if last {
                    break;
                }
                thread::park_timeout(POLL_INTERVAL);
            }
            let summary = follower.summary();
            follower.say(&summary);
            // The file is closed before the summary is sent, because the receiver removes its folder, which Windows
            // refuses while a file in it is open.
            drop(follower);
            let _ = sender.send(summary);
        })?;
        Ok(Self { ended, thread: Some(thread.thread().clone()), summary })
    }

    /// Ends the thread after the program has ended: prints the summary, and returns it if that took no longer than
    /// [`SUMMARY_WAIT_MAX`].
    pub fn end(mut self) -> Option<Summary> {
        self.ended.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.unpark();
        }
        // The limit is a number of waits of [`WAIT_SLICE`] each, and no time of a clock, so that the time for which the
        // machine was suspended meanwhile does not count.
        let waits = SUMMARY_WAIT_MAX.as_millis() / WAIT_SLICE.as_millis();
        (0..waits).find_map(|_| match self.summary.recv_timeout(WAIT_SLICE) {
            Err(RecvTimeoutError::Timeout) => None,
            summary => Some(summary.ok()),
        })?
    }
}

struct Follower {
    file: File,
    mode: ReportMode,
    /// The beginning of a line whose end the library has not written yet.
    unfinished: Vec<u8>,
    /// The lines of each process, by process id. Of lines that only differ in a count the latest is kept.
    lines: BTreeMap<u32, Vec<Line>>,
    counts: BTreeMap<(u32, u32, String), u64>,
    said: BTreeSet<String>,
}

impl Follower {
    const fn new(file: File, mode: ReportMode) -> Self {
        Self {
            file,
            mode,
            unfinished: Vec::new(),
            lines: BTreeMap::new(),
            counts: BTreeMap::new(),
            said: BTreeSet::new(),
        }
    }

    fn read(&mut self) {
        // On a read error the bytes so far are used; the next pass tries again.
        let _ = self.file.read_to_end(&mut self.unfinished);
        let Some(end) = self.unfinished.iter().rposition(|byte| *byte == b'\n') else { return };
        let rest = self.unfinished.split_off(end + 1);
        let whole = std::mem::replace(&mut self.unfinished, rest);
        for line in String::from_utf8_lossy(&whole).lines() {
            let Some((process, line)) = line.split_once(' ') else { continue };
            let (Ok(process), Some(line)) = (process.parse(), Line::parse(line)) else { continue };
            self.take(process, line);
        }
    }

    fn take(&mut self, process: u32, line: Line) {
        match &line {
            Line::Message { text, .. } if !is_sum(text) => self.tell(text.clone(), text),
            // An alarm that comes again at another time is not printed again.
            Line::Alarm(alarm) => self.tell(Alarm { at_ns: None, ..*alarm }.to_string(), &alarm.to_string()),
            Line::HeldBack(held) => {
                self.tell(HeldBack { at_ns: None, position: 0, ..*held }.to_string(), &held.to_string());
            }
            Line::StateFailed(failed) => self.tell(failed.to_string(), &failed.to_string()),
            _ => {}
        }
        match line {
            Line::Count { board, name, value } => {
                self.counts.insert((process, board, name), value);
            }
            line => self.lines.entry(process).or_default().push(line),
        }
    }

    /// Prints a reason for a failed call, if reasons are printed ([`ReportMode::Words`]) and none with this `key` was printed
    /// before.
    fn tell(&mut self, key: String, text: &str) {
        if self.mode == ReportMode::Words && self.said.insert(key) {
            say("warning", &text);
        }
    }

    fn summary(&self) -> Summary {
        let mut all = self.lines.clone();
        for ((process, board, name), value) in &self.counts {
            let line = Line::Count { board: *board, name: name.clone(), value: *value };
            all.entry(*process).or_default().push(line);
        }
        let mut summary = Summary::default();
        all.values().for_each(|lines| summary.add_lines(lines));
        summary
    }

    fn say(&self, summary: &Summary) {
        match self.mode {
            ReportMode::Quiet => {}
            ReportMode::Json => {
                use std::io::Write;
                let _ = writeln!(io::stderr(), "{}", json(summary, None));
            }
            ReportMode::Words | ReportMode::Summary => {
                let lines = summary.lines(self.mode == ReportMode::Words);
                lines.iter().for_each(|line| say("summary", line));
            }
        }
    }
}
