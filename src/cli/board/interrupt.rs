//! Ctrl-C: the first one asks for an orderly end, the second one ends the program at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// What signals have come. Made once in a program.
#[derive(Debug, Default)]
pub struct Interrupt {
    signal: Arc<AtomicUsize>,
    /// Whether the next one ends the program.
    armed: Arc<AtomicBool>,
}

impl Interrupt {
    /// Looks out for SIGINT, SIGTERM and SIGHUP from now on.
    ///
    /// # Errors
    /// What the system says.
    #[cfg(unix)]
    pub fn watch() -> std::io::Result<Self> {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        use signal_hook::flag;

        let interrupt = Self::default();
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // In this order: the flag that ends the program is not set yet when the first one comes.
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&interrupt.armed))?;
            flag::register_usize(signal, Arc::clone(&interrupt.signal), signal as usize)?;
            flag::register(signal, Arc::clone(&interrupt.armed))?;
        }
        Ok(interrupt)
    }

    #[cfg(not(unix))]
    pub fn watch() -> std::io::Result<Self> {
        Ok(Self::default())
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
