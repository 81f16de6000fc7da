//! Code that the tests of the tool share: running it, and recordings to run it on.
//!
//! Files:
//!
//! - `mod.rs`: running the tool and checking its output
//! - `board.rs`: transcripts of verbs, and reading a recording of a run
//! - `exec.rs`: a program and a library for `ecmsk exec`
//! - `machine.rs`: a machine made of files, for `list` and `doctor`
//! - `motion.rs`, `recordings.rs`: a board in motion without the model, and recordings of its frames
//! - `page.rs`: the page, its server, and a browser
//! - `serving.rs`: a running server
//! - `plots.rs`, `svg.rs`: plots of recordings, and reading them back
//! - `tshark.rs`: what tshark shows with the plugin of `ecmsk wireshark`, compared with `ecmsk dump`

pub mod board;
#[cfg(unix)]
pub mod exec;
#[cfg(target_os = "linux")]
pub mod machine;
pub mod motion;
#[cfg(all(unix, feature = "web"))]
pub mod page;
pub mod plots;
pub mod recordings;
#[cfg(unix)]
pub mod serving;
pub mod svg;
pub mod tshark;

use std::ffi::OsStr;
use std::io::Write;
use std::process::{Command, Output, Stdio};

/// A command that runs the tool, in an environment that names no link and no library.
pub fn ecmsk(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecmsk"));
    command.args(arguments).stdin(Stdio::null());
    for variable in ["ECMSK_LINK", "ECMSK_LOG", "JOURNAL_STREAM", "LD_LIBRARY_PATH", "CLICOLOR_FORCE"] {
        command.env_remove(variable);
    }
    command
}

/// The lines of a server's log without their times.
#[track_caller]
pub fn without_times(said: &str) -> String {
    let line = |line: &str| {
        let (time, rest) = line.split_once(' ').expect(line);
        assert!(
            time.len() == "2026-05-04T12:30:15.250Z".len() && time.ends_with('Z') && time.starts_with("20"),
            "{line}"
        );
        format!("{rest}\n")
    };
    said.lines().map(line).collect()
}

/// The command with the default actions of signals, as a shell at a terminal starts it. The tests themselves may run with some
/// signals ignored (`nohup`).
pub fn with_default_signals(inner: &Command) -> Command {
    let mut command = Command::new("env");
    command.arg("--default-signal=HUP,INT,QUIT,TERM").arg(inner.get_program()).args(inner.get_args());
    for (name, value) in inner.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command.stdin(Stdio::null());
    command
}

/// The exit code and output of a finished run of the tool.
#[derive(Debug)]
pub struct Ran {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

/// The lines of an output, each a JSON object.
#[track_caller]
pub fn json_lines(out: &str) -> Vec<serde_json::Value> {
    out.lines().map(|line| serde_json::from_str(line).expect("a line is one JSON object")).collect()
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("output is UTF-8");
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }
}

impl Ran {
    /// Standard error without the lines of progress: a late machine has more of them.
    pub fn said(&self) -> String {
        self.err.split_inclusive('\n').filter(|line| !line.starts_with("progress: ")).collect()
    }

    /// Asserts that the run succeeded without anything else than progress on standard error; returns its output.
    #[track_caller]
    pub fn expect_quiet(self) -> String {
        assert_eq!((self.code, &*self.said()), (Some(0), ""), "{}", self.out);
        self.out
    }

    /// Asserts the exit code.
    #[track_caller]
    pub fn expect_code(&self, code: i32) {
        assert_eq!(self.code, Some(code), "{self:?}");
    }

    /// The only line of its output, as JSON.
    #[track_caller]
    pub fn json(&self) -> serde_json::Value {
        assert_eq!(self.out.lines().count(), 1, "{}", self.out);
        serde_json::from_str(&self.out).expect("one JSON object")
    }

    /// Asserts that the run failed with this code and one line of error that contains these words and ends with this
    /// next step.
    #[track_caller]
    pub fn expect_failure(&self, code: i32, words: &[&str], next_step: &str) {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert_eq!(self.err.lines().count(), 1, "{}", self.err);
        let error = self.error(code);
        for word in words {
            assert!(error.contains(word), "`{word}` is missing in: {error}");
        }
        let last = error.trim_end().rsplit("; ").next().unwrap_or_default();
        assert!(last.contains(next_step), "the next step is `{last}`, not `{next_step}`");
    }

    /// The text of the error, behind `error: ` or, with `--json`, in an object with the exit code.
    #[track_caller]
    fn error(&self, code: i32) -> String {
        if let Some(error) = self.err.strip_prefix("error: ") {
            return error.to_owned();
        }
        let object: serde_json::Value = serde_json::from_str(&self.err).expect("an error, in words or as JSON");
        assert_eq!(object["exit_code"], code, "{}", self.err);
        object["error"].as_str().expect("words").to_owned()
    }

    /// Asserts that the command line was refused with these words and a hint where to read more.
    #[track_caller]
    pub fn expect_misuse(&self, words: &[&str]) {
        assert_eq!(self.code, Some(2), "{self:?}");
        assert!(self.out.is_empty(), "{self:?}");
        let error = self.error(2);
        for word in words {
            assert!(error.contains(word), "`{word}` is missing in: {error}");
        }
        assert!(self.err.contains("--help") || self.err.contains("ecmsk link help"), "{}", self.err);
    }
}

/// Runs the tool to its end.
pub fn run(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Ran {
    ecmsk(arguments).output().expect("the tool starts").into()
}

/// Runs the tool to its end, with `input` on its standard input.
pub fn run_with_input(arguments: &[&str], input: impl AsRef<[u8]>) -> Ran {
    let mut command = ecmsk(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut tool = command.spawn().expect("the tool starts");
    let mut stdin = tool.stdin.take().expect("a pipe");
    let input = input.as_ref().to_owned();
    let writer = std::thread::spawn(move || {
        // After an error the tool does not read its input to the end.
        let _ = stdin.write_all(&input);
    });
    let output = tool.wait_with_output().expect("the tool ends");
    writer.join().expect("the writer ends");
    output.into()
}
