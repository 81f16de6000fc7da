//! Saves and restores the modes of the terminal.

use std::io::{self, Write};

use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// The saved modes; `None` if standard input is not a terminal.
pub struct Terminal(Option<Termios>);

impl Terminal {
    /// Saves the present modes of the terminal.
    pub fn now() -> Self {
        Self(tcgetattr(io::stdin()).ok())
    }

    /// Restores the saved modes.
    pub fn restore(&self) {
        if let Some(was) = &self.0 {
            let _ = tcsetattr(io::stdin(), OptionalActions::Now, was);
            // Ends bracketed paste mode, which the line editor has switched on, and begins a new line.
            let _ = io::stdout().write_all(b"\x1b[?2004l\r\n");
            let _ = io::stdout().flush();
        }
    }
}
