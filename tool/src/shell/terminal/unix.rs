//! The terminal's modes.

use std::io::{self, Write};

use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// How it was.
pub struct Terminal(Option<Termios>);

impl Terminal {
    /// How it is, if there is one.
    pub fn now() -> Self {
        Self(tcgetattr(io::stdin()).ok())
    }

    /// Makes it so again.
    pub fn restore(&self) {
        if let Some(was) = &self.0 {
            let _ = tcsetattr(io::stdin(), OptionalActions::Now, was);
            // Bracketed paste off, and on to a line of its own.
            let _ = io::stdout().write_all(b"\x1b[?2004l\r\n");
            let _ = io::stdout().flush();
        }
    }
}
