//! A running `ecmsk serve`.

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use super::ecmsk;

/// A running `ecmsk serve`; dropping the value kills it.
pub struct Serving {
    pub child: Child,
    out: BufReader<ChildStdout>,
    said: Option<BufReader<ChildStderr>>,
    /// The first line of the server's output, without `listening on `.
    pub first_line: String,
}

impl Serving {
    /// Starts a server at any free port.
    #[track_caller]
    pub fn start(port: &str, arguments: &[&str]) -> Self {
        let mut command = ecmsk([&["serve", port, "--listen", "127.0.0.1:0"], arguments].concat());
        command.env_remove("ECMSK_TCP_SECRET");
        Self::by(command)
    }

    /// Starts a server of this board at the address of another server, which has ended.
    #[track_caller]
    pub fn start_again(link: &str, board: &str) -> Self {
        let mut command = ecmsk(["serve", "tcp", "--link", board, "--listen"]);
        command.arg(link.strip_prefix("tcp://").expect("an address")).env_remove("ECMSK_TCP_SECRET");
        Self::by(command)
    }

    /// Starts a server by its command.
    #[track_caller]
    pub fn by(mut command: Command) -> Self {
        Self::of(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts"))
    }

    /// A server that was started, with its output in a pipe: waits until it says where it listens.
    #[track_caller]
    pub fn of(child: Child) -> Self {
        Self::try_of(child).unwrap_or_else(|said| panic!("{said}"))
    }

    /// As [`Self::of`], for a server that may not start. Returns its output if it does not.
    pub fn try_of(mut child: Child) -> Result<Self, String> {
        let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut said = child.stderr.take().map(BufReader::new);
        let mut line = String::new();
        out.read_line(&mut line).expect("it says where it listens");
        let Some(first_line) = line.strip_prefix("listening on ").map(str::to_owned) else {
            said.iter_mut().for_each(|said| drop(said.read_to_string(&mut line)));
            child.wait().expect("it ends");
            return Err(line);
        };
        Ok(Self { child, out, said, first_line })
    }

    /// The next line of the server's output.
    pub fn next_line(&mut self) -> String {
        let mut line = String::new();
        self.out.read_line(&mut line).expect("text");
        line
    }

    /// The address of the page, or that of the served board.
    pub fn address(&self) -> &str {
        self.first_line.split([',', ';', ' ', '\n']).next().expect("an address")
    }

    /// The link to the served board.
    pub fn link(&self) -> String {
        format!("tcp://{}", self.address())
    }

    /// Reads standard error until a line has these words; returns the line.
    #[track_caller]
    pub fn wait_for(&mut self, words: &str) -> String {
        let said = self.said.as_mut().expect("a pipe");
        loop {
            let mut line = String::new();
            assert!(said.read_line(&mut line).expect("text") > 0, "no line with `{words}`");
            if line.contains(words) {
                return line;
            }
        }
    }

    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).expect("it runs");
    }

    /// Waits for the end of a server that has got a signal. Returns its standard error, as far as it was not read.
    #[track_caller]
    pub fn ended(mut self) -> String {
        let mut said = String::new();
        self.said.take().expect("a pipe").read_to_string(&mut said).expect("text");
        assert_eq!(self.child.wait().expect("it ends").code(), Some(0), "{said}");
        said
    }

    /// Ends the server by a signal; returns its standard error.
    #[track_caller]
    pub fn end_by(self, signal: Signal) -> String {
        self.signal(signal);
        self.ended()
    }

    /// Ends the server by SIGTERM; returns its standard error.
    #[track_caller]
    pub fn end(self) -> String {
        self.end_by(Signal::TERM)
    }
}

impl Drop for Serving {
    /// Ends the server if the test has not.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
