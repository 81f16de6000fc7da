//! Signals such as Ctrl-C: the first one ends the verb in an orderly way, a second one ends the program at once. A
//! second SIGHUP does not end it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::error::BoardError;
use crate::{signals, streams};

/// Holds the number of the signal that has arrived (0: none), which the signal handlers store here. A process may have
/// only one such value.
#[derive(Default)]
pub struct Interrupt {
    signal: Arc<AtomicUsize>,
    /// Whether a further signal ends the program at once.
    armed: Arc<AtomicBool>,
    /// A further reason to end the verb, asked for at each check.
    also: Option<Box<dyn Fn() -> bool>>,
}

impl Interrupt {
    /// Starts to catch signals: SIGINT, SIGTERM, SIGHUP and SIGQUIT; on Windows the console events.
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

    /// Ends long calls as soon as `is_asked` returns true, as a signal does; no signals are caught.
    #[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page uses it"))]
    pub fn when(is_asked: impl Fn() -> bool + 'static) -> Self {
        Self { also: Some(Box::new(is_asked)), ..Self::default() }
    }

    /// The signal that has arrived; `None` if there was none.
    pub fn signal(&self) -> Option<u8> {
        match self.signal.load(Ordering::SeqCst) {
            0 => self.also.as_ref().filter(|is_asked| is_asked()).map(|_| signals::HANG_UP as u8),
            signal => Some(signal as u8),
        }
    }

    /// Forgets the signal, so that the next step of the shell can run.
    pub fn clear(&self) {
        self.armed.store(false, Ordering::SeqCst);
        self.signal.store(0, Ordering::SeqCst);
    }
}
