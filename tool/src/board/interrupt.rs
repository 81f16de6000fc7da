//! Ctrl-C: the first one asks for an orderly end, the second one ends the program at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::signals;

/// What signals have come. Made once in a program.
#[derive(Debug, Default)]
pub struct Interrupt {
    signal: Arc<AtomicUsize>,
    /// Whether the next one ends the program.
    armed: Arc<AtomicBool>,
}

impl Interrupt {
    /// Looks out from now on: for SIGINT, SIGTERM and SIGHUP, on Windows for what the console sends.
    ///
    /// # Errors
    /// What the system says.
    pub fn watch() -> std::io::Result<Self> {
        let interrupt = Self::default();
        signals::note_once(&interrupt.signal, &interrupt.armed)?;
        Ok(interrupt)
    }

    /// The signal that asks for the end.
    pub fn signal(&self) -> Option<u8> {
        match self.signal.load(Ordering::SeqCst) {
            0 => None,
            signal => Some(signal as u8),
        }
    }

    /// It was dealt with, as in the shell, where the next step begins with none.
    pub fn clear(&self) {
        self.armed.store(false, Ordering::SeqCst);
        self.signal.store(0, Ordering::SeqCst);
    }
}
