//! Reads a line that is typed at the console.

use std::io;
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;

/// Reads one line from the console in a separate thread, which sends the line to this value.
pub struct TypedLine(Receiver<String>);

impl TypedLine {
    pub fn start() -> Self {
        let (sender, typed) = mpsc::channel();
        thread::spawn(move || {
            let mut line = String::new();
            // An error of reading the console is ignored: the empty line then means the end of the input.
            let _ = io::stdin().read_line(&mut line);
            let _ = sender.send(line);
        });
        Self(typed)
    }

    /// The line, once it was typed; empty at the end of the input.
    pub fn take(&mut self) -> Option<String> {
        match self.0.try_recv() {
            Ok(line) => Some(line),
            Err(TryRecvError::Disconnected) => Some(String::new()),
            Err(TryRecvError::Empty) => None,
        }
    }
}
