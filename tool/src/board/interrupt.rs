//! Signals such as Ctrl-C: the first one ends the verb in an orderly way, the second one ends the program at once, but for a
//! second SIGHUP.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::error::BoardError;
use crate::{signals, streams};

/// Holds the number of the signal that has arrived (0: none), which the signal handlers store. A process watches for signals in
/// one such value only.
#[derive(Debug, Default)]
pub struct Interrupt {
    signal: Arc<AtomicUsize>,
    /// Whether the next signal ends the program at once.
    armed: Arc<AtomicBool>,
}

impl Interrupt {
    /// Watches for signals from now on: SIGINT, SIGTERM, SIGHUP and SIGQUIT, on Windows the events of the console.
    ///
    /// # Errors
    /// [`BoardError::System`] if the operating system refuses to install the signal handlers.
    pub fn watch() -> Result<Self, BoardError> {
        let interrupt = Self::default();
        let noted = signals::note_once(&interrupt.signal, &interrupt.armed);
        noted.map_err(BoardError::system("catch signals"))?;
        streams::end_waits_on(&interrupt.signal);
        Ok(interrupt)
    }

    /// The signal that has arrived; `None` if there was none.
    pub fn signal(&self) -> Option<u8> {
        match self.signal.load(Ordering::SeqCst) {
            0 => None,
            signal => Some(signal as u8),
        }
    }

    /// Forgets the signal, as the shell does before the next step.
    pub fn clear(&self) {
        self.armed.store(false, Ordering::SeqCst);
        self.signal.store(0, Ordering::SeqCst);
    }
}
