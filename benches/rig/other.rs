//! Another process of this program, which is a board.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};

/// It runs until it is dropped.
pub struct Other {
    child: Child,
    said: BufReader<ChildStdout>,
}

impl Other {
    /// Starts it and waits until it says that it is there.
    pub fn start(words: &[&str]) -> Self {
        let program = std::env::current_exe().expect("it is known");
        let mut child = Command::new(program).args(words).stdout(Stdio::piped()).spawn().expect("it starts");
        let said = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut other = Self { child, said };
        assert_eq!(other.line(), READY, "{words:?}");
        other
    }

    /// The next line it says.
    pub fn line(&mut self) -> String {
        let mut line = String::new();
        self.said.read_line(&mut line).expect("it says something");
        line.trim_end().to_owned()
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        // It may have ended by itself, which its silence has shown.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What it says when it is there.
pub const READY: &str = "ready";
