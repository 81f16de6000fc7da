//! What the tests of the tool share: running it, and recordings to run it on.
#![allow(dead_code, reason = "each test uses a part of it")]

pub mod motion;
pub mod plots;
pub mod recordings;
pub mod svg;

use std::ffi::OsStr;
use std::io::Write;
use std::process::{Command, Output, Stdio};

/// The tool, in an environment that names no link and no library.
pub fn ecmsk(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecmsk"));
    command.args(arguments).stdin(Stdio::null());
    for variable in ["ECMSK_LINK", "ECMSK_LOG", "LD_LIBRARY_PATH", "CLICOLOR_FORCE"] {
        command.env_remove(variable);
    }
    command
}

/// How a run of the tool ended.
#[derive(Debug)]
pub struct Ran {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("output is UTF-8");
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }
}

impl Ran {
    /// It did what it was asked and had nothing to say about it; gives its output.
    #[track_caller]
    pub fn quiet(self) -> String {
        assert_eq!((self.code, self.err.as_str()), (Some(0), ""), "{}", self.out);
        self.out
    }

    /// It failed with this code and one line that has these words, and ends with this next step.
    #[track_caller]
    pub fn failed(&self, code: i32, words: &[&str], next_step: &str) {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert!(self.err.starts_with("error: ") && self.err.lines().count() == 1, "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "`{word}` is missing in: {}", self.err);
        }
        let last = self.err.trim_end().rsplit("; ").next().unwrap_or_default();
        assert!(last.contains(next_step), "the next step is `{last}`, not `{next_step}`");
    }

    /// The command line was wrong: these words are said of it, and where to read more.
    #[track_caller]
    pub fn misused(&self, words: &[&str]) {
        assert_eq!(self.code, Some(2), "{self:?}");
        assert!(self.err.starts_with("error: ") && self.out.is_empty(), "{self:?}");
        for word in words {
            assert!(self.err.contains(word), "`{word}` is missing in: {}", self.err);
        }
        assert!(self.err.contains("--help") || self.err.contains("ecmsk link help"), "{}", self.err);
    }
}

/// Runs the tool to its end.
pub fn run(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Ran {
    ecmsk(arguments).output().expect("the tool starts").into()
}

/// Runs the tool with this on standard input.
pub fn run_with_input(arguments: &[&str], input: impl AsRef<[u8]>) -> Ran {
    let mut command = ecmsk(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut tool = command.spawn().expect("the tool starts");
    let mut stdin = tool.stdin.take().expect("a pipe");
    let input = input.as_ref().to_owned();
    let writer = std::thread::spawn(move || {
        // A tool that has found an error reads no further.
        let _ = stdin.write_all(&input);
    });
    let output = tool.wait_with_output().expect("the tool ends");
    writer.join().expect("the writer ends");
    output.into()
}
