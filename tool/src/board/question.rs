//! Asks a question at the terminal; Ctrl-C ends the wait. During the wait the board's reports are read, so that they do
//! not fill the queue and the loss of the board is noticed.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

use std::io::{self, IsTerminal};

use super::error::BoardError;
use super::session::Board;
use crate::stderr;
use crate::visible::visible;

#[cfg(unix)]
use unix::TypedLine;
#[cfg(windows)]
use windows::TypedLine;

impl Board {
    /// Whether the user can be asked: standard input and standard error are a terminal, and the board does not run on a
    /// virtual clock.
    pub fn can_ask(&self) -> bool {
        !self.link.info().virtual_time && io::stdin().is_terminal() && io::stderr().is_terminal()
    }

    /// Asks a question and waits for a line. Only `y` and `yes` mean yes; anything else, and the end of the input,
    /// means no.
    ///
    /// # Errors
    /// [`BoardError::Stopped`], and errors of reading reports.
    pub fn ask(&self, question: &str) -> Result<bool, BoardError> {
        self.reporter.clear();
        // `raw` uses the same queue as earlier lines, so the question appears after them.
        stderr::raw(&format!("{} [y/N] ", visible(question)));
        let mut typed = TypedLine::start();
        loop {
            if let Err(stopped) = self.check_stop() {
                stderr::raw("\n");
                return Err(stopped);
            }
            if let Some(line) = typed.take() {
                return Ok(matches!(line.trim().to_ascii_lowercase().as_str(), "y" | "yes"));
            }
            self.ecm.next_cycle(self.options.read_limit)?;
        }
    }
}
