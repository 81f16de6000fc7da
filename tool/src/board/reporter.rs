//! What verbs say: results on standard output, all else on standard error. As JSON all that a program would read is on
//! standard output, one object a line.

use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use serde_json::Value;

use crate::error::say;
use crate::output;
use crate::visible::visible;

/// How long progress is told once a second where it is told less and less often.
const OFTEN: Duration = Duration::from_secs(10);

/// Characters of a bar.
const BAR: u32 = 20;

/// How to say it.
#[derive(Debug)]
pub struct Reporter {
    json: bool,
    /// Standard error is a terminal: progress is one line that changes.
    terminal: bool,
    /// The board's time passes as fast as it can.
    virtual_time: bool,
    /// Such a line stands there.
    shown: AtomicBool,
    /// The line of the script that runs, from 1; 0: none.
    line: AtomicU32,
}

impl Reporter {
    pub fn new(json: bool, virtual_time: bool) -> Self {
        Self {
            json,
            terminal: io::stderr().is_terminal(),
            virtual_time,
            shown: AtomicBool::new(false),
            line: AtomicU32::new(0),
        }
    }

    /// A result: lines of text without the last line feed, or an object.
    pub fn result(&self, text: impl Display, json: &Value) -> io::Result<()> {
        self.clear();
        if self.json {
            return self.object(json.clone());
        }
        output::print(format!("{text}\n"))
    }

    /// Objects from now on say that they are of this line of a script.
    pub fn at_line(&self, line: u32) {
        self.line.store(line, Ordering::Relaxed);
    }

    fn object(&self, mut json: Value) -> io::Result<()> {
        let line = self.line.load(Ordering::Relaxed);
        if line > 0 {
            json["line"] = line.into();
        }
        output::print(format!("{json}\n"))
    }

    /// What somebody in front of it may want to know.
    pub fn note(&self, text: impl Display) {
        self.clear();
        say("note", &text);
    }

    /// How far something is.
    pub fn progress(&self, text: impl Display, json: impl FnOnce() -> Value) -> io::Result<()> {
        if self.json {
            return self.object(json());
        }
        if self.terminal {
            let _ = write!(io::stderr(), "\r\x1b[K{}", visible(&text.to_string()));
            let _ = io::stderr().flush();
            self.shown.store(true, Ordering::Relaxed);
        } else {
            say("progress", &text);
        }
        Ok(())
    }

    /// As [`Reporter::progress`], of something whose end is known: in a terminal with a bar.
    pub fn part(&self, part: f64, text: impl Display, json: impl FnOnce() -> Value) -> io::Result<()> {
        if !self.terminal || self.json {
            return self.progress(text, json);
        }
        let bar: String = (0..BAR).map(|k| if f64::from(k) < part * f64::from(BAR) { '#' } else { '-' }).collect();
        self.progress(format_args!("[{bar}] {text}"), json)
    }

    /// Takes the line of progress away.
    pub fn clear(&self) {
        if self.shown.swap(false, Ordering::Relaxed) {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }

    /// When to tell how far it is: not within the first second, then once a second, in a terminal ten times. Where nobody looks
    /// on and the board's time passes faster than anybody reads, once a second for ten seconds, then after 20, 40, 80 and so on
    /// \[OURS]: the lines say the same at every run, and an hour has less than twenty of them.
    pub const fn pace(&self) -> ProgressPace {
        let every = if self.terminal && !self.json { Duration::from_millis(100) } else { Duration::from_secs(1) };
        let slows = self.virtual_time && !self.terminal && !self.json;
        ProgressPace { every, slows, next: Duration::from_secs(1) }
    }
}

/// When to tell how far it is, by a time that begins with 0.
#[derive(Debug)]
pub struct ProgressPace {
    every: Duration,
    /// After some time, each takes as long as all before it.
    slows: bool,
    next: Duration,
}

impl ProgressPace {
    /// Whether it is time to.
    pub fn due(&mut self, elapsed: Duration) -> bool {
        let due = elapsed >= self.next;
        while self.next <= elapsed {
            if self.slows && self.next >= OFTEN {
                self.every = self.next;
            }
            self.next += self.every;
        }
        due
    }
}
