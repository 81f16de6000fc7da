//! A question at a terminal, which Ctrl-C ends. Meanwhile reports of the board are read, so that nothing piles up and a
//! board that is lost is noticed.

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
    /// Whether somebody can be asked: there is a terminal that shows the question and takes the answer, and the board's time is
    /// real.
    pub fn can_ask(&self) -> bool {
        !self.link.info().virtual_time && io::stdin().is_terminal() && io::stderr().is_terminal()
    }

    /// Asks, and waits for the line that answers. Anything but `y` and `yes` is a no, and so is the end of the input.
    ///
    /// # Errors
    /// [`BoardError::Stopped`], and those of reading reports.
    pub fn ask(&self, question: &str) -> Result<bool, BoardError> {
        self.reporter.clear();
        // Behind what was told before.
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
