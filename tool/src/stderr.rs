//! Standard error of the tool. By default it is written directly. Verbs that move axes or serve clients write it through the
//! queue of [`streams`], so that they never wait for whoever reads it. Servers keep a log there: its lines have the time, or
//! are JSON objects.

use std::io::{self, Write};
use std::sync::OnceLock;

use serde_json::json;
use time::OffsetDateTime;

use super::streams::{self, Stream};
use super::visible::visible_bytes;

/// The format of a server's log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// `2026-05-04T12:30:15.250Z serve: ...`
    Text,
    /// `{"time":"2026-05-04T12:30:15.250Z","level":"info","kind":"serve","message":"..."}`
    Json,
}

/// The form of the lines on standard error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Lines begin with the time.
    Timed,
    /// Lines without the time, like those of other verbs: systemd's journal adds the time itself.
    Plain,
    Json,
}

/// The form of a server's lines; not set: the tool is no server.
static FORM: OnceLock<Form> = OnceLock::new();

/// From now on standard error is the log of a server.
pub fn log_in(format: LogFormat) {
    // systemd sets this variable if standard error goes to its journal.
    let is_journal = std::env::var_os("JOURNAL_STREAM").is_some();
    let form = match format {
        LogFormat::Json => Form::Json,
        LogFormat::Text if is_journal => Form::Plain,
        LogFormat::Text => Form::Timed,
    };
    // Setting it can fail only for a second server in the process, and there is one.
    let _ = FORM.set(form);
}

fn form() -> Form {
    FORM.get().copied().unwrap_or(Form::Plain)
}

/// A time as the log writes it, in UTC with milliseconds (RFC 3339).
fn moment(at: OffsetDateTime) -> String {
    let (year, month, day) = at.to_calendar_date();
    let (hour, minute, second, millisecond) = at.to_hms_milli();
    format!("{year:04}-{:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{millisecond:03}Z", u8::from(month))
}

/// A line of the log. `kind` is the word before a line of text, `target` the part of the program that says it; empty: the
/// server.
fn logged(form: Form, at: OffsetDateTime, (level, kind, target): (&str, &str, &str), message: &str) -> String {
    match form {
        Form::Json => {
            let mut line = json!({"time": moment(at), "level": level, "kind": kind, "message": message});
            if !target.is_empty() {
                line["target"] = target.into();
            }
            line.to_string()
        }
        Form::Timed => format!("{} {kind}: {message}", moment(at)),
        Form::Plain => format!("{kind}: {message}"),
    }
}

/// The level of a line in JSON, by its kind.
fn level(kind: &str) -> &'static str {
    match kind {
        "error" => "error",
        "warning" => "warn",
        _ => "info",
    }
}

/// Writes a line, directly or through the queue.
pub fn line(text: &str) {
    write(format!("{text}\n").as_bytes());
}

/// Prints a line on standard error: `kind: what`.
pub fn say(kind: &str, what: &dyn std::fmt::Display) {
    line(&said(kind, &what.to_string()));
}

/// The line that [`say`] prints.
pub fn said(kind: &str, what: &str) -> String {
    // The final error of the tool has the same form in all verbs, unless the log is in JSON.
    let form = if kind == "error" && form() != Form::Json { Form::Plain } else { form() };
    logged(form, OffsetDateTime::now_utc(), (level(kind), kind, ""), what)
}

/// Writes text that may include the tool's own control sequences. What comes from outside the tool, such as names in a
/// recording or messages of a server, must have passed [`visible`](super::visible::visible) before: its control characters
/// could control the terminal.
pub fn raw(text: &str) {
    put(text.as_bytes());
}

fn write(bytes: &[u8]) {
    put(&visible_bytes(bytes));
}

/// Writes bytes directly or through the queue. Errors are ignored, since standard error may be closed.
fn put(bytes: &[u8]) {
    if !streams::queue_bytes(Stream::Error, bytes) {
        let _ = io::stderr().write_all(bytes);
    }
}

/// The writer for log records (`ECMSK_LOG`). Each record is queued as a whole, so that no other line comes in between.
pub struct Log;

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match form() {
            Form::Plain => write(bytes),
            form => line(&record(form, OffsetDateTime::now_utc(), &String::from_utf8_lossy(bytes))),
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A log record, which begins with `[LEVEL target] `, as a line of a server's log.
fn record(form: Form, at: OffsetDateTime, text: &str) -> String {
    let text = text.trim_end();
    let parts = || {
        let (head, message) = text.strip_prefix('[')?.split_once("] ")?;
        let (level, target) = head.split_once(' ')?;
        Some((level.to_lowercase(), target.trim(), message))
    };
    match parts() {
        Some((level, target, message)) if form == Form::Json => logged(form, at, (&level, "log", target), message),
        None if form == Form::Json => logged(form, at, ("info", "log", ""), text),
        _ => format!("{} {text}", moment(at)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of the log have the wall time in UTC. As JSON they also have level and message, and log records name the
    /// part of the program.
    #[test]
    fn lines_of_the_log_have_the_time() {
        let at = OffsetDateTime::from_unix_timestamp_nanos(1_777_897_815_250_999_999).expect("a time");
        let line = |form| logged(form, at, ("warn", "warning", ""), "a \"name\"");
        assert_eq!(line(Form::Timed), "2026-05-04T12:30:15.250Z warning: a \"name\"");
        assert_eq!(line(Form::Plain), "warning: a \"name\"");
        let json = |line: &str| serde_json::from_str::<serde_json::Value>(line).expect("JSON");
        let expected = json!({
            "time": "2026-05-04T12:30:15.250Z", "level": "warn", "kind": "warning", "message": "a \"name\"",
        });
        assert_eq!(json(&line(Form::Json)), expected);

        let text = "[WARN  ecmsk::link] late ] again\n";
        assert_eq!(record(Form::Timed, at, text), "2026-05-04T12:30:15.250Z [WARN  ecmsk::link] late ] again");
        let shown = json(&record(Form::Json, at, text));
        assert_eq!((&shown["level"], &shown["target"]), (&"warn".into(), &"ecmsk::link".into()));
        assert_eq!((&shown["kind"], &shown["message"]), (&"log".into(), &"late ] again".into()));
    }
}
