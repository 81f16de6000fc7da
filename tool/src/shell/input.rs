//! Reads the lines of the shell in a separate thread, so that a signal is noticed even while the user types nothing.

use std::io::{self, BufRead};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::history::DefaultHistory;
use rustyline::{Editor, Helper, Highlighter, Hinter, Validator};

use super::complete;
use super::terminal::Terminal;
use crate::board::{Board, BoardError};
use crate::streams;

const PROMPT: &str = "ecmsk> ";
/// \[OURS] The interval at which signals are checked while the shell waits for a line.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// What the thread has read from standard input.
enum Typed {
    Line(String),
    /// Ctrl-C was pressed at the prompt. No step is running that it could end, so a note says how to leave the shell.
    Nothing,
    End,
    Failed(io::Error),
}

/// Reads the lines of the shell, from a terminal or from a pipe.
pub struct Input {
    /// Requests the next line from the reading thread. The thread shows a prompt only after a request, so there is no
    /// prompt while a step runs.
    wanted: Sender<()>,
    typed: Receiver<Typed>,
    terminal: Terminal,
}

impl Input {
    /// Starts the thread that reads standard input. `typed`: whether standard input is a terminal.
    ///
    /// # Errors
    /// [`BoardError::System`] if the operating system cannot start a thread.
    pub fn start(typed: bool) -> Result<Self, BoardError> {
        let terminal = Terminal::now();
        let (wanted, asked) = mpsc::channel();
        let (sender, lines) = mpsc::channel();
        let read = move || {
            let mut next: Box<dyn FnMut() -> Typed> = match typed.then(terminal_lines) {
                Some(Ok(next)) => Box::new(next),
                Some(Err(error)) => {
                    let _ = sender.send(Typed::Failed(io::Error::other(error)));
                    return;
                }
                None => Box::new(piped_lines()),
            };
            while asked.recv().is_ok() && sender.send(next()).is_ok() {}
        };
        thread::Builder::new().name("lines".into()).spawn(read).map_err(BoardError::system("start a thread"))?;
        Ok(Self { wanted, typed: lines, terminal })
    }

    /// Requests a line. The prompt appears after all earlier output.
    fn ask(&self) {
        streams::flush_error();
        // Sending fails only if the thread has ended. Its last message says why.
        let _ = self.wanted.send(());
    }

    /// Waits for the next line; `None` at the end of the input.
    ///
    /// # Errors
    /// [`BoardError::Stopped`] if a signal arrives, [`BoardError::Input`] if standard input cannot be read.
    pub fn next(&self, board: &Board) -> Result<Option<String>, BoardError> {
        self.ask();
        loop {
            if let Err(stopped) = board.check_stop() {
                self.terminal.restore();
                return Err(stopped);
            }
            match self.typed.recv_timeout(POLL_INTERVAL) {
                Ok(Typed::Line(line)) => return Ok(Some(line)),
                Ok(Typed::End) | Err(RecvTimeoutError::Disconnected) => return Ok(None),
                Ok(Typed::Failed(error)) => return Err(BoardError::Input(error)),
                Ok(Typed::Nothing) => {
                    board.reporter.note("nothing runs; type quit to leave");
                    self.ask();
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }
}

fn terminal_lines() -> rustyline::Result<impl FnMut() -> Typed> {
    let mut editor: Editor<Words, DefaultHistory> = Editor::new()?;
    editor.set_helper(Some(Words));
    Ok(move || match editor.readline(PROMPT) {
        Ok(line) => {
            // This can fail only with a history file, and none is used.
            let _ = editor.add_history_entry(&line);
            Typed::Line(line)
        }
        Err(ReadlineError::Interrupted) => Typed::Nothing,
        Err(ReadlineError::Eof) => Typed::End,
        Err(error) => Typed::Failed(io::Error::other(error)),
    })
}

fn piped_lines() -> impl FnMut() -> Typed {
    let mut lines = io::stdin().lock().lines();
    move || match lines.next() {
        Some(Ok(line)) => Typed::Line(line),
        Some(Err(error)) => Typed::Failed(error),
        None => Typed::End,
    }
}

/// Completes verbs and options in the line editor.
#[derive(Helper, Highlighter, Hinter, Validator)]
struct Words;

impl Completer for Words {
    type Candidate = String;

    fn complete(
        &self,
        line: &str,
        at: usize,
        _: &rustyline::Context<'_>,
    ) -> rustyline::Result<(usize, Vec<Self::Candidate>)> {
        Ok(complete(line.get(..at).unwrap_or_default()))
    }
}
