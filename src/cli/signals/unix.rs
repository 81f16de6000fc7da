//! Signals.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::Signals;

/// Those that ask for the end.
const ALL: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];

/// The number of what comes is in `signal` from now on.
///
/// # Errors
/// What the system says.
pub fn note(signal: &Arc<AtomicUsize>) -> io::Result<()> {
    for number in ALL {
        flag::register_usize(number, Arc::clone(signal), number as usize)?;
    }
    Ok(())
}

/// As [`note`], and what comes while `armed` is set ends the program at once. What comes sets it.
///
/// # Errors
/// What the system says.
pub fn note_once(signal: &Arc<AtomicUsize>, armed: &Arc<AtomicBool>) -> io::Result<()> {
    for number in ALL {
        // In this order: the flag that ends the program is not set yet when the first one comes.
        flag::register_conditional_shutdown(number, 128 + number, Arc::clone(armed))?;
        flag::register_usize(number, Arc::clone(signal), number as usize)?;
        flag::register(number, Arc::clone(armed))?;
    }
    Ok(())
}

/// What has asked for the end, for who has nothing to do but to wait for it.
pub struct Asked(Signals);

impl Asked {
    /// Looks out for SIGINT and SIGTERM from now on.
    ///
    /// # Errors
    /// What the system says.
    pub fn watch() -> io::Result<Self> {
        Signals::new([SIGINT, SIGTERM]).map(Self)
    }

    /// Waits for the first one, and gives its name.
    pub fn wait(mut self) -> &'static str {
        if self.0.forever().next() == Some(SIGTERM) { "SIGTERM" } else { "SIGINT" }
    }
}

/// What people call it.
pub fn name(signal: u8) -> String {
    match signal {
        1 => "SIGHUP".into(),
        2 => "Ctrl-C".into(),
        15 => "SIGTERM".into(),
        other => format!("signal {other}"),
    }
}
