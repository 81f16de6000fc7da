//! Shows the user why calls of the program have failed. The library writes the reasons to a file. This module reads the
//! file while the program runs, prints each reason once, and prints a summary at the end.
//!
//! A separate thread does this. If nobody reads standard error, only this thread blocks, so the program runs on and
//! signals are still passed on.

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

/// The interval at which the file of reasons is read. \[OURS]
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// The longest wait until the summary is written, because standard error may have no reader. \[OURS]
const SUMMARY_WAIT_MAX: Duration = Duration::from_secs(2);

/// What is printed about the problems that the library has reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportMode {
    /// Each reason when it occurs for the first time, and a summary when the program has ended.
    Words,
    /// Only the summary, because the user has requested the log, which contains the reasons.
    Summary,
    /// Only the summary, as one JSON object.
    Json,
    /// Nothing.
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
                // The end flag is read before the file, so that the last pass reads everything that was written before
                // the end of the program.
                let last = end.load(Ordering::Acquire);
                follower.read();
                if last {
                    break;
                }
                thread::park_timeout(POLL_INTERVAL);
            }
            let summary = follower.summary();
            follower.say(&summary);
            // The file is closed before the summary is sent, because the receiver removes the folder of the file.
            // Windows refuses this while a file in the folder is open.
            drop(follower);
            let _ = sender.send(summary);
        })?;
        Ok(Self { ended, thread: Some(thread.thread().clone()), summary })
    }

    /// Must be called when the program has ended. The thread prints the summary and ends. Returns the summary, or
    /// `None` if this took longer than [`SUMMARY_WAIT_MAX`].
    pub fn end(mut self) -> Option<Summary> {
        self.ended.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.unpark();
        }
        // The limit is a number of waits of [`WAIT_SLICE`] and not a time of a clock, so that the time for which the
        // machine was suspended does not count.
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
    /// The beginning of a line that the library has not written completely yet.
    unfinished: Vec<u8>,
    /// The lines of each process, by process id. Counts are not among them, see `counts`.
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
        // On a read error the bytes read so far are used, and the next pass tries again.
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
            // The time is not part of the key, so that a repeated alarm is printed only once.
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

    /// Prints a reason for a failed call, but only in [`ReportMode::Words`], and only if no reason with the same `key`
    /// was printed before.
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
