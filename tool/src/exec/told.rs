//! What the library tells of the program while it runs, and the summary at the end.
//!
//! A thread reads and says it: neither the program nor what this tool hands on to it waits for somebody who does not read
//! standard error.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::Duration;

use ecmsk::summary::{Line, Summary, is_sum};

use crate::error::say;
use crate::summary::json;

/// How often it is looked whether there is something new. \[OURS]
const LOOK: Duration = Duration::from_millis(100);
/// How long the summary may take to be written: who does not read standard error does not keep this tool. \[OURS]
const PATIENCE: Duration = Duration::from_secs(2);

/// How it is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manner {
    /// Each reason when it is new, and a summary.
    Words,
    /// A summary: somebody has asked for the log, which has the reasons.
    Summary,
    /// A summary, one JSON object.
    Json,
    /// Not at all.
    Quiet,
}

/// Reads what is told, in a thread.
pub struct Told {
    ended: Arc<AtomicBool>,
    thread: Option<thread::Thread>,
    summary: Receiver<Summary>,
}

impl Told {
    /// Follows the file, which is there.
    ///
    /// # Errors
    /// The system's.
    pub fn follow(file: &Path, manner: Manner) -> io::Result<Self> {
        let mut follower = Follower::new(File::open(file)?, manner);
        let ended = Arc::new(AtomicBool::new(false));
        let (sender, summary) = mpsc::channel();
        let end = Arc::clone(&ended);
        let thread = thread::Builder::new().name("told".into()).spawn(move || {
            loop {
                // What was told before the end is read after it.
                let last = end.load(Ordering::Acquire);
                follower.read();
                if last {
                    break;
                }
                thread::park_timeout(LOOK);
            }
            let summary = follower.summary();
            follower.say(&summary);
            // The file is in a folder that whoever gets the summary removes, which Windows refuses while it is open.
            drop(follower);
            let _ = sender.send(summary);
        })?;
        Ok(Self { ended, thread: Some(thread.thread().clone()), summary })
    }

    /// The program has ended: says the summary, and gives it if that could be done in time.
    pub fn end(mut self) -> Option<Summary> {
        self.ended.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.unpark();
        }
        self.summary.recv_timeout(PATIENCE).ok()
    }
}

struct Follower {
    file: File,
    manner: Manner,
    /// The begin of a line whose end is still to come.
    begun: Vec<u8>,
    /// What each process has told, but for counts that were told anew.
    lines: BTreeMap<u32, Vec<Line>>,
    counts: BTreeMap<(u32, u32, String), u64>,
    said: BTreeSet<String>,
}

impl Follower {
    const fn new(file: File, manner: Manner) -> Self {
        Self { file, manner, begun: Vec::new(), lines: BTreeMap::new(), counts: BTreeMap::new(), said: BTreeSet::new() }
    }

    fn read(&mut self) {
        // An error is no reason to end the program: there is nothing new then.
        let _ = self.file.read_to_end(&mut self.begun);
        let Some(end) = self.begun.iter().rposition(|byte| *byte == b'\n') else { return };
        let rest = self.begun.split_off(end + 1);
        let whole = std::mem::replace(&mut self.begun, rest);
        for line in String::from_utf8_lossy(&whole).lines() {
            let Some((process, line)) = line.split_once(' ') else { continue };
            let (Ok(process), Some(line)) = (process.parse(), Line::parse(line)) else { continue };
            self.take(process, line);
        }
    }

    fn take(&mut self, process: u32, line: Line) {
        match &line {
            Line::Message { text, .. } if !is_sum(text) => self.tell(text.clone()),
            Line::Alarm(alarm) => self.tell(alarm.to_string()),
            Line::StateFailed(failed) => self.tell(failed.to_string()),
            _ => {}
        }
        match line {
            Line::Count { board, name, value } => {
                self.counts.insert((process, board, name), value);
            }
            line => self.lines.entry(process).or_default().push(line),
        }
    }

    /// Says it if it is new.
    fn tell(&mut self, text: String) {
        if self.manner == Manner::Words && !self.said.contains(&text) {
            say("warning", &text);
            self.said.insert(text);
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
        match self.manner {
            Manner::Quiet => {}
            Manner::Json => {
                use std::io::Write;
                let _ = writeln!(io::stderr(), "{}", json(summary));
            }
            Manner::Words | Manner::Summary => {
                let lines = summary.lines(self.manner == Manner::Words);
                lines.iter().for_each(|line| say("summary", line));
            }
        }
    }
}
