//! Prints the output of the verbs: results on standard output, everything else on standard error. With `--json`,
//! results and progress are on standard output, one JSON object per line.

use std::fmt::Display;
use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use serde_json::Value;

use crate::stderr::say;
use crate::visible::visible;
use crate::{output, stderr};

/// Progress is shown once a second for this long; after that the interval grows, see [`Reporter::pace`].
const EVERY_SECOND_LIMIT: Duration = Duration::from_secs(10);

/// The width of a progress bar in characters.
const BAR_WIDTH: u32 = 20;

/// Prints results, notes and progress, as text or as JSON. A reporter of [`Reporter::to`] passes them on instead.
pub struct Reporter {
    json: bool,
    /// Whether standard error is a terminal. Progress is then a single line that is overwritten.
    terminal: bool,
    /// Whether the board runs on a virtual clock, which advances as fast as the machine allows.
    virtual_time: bool,
    /// Whether a progress line is on the terminal at present, so that it must be erased before other output.
    shown: AtomicBool,
    /// The number of the script line that is being executed, from 1; 0 outside of a script.
    line: AtomicU32,
    /// Gets all texts instead of standard output and error, each with whether it is progress.
    tell: Option<Box<dyn Fn(String, bool) + Send + Sync>>,
}

impl Reporter {
    pub fn new(json: bool, virtual_time: bool) -> Self {
        Self {
            json,
            terminal: io::stderr().is_terminal(),
            virtual_time,
            shown: AtomicBool::new(false),
            line: AtomicU32::new(0),
            tell: None,
        }
    }

    /// Passes all texts on to `tell`, each with whether it is progress, and prints nothing.
    #[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page uses it"))]
    pub fn to(tell: impl Fn(String, bool) + Send + Sync + 'static) -> Self {
        Self { terminal: false, tell: Some(Box::new(tell)), ..Self::new(false, false) }
    }

    /// Prints a result: lines of text without the last line feed, or a JSON object. May be called only while no axis
    /// moves, because it waits until the result is written.
    pub fn result(&self, text: impl Display, json: &Value) -> io::Result<()> {
        self.clear();
        if let Some(tell) = &self.tell {
            tell(text.to_string(), false);
            return Ok(());
        }
        if self.json {
            return output::print(self.object(json.clone()));
        }
        output::print(format!("{text}\n"))
    }

    /// Prints a result of several lines: the text, or with `--json` a JSON object for each of its parts. Like
    /// [`Self::result`], it may be called only while no axis moves.
    pub fn results(&self, text: impl Display, parts: &[Value]) -> io::Result<()> {
        if !self.json {
            return self.result(text, &Value::Null);
        }
        parts.iter().try_for_each(|part| self.result("", part))
    }

    /// Adds the number of this script line to all following JSON objects.
    pub fn at_line(&self, line: u32) {
        self.line.store(line, Ordering::Relaxed);
    }

    fn object(&self, mut json: Value) -> String {
        let line = self.line.load(Ordering::Relaxed);
        if line > 0 {
            json["line"] = line.into();
        }
        format!("{json}\n")
    }

    /// Prints a note for the user on standard error.
    pub fn note(&self, text: impl Display) {
        self.clear();
        match &self.tell {
            Some(tell) => tell(text.to_string(), false),
            None => say("note", &text),
        }
    }

    /// Shows progress. It never blocks, because axes may be moving.
    pub fn progress(&self, text: impl Display, json: impl FnOnce() -> Value) -> io::Result<()> {
        if let Some(tell) = &self.tell {
            tell(text.to_string(), true);
            return Ok(());
        }
        if self.json {
            return output::tell(self.object(json()));
        }
        if self.terminal {
            stderr::raw(&format!("\r\x1b[K{}", visible(&text.to_string())));
            self.shown.store(true, Ordering::Relaxed);
        } else {
            say("progress", &text);
        }
        Ok(())
    }

    /// Like [`Reporter::progress`], for an operation of known length: on a terminal with a progress bar. `part` is the
    /// fraction that is done, 0 to 1.
    pub fn part(&self, part: f64, text: impl Display, json: impl FnOnce() -> Value) -> io::Result<()> {
        if !self.terminal || self.json {
            return self.progress(text, json);
        }
        let bar: String =
            (0..BAR_WIDTH).map(|k| if f64::from(k) < part * f64::from(BAR_WIDTH) { '#' } else { '-' }).collect();
        self.progress(format_args!("[{bar}] {text}"), json)
    }

    /// Erases the progress line from the terminal.
    pub fn clear(&self) {
        if self.shown.swap(false, Ordering::Relaxed) {
            stderr::raw("\r\x1b[K");
        }
    }

    /// The times at which progress is shown. The first time is after a second. After that the interval is a second, or
    /// 100 ms for text on a terminal. For text without a terminal and in virtual time, the times are 1 to 10 s in steps
    /// of a second, then 20, 40, 80 s and so on \[OURS]. So the lines are the same in every run, and an hour has fewer
    /// than twenty of them.
    pub const fn pace(&self) -> ProgressPace {
        let every = if self.terminal && !self.json { Duration::from_millis(100) } else { Duration::from_secs(1) };
        let slows = self.virtual_time && !self.terminal && !self.json;
        ProgressPace { every, slows, next: Duration::from_secs(1) }
    }
}

/// Decides when progress is shown. Times are relative to the beginning of the operation.
#[derive(Debug)]
pub struct ProgressPace {
    every: Duration,
    /// Whether the interval doubles from [`EVERY_SECOND_LIMIT`] on.
    slows: bool,
    next: Duration,
}

impl ProgressPace {
    /// Whether progress is due after the time `elapsed`.
    pub fn due(&mut self, elapsed: Duration) -> bool {
        let due = elapsed >= self.next;
        while self.next <= elapsed {
            if self.slows && self.next >= EVERY_SECOND_LIMIT {
                self.every = self.next;
            }
            self.next += self.every;
        }
        due
    }
}
